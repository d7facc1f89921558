"""Single entry point for all foreign scenes and objects: from a path to a `Scan` in metres and z up."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dcap.scene.errors import FormatError, GeometryError, InputError
from dcap.scene.readers.frame import BY_HEIGHT, FileFrame, Role, find_frame, option_name
from dcap.scene.readers.gltf.gltf import read_gltf
from dcap.scene.readers.mesh.obj import read_obj
from dcap.scene.readers.mesh.paint import bake
from dcap.scene.readers.mesh.ply import read_ply
from dcap.scene.readers.mesh.raw import RawMesh
from dcap.scene.readers.mesh.stl import read_stl
from dcap.scene.readers.points.formats import is_points, point_squares, read_points
from dcap.scene.readers.scenes.interiorgs import is_interiorgs, read_labels, read_structure
from dcap.scene.readers.scenes.occupancy import read_occupancy
from dcap.scene.readers.scenes.placed_scene import (
    OBJECT_MESH,
    SCENE,
    is_placed_scene,
    named_nodes,
    parts_of_last,
    placed_scene_files,
    read_earlier,
    read_facts,
)
from dcap.scene.readers.scenes.scannet import is_scannet, majority, read_scannet
from dcap.scene.readers.scenes.sugar import COMPRESSED_NAME, check_suffix, describe, find_mesh, find_splats
from dcap.scene.readers.splats.formats import is_splats, read_gaussians
from dcap.scene.readers.splats.splats import discs
from dcap.scene.readers.usd.usd import USD_SUFFIXES, read_usd
from dcap.scene.types.floor_plan import Occupancy
from dcap.scene.types.gaussians import Gaussians
from dcap.scene.types.mesh import Mesh, SourceSurface
from dcap.scene.types.outcome import Cause, Caution
from dcap.scene.types.point_cloud import PointCloud
from dcap.scene.types.sample import SourceOptions
from dcap.scene.types.scan import LabelBox, Room, Scan
from dcap.scene.types.segmentation import VertexLabels, part_nodes

READERS = {
    ".glb": read_gltf, ".gltf": read_gltf, ".obj": read_obj, ".ply": read_ply, ".stl": read_stl,
    **dict.fromkeys(USD_SUFFIXES, read_usd),
}  # fmt: skip
"""Reader by file suffix."""

PAINTED: dict[str, Callable[[Path], RawMesh]] = {
    ".glb": partial(read_gltf, all_maps=True), ".gltf": partial(read_gltf, all_maps=True),
    ".obj": partial(read_obj, all_maps=True), **dict.fromkeys(USD_SUFFIXES, read_usd),
}  # fmt: skip
"""Reader of files that may have textures and materials, with all their properties."""

BROKEN = (ArithmeticError, AttributeError, LookupError, RecursionError, StopIteration, TypeError, ValueError)
"""Errors that decoding can raise for broken bytes, where no check of the reader names the place."""


STATED = {"up": "z", "unit": "m"}
"""Up axis and unit that InteriorGS and ScanNet define for their scenes."""

ROOM_HEIGHT, ROOM_BREADTH = (2.0, 4.5), (2.0, 30.0)
"""Ranges of the height and the longer side of a room in metres [m]."""

Mesher = Callable[[Gaussians | PointCloud], tuple[Mesh, tuple[str, ...]]]
"""Makes a mesh of Gaussians or points in metres and z up, and returns its assumptions."""


def read_scan(
    path: Path,
    options: SourceOptions,
    role: Role,
    *,
    folder: str = "",
    mesher: Mesher | None = None,
    labels: VertexLabels | None = None,
    ask_scale: bool = False,
) -> Scan:
    """Read a folder (InteriorGS, ScanNet, SuGaR, or with a single mesh), a mesh file, Gaussian splats or points.

    `folder` is the name of the given folder, or of the folder of the given file, if `path` is a copy. Splats and points
    without a mesh need a `mesher`. `labels` name the things of the file's vertices, instead of its own names.
    `ask_scale`: refuse splats of a scene whose scale nobody states, unless they are a room in metres.
    """
    if not path.exists():
        raise InputError(f"{path}: no such file or folder")
    if path.is_dir():
        return _read_folder(path, options, role, folder, mesher, labels, ask_scale=ask_scale)
    raw, bare = read_file(path, labels)
    frame = find_frame(raw, options, role)
    frame = check_scale(path, raw, frame, role) if ask_scale else frame
    return _scan(
        raw, frame, label=options.label or describe(path, folder), meshed=_meshed(path, bare, frame, mesher, role)
    )


def read_surface(path: Path, world_from_file: NDArray[np.float64]) -> SourceSurface:
    """The textures and materials of a file or folder read by `read_scan`, on its faces.

    `world_from_file` (4, 4) is the transform that it found; a file without more than vertex colours gives no faces.
    """
    placed = path.is_dir() and is_placed_scene(path)
    if path.is_dir():
        if is_scannet(path) and not is_interiorgs(path):
            return SourceSurface.untextured()
        path = path / SCENE if placed else find_mesh(path)[0]
    if path.suffix.lower() not in PAINTED or is_splats(path):
        return SourceSurface.untextured()
    with readable(path):
        raw = PAINTED[path.suffix.lower()](path).without_loose_vertices()
    if raw.paint is None or not raw.paint.says_more:
        return SourceSurface.untextured()
    if placed:  # the folder is in the world frame, its file in glTF's axes
        world_from_file = find_frame(raw, SourceOptions(up="y", unit="m"), Role.SCENE).world_from_file
    colors = np.full(raw.vertices.shape, 255, dtype=np.uint8) if raw.colors is None else raw.colors
    mesh = Mesh(np.ascontiguousarray(raw.vertices), raw.faces.astype(np.int32), colors)
    turn = -1 if np.linalg.det(world_from_file[:3, :3]) < 0 else 1  # a mirror reverses the corners of faces
    uv, *more = (
        np.nan_to_num(one, posinf=0.0, neginf=0.0)[:, ::turn] for one in (raw.paint.corner_uv, *raw.paint.more_uv)
    )
    paint = replace(raw.paint, corner_uv=uv, more_uv=tuple(more))
    return SourceSurface(mesh.transformed(world_from_file), paint)


def _read_folder(
    folder: Path,
    options: SourceOptions,
    role: Role,
    name: str,
    mesher: Mesher | None,
    labels: VertexLabels | None,
    *,
    ask_scale: bool,
) -> Scan:
    if is_placed_scene(folder):
        return _read_placed(folder, options, role, labels)
    if is_scannet(folder) and not is_interiorgs(folder):
        if labels is not None:
            raise InputError(
                f"--labels {labels.source}: {folder} is annotated itself; give its mesh instead of the folder"
            )
        return _read_scannet(folder, options, role)
    if is_interiorgs(folder):
        check_options(folder, options, role)
    mesh_path, notes = find_mesh(folder)
    raw, bare = read_file(mesh_path, labels)
    if not is_interiorgs(folder):
        frame = find_frame(raw, options, role)
        frame = check_scale(mesh_path, raw, frame, role) if ask_scale else frame
        own = describe(mesh_path, name if mesh_path.parent == folder else "")
        meshed = _meshed(mesh_path, bare, frame, mesher, role)
        return _scan(raw, frame, label=options.label or own, notes=notes, meshed=meshed)
    with readable(folder):
        boxes, label_notes = read_labels(folder)
        rooms, structure = read_structure(folder)
    frame = stated_frame(raw, options, role)
    if labels is not None:  # a person's labels take precedence over the annotation
        boxes, structure = (), ()
    boxes = boxes + tuple(box for box in structure if not any(_same_thing(box, other) for other in boxes))
    meshed = _meshed(mesh_path, bare, frame, mesher, role)
    return _scan(raw, frame, label=options.label, notes=notes + label_notes, boxes=boxes, rooms=rooms, meshed=meshed)


def _same_thing(box: LabelBox, other: LabelBox) -> bool:
    """Return whether a wall or opening of structure.json is also annotated in labels.json."""
    if box.id == other.id:
        return True
    near = (
        other.box.contains(box.box.center[None], margin=0.1)[0]
        or box.box.contains(other.box.center[None], margin=0.1)[0]
    )
    return bool(near) and box.label in other.label.split()


def _read_scannet(folder: Path, options: SourceOptions, role: Role) -> Scan:
    """The aligned mesh of a scene of ScanNet and its instances."""
    with readable(folder):
        raw, file_from_scanned = read_scannet(folder)
    frame = stated_frame(raw, options, role)
    return _scan(
        raw, replace(frame, world_from_file=frame.world_from_file @ file_from_scanned), label=options.label, meshed=None
    )


def _read_placed(folder: Path, options: SourceOptions, role: Role, labels: VertexLabels | None) -> Scan:
    """The scene of a folder written by a placement: in its world frame, with its own names."""
    if role is not Role.SCENE:
        raise InputError(f"{folder}: the folder of a placement is a scene; give the mesh of an object")
    placed_scene_files(folder)  # refuses an incomplete folder
    given = [
        name for name, value in (("up", options.up), ("unit", options.unit), ("label", options.label))
        if value not in ("auto", "", STATED.get(name))
    ]  # fmt: skip
    if given or labels is not None:
        name = option_name(role, given[0]) if given else f"--labels {labels.source if labels else ''}"
        raise InputError(f"{name}: {folder} was written by a placement, in metres, z up and with its names; omit it")
    path = folder / SCENE
    facts = read_facts(folder)
    earlier = read_earlier(folder, facts)
    raw, _ = read_file(path)
    names = named_nodes(path, facts, raw.node_names, raw.node_labels)
    frame = find_frame(raw, SourceOptions(up="y", unit="m"), role)
    scan = _scan(raw, replace(frame, unit_source="format"), label="", meshed=None)
    known = [node for one in facts.instances for node in part_nodes(one.id, [part.name for part in one.parts])]
    nodes = {name: number for number, name in enumerate(dict.fromkeys([*known, *filter(None, names)]))}
    face_node = np.array([*(nodes.get(name, -1) for name in names), -1], dtype=np.int32)[scan.face_node]
    last = next((one for one in facts.instances if one.id == facts.object), None)
    if last is not None:
        mine = np.flatnonzero(face_node == nodes[last.id])
        if not (folder / OBJECT_MESH).is_file():
            raise InputError(f"{folder}: {OBJECT_MESH} is missing, the object as it came to rest; place again into it")
        given_mesh = read_ply(folder / OBJECT_MESH)
        part = parts_of_last(
            folder / SCENE, last, Mesh.of(given_mesh.vertices, given_mesh.faces),
            scan.mesh.corners(mine).mean(axis=1),
        )  # fmt: skip
        face_node[mine] = np.array(
            [nodes[name] for name in part_nodes(last.id, [one.name for one in last.parts])], dtype=np.int32
        )[part]
    return replace(
        scan, face_node=face_node, node_names=tuple(nodes), node_labels=(), world_from_file=np.eye(4), up="z",
        earlier=earlier,
    )  # fmt: skip


def check_options(folder: Path, options: SourceOptions, role: Role) -> None:
    """Refuse options that contradict InteriorGS: its boxes, rooms and map would not turn with the mesh."""
    for name, given in (("up", options.up), ("unit", options.unit)):
        if given not in ("auto", STATED[name]):
            raise InputError(
                f"{option_name(role, name)} {given}: {folder}: InteriorGS annotations are in metres, z up; "
                f"omit {option_name(role, name)}, or convert mesh and splats to that"
            )


def stated_frame(raw: RawMesh, options: SourceOptions, role: Role) -> FileFrame:
    """The frame of InteriorGS and ScanNet, which define metres and z up for the mesh too; options take precedence."""
    stated = SourceOptions(
        up=STATED["up"] if options.up == "auto" else options.up,
        unit=STATED["unit"] if options.unit == "auto" else options.unit,
    )
    frame = find_frame(raw, stated, role)
    return replace(frame, unit_source="format" if options.unit == "auto" else "option")


@contextmanager
def readable(path: Path) -> Iterator[None]:
    """Turn decoding errors of broken bytes into one line."""
    try:
        yield
    except OSError as error:
        raise FormatError(f"{path}: cannot be read: {error.strerror}") from None
    except GeometryError as error:
        raise FormatError(f"{path}: {error}") from None
    except BROKEN as error:
        raise FormatError(f"{path}: the file contradicts its format ({type(error).__name__}: {error})") from None


def read_file(path: Path, labels: VertexLabels | None = None) -> tuple[RawMesh, Gaussians | PointCloud | None]:
    """A mesh, or Gaussians or points with a substitute mesh for finding units and axes."""
    check_suffix(path)
    with readable(path):
        kind = "splats" if is_splats(path) else "points" if is_points(path) else ""
        if kind and labels is not None:
            raise InputError(f"--labels {labels.source}: {path} holds {kind}, which have no vertices to label")
        if kind == "splats":
            splats = read_gaussians(path)
            return discs(path, splats), splats
        if kind == "points":
            cloud, notes = read_points(path)
            return point_squares(path, cloud, notes), cloud
        raw = READERS[path.suffix.lower()](path)
        return (raw if labels is None else with_vertex_labels(raw, labels)).without_loose_vertices(), None


def with_vertex_labels(raw: RawMesh, labels: VertexLabels) -> RawMesh:
    """A mesh whose nodes are the labelled things: each face belongs to the thing of most of its corners."""
    if len(labels.instance) != len(raw.vertices):
        raise InputError(
            f"--labels {labels.source}: {len(labels.instance)} vertices, {raw.path} has {len(raw.vertices)}; "
            "give one number for each vertex in the file's order"
        )
    node = majority(labels.instance.astype(np.int64)[raw.faces])
    names = tuple(label or "thing" for label in labels.labels)
    return replace(raw, face_node=node, node_names=labels.ids, node_labels=names, notes=(*raw.notes, *labels.notes))


def check_scale(path: Path, raw: RawMesh, frame: FileFrame, role: Role) -> FileFrame:
    """Ask for the scale of splats that nobody states, unless they are a room in metres, which is accepted and
    reported."""
    if not raw.of_splats or role is not Role.SCENE or frame.unit_source != "estimate":
        return frame
    low, high = np.quantile(raw.vertices @ frame.world_from_file[:3, :3].T, [0.01, 0.99], axis=0)
    size = high - low
    if not (ROOM_HEIGHT[0] <= size[2] <= ROOM_HEIGHT[1] and ROOM_BREADTH[0] <= size[:2].max() <= ROOM_BREADTH[1]):
        raise InputError(
            f"{path}: Gaussians have no unit, and as metres they would be {size[0]:.3g} x {size[1]:.3g} m and "
            f"{size[2]:.3g} m high, which is not a room; state the scale: {BY_HEIGHT}; or --unit m, cm, mm or in"
        )
    told = f"Gaussians carry no unit; assuming metres, as the room is {size[2]:.2f} m high (else: --unit, --height-of)"
    return replace(frame, notes=(*frame.notes, Caution(Cause.ASSUMED, told)))


def _meshed(
    path: Path, bare: Gaussians | PointCloud | None, frame: FileFrame, mesher: Mesher | None, role: Role
) -> tuple[Mesh, tuple[str, ...]] | None:
    """The surface of splats or points in the world frame, with notes; None for anything else."""
    if bare is None:
        return None
    kind = "Gaussian splats" if isinstance(bare, Gaussians) else "a point cloud"
    if mesher is None:
        raise InputError(f"{path}: {kind}, not a mesh")
    mesh, notes = mesher(bare.transformed(frame.world_from_file))
    notes = (f"no mesh: the surface is reconstructed from {kind} ({len(mesh.faces)} faces)", *notes)
    if isinstance(bare, PointCloud) and frame.unit_source == "estimate" and frame.unit_metres == 1.0:
        notes = (f"no unit in the file; assuming metres ({option_name(role, 'unit')})", *notes)
    return mesh, notes


def _scan(
    raw: RawMesh,
    frame: FileFrame,
    *,
    label: str,
    meshed: tuple[Mesh, tuple[str, ...]] | None,
    notes: tuple[str, ...] = (),
    boxes: tuple[LabelBox, ...] = (),
    rooms: tuple[Room, ...] = (),
) -> Scan:
    """Bake the colours and convert everything to the world frame, unless that is already done (`meshed`)."""
    if meshed is None:
        vertices, faces, colors, face_node = bake(raw)
        baked = Mesh(np.ascontiguousarray(vertices), faces.astype(np.int32), np.ascontiguousarray(colors))
        mesh = baked.transformed(frame.world_from_file)
    else:
        mesh, assumed = meshed
        face_node = np.full(len(mesh.faces), -1, dtype=np.int32)
        notes += assumed
    return Scan(
        mesh=mesh, face_node=face_node, node_names=raw.node_names, boxes=boxes,
        rooms=rooms,
        label=" ".join(label.replace("_", " ").lower().split()), world_from_file=frame.world_from_file, up=frame.up,
        unit_metres=frame.unit_metres, unit_source=frame.unit_source, notes=raw.notes + frame.notes + notes,
        node_labels=raw.node_labels,
    )  # fmt: skip


@dataclass(frozen=True, eq=False, slots=True)
class SplatScene:
    """Content of a folder or file of splats."""

    path: Path
    """The file of splats."""
    splats: Gaussians
    boxes: tuple[LabelBox, ...]
    rooms: tuple[Room, ...]
    occupancy: Occupancy | None
    annotated: bool
    """Whether the folder has InteriorGS' annotations: the format states units and axes."""
    world_from_file: NDArray[np.float64]
    """Maps the file's own coordinates to ours, shape (4, 4)."""
    notes: tuple[str, ...]
    """Assumptions and ignored parts on reading, one sentence each."""


def read_splat_scene(path: Path, options: SourceOptions) -> SplatScene:
    """Read a folder with Gaussian splats, or a file of them."""
    if not path.exists():
        raise InputError(f"{path}: no such file or folder")
    annotated = path.is_dir() and is_interiorgs(path)
    if annotated:
        check_options(path, options, Role.SCENE)
    found = find_splats(path) if path.is_dir() else path
    if found is None:
        raise InputError(
            f"{path}: no Gaussian splats in this folder (looked for {COMPRESSED_NAME} and other "
            ".ply, .splat, .spz and .sog files)"
        )
    raw, splats = read_file(found)
    if not isinstance(splats, Gaussians):
        kind = "a mesh" if splats is None else "a point cloud"
        raise InputError(f"{found}: {kind}, not Gaussian splats; give a file of splats or a folder with one")
    frame = (stated_frame if annotated else find_frame)(raw, options, Role.SCENE)
    boxes, notes = read_labels(path) if annotated else ((), ())
    rooms = read_structure(path)[0] if annotated else ()
    occupancy, map_notes = read_occupancy(path, rooms) if path.is_dir() else (None, ())
    return SplatScene(
        found, splats.transformed(frame.world_from_file), boxes, rooms, occupancy, annotated, frame.world_from_file,
        raw.notes + frame.notes + notes + map_notes,
    )  # fmt: skip
