"""Writes meshes as binary PLY, from columns of numbers or for the store, as OBJ, and objects in any of these or GLB.

`dcap.scene.readers` reads foreign files. plyfile would write the same bytes, but lists row by row: ten seconds for a
million faces, which every stage saves again (docs/decisions/017). Same input, same bytes.
"""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dcap.scene.errors import InputError
from dcap.scene.types.mesh import Mesh
from dcap.scene.writers.glb import Node, glb_bytes

KINDS = {"u1": "uchar", "i4": "int", "u4": "uint", "f4": "float", "f8": "double"}
"""PLY names of numpy's types."""

Columns = Mapping[str, NDArray[np.generic]]
"""Columns of numbers by the names of their properties."""

HEADER_END = b"end_header\n"

VERTEX = np.dtype([("position", "<f8", 3), ("color", "u1", 3)])
FACE = np.dtype([("count", "u1"), ("indices", "<i4", 3)])


def ply_bytes(elements: Mapping[str, Columns], comments: Sequence[str] = ()) -> bytes:
    """A little-endian file of elements by name.

    An element maps names of properties, separated by blanks, to their columns (n, k), and `list NAME` to a list of k
    per row.
    """
    lines, body = ["ply", "format binary_little_endian 1.0", *(f"comment {one}" for one in comments)], b""
    for element, columns in elements.items():
        count = len(next(iter(columns.values())))
        lines.append(f"element {element} {count}")
        fields: dict[str, NDArray[np.generic]] = {}
        for names, values in columns.items():
            if not names:  # no column
                continue
            kind = KINDS[values.dtype.str[1:]]
            if names.startswith("list "):
                lines.append(f"property list uchar {kind} {names.removeprefix('list ')}")
                fields[f"length of {names}"] = np.full((count, 1), values.shape[1], dtype=np.uint8)
            else:
                lines += [f"property {kind} {name}" for name in names.split()]
            fields[names] = values
        rows = np.empty(count, [(name, one.dtype.newbyteorder("<"), one.shape[1:]) for name, one in fields.items()])
        for name, one in fields.items():
            rows[name] = one
        body += rows.tobytes()
    return "\n".join([*lines, ""]).encode("ascii") + HEADER_END + body


def write_ply(path: Path, mesh: Mesh, comments: Sequence[str] = ()) -> None:
    """Write a binary PLY with vertex normals and colours, with the properties that Open3D writes."""
    place: NDArray[np.float64] = np.hstack([mesh.vertices, mesh.vertex_normals])
    vertex: Columns = {"x y z nx ny nz": place, "red green blue": mesh.colors}
    face: Columns = {"list vertex_indices": mesh.faces.astype(np.uint32)}
    path.write_bytes(ply_bytes({"vertex": vertex, "face": face}, comments))


def write_object(path: Path, parts: Sequence[tuple[str, Mesh]]) -> None:
    """Write named parts as GLB (a node per part, y up as required), OBJ or PLY (one mesh, z up), by the suffix."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix == ".glb":
        path.write_bytes(glb_bytes([Node(name, mesh) for name, mesh in parts]))
        return
    whole = Mesh.concatenate([mesh for _, mesh in parts])
    if path.suffix == ".ply":
        write_ply(path, whole)
    elif path.suffix == ".obj":
        path.write_bytes(obj_bytes(whole))
    else:
        raise InputError(f"{path}: objects are written as .glb, .obj or .ply, not {path.suffix!r}")


def mesh_to_ply(mesh: Mesh) -> bytes:
    """A mesh with double positions, so that nothing is lost."""
    vertex: Columns = {"x y z": mesh.vertices, "red green blue": mesh.colors}
    face: Columns = {"list vertex_indices": mesh.faces.astype(np.int32, copy=False)}
    return ply_bytes({"vertex": vertex, "face": face}, ["metres, right-handed, z up"])


def mesh_from_ply(data: bytes) -> Mesh:
    """The mesh that `mesh_to_ply` wrote."""
    start = data.index(HEADER_END) + len(HEADER_END)
    counts = [int(line.split()[2]) for line in data[:start].splitlines() if line.startswith(b"element")]
    vertices = np.frombuffer(data, VERTEX, counts[0], start)
    faces = np.frombuffer(data, FACE, counts[1], start + vertices.nbytes)
    return Mesh(vertices["position"].copy(), faces["indices"].copy(), vertices["color"].copy())


def obj_bytes(mesh: Mesh) -> bytes:
    """A mesh with its vertex colours after the positions [m], the form that most readers accept."""
    colors = mesh.colors / 255.0
    rows = zip(mesh.vertices.tolist(), colors.tolist(), strict=True)
    lines = [f"v {x:.6f} {y:.6f} {z:.6f} {r:.3f} {g:.3f} {b:.3f}" for (x, y, z), (r, g, b) in rows]
    return joined([*lines, *faces_of(mesh)])


def shape_bytes(mesh: Mesh) -> bytes:
    """A mesh without colours, for collisions."""
    return joined([*(f"v {x:.7f} {y:.7f} {z:.7f}" for x, y, z in mesh.vertices.tolist()), *faces_of(mesh)])


def faces_of(mesh: Mesh) -> Iterable[str]:
    """Lines of the faces, counted from one."""
    return (f"f {a} {b} {c}" for a, b, c in (mesh.faces + 1).tolist())


def joined(lines: list[str]) -> bytes:
    """Lines as the bytes of a file."""
    return ("\n".join(lines) + "\n").encode("ascii")
