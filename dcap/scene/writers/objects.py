"""Writes objects as GLB (a named node per part, y up as required), OBJ or PLY (one mesh, z up as given).

Vertex colours are the sRGB bytes of the mesh. Same input, same bytes.
"""

from collections.abc import Sequence
from pathlib import Path

import trimesh
from trimesh.exchange.obj import export_obj

from dcap.scene.errors import InputError
from dcap.scene.types.mesh import Mesh
from dcap.scene.writers.glb import Node, glb_bytes
from dcap.scene.writers.interiorgs import write_ply


def write_object(path: Path, parts: Sequence[tuple[str, Mesh]]) -> None:
    """Write named parts; the suffix determines the format."""
    path.parent.mkdir(parents=True, exist_ok=True)
    whole = Mesh.concatenate([mesh for _, mesh in parts])
    if path.suffix == ".glb":
        path.write_bytes(glb_bytes([Node(name, mesh) for name, mesh in parts]))
    elif path.suffix == ".ply":
        write_ply(path, whole)
    elif path.suffix == ".obj":
        path.write_text(_obj(whole), encoding="ascii")
    else:
        raise InputError(f"{path}: objects are written as .glb, .obj or .ply, not {path.suffix!r}")


def _obj(mesh: Mesh) -> str:
    """Vertices followed by colours 0..1, the form of many tools."""
    colored = trimesh.Trimesh(mesh.vertices, mesh.faces, vertex_colors=mesh.colors, process=False)
    return str(export_obj(colored, include_normals=False, digits=6, header=None))  # type: ignore[no-untyped-call]
