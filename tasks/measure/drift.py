"""How far the object goes when the final state is simulated on.

In: the bodies of the simulation and the final state. Out: `Drift`.
"""

import numpy as np
from pydantic import BaseModel, NonNegativeInt, PositiveFloat, PositiveInt

from dcap.scene.types.gravity import GRAVITY
from dcap.scene.types.measures import Drift
from dcap.scene.types.particles import Particles
from dcap.scene.types.settled import Settled, SettledBody
from solver.config import SolverConfig
from solver.errors import ModelError, UnstableStep
from tasks.bodies.solver_model import solver_model
from tasks.cache import stage

DEFORMED = 1e-4
"""A surface that is farther from where a rigid motion puts it has given way [m]."""


class DriftConfig(BaseModel, frozen=True, extra="forbid"):
    """How long is looked."""

    solver: SolverConfig = SolverConfig(longest_step=0.6, newton_tolerance=3e-3)
    """Twice as long steps as a drop's, which look at a loss of balance closely enough to see it, and balance to what a
    certificate allows: what is to be seen is millimetres."""
    seconds: PositiveFloat = 1.0
    """True time that is simulated [s]."""
    most_steps: PositiveInt = 60
    """Steps at most: a rest state takes about 25 for a second, what falls more."""
    most_work: PositiveFloat = 3e6
    """Material points times Newton iterations at most: four to six seconds of one core."""
    threads: NonNegativeInt = 0
    """Worker threads, 0: all cores; never changes a result."""


def drift(particles: Particles, settled: Settled, config: DriftConfig) -> Drift:
    """Simulate a final state on, with the material, friction and neighbours of the drop."""
    from solver.onward import PlacedBodies, onward  # loads Taichi, seconds for whoever does not simulate

    if not settled.nodes and (shapes := [one.name for one in settled.bodies if gave_way(one)]):
        return unknown(f"the method keeps no displacements inside of {', '.join(shapes)}, so no dent to go on from")
    model = solver_model(particles, (0.0, 0.0, -GRAVITY))
    solver = config.solver.model_copy(update={"threads": config.threads})
    rest = {one.name: one.world_from_start for one in settled.bodies}
    grids = zip(settled.bodies, settled.nodes, strict=True) if settled.nodes else ()
    placed = PlacedBodies(
        {name: pose[:3, :3] for name, pose in rest.items()},
        {name: pose[:3, 3] for name, pose in rest.items()},
        {body.name: moved for body, moved in grids if moved is not None},
    )
    try:
        found = onward(model, solver, placed, config.seconds, config.most_steps, config.most_work)
    except (ModelError, UnstableStep) as error:
        return unknown(" ".join(str(error).split()), broken=isinstance(error, UnstableStep))
    return Drift(found.seconds, found.steps, found.distance, found.angle, found.force_residual)


def unknown(why: str, *, broken: bool = False) -> Drift:
    """Of a state that cannot be simulated on."""
    return Drift(0.0, 0, np.inf, np.inf, np.inf, why, broken=broken)


def gave_way(body: SettledBody) -> bool:
    """Whether a body has another shape than it began with."""
    pose, start = body.world_from_start, body.surface.vertices - body.displacement
    moved = start @ pose[:3, :3].T + pose[:3, 3]
    return bool(np.abs(moved - body.surface.vertices).max(initial=0.0) > DEFORMED)


drift_task = stage(drift, process=True, simulates=True)
