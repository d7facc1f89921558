"""Stage 7, particles: from meshes, a pose and materials to all bodies of the drop, one free or several.

In: the segmented scene and object, the intent (mass), the pre-drop pose and the material of every part. Out:
`Particles`: the object, the base within a crop around it (its soft parts as one bonded body, its rigid parts as
another) and the neighbours in reach as obstacles. The notes name every crop, cap and treatment.

A drop with several free bodies: the object, and things within its reach that were placed earlier.

In: the object's own setup and the freed things. Out: a setup for each thing over its support, and one for the ground,
the instance that finally carries them all: its crop and its contact region contain all of them, and its cells are fine
under each thing on it.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.distance import sampler
from dcap.geometry.raycast import Raycaster
from dcap.scene.errors import GeometryError
from dcap.scene.types.choices import Anchor, Intent
from dcap.scene.types.earlier import FreedThings, PlacedThing
from dcap.scene.types.materials import PartMaterials
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.outcome import Cause, Caution, Infeasible, Reason, about
from dcap.scene.types.particles import Particles, SimulationBody, SoftSimulationBody
from dcap.scene.types.segmentation import Segmentation, SegmentedObject, SegmentedScene
from dcap.scene.types.settled import EndPose
from tasks.bodies.footprint import Footprint, around
from tasks.bodies.object_shape import ObjectShape, OpenShape, object_shape, refused
from tasks.bodies.plan_contact import Layer
from tasks.cache import stage
from tasks.particles.base_bodies import BaseBodies, base_bodies
from tasks.particles.config import ParticlesConfig
from tasks.particles.contact_layers import footprint_on, layers_of, object_layers
from tasks.particles.drop_setup import OBJECT, REACH_ABOVE, REACH_BELOW, DropSetup, drop_setup
from tasks.particles.object_body import object_body
from tasks.particles.obstacles import neighbours

MOST_BUDGETS = 3
"""Maximum number of things on the ground whose cells count in its budget."""


@dataclass(frozen=True, eq=False, slots=True)
class FreeThing:
    """A thing placed earlier, as a body of the drop."""

    thing: PlacedThing
    setup: DropSetup
    shape: ObjectShape

    @property
    def carrier(self) -> str:
        """Id of the instance on which it lies."""
        return self.setup.anchor.base_id


def free_things(
    scene: Segmentation,
    intent: Intent,
    anchor: Anchor,
    materials: PartMaterials,
    config: ParticlesConfig,
    freed: FreedThings,
) -> list[FreeThing] | Infeasible:
    """Each thing at its start over its support."""
    found = []
    for thing in freed.things:
        index = scene.index_of(thing.id)
        faces = np.flatnonzero(scene.face_instance == index)
        one = scene.instances[index]
        item = Segmentation(
            scene.mesh.submesh(faces), (one,), np.zeros(len(faces), dtype=np.int32), scene.face_part[faces]
        )
        low, high = item.mesh.bounds
        carrier = thing.carried_by[0] if thing.carried_by else freed.ground
        own_anchor = replace(
            anchor, base_id=carrier, part_index=0, world_from_object=np.eye(4), lean=None,
            surface_point=np.array([*(0.5 * (low + high))[:2], low[2]]),
        )  # fmt: skip
        own_intent = replace(intent, object_name=one.label, mass=thing.mass, mass_given=True)
        shape = object_shape(item, own_intent, own_anchor)
        if isinstance(shape, OpenShape):
            return refused(shape, f"{thing.id}, {one.label}")
        setup = drop_setup(scene, shape.item, own_intent, own_anchor, materials, config)
        found.append(FreeThing(thing, replace(setup, body=thing.id, borne=borne_by(thing.id, freed)), shape))
    return found


def borne_by(instance: str, freed: FreedThings) -> float:
    """Mass of the things that lie on an instance, directly or on top of one another [kg]."""
    on_it = [one for one in freed.things if one.carried_by[:1] == (instance,)]
    return sum(one.mass + borne_by(one.id, freed) for one in on_it)


def ground_setup(own: DropSetup, things: list[FreeThing], freed: FreedThings) -> DropSetup:
    """The setup for building the ground and its surroundings; it shares the lists of notes with `own`."""
    on_it = [one.setup for one in things if one.carrier == freed.ground]
    if own.anchor.base_id == freed.ground:
        lead, beside = own, on_it
    else:
        root = own.anchor.base_id
        by_id = {one.thing.id: one for one in things}
        while by_id[root].carrier in by_id:
            root = by_id[root].carrier
        lead = replace(by_id[root].setup, borne=by_id[root].setup.borne + own.intent.mass)
        beside = [one for one in on_it if one.body != root]
        own.notes[:] = [one for one in own.notes if not one.startswith(f"{own.anchor.base_id} is cut ")]
        own.notes.append(f"{freed.ground} is cut around the bodies that take part and clamped at the cut")
    setups = [own, *(one.setup for one in things)]
    crop, reach = setups[0].crop, setups[0].contact_region
    for one in setups[1:]:
        crop, reach = around(crop, one.crop), around(reach, one.contact_region)
    reach[:, :2] = crop[:, :2]
    reach[0, 2] = min(one.mesh.bounds[0, 2] - min(one.descent.gap, REACH_BELOW) for one in setups) - REACH_BELOW
    reach[1, 2] = max(one.mesh.bounds[1, 2] for one in setups) + REACH_ABOVE
    cells = lead.config.base_cells * min(1 + len(beside), MOST_BUDGETS)
    return replace(
        lead, mesh=Mesh.concatenate([one.mesh for one in setups]), crop=crop, reach=reach,
        anchor=on_ground(lead, freed.ground), free=frozenset(one.thing.id for one in things), beside=tuple(beside),
        config=lead.config.model_copy(update={"base_cells": cells}), notes=own.notes, geometry=own.geometry,
    )  # fmt: skip


def on_ground(lead: DropSetup, ground: str) -> Anchor:
    """The anchor of a body on the ground, with the part beneath it."""
    if lead.body == OBJECT:  # its anchor was chosen
        return lead.anchor
    faces = np.flatnonzero(lead.scene.face_instance == lead.scene.index_of(ground))
    place = lead.descent.first[None] + [0.0, 0.0, REACH_ABOVE]
    hit = Raycaster(lead.scene.mesh.submesh(faces)).cast(place, np.array([[0.0, 0.0, -1.0]]))
    part = max(int(lead.scene.face_part[faces[hit.face[0]]]), 0) if hit.face[0] >= 0 else 0
    name = lead.base.parts[part].name
    return replace(lead.anchor, base_id=ground, part=name, part_index=part, surface_point=lead.descent.first)


def layers_below(carrier: str, base: BaseBodies, things: list[FreeThing], ground: DropSetup) -> list[Layer]:
    """The layers of a support, from the top down; none if it is rigid."""
    for one in things:
        if one.thing.id == carrier:
            return object_layers(one.setup)
    if base.soft is None:
        return []
    return layers_of(base.column, ground.materials.of_parts(carrier, len(ground.base.parts)))


def own_footprint(setup: DropSetup, base: BaseBodies, things: list[FreeThing], ground: DropSetup) -> Footprint:
    """The predicted contact of one body with its support."""
    return footprint_on(setup, layers_below(setup.anchor.base_id, base, things, ground))


def thing_bodies(ground: DropSetup, things: list[FreeThing], base: BaseBodies) -> list[SimulationBody]:
    """The things as bodies, free to move."""
    bodies = []
    for one in things:
        foot = own_footprint(one.setup, base, things, ground)
        setup = replace(one.setup, notes=ground.notes, geometry=ground.geometry)
        cell = base.cell or None if one.carrier == ground.base.id else None
        bodies.append(object_body(setup, one.shape, foot, cell).body)
    return bodies


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
    """Build every body of the drop; cells are also fine where an earlier drop `ended`, and `freed` things are free
    bodies like the object."""
    shape = object_shape(item, intent, anchor)
    if isinstance(shape, OpenShape):
        return refused(shape, intent.object_name)
    setup = drop_setup(scene, shape.item, intent, anchor, materials, config, ended)
    setup.notes += [about("object", note) for note in shape.notes]
    if config.coarser > 1.0:
        setup.notes.append(f"cells are {config.coarser:.3g} times larger, because the drop failed with smaller ones")
    if ended is not None:
        setup.notes.append(
            "dropped again from its start, as it came to rest outside the predicted contact; cells are fine there too"
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
    """Boxes in plan of the predicted contact on a soft base (k, 2, 2) [m]: its patches, and the region that the object
    may touch while it levels out, that is, without rolling or sliding away."""
    if base.soft is None or not foot.contacts:
        return None
    return np.concatenate([*(one.boxes for one in foot.contacts), foot.on_base[1:, :, :2]])


def note_overlaps(setup: DropSetup, bodies: list[SimulationBody]) -> None:
    """Note where the object starts inside something."""
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
    """The same for a proposed pose that is not supported by anything: if no bodies can be made there, over nothing or
    over an edge without a solid, the pose is kept nevertheless and measured without a simulation."""
    try:
        return particles(scene, item, intent, anchor, materials, config)
    except GeometryError as error:
        return Infeasible(Reason.NO_SUPPORT_HIT, str(error), None)


particles_task = stage(particles, process=True)
proposal_particles_task = stage(proposal_particles, process=True, name=particles_task.name)
