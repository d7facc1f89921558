"""What is in a picture of the rest state: the object and the scene as they settled, and what a camera may see of them.

In: scene and object as segmented, and the settled state. Out: meshes.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation as Turn

from dcap.geometry.camera import Camera
from dcap.geometry.deform import displaced, following, with_own_vertices
from dcap.geometry.rendering.cutaway import cut_faces
from dcap.scene.types.anchor import Anchor
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.segmentation import Segmentation
from dcap.scene.types.settled import Settled, SettledBody

Array = NDArray[np.float64]

RIGID_TOLERANCE = 1e-6
"""A surface that is this close to a turned and moved copy of its start did not deform [m]."""
STUDIO_COLOR = (214, 212, 209)
"""A floor for scenes that have none; close to the backdrop."""


def settled_item(item: Segmentation, anchor: Anchor, body: SettledBody) -> Mesh:
    """The object at rest: its own mesh, moved as a whole or following the deformed surface."""
    if not is_rigid(body):
        return following(item.mesh.transformed(anchor.world_from_object), body.surface, body.displacement)
    world_from_start = np.eye(4)
    world_from_start[:3, :3], world_from_start[:3, 3] = turn_of(body), body.position
    return item.mesh.transformed(world_from_start @ anchor.world_from_object)


@dataclass(frozen=True, eq=False, slots=True)
class SettledScene:
    """The scene at rest."""

    scene: Segmentation
    """With the dents that the drop left in the base, and with things moved that were placed before."""
    shift: Array
    """How far each vertex has moved from where it would be unloaded [m], shape (n, 3)."""


def settled_scene(scene: Segmentation, settled: Settled, base_id: str) -> SettledScene:
    """The scene with the dents that the drop left in the base and in what carries that, and with the things that were
    placed before where they came to rest."""
    after, shift = scene, np.zeros_like(scene.mesh.vertices)
    placed = {one.id: one.placed for one in scene.instances}
    for body in settled.bodies[1:]:
        moved = np.abs(body.displacement).max(initial=0.0) > 0.0
        if body.name in placed and (moved or body.name == base_id):
            move = with_thing_moved if placed[body.name] else with_dent
            after, shift = move(after, shift, body)
    return SettledScene(after, shift)


def with_dent(scene: Segmentation, shift: Array, body: SettledBody) -> tuple[Segmentation, Array]:
    """The scene with the dent in one instance, and how far each vertex has moved [m], shape (n, 3)."""
    mine = scene.face_instance == scene.index_of(body.name)
    found = displaced(scene.mesh, mine, body.surface, body.displacement)
    origin = found.origin
    after = replace(
        scene, mesh=found.mesh, face_instance=scene.face_instance[origin], face_part=scene.face_part[origin]
    )
    before = np.zeros_like(found.shift)
    before[: len(shift)] = shift  # new vertices come last, and lie on the dented instance alone
    return after, before + found.shift


def with_thing_moved(scene: Segmentation, shift: Array, body: SettledBody) -> tuple[Segmentation, Array]:
    """The scene with a thing that was placed before at its new place; what moved as a whole is not dented."""
    mine = scene.face_instance == scene.index_of(body.name)
    mesh = with_own_vertices(scene.mesh, mine)
    more = np.zeros((len(mesh.vertices), 3))
    more[: len(shift)] = shift
    used = np.unique(mesh.faces[mine])
    turn, world_from_start = turn_of(body), np.eye(4)
    world_from_start[:3, :3], world_from_start[:3, 3] = turn, body.position
    whole = Mesh(mesh.vertices[used], np.searchsorted(used, mesh.faces[mine]).astype(np.int32), mesh.colors[used])
    as_a_whole = whole.transformed(world_from_start)
    moved = as_a_whole if is_rigid(body) else following(whole, body.surface, body.displacement)
    vertices = mesh.vertices.copy()
    more[used] = moved.vertices - as_a_whole.vertices
    vertices[used] = moved.vertices
    return replace(scene, mesh=replace(mesh, vertices=vertices)), more


def turn_of(body: SettledBody) -> Array:
    """World-from-start rotation, shape (3, 3)."""
    return np.asarray(Turn.from_quat(body.quaternion, scalar_first=True).as_matrix())


def is_rigid(body: SettledBody) -> bool:
    """Whether its surface did not deform."""
    start = body.surface.vertices - body.displacement
    moved = start @ turn_of(body).T + body.position
    return bool(np.abs(moved - body.surface.vertices).max() <= RIGID_TOLERANCE)


def structure_faces(scene: Segmentation) -> NDArray[np.bool_]:
    """Faces of walls, ceiling and floor, and those that belong to nothing, shape (m,)."""
    flag = np.array([one.structure for one in scene.instances] + [True])
    return np.asarray(flag[scene.face_instance])


def shown(scene: Segmentation, camera: Camera) -> list[Mesh]:
    """The scene as the camera may see it: without what is cut away, on a studio floor if it has none."""
    meshes = [scene.mesh.submesh(shown_faces(scene, camera))]
    if not any(one.structure for one in scene.instances):
        meshes.append(studio_floor(scene.mesh))
    return [mesh for mesh in meshes if len(mesh.faces)]


def shown_faces(scene: Segmentation, camera: Camera) -> NDArray[np.int64]:
    """Faces that are not cut away before the camera, shape (k,)."""
    return np.flatnonzero(~cut_faces(scene.mesh, structure_faces(scene), camera.position, camera.target))


def studio_floor(mesh: Mesh) -> Mesh:
    """A wide round plate just under a scene without a floor."""
    low, high = mesh.bounds
    middle, reach = 0.5 * (low + high), 60.0 * float(np.linalg.norm(high - low))
    angle = np.linspace(0.0, 2.0 * np.pi, 96, endpoint=False)
    rim = middle[:2] + reach * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    points = np.concatenate([middle[None, :2], rim])
    index = np.arange(96)
    faces = np.stack([np.zeros(96, dtype=int), 1 + index, 1 + (index + 1) % 96], axis=1)
    return Mesh.of(np.concatenate([points, np.full((97, 1), low[2] - 1e-3)], axis=1), faces, STUDIO_COLOR)
