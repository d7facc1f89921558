"""Drift of a final state when its simulation continues, and its depth against the depth expected from the weight.

In: scene and object, masses and materials, the bodies of the simulation and the final state. Out: `Drift`;
`Indentation`, without numbers for a rigid support or an object as soft as the support.

The reference of the depth is not a drop but the contact of elastic layered half-spaces across the true gap between both
surfaces, frictionless and quasi-static (docs/metrics.md states its error). The object is lifted over the undeformed
support, so the reference does not depend on the method's depth.
"""

import numpy as np
from pydantic import BaseModel, NonNegativeInt, PositiveFloat, PositiveInt

from dcap.evaluation.metrics.touching import columns
from dcap.geometry.raycast import Raycaster
from dcap.scene.types.choices import Anchor, Intent
from dcap.scene.types.materials import PartMaterials
from dcap.scene.types.measures import Drift, Indentation
from dcap.scene.types.particles import GRAVITY, Particles
from dcap.scene.types.segmentation import SegmentedObject, SegmentedScene
from dcap.scene.types.settled import Settled
from solver.config import SolverConfig
from solver.errors import ModelError, UnstableStep
from tasks.bodies.footprint import heights_over
from tasks.bodies.plan_contact import plan_contact
from tasks.bodies.solver_model import solver_model
from tasks.cache import stage
from tasks.particles.contact_layers import RIGID, compliance_of, layers_of

DEFORMED = 1e-4
"""Largest distance of a surface from its rigid motion at which it counts as undeformed [m]."""
LIFTED = 0.01
"""Height to which the object is lifted over the support before it is pressed onto it [m]; results do not depend on
it."""
STIFF = 0.1
"""Largest compliance of the object over that of the support for which the object stays undeformed [-]."""


class DriftConfig(BaseModel, frozen=True, extra="forbid"):
    """Length and cost of the continued simulation."""

    solver: SolverConfig = SolverConfig(longest_step=0.6, newton_tolerance=3e-3)
    """Steps twice as long as a drop's, short enough to detect a loss of balance, and the tolerance of a certificate:
    the drift in question is millimetres."""
    seconds: PositiveFloat = 1.0
    """Simulated time [s]."""
    most_steps: PositiveInt = 60
    """Most steps; a rest state takes about 25."""
    most_work: PositiveFloat = 3e6
    """Most material points times Newton iterations."""
    threads: NonNegativeInt = 0
    """Worker threads, 0: all cores; never changes a result."""


def drift(particles: Particles, settled: Settled, config: DriftConfig) -> Drift:
    """Continue the simulation of a final state with the materials, friction and neighbours of the drop."""
    from solver.onward import PlacedBodies, onward  # loads Taichi, which costs seconds

    if not settled.nodes and (shapes := [one.name for one in settled.bodies if not one.is_rigid(DEFORMED)]):
        return unknown(
            f"the method keeps no displacements inside {', '.join(shapes)}, so there is no dent to continue from"
        )
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


drift_task = stage(drift, process=True, simulates=True)


def indentation(
    scene: SegmentedScene,
    item: SegmentedObject,
    intent: Intent,
    anchor: Anchor,
    materials: PartMaterials,
    particles: Particles,
    settled: Settled,
) -> Indentation:
    """Compare depths on the base, whose layers are known; the object keeps its undeformed shape, moved rigidly."""
    index = scene.index_of(anchor.base_id)
    rows = materials.of_parts(anchor.base_id, len(scene.instances[index].parts))
    layers = layers_of(particles.column, rows)
    softest = max(compliance_of(row) for row in materials.of_parts("object", len(item.instances[0].parts)))
    if not layers:
        return Indentation(reason="the support is rigid")
    if softest > STIFF * max(compliance for _, compliance in layers):
        return Indentation(reason="the object gives way as well")
    thing = item.mesh.transformed(settled.bodies[0].world_from_start @ anchor.world_from_object)
    base = scene.mesh.submesh(np.flatnonzero(scene.face_instance == index))
    lines = columns(thing, Raycaster(base))
    if lines.nearest < 0:
        return Indentation(reason="the object is not over its base")
    depth = max(-float(lines.gap.min()), 0.0)
    lift = np.eye(4)
    lift[2, 3] = depth + LIFTED
    over = thing.transformed(lift)
    stacks = ([(float(np.ptp(thing.bounds[:, 2])), softest)], [*layers, RIGID])
    found = plan_contact(heights_over(over, Raycaster(base)), over.bounds[:, :2], intent.mass * GRAVITY, stacks)
    if found is None:
        return Indentation(reason="the object is not over its base")
    return Indentation(depth, found.patch.approach)


indentation_task = stage(indentation)
