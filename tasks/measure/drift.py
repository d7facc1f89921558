"""Drift of the object when the simulation of the final state is continued.

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
"""Largest distance of a surface from its rigid motion at which it counts as undeformed [m]."""


class DriftConfig(BaseModel, frozen=True, extra="forbid"):
    """Length and cost of the continued simulation."""

    solver: SolverConfig = SolverConfig(longest_step=0.6, newton_tolerance=3e-3)
    """Steps twice as long as a drop's, short enough to detect a loss of balance, and the tolerance of a certificate:
    the drift in question is millimetres."""
    seconds: PositiveFloat = 1.0
    """Simulated time [s]."""
    most_steps: PositiveInt = 60
    """Most steps: a rest state takes about 25 for a second, a fall more."""
    most_work: PositiveFloat = 3e6
    """Most material points times Newton iterations: four to six seconds of one core."""
    threads: NonNegativeInt = 0
    """Worker threads, 0: all cores; never changes a result."""


def drift(particles: Particles, settled: Settled, config: DriftConfig) -> Drift:
    """Continue the simulation of a final state, with the material, friction and neighbours of the drop."""
    from solver.onward import PlacedBodies, onward  # loads Taichi, which costs seconds

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
    """Drift of a state that cannot be simulated."""
    return Drift(0.0, 0, np.inf, np.inf, np.inf, why, broken=broken)


def gave_way(body: SettledBody) -> bool:
    """Whether a body has deformed since the start."""
    pose, start = body.world_from_start, body.surface.vertices - body.displacement
    moved = start @ pose[:3, :3].T + pose[:3, 3]
    return bool(np.abs(moved - body.surface.vertices).max(initial=0.0) > DEFORMED)


drift_task = stage(drift, process=True, simulates=True)
