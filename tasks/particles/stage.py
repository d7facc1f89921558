"""Stage 7, particles: from meshes, a pose and materials to everything the drop simulates.

In: the segmented scene and object, the intent (mass), the pre-drop pose and the material of every part. Out:
`Particles`: the object, the base within a crop around it (its soft parts one bonded body, its rigid parts another)
and the neighbours in reach as obstacles. Every crop, cap and treatment is named in the notes.
"""

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.distance import sampler
from dcap.scene.errors import GeometryError
from dcap.scene.types.anchor import Anchor
from dcap.scene.types.caution import Cause, Caution, about
from dcap.scene.types.earlier import FreedThings
from dcap.scene.types.intent import Intent
from dcap.scene.types.materials import PartMaterials
from dcap.scene.types.outcome import Infeasible, Reason
from dcap.scene.types.particles import Particles, SimulationBody, SoftSimulationBody
from dcap.scene.types.segmentation import SegmentedObject, SegmentedScene
from dcap.scene.types.settled import EndPose
from tasks.bodies.footprint import Footprint
from tasks.bodies.object_shape import OpenShape, object_shape, refused
from tasks.cache import stage
from tasks.particles.base_bodies import BaseBodies, base_bodies
from tasks.particles.config import ParticlesConfig
from tasks.particles.drop_setup import DropSetup, drop_setup
from tasks.particles.object_body import object_body
from tasks.particles.obstacles import neighbours
from tasks.particles.several import free_things, ground_setup, own_footprint, thing_bodies


def particles(
    scene: SegmentedScene,
    item: SegmentedObject,
    intent: Intent,
    anchor: Anchor,
    materials: PartMaterials,
    config: ParticlesConfig,
    ended: EndPose | None = None,
    freed: FreedThings | None = None,
) -> Particles | Infeasible:
    """Build every body of the drop; where an earlier drop `ended` cells are fine, too, and `freed` things are
    free bodies like the object."""
    shape = object_shape(item, intent, anchor)
    if isinstance(shape, OpenShape):
        return refused(shape, intent.object_name)
    setup = drop_setup(scene, shape.item, intent, anchor, materials, config, ended)
    setup.notes += [about("object", note) for note in shape.notes]
    if config.coarser > 1.0:
        setup.notes.append(f"cells are {config.coarser:.3g} times larger: on the smaller ones the drop broke down")
    if ended is not None:
        setup.notes.append(
            "dropped again from its start: it had ended where contact was not foreseen; cells are fine there too"
        )
    if freed is not None and freed.notes:
        setup.notes += freed.notes
    if freed is None or not freed.things:
        base = base_bodies(setup)
        placed = object_body(setup, shape, base.footprint, base.cell or None)
        bodies: list[SimulationBody] = [placed.body, *base.bodies, *neighbours(setup, base.footprint)]
        seen = foreseen_on(base, base.footprint)
    else:
        things = free_things(scene, intent, anchor, materials, config, freed)
        if isinstance(things, Infeasible):
            return things
        ground = ground_setup(setup, things, freed)
        base = base_bodies(ground)
        foot, direct = own_footprint(setup, base, things, ground), anchor.base_id == freed.ground
        placed = object_body(setup, shape, foot, base.cell or None if direct else None)
        bodies = [placed.body, *base.bodies, *thing_bodies(ground, things, base), *neighbours(ground, base.footprint)]
        seen = foreseen_on(base, foot) if direct else None
    note_overlaps(setup, bodies)
    total = sum(len(b.points.volume) for b in bodies if isinstance(b, SoftSimulationBody))
    if total > config.particle_limit:
        raise GeometryError(
            f"{total} particles > {config.particle_limit}; lower ParticlesConfig.object_cells ({config.object_cells}) "
            f"or base_cells ({config.base_cells}), or raise particle_limit"
        )
    return Particles(
        tuple(bodies), (), base.cell or placed.cell, tuple(setup.notes), tuple(setup.geometry),
        base.column, seen,
    )  # fmt: skip


def foreseen_on(base: BaseBodies, foot: Footprint) -> NDArray[np.float64] | None:
    """Where the object was foreseen on a soft base, boxes in plan (k, 2, 2) [m]: its patches, and where it may touch as
    it levels out, that is, has neither rolled nor slid away."""
    if base.soft is None or not foot.contacts:
        return None
    return np.concatenate([*(one.boxes for one in foot.contacts), foot.on_base[1:, :, :2]])


def note_overlaps(setup: DropSetup, bodies: list[SimulationBody]) -> None:
    """Say where the object starts inside something."""
    for body in bodies[1:]:
        depth = -float(sampler(body.distance)(bodies[0].surface.vertices).min())
        if depth > 1e-3:
            inside = f"the object starts {1e3 * depth:.1f} mm inside {body.name}"
            setup.notes.append(Caution(Cause.NOT_MET, inside))


def proposal_particles(
    scene: SegmentedScene,
    item: SegmentedObject,
    intent: Intent,
    anchor: Anchor,
    materials: PartMaterials,
    config: ParticlesConfig,
) -> Particles | Infeasible:
    """The same for a pose that nobody has set down on anything: where no bodies can be made there, over nothing or over
    an edge without a solid, the pose stands all the same, and is measured without a simulation."""
    try:
        return particles(scene, item, intent, anchor, materials, config)
    except GeometryError as error:
        return Infeasible(Reason.NO_SUPPORT_HIT, str(error), None)


particles_task = stage(particles, process=True)
proposal_particles_task = stage(proposal_particles, process=True, name=particles_task.name)
