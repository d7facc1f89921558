"""PLY meshes with vertex or face colours and any polygons, from tables that plyfile reads.

Tables of PLY files, read by the library plyfile after checks of the header.

Guaranteed: the counts of the header are compared with the file's length before memory is allocated, which plyfile does
not do. Binary elements whose lists have three or four numbers are mapped; all others are read value by value. Source:
Greg Turk, "The PLY Polygon File Format", 1994.
"""

import re
import warnings
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from plyfile import PlyData, PlyElement, PlyElementParseError, PlyListProperty, PlyParseError

from dcap.scene.errors import FormatError, InputError, format_error
from dcap.scene.readers.files import read_bytes
from dcap.scene.readers.mesh.raw import RawMesh, check_face_count, check_vertex_count, triangulate, unnamed_mesh
from dcap.scene.types.mesh import Paint

HEADER_LIMIT = 1 << 20
"""Maximum length of a header [bytes]."""

COUNT = re.compile(rb"(?<![^\r\n])([ \t]*element[ \t]+\S+[ \t]+)(\d+)(?=\s)")
"""The number of rows stated in a line of the header."""

END = re.compile(rb"(?<=[\r\n])end_header[ \t]*(\r\n|\n|\r)")
"""The last line of the header; a comment may contain the word too."""

WEDGE = ("texcoord", 6)
"""Texture coordinates of a triangle's corners, as written by some programs: the only common list of another length."""

Column = NDArray[np.generic]
"""One number per row (n,), lists of one length (n, k), or lists of several lengths: an array of arrays as objects
(n,)."""

Table = dict[str, Column]
INDEX_NAMES = ("vertex_indices", "vertex_index")

TEXTURE = re.compile(rb"comment[ \t]+TextureFile[ \t]+([^\r\n]+)")
"""A line of the header that names an image, as written by some programs."""


@dataclass(frozen=True, eq=False)
class PlyHeader:
    """Header of a PLY file."""

    elements: dict[str, PlyElement]
    """By name in file order, without data."""
    counts: dict[str, int]
    """Number of rows stated for each element."""
    is_text: bool
    text: bytes
    """The header text, in ASCII."""

    def properties(self, element: str) -> set[str]:
        """Names of an element's properties; empty if there is no such element."""
        return {p.name for p in self.elements[element].properties} if element in self.elements else set()


def read_header(path: Path) -> PlyHeader:
    """Elements, counts and encoding."""
    data = read_bytes(path, HEADER_LIMIT)
    if data[:3] != b"ply":
        raise FormatError(f"{path}: does not begin with 'ply'")
    end = END.search(data)
    if end is None:
        raise FormatError(f"{path}: the PLY header has no end_header line")
    # plyfile only accepts ASCII, but comments contain names of people and folders
    text = data[: end.end()].decode("ascii", "replace").encode("ascii", "replace")
    counts = [int(match[2]) for match in COUNT.finditer(text)]
    try:
        found = PlyData.read(BytesIO(COUNT.sub(rb"\g<1>0", text)))
    except (PlyParseError, ValueError) as broken:
        raise FormatError(f"{path}: the PLY header is not understood: {broken}") from None
    elements = {element.name: element for element in found}
    if len(elements) != len(counts):
        raise FormatError(f"{path}: the PLY header declares an element twice, or without a count")
    for prop in (p for element in found for p in element.properties):
        if isinstance(prop, PlyListProperty) and prop.len_dtype[0] == "f":
            raise FormatError(f"{path}: the length of list {prop.name!r} has a floating-point type ({prop})")
    return PlyHeader(elements, dict(zip(elements, counts, strict=True)), found.text, text)


def read_tables(path: Path, header: PlyHeader) -> dict[str, Table]:
    """All elements by name; the file must be long enough for its header."""
    _check_length(path, header, path.stat().st_size - len(header.text))
    try:
        found = (None if header.is_text else _mapped(path, header)) or _by_value(path, header)
    except PlyElementParseError as broken:
        what = f"PLY {broken}" + (": the file is truncated" if "early end" in broken.message else "")
        raise format_error(path, what, line=_line(header, broken)) from None
    return {element.name: {p.name: element.data[p.name] for p in element.properties} for element in found}


def _check_length(path: Path, header: PlyHeader, available: int) -> None:
    """Refuse a header that states more than the file can hold."""
    needed = 0
    for name, element in header.elements.items():
        count, row = header.counts[name], 0
        if count and not element.properties:
            raise FormatError(f"{path}: the header declares {count} rows of element {name!r} without properties")
        for prop in element.properties:
            stored = prop.len_dtype if isinstance(prop, PlyListProperty) else prop.val_dtype
            # each value of a text takes at least a digit and a separator; an empty list still states its length
            row += 2 if header.is_text else np.dtype(stored).itemsize
        needed += count * row
        if needed > available + 1:  # the last separator of a text may be missing
            raise FormatError(
                f"{path}: the header promises {count} of element {name!r}, at least {needed} bytes "
                f"of data, but {available} follow: the file is truncated"
            )


def _line(header: PlyHeader, broken: PlyElementParseError) -> int:
    """The number of the broken line of a text; 0 for binary files."""
    names = list(header.elements)
    before = sum(header.counts[name] for name in names[: names.index(broken.element.name)])
    return header.text.count(b"\n") + before + broken.row + 1 if header.is_text else 0


def _mapped(path: Path, header: PlyHeader) -> PlyData | None:
    """A binary file whose lists have the usual lengths; None if they do not."""
    for corners in (3, 4):
        lengths = {
            name: {p.name: WEDGE[1] if p.name == WEDGE[0] else corners for p in element.properties}
            for name, element in header.elements.items()
        }
        try:
            return PlyData.read(path, known_list_len=lengths)
        except PlyElementParseError as broken:
            if broken.element.name == "face" and broken.message == "early end-of-file" and corners == 3:
                raise  # all faces have the same number of corners
        except UnicodeDecodeError:  # a header that is not ASCII
            return None
    return None


def _by_value(path: Path, header: PlyHeader) -> PlyData:
    """Any file, much slower. From memory, so that nothing is allocated for an invalid list that claims to extend beyond
    the end."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # numpy's warning about empty lists
        return PlyData.read(BytesIO(header.text + read_bytes(path)[len(header.text) :]))


def scalar(path: Path, table: Table, name: str) -> Column:
    """A property with one number per vertex, shape (n,); raises FormatError if it is missing."""
    column = table.get(name)
    if column is None or not is_scalar(column):
        raise FormatError(f"{path}: the PLY vertex element has no property {name!r} of one number")
    return np.asarray(column)


def is_scalar(column: Column) -> bool:
    """Return whether a property has one number per row, not lists."""
    return column.ndim == 1 and column.dtype != np.object_


def describes_splats(header: PlyHeader) -> bool:
    """Return whether a PLY header describes Gaussians, not a mesh."""
    names = header.properties("vertex")
    return "packed_position" in names or {"f_dc_0", "opacity"} <= names


def read_ply(path: Path) -> RawMesh:
    """Read a PLY mesh of triangles or polygons."""
    header = read_header(path)
    if "vertex" not in header.elements:
        raise FormatError(f"{path}: the PLY header declares no vertex element")
    if describes_splats(header):  # not a surface: its vertices are centres
        raise InputError(f"{path}: Gaussian splats, not a mesh")
    for name, check in (("vertex", check_vertex_count), ("face", check_face_count)):
        check(path, min(header.counts.get(name, 0), path.stat().st_size))
    tables = read_tables(path, header)
    vertex, face = tables["vertex"], tables.get("face", {})
    vertices = np.stack([scalar(path, vertex, axis) for axis in "xyz"], axis=1).astype(np.float64)
    index = next((face[name] for name in INDEX_NAMES if name in face), None)
    if index is None and header.counts.get("tristrips", 0):
        raise FormatError(f"{path}: its faces are triangle strips, which are not read; save it with a face element")
    if index is None or not len(index):
        raise InputError(f"{path}: no faces ({len(vertices)} vertices): a point cloud, not a mesh")
    if is_scalar(index):
        raise FormatError(f"{path}: the PLY face element has one vertex index per face, expected a list")
    faces, owner = _faces(path, vertices, index)
    face_color = colors_of(face)
    paint = None
    if face_color is not None and colors_of(vertex) is None:
        count = len(faces)
        paint = Paint(face_color[owner], np.full(count, -1, dtype=np.int32), np.zeros((count, 3, 2)), ())
    textures = dict.fromkeys(match.group(1).decode().strip() for match in TEXTURE.finditer(header.text))
    notes = (f"texture {name!r} of a PLY is not read; save the mesh as OBJ or GLB to keep it" for name in textures)
    return unnamed_mesh(path, vertices, faces, colors=colors_of(vertex), paint=paint, notes=tuple(notes))


def _faces(path: Path, vertices: NDArray[np.float64], index: Column) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Triangles (t, 3) and the polygon (t,) from which each was cut."""
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
            raise FormatError(f"{path}: a face uses vertex {polygons[wrong][0]}, the file has {len(vertices)}{more}")
        triples, owner = triangulate(vertices, polygons)
        faces.append(np.take_along_axis(polygons[owner], triples, axis=1))
        owners.append(numbers[owner])
    if not faces:
        raise InputError(f"{path}: {len(lengths)} faces, none with three corners; a surface is needed")
    owner = np.concatenate(owners)
    order = np.argsort(owner, kind="stable")
    return np.concatenate(faces)[order], owner[order]


def colors_of(table: Table) -> NDArray[np.uint8] | None:
    """Colours of an element as bytes; None if it has none."""
    for names in (("red", "green", "blue"), ("r", "g", "b"), ("diffuse_red", "diffuse_green", "diffuse_blue")):
        if all(name in table and is_scalar(table[name]) for name in names):
            channels = np.stack([np.asarray(table[name]) for name in names], axis=1)
            levels = channels.astype(np.float64)
            if channels.dtype.kind == "f" and np.nanmax(levels, initial=0.0) <= 1.0:
                levels *= 255.0
            return np.clip(np.rint(levels), 0, 255).astype(np.uint8)
    return None
