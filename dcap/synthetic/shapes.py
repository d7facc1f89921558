"""Closed parametric solids (rounded boxes, lofts, lathes, tubes, lenses), and pieces made of them.

Every solid is a closed manifold with outward normals, centred on the origin unless its docstring says otherwise, in
metres, z up. Colours are a neutral grey until `dcap.synthetic.paint` colours them. `edge` is the wanted length
of a triangle edge [m].

A piece of furniture or an object: labelled, made of named parts, each of one or more closed solids.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import manifold3d
import numpy as np
from numpy.typing import NDArray

from dcap.arrays import Array
from dcap.scene.types.mesh import Mesh

Size = tuple[float, float, float]
"""Width, depth and height [m]."""


def outward(mesh: Mesh) -> Mesh:
    """The same closed mesh with faces turned so that its volume is positive."""
    if volume(mesh) >= 0.0:
        return mesh
    return replace(mesh, faces=np.ascontiguousarray(mesh.faces[:, ::-1]))


def volume(mesh: Mesh) -> float:
    """Signed volume of a closed mesh by the divergence theorem [m^3]."""
    a, b, c = mesh.triangles.transpose(1, 0, 2)
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0)


def warped(mesh: Mesh, change: Callable[[Array], Array]) -> Mesh:
    """The mesh with its vertices (n, 3) mapped by `change`."""
    return replace(mesh, vertices=np.ascontiguousarray(change(mesh.vertices)))


def rotation(axis: str, degrees: float) -> Array:
    """Rotation about a coordinate axis, shape (3, 3)."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    first, second = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    matrix = np.eye(3)
    matrix[first, first] = matrix[second, second] = c
    matrix[first, second], matrix[second, first] = -s, s
    return matrix


def turned(mesh: Mesh, axis: str, degrees: float) -> Mesh:
    """The mesh rotated about a coordinate axis through the origin."""
    return replace(mesh, vertices=mesh.vertices @ rotation(axis, degrees).T)


def moved(mesh: Mesh, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Mesh:
    """The mesh shifted [m]."""
    return replace(mesh, vertices=mesh.vertices + np.array([x, y, z]))


def scaled(mesh: Mesh, x: float, y: float, z: float) -> Mesh:
    """The mesh stretched along the axes by positive factors."""
    return replace(mesh, vertices=mesh.vertices * np.array([x, y, z]))


def joined(meshes: Sequence[Mesh]) -> Mesh:
    """Several solids in one mesh, unchanged."""
    return Mesh.concatenate(list(meshes))


# ---- grids -----------------------------------------------------------------------------------------------------


def columns(*parts: Array) -> Array:
    """Coordinates side by side: (n,) or (n, k) each, shape (n, sum of k)."""
    return np.column_stack(parts)


def line(low: float, high: float, edge: float) -> Array:
    """Evenly spaced numbers from low to high, no further apart than `edge`."""
    return np.linspace(low, high, max(2, int(np.ceil((high - low) / edge - 1e-9)) + 1))


def rounded_nodes(half: float, radius: float, edge: float) -> Array:
    """Node planes over [-half, half] whose outer `radius` becomes a quarter circle of equal steps [m]."""
    steps = int(np.clip(np.ceil(radius * np.pi / 4 / edge), 1, 6))
    arc = radius * np.tan(np.linspace(0.0, np.pi / 4, steps + 1)[1:])
    inner = half - radius
    middle = line(-inner, inner, edge) if inner > 1e-9 else np.zeros(1)
    return np.concatenate([(-inner - arc)[::-1], middle, inner + arc])


def grid_surface(x: Array, y: Array, z: Array) -> Mesh:
    """Surface of the box spanned by node planes; vertices lie on the grid."""
    shape = (len(x), len(y), len(z))
    index = np.arange(int(np.prod(shape))).reshape(shape)
    sheets = [index[0].T, index[-1], index[:, 0], index[:, -1].T, index[:, :, 0].T, index[:, :, -1]]
    quads = np.concatenate([_quads(sheet) for sheet in sheets])
    used, faces = np.unique(quads, return_inverse=True)
    grid = np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1).reshape(-1, 3)
    return outward(Mesh.of(grid[used], faces.reshape(-1, 3)))


def _quads(index: NDArray[np.int64]) -> NDArray[np.int64]:
    """Two triangles per cell of a 2D index array, diagonals alternating, shape (m, 3)."""
    a, b, c, d = (part.ravel() for part in (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]))
    odd = (np.indices((index.shape[0] - 1, index.shape[1] - 1)).sum(axis=0) % 2).astype(bool).ravel()
    first = np.where(odd[:, None], np.c_[a, b, d], np.c_[a, b, c])
    second = np.where(odd[:, None], np.c_[b, c, d], np.c_[a, c, d])
    return np.concatenate([first, second])


def sheet(u: Array, v: Array, place: Callable[[Array, Array], Array]) -> Mesh:
    """An open surface over the parameter grid u x v; `place` maps flat (n,), (n,) to (n, 3)."""
    index = np.arange(len(u) * len(v)).reshape(len(u), len(v))
    grid_u, grid_v = np.meshgrid(u, v, indexing="ij")
    return Mesh.of(place(grid_u.ravel(), grid_v.ravel()), _quads(index))


# ---- boxes and balls -------------------------------------------------------------------------------------------


def rounded_box(size: Sequence[float], radius: float, edge: float = 0.025) -> Mesh:
    """A box of the given outer size whose edges and corners are rounded."""
    half = np.asarray(size, dtype=float) / 2
    radius = float(min(radius, half.min() * 0.999))
    mesh = grid_surface(*(rounded_nodes(h, radius, edge) for h in half))
    core = np.clip(mesh.vertices, radius - half, half - radius)
    direction = mesh.vertices - core
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return replace(mesh, vertices=core + radius * direction)


def sphere(radius: float, edge: float = 0.01) -> Mesh:
    """A ball, meshed as a rounded cube without poles."""
    steps = int(np.clip(np.ceil(radius * np.pi / 2 / edge), 4, 64))
    nodes = np.tan(np.linspace(-np.pi / 4, np.pi / 4, steps + 1))
    mesh = grid_surface(nodes, nodes, nodes)
    return replace(mesh, vertices=radius * mesh.vertices / np.linalg.norm(mesh.vertices, axis=1, keepdims=True))


def ellipsoid(radii: Sequence[float], edge: float = 0.01) -> Mesh:
    """An ellipsoid with the given half axes."""
    return scaled(sphere(1.0, edge / float(np.mean(radii))), *(float(r) for r in radii))


def cushioned(mesh: Mesh, top: float, bottom: float = 0.0) -> Mesh:
    """A box-like mesh whose upper and lower side are crowned outwards by `top` and `bottom` [m]."""
    low, high = mesh.bounds
    center, half = (low + high) / 2, (high - low) / 2

    def change(points: Array) -> Array:
        u, v, w = ((points - center) / half).T
        dome = (1 - np.abs(u) ** 2.4) * (1 - np.abs(v) ** 2.4)
        lift = np.where(w > 0, top * np.clip(w, 0, 1), bottom * np.clip(w, -1, 0)) * dome
        return points + columns(np.zeros_like(lift), np.zeros_like(lift), lift)

    return warped(mesh, change)


def lens(half_x: float, half_y: float, upper: float, lower: float, pinch: float = 0.08, edge: float = 0.02) -> Mesh:
    """A puffed pillow: two sheets joined at a thin rim with drawn-in sides; heights `upper`, `lower` [m].

    Rim at z = 0. The lower side is flatter than the upper one, so that the pillow lies flat.
    """
    nodes = [np.sin(line(-np.pi / 2, np.pi / 2, edge / half * np.pi / 2)) for half in (half_x, half_y)]
    mesh = grid_surface(nodes[0], nodes[1], np.array([-1.0, 0.0, 1.0]))

    def change(points: Array) -> Array:
        u, v, side = points.T
        fall = np.clip((1 - u**2) * (1 - v**2), 0.0, 1.0)
        height = np.where(side > 0, upper * fall**0.42, -lower * fall**0.25)
        rim = 0.006 * side  # a seam: the sheets are 12 mm apart at the rim
        x = half_x * u * (1 - pinch * (1 - v**2) * u**2)
        y = half_y * v * (1 - pinch * (1 - u**2) * v**2)
        bulge = 1 + 0.012 * (side == 0)
        return columns(x * bulge, y * bulge, np.where(side == 0, 0.0, height + rim))

    return outward(warped(mesh, change))


# ---- lofts -----------------------------------------------------------------------------------------------------


def loft(rings: Array, start: Array | None, end: Array | None) -> Mesh:
    """Rings (k, m, 3) joined one after the other; each end closed with a pole, or first to last ring if both None."""
    level_count, ring_count = rings.shape[:2]
    index = np.arange(level_count * ring_count).reshape(level_count, ring_count)
    if start is None or end is None:
        index = np.vstack([index, index[:1]])
    wrapped = np.hstack([index, index[:, :1]])
    faces, vertices = [_quads(wrapped)], [rings.reshape(-1, 3)]
    if start is not None and end is not None:
        first, last, poles = wrapped[0], wrapped[-1], level_count * ring_count
        faces.append(np.c_[np.full(ring_count, poles), first[:-1], first[1:]])
        faces.append(np.c_[np.full(ring_count, poles + 1), last[1:], last[:-1]])
        vertices.append(np.stack([start, end]))
    return outward(Mesh.of(np.concatenate(vertices), np.concatenate(faces)))


def resampled(points: Array, edge: float) -> Array:
    """A polyline with extra points so that no piece is longer than `edge`; corners are kept."""
    pieces = [np.linspace(a, b, max(2, int(np.ceil(np.linalg.norm(b - a) / edge - 1e-9)) + 1))[:-1]
              for a, b in pairwise(points)]  # fmt: skip
    return np.concatenate([*pieces, points[-1:]])


def smoothed(points: Array, rounds: int = 2) -> Array:
    """Corner cutting (Chaikin 1974) that keeps both end points."""
    for _ in range(rounds):
        a, b = points[:-1], points[1:]
        cut = np.stack([0.75 * a + 0.25 * b, 0.25 * a + 0.75 * b], axis=1).reshape(-1, points.shape[1])
        points = np.concatenate([points[:1], cut[1:-1], points[-1:]])
    return points


def lathe(profile: Sequence[Sequence[float]], edge: float = 0.02, *, smooth: int = 0, segments: int = 0) -> Mesh:
    """A solid of revolution about z of the (radius, z) polyline.

    The polyline runs from axis to axis (both radii 0), or is the outline of a ring (neither is 0).
    """
    points = resampled(smoothed(np.asarray(profile, dtype=float), smooth), edge)
    on_axis = points[0, 0] <= 1e-9 and points[-1, 0] <= 1e-9
    count = segments or int(np.clip(np.ceil(2 * np.pi * points[:, 0].max() / edge), 12, 120))
    angle = np.arange(count) * (2 * np.pi / count)
    levels = points[1:-1] if on_axis else _opened(points)
    rings = np.stack([levels[:, :1] * np.cos(angle), levels[:, :1] * np.sin(angle),
                      np.broadcast_to(levels[:, 1:], (len(levels), count))], axis=-1)  # fmt: skip
    if not on_axis:
        return loft(rings, None, None)
    return loft(rings, np.array([0.0, 0.0, points[0, 1]]), np.array([0.0, 0.0, points[-1, 1]]))


def _opened(points: Array) -> Array:
    """The outline without a repeated last point."""
    return points[:-1] if np.allclose(points[0], points[-1]) else points


def tube(path: Sequence[Sequence[float]] | Array, radius: float | Array, edge: float = 0.02, *, round_ends: bool = True,
         segments: int = 0) -> Mesh:  # fmt: skip
    """A round bar along a polyline (k, 3); `radius` is one number or one per point."""
    points = np.asarray(path, dtype=float)
    radii = np.broadcast_to(np.asarray(radius, dtype=float), (len(points),)).copy()
    tangents = np.gradient(points, axis=0)
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    if round_ends:
        points, radii, tangents = _with_round_ends(points, radii, tangents)
    count = segments or int(np.clip(np.ceil(2 * np.pi * radii.max() / edge), 8, 48))
    side = _frames(tangents)
    up = np.cross(tangents, side)
    angle = np.arange(count) * (2 * np.pi / count)
    offset = side[:, None] * np.cos(angle)[:, None] + up[:, None] * np.sin(angle)[:, None]
    rings = points[:, None] + radii[:, None, None] * offset
    cap = 0.08 * radii[[0, -1], None] if round_ends else 0.0
    ends = points[[0, -1]] + np.array([[-1.0], [1.0]]) * tangents[[0, -1]] * cap
    return loft(rings, ends[0], ends[1])


def _with_round_ends(points: Array, radii: Array, tangents: Array) -> tuple[Array, Array, Array]:
    """The path with two shrinking rings beyond each end, so that the bar ends in a dome."""
    lift, shrink = np.array([0.6, 0.92]), np.array([0.8, 0.39])
    head = points[0] - tangents[0] * (lift[::-1, None] * radii[0])
    tail = points[-1] + tangents[-1] * (lift[:, None] * radii[-1])
    return (
        np.concatenate([head, points, tail]),
        np.concatenate([shrink[::-1] * radii[0], radii, shrink * radii[-1]]),
        np.concatenate([tangents[[0, 0]], tangents, tangents[[-1, -1]]]),
    )


def _frames(tangents: Array) -> Array:
    """One unit vector normal to each tangent, carried along without twist, shape (k, 3)."""
    start = np.eye(3)[int(np.argmin(np.abs(tangents[0])))]
    sides = []
    for tangent in tangents:
        start = start - tangent * (start @ tangent)
        start = start / np.linalg.norm(start)
        sides.append(start)
    return np.array(sides)


def rounded_rings(levels: Sequence[Sequence[float]], count: int, exponent: float = 4.0) -> Array:
    """Superellipse rings for rows (half_x, half_y, z), shape (k, count, 3)."""
    angle = np.arange(count) * (2 * np.pi / count)
    c, s = np.cos(angle), np.sin(angle)
    x = np.sign(c) * np.abs(c) ** (2 / exponent)
    y = np.sign(s) * np.abs(s) ** (2 / exponent)
    return np.stack([np.c_[a * x, b * y, np.full(count, z)] for a, b, z in levels])


def bar(start: Sequence[float], end: Sequence[float], radius: float, edge: float = 0.025, taper: float = 1.0) -> Mesh:
    """A straight round bar with flat ends; `taper` is the end's radius over the start's."""
    path = resampled(np.array([start, end], dtype=float), edge)
    return tube(path, np.linspace(radius, radius * taper, len(path)), edge, round_ends=False)


# ---- boolean operations ----------------------------------------------------------------------------------------


def _manifold(mesh: Mesh) -> manifold3d.Manifold:
    properties = np.hstack([mesh.vertices, mesh.colors.astype(float)]).astype(np.float32)
    return manifold3d.Manifold(manifold3d.Mesh(properties, mesh.faces.astype(np.uint32)))


def _mesh(solid: manifold3d.Manifold) -> Mesh:
    """Convert back to one vertex per position: copies that only differ in colour are merged."""
    result = solid.to_mesh()
    target = np.arange(len(result.vert_properties))
    target[np.asarray(result.merge_from_vert, dtype=np.int64)] = np.asarray(result.merge_to_vert, dtype=np.int64)
    faces = target[np.asarray(result.tri_verts, dtype=np.int64)]
    used, compact = np.unique(faces, return_inverse=True)
    properties = np.asarray(result.vert_properties, dtype=np.float64)[used]
    colors = np.clip(np.rint(properties[:, 3:6]), 0, 255).astype(np.uint8)
    return Mesh.of(properties[:, :3], compact.reshape(-1, 3), colors)


def union(meshes: Sequence[Mesh]) -> Mesh:
    """The union of closed solids as one closed surface; colours are kept."""
    return _mesh(manifold3d.Manifold.batch_boolean([_manifold(m) for m in meshes], manifold3d.OpType.Add))


def difference(mesh: Mesh, tool: Mesh) -> Mesh:
    """The solid minus `tool`."""
    return _mesh(_manifold(mesh) - _manifold(tool))


@dataclass(frozen=True, eq=False, slots=True)
class SolidPart:
    """A named part."""

    name: str
    """Part name in lower case, as listed in `dcap.scene.types.segmentation.Part`."""
    solids: tuple[Mesh, ...]
    """Closed solids; they may overlap each other and other parts."""


@dataclass(frozen=True, eq=False, slots=True)
class Assembly:
    """One instance. Furniture: origin on the floor below the middle, front towards +y."""

    label: str
    """Category as in InteriorGS, lower case."""
    parts: tuple[SolidPart, ...]

    @property
    def bounds(self) -> Array:
        """Axis-aligned bounds [m], shape (2, 3)."""
        bounds = np.array([solid.bounds for part in self.parts for solid in part.solids])
        return np.stack([bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)])

    def placed(self, x: float = 0.0, y: float = 0.0, z: float = 0.0, yaw_deg: float = 0.0) -> "Assembly":
        """The piece turned about the vertical and then shifted [m]."""
        pose = np.eye(4)
        pose[:3, :3] = rotation("z", yaw_deg)
        pose[:3, 3] = x, y, z
        return self.transformed(pose)

    def transformed(self, pose: Array) -> "Assembly":
        """The piece under a 4x4 rigid map."""
        moved = tuple(replace(p, solids=tuple(s.transformed(pose) for s in p.solids)) for p in self.parts)
        return replace(self, parts=moved)


def assembly(label: str, **parts: Mesh | list[Mesh]) -> Assembly:
    """Shorthand: part names as keywords, underscores standing for spaces; a list for several solids."""
    named = ((name.replace("_", " "), m if isinstance(m, list) else [m]) for name, m in parts.items())
    return Assembly(label, tuple(SolidPart(name, tuple(solids)) for name, solids in named if solids))
