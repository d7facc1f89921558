"""Wavefront OBJ of triangles: positions with vertex colours, or positions alone."""

from collections.abc import Iterable

from dcap.scene.types.mesh import Mesh


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
