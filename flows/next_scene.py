"""Scene for the next placement: the scene with the placed object in it, described by `scene.json`.

In: the values of a placement. Out: the files next to scene.glb. A failed placement leaves its scene unchanged.
"""

from dataclasses import replace

import numpy as np

from dcap.arrays import Array
from dcap.scene.readers.scenes.placed_scene import OBJECT_NODE
from dcap.scene.types.boxes import OrientedBox, min_area_box
from dcap.scene.types.choices import Intent
from dcap.scene.types.earlier import Deformation, EarlierPlacements, PlacedThing
from dcap.scene.types.materials import PartMaterial
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.particles import Particles
from dcap.scene.types.segmentation import Instance, Part, Segmentation
from dcap.scene.types.settled import Settled
from dcap.scene.writers.placed_scene import placed_scene_files_of
from flows.placement_json import FinalState, Values
from tasks.render.settled_meshes import SettledScene, settled_item, settled_scene

MOVED = 1e-7
"""Displacement beyond which a vertex counts as dented [m]."""
LOOKS_ASIDE = 0.7
"""Least horizontal part of a front for a turned thing to keep it [-]."""


def next_scene_files(values: Values, prompt: str) -> dict[str, bytes]:
    """scene.json and its companion files, by name."""
    if values.scene is None:
        return {}
    final = values.final
    if final is None or values.particles is None or values.materials is None:
        return placed_scene_files_of(unchanged(values), None, None)
    earlier, last = with_object(values, final, values.particles, values.materials.rows, prompt)
    return placed_scene_files_of(earlier, last, np.clip(final.item.face_part, 0, None))


def unchanged(values: Values) -> EarlierPlacements:
    """The scene unchanged."""
    assert values.scene is not None
    if values.scan is not None and values.scan.earlier is not None:
        return values.scan.earlier
    return EarlierPlacements(values.scene.instances, (), (), (), ())


def with_object(
    values: Values, final: FinalState, particles: Particles, rows: tuple[PartMaterial, ...], prompt: str
) -> tuple[EarlierPlacements, str]:
    """The scene with the object as one more placed thing, and its id."""
    scene, settled, anchor, item = final.scene, final.settled, final.anchor, final.item
    before = unchanged(values)
    last = free_id(before)
    name_of = {body.name: body.instance for body in particles.bodies} | {OBJECT_NODE: last}
    free = [name_of[body.name] for body in particles.bodies if not body.fixed]
    after = settled_scene(scene, settled, anchor.base_id)
    start = item.mesh.transformed(final.body.world_from_start @ anchor.world_from_object)
    rest = settled_item(item, anchor, final.body)
    forces = bearing(settled, name_of)
    pairs = tuple(pair for pair in forces if {*pair} & set(free))
    placed = {one.id: one for one in before.placed}
    placed[last] = PlacedThing(last, particles.bodies[0].inertial.mass, (), prompt)
    heights = {one: float(mesh_of(after.scene, one, last, rest).bounds[:, 2].mean()) for one in free}
    for one in free:
        carriers = carried_by(one, forces, heights)
        placed[one] = replace(placed[one], carried_by=carriers or placed[one].carried_by or (anchor.base_id,))
    earlier = EarlierPlacements(
        instances=(
            *(at_new_place(one, after.scene, settled) if one.id in free else one for one in before.instances),
            placed_instance(last, final, values.intent, rest),
        ),
        materials=kept_materials(before, rows, last),
        placed=tuple(placed.values()),
        touching=tuple(sorted({*(p for p in before.touching if not {*p} & set(free)), *pairs})),
        deformations=(
            *(one for one in before.deformations if not set(one.loads) & set(free)),
            *dents(scene, after, settled, free),
            *sagged(last, start, rest),
        ),
    )
    return earlier, last


def free_id(before: EarlierPlacements) -> str:
    """The first of placed_1, placed_2 ... that no instance has."""
    taken = {one.id for one in before.instances}
    number = len(before.placed) + 1
    while f"placed_{number}" in taken:
        number += 1
    return f"placed_{number}"


def mesh_of(scene: Segmentation, one: str, last: str, rest: Mesh) -> Mesh:
    """A placed thing at rest."""
    return rest if one == last else scene.instance_mesh(scene.index_of(one))


def bearing(settled: Settled, name_of: dict[str, str]) -> dict[tuple[str, str], float]:
    """Normal force between pairs of instances, their ids in order [N]."""
    forces: dict[tuple[str, str], float] = {}
    for row in settled.contacts:
        a, b = sorted((name_of[row.a], name_of[row.b]))
        if a != b and row.normal_force_n > 0.0:
            forces[a, b] = forces.get((a, b), 0.0) + row.normal_force_n
    return forces


def carried_by(one: str, forces: dict[tuple[str, str], float], heights: dict[str, float]) -> tuple[str, ...]:
    """Supports of a thing: fixed things that it touches and free ones below it, the largest force first."""
    found = []
    for (a, b), force in forces.items():
        if one in (a, b):
            other = b if a == one else a
            if other not in heights or heights[other] < heights[one]:
                found.append((force, other))
    return tuple(other for _, other in sorted(found, key=lambda pair: (-pair[0], pair[1])))


def kept_materials(before: EarlierPlacements, rows: tuple[PartMaterial, ...], last: str) -> tuple[PartMaterial, ...]:
    """Materials by instance and part, newly chosen ones first."""
    found = {(row.body, row.part_index): row for row in before.materials}
    for row in rows:
        body = last if row.body == OBJECT_NODE else row.body
        found.setdefault((body, row.part_index), replace(row, body=body))
    return tuple(found.values())


def placed_instance(last: str, final: FinalState, intent: Intent | None, rest: Mesh) -> Instance:
    """The object as an instance of the scene."""
    own = final.item.instances[0]
    pose = final.body.world_from_start @ final.anchor.world_from_object
    number = np.clip(final.item.face_part, 0, None)
    parts = tuple(
        Part(part.name, box_around(rest.submesh(np.flatnonzero(number == index))), part.confidence)
        for index, part in enumerate(own.parts)
    )
    front = None if own.front is None else turned(own.front, pose[:3, :3] / np.cbrt(np.linalg.det(pose[:3, :3])))
    label = (intent.object_name if intent else "") or own.label
    return Instance(last, label, box_around(rest), parts, front, placed=True)


def at_new_place(one: Instance, scene: Segmentation, settled: Settled) -> Instance:
    """A thing that was placed before, with its present boxes."""
    index = scene.index_of(one.id)
    mine = scene.face_instance == index
    parts = tuple(
        replace(part, box=box_around(scene.mesh.submesh(np.flatnonzero(mine & (scene.face_part == number)))))
        for number, part in enumerate(one.parts)
    )
    body = next((body for body in settled.bodies if body.name == one.id), None)
    front = one.front
    if front is not None and body is not None:
        front = turned(front, body.world_from_start[:3, :3])
    return replace(one, box=box_around(scene.mesh.submesh(np.flatnonzero(mine))), parts=parts, front=front)


def box_around(mesh: Mesh) -> OrientedBox:
    """The box of a mesh; one without volume around none."""
    if not len(mesh.faces):
        return OrientedBox(np.zeros(3), np.eye(3), np.zeros(3))
    return min_area_box(mesh.vertices)


def turned(front: Array, turn: Array) -> Array | None:
    """A front after a turn, horizontal; None where it looks up or down now."""
    flat = (turn @ front) * (1.0, 1.0, 0.0)
    length = float(np.linalg.norm(flat))
    return flat / length if length >= LOOKS_ASIDE else None


def dents(start: Segmentation, rest: SettledScene, settled: Settled, free: list[str]) -> list[Deformation]:
    """Deformations of the scene by the drop, by instance: supports of the free things, and free things that sag."""
    found, after = [], rest.scene
    bodies = {body.name: body for body in settled.bodies}
    for index, one in enumerate(after.instances):
        mine = np.flatnonzero(after.face_instance == index)
        if one.id in free:
            unloaded = start.instance_mesh(index).transformed(bodies[one.id].world_from_start)
            found += sagged(one.id, unloaded, after.mesh.submesh(mine))
            continue
        moved = (np.linalg.norm(rest.shift, axis=1) > MOVED)[after.mesh.faces[mine]].any(axis=1)
        if moved.any():
            used, inverse = np.unique(after.mesh.faces[mine[moved]], return_inverse=True)
            surface = Mesh.of(after.mesh.vertices[used], inverse.reshape(-1, 3))
            found.append(Deformation(one.id, tuple(free), surface, rest.shift[used]))
    return found


def sagged(one: str, start: Mesh, rest: Mesh) -> list[Deformation]:
    """Difference of a thing at rest from its own shape after the best-fit rigid motion."""
    shift = rest.vertices - start.vertices
    if np.abs(shift).max() <= 2e-6:
        return []
    return [Deformation(one, (one,), Mesh.of(rest.vertices, rest.faces), shift)]
