"""Content of a picture of the rest state: the settled object and scene, and their parts visible to a camera.

In: scene and object as segmented, and the settled state. Out: meshes.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.camera import Camera
from dcap.geometry.deform import displaced, following, with_own_vertices
from dcap.geometry.raycast import Raycaster
from dcap.geometry.rendering.cutaway import StructurePlanes
from dcap.geometry.rendering.painted import painted
from dcap.scene.types.anchor import Anchor
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.paint import PaintedMesh, SourceSurface
from dcap.scene.types.segmentation import Segmentation
from dcap.scene.types.settled import Settled, SettledBody

Array = NDArray[np.float64]

RIGID_TOLERANCE = 1e-6
"""Largest distance of a surface from a rigidly moved copy of its start at which it counts as undeformed [m]."""
HANGING = 0.15
"""Largest thickness, and largest distance of a point from the wall, of a flat thing that hangs on a wall [m]."""
STUDIO_COLOR = (214, 212, 209)
"""A floor for scenes that have none; close to the backdrop."""


def settled_item(item: Segmentation, anchor: Anchor, body: SettledBody) -> Mesh:
    """The object at rest: its own mesh, moved rigidly or following the deformed surface."""
    return settled_mesh(item.mesh, anchor, body)


def settled_mesh(own: Mesh, anchor: Anchor, body: SettledBody) -> Mesh:
    """A mesh in the object's own frame, moved to the rest state."""
    return at_rest(own.transformed(anchor.world_from_object), body)


def at_rest(whole: Mesh, body: SettledBody) -> Mesh:
    """A mesh at a body's start, moved to the body's rest state: rigidly, or following its surface."""
    return (
        whole.transformed(body.world_from_start)
        if is_rigid(body)
        else following(whole, body.surface, body.displacement)
    )


@dataclass(frozen=True, eq=False, slots=True)
class SettledScene:
    """The scene at rest."""

    scene: Segmentation
    """The scene with the drop's dents in the base, and earlier placed things at their new places."""
    shift: Array
    """Displacement of each vertex from its unloaded position [m], shape (n, 3)."""
    start: Mesh
    """The same faces at the start of the drop."""
    origin: NDArray[np.int64]
    """The face of the scene as segmented that each face came from, shape (m,)."""


def settled_scene(scene: Segmentation, settled: Settled, base_id: str) -> SettledScene:
    """The scene with the drop's dents in the base and its supports, and with earlier placed things at their rest
    positions."""
    mesh = scene.mesh
    after = SettledScene(scene, np.zeros_like(mesh.vertices), mesh, np.arange(len(mesh.faces)))
    placed = {one.id: one.placed for one in scene.instances}
    for body in settled.bodies[1:]:
        moved = np.abs(body.displacement).max(initial=0.0) > 0.0
        if body.name in placed and (moved or body.name == base_id):
            after = with_thing_moved(after, body) if placed[body.name] else with_dent(after, body)
    return after


def is_as_given(around: SettledScene, scene: Segmentation) -> bool:
    """Whether nothing of a scene has moved or bends."""
    after, given = around.scene.mesh, scene.mesh
    return np.array_equal(after.faces, given.faces) and np.array_equal(after.vertices, given.vertices)


def with_dent(around: SettledScene, body: SettledBody) -> SettledScene:
    """The scene with the dent in one instance."""
    scene = around.scene
    mine = scene.face_instance == scene.index_of(body.name)
    found = displaced(scene.mesh, mine, body.surface, body.displacement)
    more = len(found.shift) - len(around.shift)  # new vertices come last, and lie on the dented instance alone
    shift = found.shift + np.concatenate([around.shift, np.zeros((more, 3))])
    undented = found.mesh.vertices - found.shift
    undented[: len(around.shift)] = around.start.vertices
    origin = found.origin
    after = replace(
        scene, mesh=found.mesh, face_instance=scene.face_instance[origin], face_part=scene.face_part[origin]
    )
    return SettledScene(after, shift, replace(found.mesh, vertices=undented), around.origin[origin])


def with_thing_moved(around: SettledScene, body: SettledBody) -> SettledScene:
    """The scene with an earlier placed thing at its new place; a rigidly moved thing is not dented."""
    scene = around.scene
    mine = scene.face_instance == scene.index_of(body.name)
    mesh, start = with_own_vertices(scene.mesh, mine), with_own_vertices(around.start, mine)
    shift = np.zeros((len(mesh.vertices), 3))
    shift[: len(around.shift)] = around.shift
    used = np.unique(mesh.faces[mine])
    whole = Mesh(mesh.vertices[used], np.searchsorted(used, mesh.faces[mine]).astype(np.int32), mesh.colors[used])
    moved = at_rest(whole, body)
    vertices = mesh.vertices.copy()
    shift[used] = moved.vertices - whole.transformed(body.world_from_start).vertices
    vertices[used] = moved.vertices
    return SettledScene(replace(scene, mesh=replace(mesh, vertices=vertices)), shift, start, around.origin)


def is_rigid(body: SettledBody) -> bool:
    """Whether its surface did not deform."""
    start = body.surface.vertices - body.displacement
    pose = body.world_from_start
    moved = start @ pose[:3, :3].T + pose[:3, 3]
    return bool(np.abs(moved - body.surface.vertices).max() <= RIGID_TOLERANCE)


def structure_faces(scene: Segmentation) -> NDArray[np.bool_]:
    """Whether faces belong to walls, ceiling, floor, or nothing, shape (m,)."""
    flag = np.array([one.structure for one in scene.instances] + [True])
    return np.asarray(flag[scene.face_instance])


def painted_item(item: Segmentation, anchor: Anchor, body: SettledBody, surface: SourceSurface | None) -> PaintedMesh:
    """The object at rest in its own textures."""
    return painted(item.mesh, surface).moved(settled_item(item, anchor, body))


def painted_scene(around: SettledScene, surface: SourceSurface | None) -> PaintedMesh:
    """The scene at rest in its own textures."""
    return painted(around.start, surface).moved(around.scene.mesh)


def shown(scene: Segmentation, camera: Camera, look: PaintedMesh | None = None) -> list[PaintedMesh]:
    """The scene for a camera, with the look of its mesh if it has textures: without cut-away faces, on a studio floor
    if it has none."""
    return shown_meshes(scene, shown_faces(scene, camera), look)


def shown_meshes(scene: Segmentation, faces: NDArray[np.integer], look: PaintedMesh | None = None) -> list[PaintedMesh]:
    """Meshes of some faces (k,) of the scene, and of the studio floor if it has no floor."""
    meshes = [(look or PaintedMesh(scene.mesh)).submesh(faces), *floor_of(scene)]
    return [one for one in meshes if len(one.mesh.faces)]


def floor_of(scene: Segmentation) -> list[PaintedMesh]:
    """The studio floor of a scene that has none."""
    return [] if any(one.structure for one in scene.instances) else [PaintedMesh(studio_floor(scene.mesh))]


def shown_faces(scene: Segmentation, camera: Camera) -> NDArray[np.int64]:
    """Faces that are not cut away in front of the camera, shape (k,)."""
    return np.flatnonzero(~Cutaway(scene).faces(camera))


class Cutaway:
    """Faces of a scene that are cut away in front of cameras."""

    def __init__(self, scene: Segmentation) -> None:
        self._scene = scene
        self._planes = StructurePlanes(scene.mesh, structure_faces(scene))
        self._flat = [
            (index, one.box.corners) for index, one in enumerate(scene.instances)
            if not one.structure and not one.placed and 2.0 * float(one.box.half_extents.min()) <= HANGING
        ]  # fmt: skip

    def faces(self, camera: Camera) -> NDArray[np.bool_]:
        """Whether faces are cut away in front of a camera, shape (m,)."""
        cut = self._planes.between(camera.position, camera.target)
        return cut | self._hanging(cut, camera.target)

    def _hanging(self, cut: NDArray[np.bool_], target: Array) -> NDArray[np.bool_]:
        """Faces of flat things that hang on cut-away walls, (m,), unless the camera looks at them: they would float in
        front of the room, seen from behind."""
        result, mesh = np.zeros(len(cut), dtype=bool), self._scene.mesh
        if not cut.any():
            return result
        wall: Raycaster | None = None
        for index, corners in self._flat:
            if ((corners.min(axis=0) - HANGING <= target) & (target <= corners.max(axis=0) + HANGING)).all():
                continue
            mine = np.flatnonzero(self._scene.face_instance == index)
            wall = wall or Raycaster(mesh, np.flatnonzero(cut))
            points = mesh.vertices[np.unique(mesh.faces[mine])]
            if len(points) and float(wall.distance_to(points).max()) <= HANGING:
                result[mine] = True
        return result


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
