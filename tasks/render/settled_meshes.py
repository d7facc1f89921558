"""Meshes of the rest state: for pictures, for files with the source's textures, and contact patches.

In: scene and object as segmented, their textured sources, and the settled state. Out: painted meshes, with the faces
and textures of the sources (without textures those of the stages); faces of a support are only cut where it bends. The
contact patches are the parts of the object's finely cut surface nearest to the contact points, one for each touching
pair, with the area, force and mean pressure of the drop.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from dcap.arrays import Array
from dcap.geometry.camera import Camera
from dcap.geometry.deform import displaced, following, with_own_vertices
from dcap.geometry.raycast import Raycaster
from dcap.geometry.rendering.painted import nearest_faces, own_paint, paint_from, painted
from dcap.geometry.rendering.view_volume import StructurePlanes
from dcap.geometry.solid.repair import subdivide_near
from dcap.scene.types.choices import Anchor
from dcap.scene.types.mesh import Mesh, PaintedMesh, SourceSurface
from dcap.scene.types.segmentation import Segmentation
from dcap.scene.types.settled import Settled, SettledBody
from dcap.scene.writers.glb import Node
from tasks.render.contact_picture import patch_radius

RIGID_TOLERANCE = 1e-6
"""Largest distance of a surface from a rigidly moved copy of its start at which it counts as undeformed [m]."""
HANGING = 0.15
"""Largest thickness, and largest distance of a point from the wall, for a flat thing that hangs on a wall [m]."""
STUDIO_COLOR = (214, 212, 209)
"""Colour of the floor for scenes without a floor, close to the backdrop."""
COLOR = (255, 122, 26)
REACH = 4.0
"""Reach of a patch from its contact point, over the radius of the disc that the point represents [-]."""
SAME = 1e-6
"""Distance within which a contact point counts as a corner of the surface [m]."""


def settled_item(item: Segmentation, anchor: Anchor, body: SettledBody) -> Mesh:
    """The object at rest: its own mesh, moved rigidly or following the deformed surface."""
    return at_rest(item.mesh.transformed(anchor.world_from_object), body)


def at_rest(whole: Mesh, body: SettledBody) -> Mesh:
    """A mesh at a body's start, moved to the body's rest state: rigidly, or following its surface."""
    return (
        whole.transformed(body.world_from_start)
        if body.is_rigid(RIGID_TOLERANCE)
        else following(whole, body.surface, body.displacement)
    )


@dataclass(frozen=True, eq=False, slots=True)
class SettledScene:
    """The scene at rest."""

    scene: Segmentation
    """The scene with the drop's dents in the base, and with things placed earlier at their new places."""
    shift: Array
    """Displacement of each vertex from its unloaded position [m], shape (n, 3)."""
    start: Mesh
    """The same faces at the start of the drop."""
    origin: NDArray[np.int64]
    """The face of the scene as segmented that each face came from, shape (m,)."""


def settled_scene(scene: Segmentation, settled: Settled, base_id: str) -> SettledScene:
    """The scene with the drop's dents in the base and its supports, and with things placed earlier at their rest
    positions."""
    after = untouched(scene)
    placed = {one.id: one.placed for one in scene.instances}
    for body in settled.bodies[1:]:
        moved = np.abs(body.displacement).max(initial=0.0) > 0.0
        if body.name in placed and (moved or body.name == base_id):
            after = with_thing_moved(after, body) if placed[body.name] else with_dent(after, body)
    return after


def with_dent(around: SettledScene, body: SettledBody) -> SettledScene:
    """The scene with the dent in one instance."""
    scene = around.scene
    mine = scene.face_instance == scene.index_of(body.name)
    found = displaced(scene.mesh, mine, body.surface, body.displacement)
    more = len(found.shift) - len(around.shift)  # new vertices come last, and lie only on the dented instance
    shift = found.shift + np.concatenate([around.shift, np.zeros((more, 3))])
    undented = found.mesh.vertices - found.shift
    undented[: len(around.shift)] = around.start.vertices
    origin = found.origin
    after = replace(
        scene, mesh=found.mesh, face_instance=scene.face_instance[origin], face_part=scene.face_part[origin]
    )
    return SettledScene(after, shift, replace(found.mesh, vertices=undented), around.origin[origin])


def with_thing_moved(around: SettledScene, body: SettledBody) -> SettledScene:
    """The scene with a thing placed earlier at its new place; a rigidly moved thing is not dented."""
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


def structure_faces(scene: Segmentation) -> NDArray[np.bool_]:
    """Mask of the faces that belong to walls, ceiling, floor, or nothing, shape (m,)."""
    flag = np.array([one.structure for one in scene.instances] + [True])
    return np.asarray(flag[scene.face_instance])


def painted_item(item: Segmentation, anchor: Anchor, body: SettledBody, surface: SourceSurface | None) -> PaintedMesh:
    """The object at rest with its own textures."""
    return painted(item.mesh, surface).moved(settled_item(item, anchor, body))


def painted_scene(around: SettledScene, surface: SourceSurface | None) -> PaintedMesh:
    """The scene at rest with its own textures."""
    return painted(around.start, surface).moved(around.scene.mesh)


def shown(scene: Segmentation, camera: Camera, look: PaintedMesh | None = None) -> list[PaintedMesh]:
    """The meshes of the scene for a camera, with textures if it has them: without cut-away faces, and on a studio floor
    if it has no floor."""
    meshes = [(look or PaintedMesh(scene.mesh)).submesh(shown_faces(scene, camera)), *floor_of(scene)]
    return [one for one in meshes if len(one.mesh.faces)]


def floor_of(scene: Segmentation) -> list[PaintedMesh]:
    """The studio floor for a scene without a floor, a wide round plate just under it; else empty."""
    if any(one.structure for one in scene.instances):
        return []
    low, high = scene.mesh.bounds
    middle, reach = 0.5 * (low + high), 60.0 * float(np.linalg.norm(high - low))
    angle = np.linspace(0.0, 2.0 * np.pi, 96, endpoint=False)
    rim = middle[:2] + reach * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    points = np.concatenate([middle[None, :2], rim])
    index = np.arange(96)
    faces = np.stack([np.zeros(96, dtype=int), 1 + index, 1 + (index + 1) % 96], axis=1)
    vertices = np.concatenate([points, np.full((97, 1), low[2] - 1e-3)], axis=1)
    return [PaintedMesh(Mesh.of(vertices, faces, STUDIO_COLOR))]


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
        """Mask of the faces that are cut away in front of a camera, shape (m,)."""
        cut = self._planes.between(camera.position, camera.target)
        return cut | self._hanging(cut, camera.target)

    def _hanging(self, cut: NDArray[np.bool_], target: Array) -> NDArray[np.bool_]:
        """Mask of flat things on cut-away walls, (m,), unless the camera looks at them: they would float in front of
        the room, seen from behind."""
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


def contact_nodes(settled: Settled) -> list[Node]:
    """A node for each pair with the object; empty if nothing touches it."""
    own, points = settled.bodies[0], settled.contact_points
    rows = [row for row in settled.contacts if own.name in (row.a, row.b)]
    if not len(points) or not rows:
        return [Node("contacts")]
    surface, away = near_points(own.surface, points)
    others = [row.b if row.a == own.name else row.a for row in rows]
    nearest = np.zeros(len(away))
    if len(others) > 1:
        known, middle = {body.name: body.surface for body in settled.bodies}, surface.triangles.mean(axis=1)
        nearest = np.stack([Raycaster(known[name]).distance_to(middle) for name in others]).argmin(axis=0)
    children = []
    for number, (row, other) in enumerate(zip(rows, others, strict=True)):
        faces = patch_faces(surface, np.where(nearest == number, away, np.inf), row.area_m2)
        patch = surface.submesh(faces)
        colored = Mesh.of(patch.vertices, patch.faces, COLOR)
        loads = {
            "area_m2": row.area_m2,
            "normal_force_n": row.normal_force_n,
            "tangential_force_n": row.tangential_force_n,
            "mean_pressure_pa": row.normal_force_n / row.area_m2 if row.area_m2 > 0.0 else 0.0,
        }
        children.append(Node(f"{own.name} on {other}", colored, label=f"contact with {other}", extras=loads))
    return [Node("contacts", children=tuple(children))]


def near_points(surface: Mesh, points: Array) -> tuple[Mesh, Array]:
    """A surface cut finely near contact points (k, 3), and the distance of each face from the nearest of them [m],
    shape (m,); not cut if every contact point is a corner."""
    tree, radius = cKDTree(points), patch_radius(points)
    box = np.stack([points.min(axis=0) - REACH * radius, points.max(axis=0) + REACH * radius])
    carried = (tree.query(surface.vertices, distance_upper_bound=SAME)[0] <= SAME)[surface.faces].all(axis=1)
    whole, rest = surface.submesh(np.flatnonzero(carried)), surface.submesh(np.flatnonzero(~carried))
    fine = subdivide_near(rest, box, radius) if len(rest.faces) else rest
    away = tree.query(fine.triangles.mean(axis=1), distance_upper_bound=REACH * radius, workers=-1)[0]
    return Mesh.concatenate([whole, fine]), np.concatenate([np.zeros(len(whole.faces)), away])


def patch_faces(surface: Mesh, away: Array, area: float) -> NDArray[np.int64]:
    """The faces nearest to contact points, at distances (m,) [m] (inf: too far), that make up the area found in the
    drop [m^2]; at least one face."""
    order = np.argsort(away, kind="stable")
    order = order[np.isfinite(away[order])]
    total = np.cumsum(surface.face_areas[order])
    return np.sort(order[: int(np.searchsorted(total, area)) + 1])


def object_at_rest(item: Segmentation, surface: SourceSurface, anchor: Anchor, body: SettledBody) -> PaintedMesh:
    """The object at rest."""
    if not surface.kept:
        return PaintedMesh(settled_item(item, anchor, body))
    return PaintedMesh(at_rest(surface.mesh.transformed(anchor.world_from_object), body), own_paint(surface))


def scene_at_rest(
    scene: Segmentation, surface: SourceSurface, settled: Settled | None, base_id: str
) -> tuple[SettledScene, PaintedMesh]:
    """The scene with its dents, and its painted mesh; unchanged if nothing has settled in it."""
    own = of_source(scene, surface)
    around = untouched(own) if settled is None else settled_scene(own, settled, base_id)
    paint = paint_from(surface, around.start, around.origin) if surface.kept else None
    return around, PaintedMesh(around.scene.mesh, paint)


def untouched(scene: Segmentation) -> SettledScene:
    """A scene in which nothing has moved."""
    return SettledScene(scene, np.zeros_like(scene.mesh.vertices), scene.mesh, np.arange(len(scene.mesh.faces)))


def of_source(scene: Segmentation, surface: SourceSurface) -> Segmentation:
    """The scene's things and parts, on the faces of its textured source."""
    if not surface.kept:
        return scene
    owner = nearest_faces(scene.mesh, surface.mesh)
    known = owner >= 0
    return replace(
        scene,
        mesh=surface.mesh,
        face_instance=np.where(known, scene.face_instance[owner], -1).astype(np.int32),
        face_part=np.where(known, scene.face_part[owner], -1).astype(np.int32),
    )
