"""Stage mesh: from a foreign file or folder to one clean coloured mesh in metres and z up, and its textured surface.

A folder or file with only Gaussian splats or points gets a surface from them, in a process of its own (Taichi).
Cleaning is light, to preserve a scan's surface: faces without area and repeated faces are removed, equal vertices of
equal colour are merged. The notes list the changes. The textured surface has the faces, corners and textures of the
file, for pictures and files; it is empty without textures.
"""

import logging
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, NonNegativeInt

from dcap.geometry.deform import DisplacementField
from dcap.geometry.rendering.painted import nearest_faces
from dcap.geometry.splatting.config import SurfaceConfig
from dcap.knowledge.lexicon import names_thing
from dcap.scene.errors import FormatError, GeometryError
from dcap.scene.readers.frame import Role
from dcap.scene.readers.scenes.sugar import has_no_faces
from dcap.scene.readers.source import read_scan, read_surface
from dcap.scene.types.gaussians import Gaussians
from dcap.scene.types.mesh import Mesh, SourceSurface
from dcap.scene.types.point_cloud import PointCloud
from dcap.scene.types.sample import SourceOptions
from dcap.scene.types.scan import FileScale, Scan
from dcap.scene.types.segmentation import SegmentedScene, VertexLabels
from tasks.artifact import Source
from tasks.cache import stage

LOG = logging.getLogger(__name__)
WELD_FRACTION = 1e-7
"""Distance over the largest extent within which vertices are merged [-]."""
COLOR_LEVELS = 16
"""Colour levels per channel; only vertices of the same level are merged."""


class MeshConfig(BaseModel, frozen=True, extra="forbid"):
    """Settings of a surface from splats or points."""

    surface: SurfaceConfig = SurfaceConfig()
    """Settings of the surface."""
    threads: NonNegativeInt = 0
    """Worker threads for it, 0: all cores; never changes a result."""


def mesh_scene(
    source: Source,
    options: SourceOptions,
    config: MeshConfig,
    labels: VertexLabels | None = None,
    scale: FileScale | None = None,
) -> Scan:
    """The scene's source as a clean mesh; `labels` name the things of its vertices, `scale` is its unit. The name of a
    file becomes its label only if it is a word for a thing."""
    given = options if scale is None else replace(options, unit=repr(scale.metres))
    scan = mesh(source, given, Role.SCENE, config, labels)
    label = scan.label if options.label or names_thing(scan.label) else ""
    return replace(scan, label=label, notes=scan.notes if scale is None else (*scan.notes, scale.note))


def mesh_object(source: Source, options: SourceOptions, config: MeshConfig) -> Scan:
    """The object's source as a clean mesh."""
    return mesh(source, options, Role.OBJECT, config)


def mesh(
    source: Source, options: SourceOptions, role: Role, config: MeshConfig, labels: VertexLabels | None = None
) -> Scan:  # fmt: skip
    """Read the source and clean it; the role determines plausible sizes and the option named in messages."""
    try:
        mesher = partial(surface, role=role, config=config)
        ask = role is Role.SCENE and options.unit == "auto"
        scan = read_scan(
            source.path, options, role, folder=source.folder, mesher=mesher, labels=labels, ask_scale=ask
        )  # fmt: skip
        return cleaned(scan)
    except GeometryError as error:
        raise FormatError(f"{source.path}: {error}") from None


def surface(bare: Gaussians | PointCloud, role: Role, config: MeshConfig) -> tuple[Mesh, tuple[str, ...]]:
    """The surface of Gaussians or points in metres, and the assumptions made; starts Taichi."""
    from dcap.geometry.splatting.cloud import mesh_of_points  # loads Taichi and Open3D, which a mesh does not need
    from dcap.geometry.splatting.surface import mesh_of_splats
    from solver.runtime import available_cores, start

    start(config.threads)
    threads = config.threads or len(available_cores())

    def tell(part: float, text: str) -> None:
        LOG.info(text, extra={"progress": part})

    if isinstance(bare, Gaussians):
        return mesh_of_splats(bare, config.surface, threads, tell), ()
    return mesh_of_points(bare, config.surface, single=role is Role.OBJECT, threads=threads, progress=tell)


def needs_process(source: Source, **_: object) -> bool:
    """Return whether a source is splats or points: Taichi runs once per process."""
    return has_no_faces(source.path)


mesh_scene_task = stage(mesh_scene, process=needs_process)
mesh_object_task = stage(mesh_object, process=needs_process)


def cleaned(scan: Scan) -> Scan:
    """Weld equal vertices; drop faces without area and faces that repeat another face."""
    before = scan.mesh
    step = WELD_FRACTION * max(float(np.ptp(before.bounds, axis=0).max()), 1e-12)
    place = np.unique(np.rint(before.vertices / step), axis=0, return_inverse=True)[1].reshape(-1)
    faces = place[before.faces]
    kept = np.flatnonzero(_has_area(before, faces) & _first_of_its_kind(faces))
    if not len(kept):
        raise GeometryError(f"all {len(before.faces)} faces have zero area or repeat another one")
    after = _welded(before, place, kept)
    notes = scan.notes
    if len(kept) < len(before.faces):
        notes += (
            f"{len(before.faces) - len(kept)} of {len(before.faces)} faces were degenerate or repeated and are dropped",
        )
    return replace(scan, mesh=after, face_node=scan.face_node[kept], notes=notes)


def _has_area(mesh: Mesh, faces: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Mask of the faces that have three different corners and an area above rounding, shape (m,)."""
    a, b, c = faces.T
    extent = float(np.ptp(mesh.bounds, axis=0).max())
    # float64 products of coordinates of size `extent` round at 1e-16 extent^2; 1e-14 is safely above.
    return np.asarray((a != b) & (b != c) & (c != a) & (mesh.face_areas > 1e-14 * extent * extent))


def _first_of_its_kind(faces: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Mask without faces that have the same three corners in the same sense as an earlier face, shape (m,).

    A face with the opposite orientation stays: it may belong to another solid that touches the first.
    """
    start = np.argmin(faces, axis=1)[:, None]
    turned = np.take_along_axis(faces, (start + np.arange(3)) % 3, axis=1)
    first = np.unique(turned, axis=0, return_index=True)[1]
    mask = np.zeros(len(faces), dtype=bool)
    mask[first] = True
    return mask


def _welded(mesh: Mesh, place: NDArray[np.int64], kept: NDArray[np.int64]) -> Mesh:
    """The kept faces with one vertex per place and colour level; the colour is the mean."""
    level = mesh.colors.astype(np.int64) * COLOR_LEVELS // 256
    key = ((place * COLOR_LEVELS + level[:, 0]) * COLOR_LEVELS + level[:, 1]) * COLOR_LEVELS + level[:, 2]
    used = np.unique(mesh.faces[kept])
    _, first, inverse = np.unique(key[used], return_index=True, return_inverse=True)
    number = np.zeros(len(mesh.vertices), dtype=np.int32)
    number[used] = inverse
    size = np.bincount(inverse)
    colors = np.stack([np.bincount(inverse, mesh.colors[used, i]) / size for i in range(3)], axis=1)
    return Mesh(mesh.vertices[used[first]], number[mesh.faces[kept]], np.rint(colors).astype(np.uint8))


def textured_surface(source: Source, scan: Scan) -> SourceSurface:
    """The textured surface of a source."""
    return read_surface(source.path, scan.world_from_file)


def surface_start(surface: SourceSurface, given: SegmentedScene, start: SegmentedScene) -> SourceSurface:
    """The textured surface of an input scene at the start of the drop: dents undone, things lifted out of them.

    `given` and `start` have the same faces in the same order. Moved things take their part of the surface along.
    """
    corners, moved = given.mesh.triangles, start.mesh.triangles - given.mesh.triangles
    changed = np.unique(given.face_instance[np.abs(moved).max(axis=(1, 2)) > 0.0])
    if not surface.kept or not len(changed):
        return surface
    owner = nearest_faces(given.mesh, surface.mesh)
    instance = np.where(owner >= 0, given.face_instance[owner], -1)
    vertices = surface.mesh.vertices.copy()
    for one in changed[changed >= 0]:
        mine = given.face_instance == one
        faces = np.arange(3 * int(mine.sum()), dtype=np.int32).reshape(-1, 3)
        apart = Mesh.of(corners[mine].reshape(-1, 3), faces)
        used = np.unique(surface.mesh.faces[instance == one])
        field = DisplacementField(apart, moved[mine].reshape(-1, 3), close=np.inf)
        vertices[used] += field.at(vertices[used])
    return replace(surface, mesh=replace(surface.mesh, vertices=vertices))


surface_start_task = stage(surface_start)
surface_scene_task = stage(textured_surface, name="surface_scene")
surface_object_task = stage(textured_surface, name="surface_object")
