"""Wavefront OBJ meshes: any polygons, negative indices, vertex colours, objects, groups, MTL colours and textures.

Every index is checked; polygons are kept whole until `triangulate` cuts them, so quads are never lost.
"""

import re
from codecs import BOM_UTF8, BOM_UTF16_BE, BOM_UTF16_LE
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dcap.scene.errors import FormatError, InputError, format_error
from dcap.scene.readers.files import library_names, meanings, read_bytes
from dcap.scene.readers.mesh.mtl import MtlMaterial, read_mtl, with_materials
from dcap.scene.readers.mesh.raw import RawMesh, check_face_count, check_vertex_count, triangulate
from dcap.scene.text import short_name
from dcap.scene.types.mesh import Paint

CORNER = re.compile(rb"-?\d{1,18}(?:/(?:-?\d{1,18})?){0,2}")
"""One corner of a face: position, texture coordinate and normal."""
NUMERIC = (b"v", b"vt", b"f")
"""Lines that may end in a comment; a name may contain the sign."""
SHOWN = 80
"""Maximum length of a broken line in a message [characters]."""
TOLD = 3
"""Maximum number of missing materials named in a message."""


@dataclass
class Lines:
    """The file's lines by kind, in file order, without their keyword."""

    vertex: list[bytes] = field(default_factory=list)
    texture: list[bytes] = field(default_factory=list)
    face: list[bytes] = field(default_factory=list)
    face_line: list[int] = field(default_factory=list)
    """Line number of each face, for messages."""
    seen: list[tuple[int, int]] = field(default_factory=list)
    """Number of vertices and texture coordinates read before each face (negative indices count from there)."""
    switches: dict[str, list[tuple[int, str]]] = field(default_factory=lambda: {"o": [], "g": [], "usemtl": []})
    """(first face, name) of every object, group and material."""


def read_obj(path: Path, *, all_maps: bool = False) -> RawMesh:
    """Read an OBJ file with the MTL and images next to it.

    `all_maps`: also read transparency, factors, further maps and names of materials, in addition to colours.
    """
    data = read_bytes(path)
    if data.startswith((BOM_UTF16_LE, BOM_UTF16_BE)):
        raise FormatError(f"{path}: its text is UTF-16; save it as UTF-8")
    data = data.removeprefix(BOM_UTF8)
    lines = _sort_lines(data)
    check_face_count(path, len(lines.face))
    check_vertex_count(path, max(len(lines.vertex), len(lines.texture)))
    numbers = _numbers(path, data, "v", lines.vertex, 3)
    vertices = numbers[:, :3].copy()
    if not len(vertices) or not lines.face:
        raise InputError(f"{path}: no faces ({len(vertices)} vertices); a surface is needed")
    uv = _numbers(path, data, "vt", lines.texture, 1)
    faces, face_uv, owner = _faces(path, lines, vertices, len(uv))
    named = lines.switches["o"] or lines.switches["g"]
    face_node, names = _spread(named, len(lines.face))
    notes: list[str] = []
    library: dict[str, MtlMaterial] = {}
    for name in library_names(path.parent, data):
        library |= read_mtl(path.parent, name, notes, all_maps=all_maps)
    library = _used_materials(lines, library, notes)
    paint = _paint(lines, library, uv, face_uv, owner)
    if all_maps and paint is not None:
        has_uv = (face_uv >= 0).all(axis=1) & (uv.shape[1] >= 2)
        paint = with_materials(paint, library, *_spread(lines.switches["usemtl"], len(lines.face)), owner, has_uv)
    return RawMesh(
        path=path, vertices=vertices, faces=faces, colors=_vertex_colors(numbers), paint=paint,
        face_node=face_node[owner], node_names=names, up="", unit_metres=0.0, notes=tuple(notes),
    )  # fmt: skip


def _statements(data: bytes) -> Iterator[tuple[int, bytes, bytes]]:
    """Line number, keyword and the rest of every line; a line that ends in a backslash continues on the next."""
    text = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n").replace(b"\\\n", b" ")
    for number, line in enumerate(text.split(b"\n"), start=1):
        key, _, rest = line.strip().replace(b"\t", b" ").partition(b" ")
        yield number, key, rest.partition(b"#")[0] if key in NUMERIC else rest


def _sort_lines(data: bytes) -> Lines:
    """Split the text and sort its lines by keyword."""
    lines = Lines()
    for number, key, rest in _statements(data):
        if key == b"v":
            lines.vertex.append(rest)
        elif key == b"vt":
            lines.texture.append(rest)
        elif key == b"f":
            lines.face.append(rest)
            lines.face_line.append(number)
            lines.seen.append((len(lines.vertex), len(lines.texture)))
        elif key in (b"o", b"g", b"usemtl"):
            lines.switches[key.decode()].append((len(lines.face), short_name(rest.strip().decode("utf-8", "replace"))))
    return lines


def _numbers(path: Path, data: bytes, keyword: str, rows: list[bytes], least: int) -> NDArray[np.float64]:
    """Rows of at least `least` numbers as one array; rows of unequal length are cut to the shortest."""
    if not rows:
        return np.zeros((0, least))
    counts = [len(row.split()) for row in rows]
    width = min(counts)
    try:
        if least <= width == max(counts):
            return np.array(b" ".join(rows).split(), dtype=np.float64).reshape(-1, width)
        if least <= width:
            return np.array([row.split()[:width] for row in rows], dtype=np.float64)
    except ValueError:
        pass
    at = (number for number, key, _ in _statements(data) if key == keyword.encode())
    faults = ((number, _fault(row, keyword, least)) for number, row in zip(at, rows, strict=True))
    line, what = next((number, what) for number, what in faults if what)
    raise format_error(path, what, line=line)


def _fault(row: bytes, keyword: str, least: int) -> str:
    """Fault in a row of at least `least` numbers; empty if it is sound."""
    words = row.split()
    if len(words) < least:
        return f"{keyword!r} has {len(words)} values, expected {least}"
    try:
        np.array(words, dtype=np.float64)
    except ValueError:
        text = " ".join(word.decode("latin-1") for word in words)
        return f"{text!r} in a {keyword!r} line is not all numbers"
    return ""


def _vertex_colors(numbers: NDArray[np.float64]) -> NDArray[np.uint8] | None:
    """Colours written after the position, 0..1 or 0..255."""
    if numbers.shape[1] < 6:
        return None
    values = numbers[:, -3:]
    return np.clip(np.rint(values * (255.0 if np.nanmax(values) <= 1.0 else 1.0)), 0, 255).astype(np.uint8)


def _faces(
    path: Path, lines: Lines, vertices: NDArray[np.float64], uv_count: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Triangles (t, 3), their texture coordinate indices (t, 3; -1 for none) and their face line (t,)."""
    corners = np.array([len(row.split()) for row in lines.face])
    if (corners < 3).any():
        bad = int(np.argmax(corners < 3))
        raise format_error(path, f"a face of {corners[bad]} corners", line=lines.face_line[bad])
    check_face_count(path, int((corners - 2).sum()))
    parts = [(np.zeros((0, 3), np.int64), np.zeros((0, 3), np.int64), np.zeros(0, np.int64))]
    for count in np.unique(corners):
        numbers = np.flatnonzero(corners == count)
        index = _indices(path, lines, numbers, int(count))
        position, wrong = _resolved(lines, numbers, index[..., 0], len(vertices), 0)
        if wrong.any():
            row = int(np.argmax(wrong.any(axis=1)))
            what = f"a face uses vertex {index[row, wrong[row], 0][0]}, the file has {len(vertices)}"
            raise format_error(path, what, line=lines.face_line[numbers[row]])
        texture, absent = _resolved(lines, numbers, index[..., 1], uv_count, 1)
        texture = np.where(absent, -1, texture)
        triples, polygon = triangulate(vertices, position)
        position, texture = (np.take_along_axis(of[polygon], triples, axis=1) for of in (position, texture))
        parts.append((position, texture, numbers[polygon]))
    owner = np.concatenate([part[2] for part in parts])
    order = np.argsort(owner, kind="stable")
    return np.concatenate([p[0] for p in parts])[order], np.concatenate([p[1] for p in parts])[order], owner[order]


def _indices(path: Path, lines: Lines, numbers: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """Position and texture indices as written (0: absent), shape (faces, count, 2)."""
    rows = [lines.face[i] for i in numbers]
    text = b" ".join(rows)
    tokens = text.split()
    slashes = tokens[0].count(b"/")
    same = text.count(b"/") == slashes * len(tokens) and all(t.count(b"/") == slashes for t in tokens)
    if same and b"/ " not in text + b" ":
        try:
            flat = np.array(text.replace(b"//", b"/0/").replace(b"/", b" ").split(), dtype=np.int64)
            table = flat.reshape(len(rows), count, slashes + 1)
            return table[..., :2] if slashes else np.concatenate([table, np.zeros_like(table)], axis=-1)
        except (ValueError, OverflowError):
            pass
    for i, row in zip(numbers, rows, strict=True):
        if not all(CORNER.fullmatch(token) for token in row.split()):
            shown = row[:SHOWN].decode("latin-1")
            raise format_error(path, f"face {shown!r} is not understood", line=lines.face_line[i])
    pairs = [[int(word or 0) for word in [*t.split(b"/"), b""][:2]] for t in tokens]
    return np.array(pairs, dtype=np.int64).reshape(-1, count, 2)


def _resolved(
    lines: Lines, numbers: NDArray[np.int64], index: NDArray[np.int64], count: int, kind: int
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """0-based indices from 1-based and negative ones, and the mask of those that do not exist in the file."""
    resolved = index - 1
    if (index < 0).any():
        seen = np.array([lines.seen[i][kind] for i in numbers])[:, None]
        resolved = np.where(index < 0, seen + index, resolved)
    return resolved, (resolved >= count) | (resolved < 0)


def _spread(switches: list[tuple[int, str]], count: int) -> tuple[NDArray[np.int32], tuple[str, ...]]:
    """Name index per face (-1 before the first switch) and the names in order of appearance."""
    number = {"": -1}
    for _, name in switches:
        number.setdefault(name, len(number) - 1)
    starts = np.array([0, *(start for start, _ in switches), count])
    index = np.array([-1, *(number[name] for _, name in switches)], dtype=np.int32)
    return np.repeat(index, np.diff(starts)), tuple(name for name in number if name)


def _used_materials(lines: Lines, library: Mapping[str, MtlMaterial], notes: list[str]) -> dict[str, MtlMaterial]:
    """Materials by the names under which faces use them; a note lists those that no library has.

    A comment may follow either name, but "Material #25" is not "Material #26".
    """
    if not library:
        return {}
    exact = {short_name(name): one for name, one in library.items()}
    times = Counter(name for full in exact for name in meanings(full)[1:])
    bare = {name: one for full, one in exact.items() for name in meanings(full)[1:] if times[name] == 1}
    known = bare | exact
    found = {}
    names = dict.fromkeys(name for _, name in lines.switches["usemtl"] if name)
    for name in names:
        one = known.get(name) or next((exact[short] for short in meanings(name)[1:] if short in exact), None)
        if one is not None:
            found[name] = one
    missing = [repr(name) for name in names if name not in found]
    if missing:
        more = f" and {len(missing) - TOLD} more" if len(missing) > TOLD else ""
        notes.append(f"no MTL file has the material {', '.join(missing[:TOLD])}{more}: grey is used")
    return found


def _paint(
    lines: Lines,
    library: dict[str, MtlMaterial],
    uv: NDArray[np.float64],
    face_uv: NDArray[np.int64],
    owner: NDArray[np.int64],
) -> Paint | None:
    """Material colours and textures of the faces; None if the file names no existing material."""
    material_index, names = _spread(lines.switches["usemtl"], len(lines.face))
    if not names or not library:
        return None
    plain = MtlMaterial()
    materials = [library.get(name, plain) for name in names] + [plain]
    textures = tuple(m.texture for m in materials if m.texture is not None)
    numbers = np.cumsum([m.texture is not None for m in materials]) - 1
    slot = np.array(
        [n if m.texture is not None else -1 for n, m in zip(numbers, materials, strict=True)], dtype=np.int32
    )
    face_material = material_index[owner]
    has_uv = (face_uv >= 0).all(axis=1) & (uv.shape[1] >= 2)
    return Paint(
        face_color=np.array([m.color for m in materials], dtype=np.uint8)[face_material],
        face_texture=np.where(has_uv, slot[face_material], -1).astype(np.int32),
        corner_uv=uv[face_uv, :2] if uv.shape[1] >= 2 and len(uv) else np.zeros((len(face_uv), 3, 2)),
        textures=textures,
    )
