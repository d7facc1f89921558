"""Surfaces as a graphics card draws them: vertices split along sharp edges, and no more faces than it can take.

In: meshes of the pipeline. Out: `DrawnSurface`, and its bytes as a GLB. The GLB keeps the world's axes (z up): the
viewer takes it as it is, and averages normals over the faces at a vertex itself. Source: Khronos, "glTF 2.0
Specification", sections 3.6, 3.7 and 3.9.
"""

import json
import struct
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from dcap.geometry.boundary import welded
from dcap.scene.types.mesh import Mesh

SHARP_COS = float(np.cos(np.radians(40.0)))
"""Faces that meet at more than this angle have an edge between them."""
ALIKE = 32
"""Vertices at one place whose colours differ by more stay two: a border of colours [0..255]."""
MOST_ROUNDS = 20
"""Rounds in which cells grow until few enough faces are left [-]."""
GROWTH = 1.25
ROUGHNESS, ALBEDO = 1.0, 0.7
"""Of all surfaces; the viewer's own light from above would bleach colours that are taken as they are [-]."""
FLOAT, SHORT, INDEX, VERTICES, INDICES = 5126, 5123, 5125, 34962, 34963
"""glTF's numbers of component types and of buffer targets."""


@dataclass(frozen=True, eq=False, slots=True)
class DrawnSurface:
    """Triangles with normals."""

    vertices: NDArray[np.float32]
    """In the frame of their node [m], shape (n, 3)."""
    normals: NDArray[np.float32]
    """Unit, shape (n, 3)."""
    colors: NDArray[np.uint8]
    """sRGB, shape (n, 3)."""
    faces: NDArray[np.uint32]
    """Shape (m, 3)."""


@dataclass(frozen=True, eq=False, slots=True)
class SmoothMesh:
    """A mesh with one vertex for each side of a sharp edge."""

    mesh: Mesh
    source: NDArray[np.int64]
    """The vertex of the given mesh that each came from, shape (n,)."""

    def moved(self, vertices: NDArray[np.float64], colors: NDArray[np.uint8] | None = None) -> "SmoothMesh":
        """With the given mesh's vertices (k, 3) elsewhere [m], perhaps in other colours: the edges stay."""
        shade = self.mesh.colors if colors is None else colors[self.source]
        return SmoothMesh(Mesh(vertices[self.source], self.mesh.faces, shade), self.source)


def smooth(mesh: Mesh) -> SmoothMesh:
    """Split the vertices where faces meet at a sharp edge, and join those that only the file keeps apart."""
    corner = welded(mesh.vertices)[mesh.faces].astype(np.int64)
    unit = mesh.face_normals
    unit = unit / np.maximum(np.linalg.norm(unit, axis=1, keepdims=True), 1e-300)
    begin, end = corner, np.roll(corner, -1, axis=1)
    key = np.minimum(begin, end) * (corner.max(initial=0) + 1) + np.maximum(begin, end)
    order = np.argsort(key, axis=None, kind="stable")
    one, other = order[:-1], order[1:]
    same = key.ravel()[one] == key.ravel()[other]
    one, other = one[same], other[same]
    gentle = np.einsum("ij,ij->i", unit[one // 3], unit[other // 3]) > SHARP_COS
    one, other = one[gentle], other[gentle]
    after = [3 * (edge // 3) + (edge + 1) % 3 for edge in (one, other)]
    forth = corner.ravel()[one] == corner.ravel()[other]  # neighbours that are wound alike pass an edge back and forth
    first = np.concatenate([one, after[0]])
    second = np.concatenate([np.where(forth, other, after[1]), np.where(forth, after[1], other)])
    colors = mesh.colors[mesh.faces].reshape(-1, 3).astype(np.int16)
    alike = (np.abs(colors[first] - colors[second]) <= ALIKE).all(axis=1)
    count = corner.size
    links = coo_array((np.ones(int(alike.sum()), dtype=np.int8), (first[alike], second[alike])), shape=(count, count))
    group = connected_components(links, directed=False)[1]
    _, place = np.unique(group, return_index=True)
    source = mesh.faces.ravel()[place].astype(np.int64)
    faces = group.reshape(-1, 3).astype(np.int32)
    return SmoothMesh(Mesh(mesh.vertices[source], faces, mesh.colors[source]), source)


def drawn(
    surface: SmoothMesh, faces: NDArray[np.integer] | None = None, normals: NDArray[np.float64] | None = None
) -> DrawnSurface:
    """Some faces (default all) of a surface; `normals` are those of its vertices, if they are known."""
    mesh = surface.mesh
    normals = vertex_normals(mesh) if normals is None else normals
    chosen = mesh.faces if faces is None else mesh.faces[faces]
    used, inverse = np.unique(chosen, return_inverse=True)
    return DrawnSurface(
        mesh.vertices[used].astype(np.float32),
        normals[used].astype(np.float32),
        mesh.colors[used],
        inverse.reshape(-1, 3).astype(np.uint32),
    )


def vertex_normals(mesh: Mesh) -> NDArray[np.float64]:
    """Unit normals as wound, averaged by area over the faces at each vertex; z where there is none, shape (n, 3)."""
    total = np.zeros_like(mesh.vertices)
    for axis, part in enumerate(mesh.face_normals.T):
        for corner in mesh.faces.T:
            total[:, axis] += np.bincount(corner, part, minlength=len(total))
    length = np.linalg.norm(total, axis=1)
    total[length == 0.0] = (0.0, 0.0, 1.0)
    return np.asarray(total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-300))


def towards(mesh: Mesh, point: NDArray[np.float64]) -> Mesh:
    """The mesh with every face wound so that it is seen from a point [m]: a room's shell that is open from outside."""
    away = np.einsum("ij,ij->i", mesh.face_normals, mesh.triangles.mean(axis=1) - point) > 0.0
    faces = mesh.faces.copy()
    faces[away] = faces[away][:, ::-1]
    return Mesh(mesh.vertices, faces, mesh.colors)


def thinned(mesh: Mesh, kept: NDArray[np.bool_], most: int) -> tuple[Mesh, NDArray[np.int64]]:
    """A mesh of about `most` faces, and the face that each came from; faces that are `kept` (m,) stay as they are.

    Vertices are drawn together in the cells of a grid, which grow until few enough faces are left: fast on millions of
    faces, and every face stays one of its instance and part.
    """
    own = np.arange(len(mesh.faces), dtype=np.int64)
    if len(own) <= most:
        return mesh, own
    loose = np.flatnonzero(~kept)
    fixed = np.zeros(len(mesh.vertices), dtype=bool)
    fixed[mesh.faces[kept]] = True
    budget = max(most - int(kept.sum()), 1)
    low = mesh.vertices.min(axis=0)
    size = float(np.sqrt(2.0 * mesh.face_areas[loose].sum() / budget))  # about two faces for each cell of the surface
    for _ in range(MOST_ROUNDS):
        group = groups(mesh.vertices, low, size, fixed)
        faces = group[mesh.faces[loose]]
        a, b, c = faces.T
        left = (a != b) & (b != c) & (c != a)
        if left.sum() <= budget:
            break
        size *= GROWTH
    representative = np.zeros(group.max() + 1, dtype=np.int64)
    representative[group[::-1]] = np.arange(len(group))[::-1]  # the first vertex of each cell
    faces = mesh.faces.astype(np.int64)
    faces[loose] = representative[group[mesh.faces[loose]]]
    chosen = np.sort(np.concatenate([np.flatnonzero(kept), loose[left]]))
    used, inverse = np.unique(faces[chosen], return_inverse=True)
    few = Mesh(mesh.vertices[used], inverse.reshape(-1, 3).astype(np.int32), mesh.colors[used])
    return few, chosen


def groups(
    vertices: NDArray[np.float64], low: NDArray[np.float64], size: float, fixed: NDArray[np.bool_]
) -> NDArray[np.int64]:
    """Number of the cell of each vertex, of their own for those that are fixed, shape (n,)."""
    cell = np.floor((vertices - low) / size).astype(np.int64)
    count = cell.max(axis=0) + 1
    key = (cell[:, 0] * count[1] + cell[:, 1]) * count[2] + cell[:, 2]
    key[fixed] = int(count.prod()) + np.flatnonzero(fixed)
    return np.asarray(np.unique(key, return_inverse=True)[1], dtype=np.int64).reshape(-1)


def linear(colors: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Linear intensities 0..1 of sRGB bytes, of the same shape [IEC 61966-2-1]."""
    share = colors / 255.0
    return np.asarray(np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4))


def glb_of(surface: DrawnSurface, *, opacity: float = 1.0, both_sides: bool = True) -> bytes:
    """One surface as a GLB in the world's axes."""
    count = len(surface.vertices)
    color = np.full((count, 4), 65535, dtype="<u2")
    color[:, :3] = np.round(65535.0 * linear(surface.colors))
    blocks = [
        (surface.vertices.astype("<f4"), FLOAT, "VEC3", VERTICES),
        (surface.normals.astype("<f4"), FLOAT, "VEC3", VERTICES),
        (color, SHORT, "VEC4", VERTICES),
        (surface.faces.astype("<u4").reshape(-1), INDEX, "SCALAR", INDICES),
    ]
    views, accessors, binary = [], [], b""
    for number, (array, component, kind, target) in enumerate(blocks):
        data = array.tobytes()
        views.append({"buffer": 0, "byteOffset": len(binary), "byteLength": len(data), "target": target})
        accessors.append({"bufferView": number, "componentType": component, "count": len(array), "type": kind})
        binary += data  # every element takes a multiple of four bytes
    accessors[0] |= {"min": array_list(surface.vertices.min(axis=0)), "max": array_list(surface.vertices.max(axis=0))}
    accessors[2] |= {"normalized": True}
    material = {
        "pbrMetallicRoughness": {
            "baseColorFactor": [ALBEDO, ALBEDO, ALBEDO, opacity], "metallicFactor": 0.0, "roughnessFactor": ROUGHNESS,
        },
        "doubleSided": both_sides,
    } | ({"alphaMode": "BLEND"} if opacity < 1.0 else {})  # fmt: skip
    primitive = {"attributes": {"POSITION": 0, "NORMAL": 1, "COLOR_0": 2}, "indices": 3, "material": 0}
    document = {
        "asset": {"version": "2.0", "generator": "dcap"}, "scene": 0, "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}], "meshes": [{"primitives": [primitive]}], "materials": [material],
        "accessors": accessors, "bufferViews": views, "buffers": [{"byteLength": len(binary)}],
    }  # fmt: skip
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(binary), b"BIN\0") + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def array_list(array: NDArray[np.float32]) -> list[float]:
    """Numbers for JSON."""
    return [float(one) for one in array]
