"""PLY meshes: vertex or face colours, any polygons."""

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dcap.scene.errors import FormatError, InputError
from dcap.scene.problems import Report, error, refusing
from dcap.scene.readers.mesh.ply_table import (
    Column,
    PlyHeader,
    Table,
    describes_splats,
    is_scalar,
    read_header,
    read_tables,
    scalar,
)
from dcap.scene.readers.mesh.polygons import triangulate
from dcap.scene.readers.mesh.raw import RawMesh, check_face_count, check_vertex_count
from dcap.scene.types.paint import Paint

INDEX_NAMES = ("vertex_indices", "vertex_index")

TEXTURE = re.compile(rb"comment[ \t]+TextureFile[ \t]+([^\r\n]+)")
"""A line of the header that names an image, as some programs write it."""


def read_ply(path: Path, report: Report | None = None) -> RawMesh:
    """Read a PLY triangle or polygon mesh; with a `report`, faces that are broken are told and left out."""
    report = report or refusing(path)
    header = read_header(path)
    _refuse_splats(path, header)
    for name, check in (("vertex", check_vertex_count), ("face", check_face_count)):
        check(path, min(header.counts.get(name, 0), path.stat().st_size))
    tables = read_tables(path, header, report)
    vertex, face = tables["vertex"], tables.get("face", {})
    vertices = np.stack([scalar(path, vertex, axis) for axis in "xyz"], axis=1).astype(np.float64)
    index = next((face[name] for name in INDEX_NAMES if name in face), None)
    if index is None and header.counts.get("tristrips", 0):
        raise FormatError(f"{path}: its faces are triangle strips, which are not read; save it with a face element")
    if index is None or not len(index):
        raise InputError(f"{path}: no faces ({len(vertices)} vertices): a point cloud, not a mesh")
    if is_scalar(index):
        raise FormatError(f"{path}: the PLY face element has one vertex index per face, expected a list")
    faces, owner = _faces(path, vertices, index, report)
    face_color = colors_of(face)
    return RawMesh(
        path=path, vertices=vertices, faces=faces, colors=colors_of(vertex),
        paint=None if face_color is None or colors_of(vertex) is not None else _face_paint(face_color[owner]),
        face_node=np.full(len(faces), -1, dtype=np.int32), node_names=(), up="", unit_metres=0.0,
        notes=_unread_textures(header),
    )  # fmt: skip


def _unread_textures(header: PlyHeader) -> tuple[str, ...]:
    """A note for each image that the header names: the format itself has colours of vertices and faces alone."""
    names = dict.fromkeys(match.group(1).decode().strip() for match in TEXTURE.finditer(header.text))
    return tuple(f"texture {name!r} of a PLY is not read; save the mesh as OBJ or GLB to keep it" for name in names)


def _refuse_splats(path: Path, header: PlyHeader) -> None:
    """Gaussian splats are not a surface: say so instead of reading their centres."""
    if "vertex" not in header.elements:
        raise FormatError(f"{path}: the PLY header declares no vertex element")
    if describes_splats(header):
        raise InputError(f"{path}: Gaussian splats, not a mesh")


def _faces(
    path: Path, vertices: NDArray[np.float64], index: Column, report: Report
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Triangles (t, 3) and the polygon (t,) that each came from."""
    of_several = index.dtype == np.object_
    lengths = np.array([len(row) for row in index]) if of_several else np.full(len(index), index.shape[1])
    check_face_count(path, int(np.maximum(lengths - 2, 0).sum()))
    faces: list[NDArray[np.int64]] = []
    owners: list[NDArray[np.int64]] = []
    for corners in np.unique(lengths[lengths > 2]).tolist():
        numbers = np.flatnonzero(lengths == corners)
        polygons = (np.stack(index[numbers].tolist()) if of_several else index).astype(np.int64)
        wrong = (polygons < 0) | (polygons >= len(vertices))
        if wrong.any():
            bad = wrong.any(axis=1)
            more = f" (face {numbers[np.argmax(bad)]}, {int(bad.sum())} such faces)"
            report(error(f"a face uses vertex {polygons[wrong][0]}, the file has {len(vertices)}{more}"))
            polygons, numbers = polygons[~bad], numbers[~bad]
        triples, owner = triangulate(vertices, polygons)
        faces.append(np.take_along_axis(polygons[owner], triples, axis=1))
        owners.append(numbers[owner])
    if not faces:
        raise InputError(f"{path}: {len(lengths)} faces, none with three corners: nothing to place on or to place")
    owner = np.concatenate(owners)
    order = np.argsort(owner, kind="stable")
    return np.concatenate(faces)[order], owner[order]


def colors_of(table: Table) -> NDArray[np.uint8] | None:
    """Colours of an element as bytes, None if it has none."""
    for names in (("red", "green", "blue"), ("r", "g", "b"), ("diffuse_red", "diffuse_green", "diffuse_blue")):
        if all(name in table and is_scalar(table[name]) for name in names):
            channels = np.stack([np.asarray(table[name]) for name in names], axis=1)
            levels = channels.astype(np.float64)
            if channels.dtype.kind == "f" and np.nanmax(levels, initial=0.0) <= 1.0:
                levels *= 255.0
            return np.clip(np.rint(levels), 0, 255).astype(np.uint8)
    return None


def _face_paint(color: NDArray[np.uint8]) -> Paint:
    """Face colours without textures."""
    count = len(color)
    return Paint(color, np.full(count, -1, dtype=np.int32), np.zeros((count, 3, 2)), ())
