"""One door for every foreign scene and object: a path in, a `Scan` in metres and z up out."""

from pathlib import Path

import numpy as np

from scene.errors import FormatError, InputError
from scene.mesh import Mesh
from scene.readers.frame import Frame, Role, find_frame
from scene.readers.gltf import read_gltf
from scene.readers.interiorgs import is_interiorgs, read_labels, read_structure
from scene.readers.obj import read_obj
from scene.readers.paint import bake
from scene.readers.ply import read_ply
from scene.readers.raw import RawMesh
from scene.readers.stl import read_stl
from scene.readers.sugar import check_suffix, describe, find_mesh
from scene.sample import SourceOptions
from scene.scan import LabelBox, Room, Scan

READERS = {".glb": read_gltf, ".gltf": read_gltf, ".obj": read_obj, ".ply": read_ply, ".stl": read_stl}
"""Reader by file suffix."""

BROKEN = (ArithmeticError, AttributeError, LookupError, RecursionError, StopIteration, TypeError, ValueError)
"""What decoding can raise on bytes that break their format where no check of the reader names the place."""


def read_scan(path: Path, options: SourceOptions, role: Role, *, folder: str = "") -> Scan:
    """Read a folder (InteriorGS, SuGaR, or one with a single mesh) or a mesh file.

    `folder` is the name of the folder that was given, or that a given file lay in, where `path` is a copy of it.
    """
    if not path.exists():
        raise InputError(f"{path}: no such file or folder")
    if path.is_dir():
        return _read_folder(path, options, role, folder)
    raw = _read_mesh(path)
    return _scan(raw, options, find_frame(raw, options, role), label=options.label or describe(path, folder))


def _read_folder(folder: Path, options: SourceOptions, role: Role, name: str) -> Scan:
    mesh_path, notes = find_mesh(folder)
    raw = _read_mesh(mesh_path)
    if not is_interiorgs(folder):
        frame = find_frame(raw, options, role)
        own = describe(mesh_path, name if mesh_path.parent == folder else "")
        return _scan(raw, options, frame, label=options.label or own, notes=notes)
    boxes, label_notes = read_labels(folder)
    rooms, structure = read_structure(folder)
    frame = _interiorgs_frame(raw, options, role)
    boxes = boxes + tuple(box for box in structure if not any(_same_thing(box, other) for other in boxes))
    return _scan(raw, options, frame, label=options.label, notes=notes + label_notes, boxes=boxes, rooms=rooms)


def _same_thing(box: LabelBox, other: LabelBox) -> bool:
    """Whether a wall or opening of structure.json is annotated in labels.json too."""
    if box.id == other.id:
        return True
    near = (
        other.box.contains(box.box.center[None], margin=0.1)[0]
        or box.box.contains(other.box.center[None], margin=0.1)[0]
    )
    return bool(near) and box.label in other.label.split()


def _interiorgs_frame(raw: RawMesh, options: SourceOptions, role: Role) -> Frame:
    """InteriorGS states metres and z up, for the mesh too; options still win."""
    stated = SourceOptions(
        up="z" if options.up == "auto" else options.up, unit="m" if options.unit == "auto" else options.unit
    )
    frame = find_frame(raw, stated, role)
    source = "format" if options.unit == "auto" else "option"
    return Frame(frame.world_from_file, frame.up, frame.unit_metres, source, frame.notes)


def _read_mesh(path: Path) -> RawMesh:
    check_suffix(path)
    try:
        return READERS[path.suffix.lower()](path)
    except OSError as error:
        raise FormatError(f"{path}: cannot be read: {error.strerror}") from None
    except BROKEN as error:
        raise FormatError(f"{path}: the file contradicts its format ({type(error).__name__}: {error})") from None


def _scan(
    raw: RawMesh,
    options: SourceOptions,
    frame: Frame,
    *,
    label: str,
    notes: tuple[str, ...] = (),
    boxes: tuple[LabelBox, ...] = (),
    rooms: tuple[Room, ...] = (),
) -> Scan:
    """Bake the colours and bring everything to the world frame."""
    vertices, faces, colors, face_node = bake(raw)
    mesh = Mesh(np.ascontiguousarray(vertices), faces.astype(np.int32), np.ascontiguousarray(colors))
    return Scan(
        mesh=mesh.transformed(frame.world_from_file), face_node=face_node, node_names=raw.node_names, boxes=boxes,
        rooms=rooms,
        label=" ".join(label.replace("_", " ").lower().split()), world_from_file=frame.world_from_file, up=frame.up,
        unit_metres=frame.unit_metres, unit_source=frame.unit_source, notes=raw.notes + frame.notes + notes,
    )  # fmt: skip
