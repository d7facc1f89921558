"""The reference drops and their criteria of rest; needs only numpy, so that it runs in a peer's environment."""

import json
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass

SLAB = (0.40, 0.40, 0.15)
"""Size of the slab, bottom bonded, weightless [m]."""
DENSITY = 200.0
"""Density of the slab [kg/m^3]: affects its motion, not its rest state."""
POISSON = 0.3
"""Poisson's ratio of the slab [-]."""
RADIUS = 0.05
"""Radius of the ball [m]."""
MASS = 1.0
"""Mass of the ball [kg]."""
GRAVITY = 9.81
"""Gravity, on the ball only [m/s^2]."""
START = 0.01
"""Height of the ball above the slab at the start [m]."""
FRICTION = 0.5
"""Friction between ball and slab [-]; the depth hardly depends on it (0.02 %)."""
DEPTH = {2e4: 12.166e-3, 5e5: 1.488e-3}
"""Depth of the ball at rest [m] by Young's modulus [Pa]: static finite elements (hex27)."""

REST_SPEED = 6.5e-4
"""Upper bound of the speed of ball and particles at rest [m/s]: 5e-4 sqrt(g L), as in solver/config.py."""
REST_DRIFT = 1.7e-5
"""Upper bound of the variation of the ball's height at rest [m]: 1e-4 L, as there."""
REST_SECONDS = 0.1
"""Time for which both must hold [s]: more than half a swing of the ball on the softer slab (0.18 s)."""
LOOK_SECONDS = 0.01
"""Interval between tests of rest [s], at which reading speeds back costs little."""
LONGEST = 3.0
"""Longest simulated time of a drop [s]."""
BALL_DENSITY = MASS / (4 / 3 * 3.141592653589793 * RADIUS**3)
"""Density of the ball [kg/m^3]."""


@dataclass(frozen=True, kw_only=True)
class Fall:
    """End of a followed drop."""

    depth: float
    """Undeformed top minus lowest point of the ball at the end [m]."""
    speed: float
    """Largest speed of ball and particles at the end [m/s]."""
    at_rest: bool
    simulated: float
    """Simulated time, including the REST_SECONDS that show rest [s]."""
    wall: float
    """Wall time of the steps [s]."""
    cpu: float
    """Processor time of the steps, all threads [s]: what counts on a machine that others use too."""


@dataclass(frozen=True, kw_only=True)
class PeerDrop(Fall):
    """Result of one drop; times are of the steps alone, without building and compiling."""

    versions: str
    device: str
    elements: str
    """Size of the discretisation, in words."""
    cell: float
    """Smallest cell or node distance [m]."""
    step: float
    """Time step [s]."""
    prepare: float
    """Building, compiling and first steps [s]; not part of wall."""


def follow(advance: Callable[[], float], look: Callable[[], tuple[float, float]], limit: float) -> Fall:
    """Advance by about LOOK_SECONDS at a time until rest, LONGEST or `limit` [s] of wall time.

    `advance` returns the seconds simulated; `look` the height of the ball's centre [m] and the largest speed [m/s].
    """
    simulated = moving = 0.0
    window = round(REST_SECONDS / LOOK_SECONDS)
    heights: list[float] = []
    begin, begin_cpu = time.perf_counter(), time.process_time()
    while True:
        simulated += advance()
        height, speed = look()
        wall, cpu = time.perf_counter() - begin, time.process_time() - begin_cpu
        depth = SLAB[2] - (height - RADIUS)
        if not speed <= REST_SPEED:  # also where it is not a number
            moving = simulated
        heights = [*heights[-window:], height]
        at_rest = simulated - moving >= REST_SECONDS and max(heights) - min(heights) <= REST_DRIFT
        sys.stderr.write(f"t = {simulated:.3f} s  depth {1e3 * depth:.3f} mm  speed {speed:.1e} m/s  {wall:.0f} s\n")
        if at_rest or simulated >= LONGEST or wall >= limit or speed != speed:
            return Fall(depth=depth, speed=speed, at_rest=at_rest, simulated=simulated, wall=wall, cpu=cpu)


def report(outcome: PeerDrop) -> None:
    """One JSON line, the last on standard output: simulators print there too."""
    sys.stdout.write("\n" + json.dumps(asdict(outcome)) + "\n")
