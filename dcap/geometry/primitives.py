"""Boxes, spheres, cylinders and capsules: exact signed distance and a surface mesh with vertices at the extremes.

All are centred on the origin, with axes along local z, in metres. Signed distances are exact outside and inside,
negative inside.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from dcap.arrays import Array
from dcap.scene.types.mesh import Mesh

if TYPE_CHECKING:
    import trimesh


class Primitive(Protocol):
    """A solid with a known signed distance."""

    @property
    def half_extents(self) -> Array:
        """Half side lengths of its box [m], shape (3,)."""

    @property
    def volume(self) -> float:
        """Volume [m^3]."""

    @property
    def inertia_per_mass(self) -> Array:
        """Diagonal inertia about the centre over the mass [m^2], shape (3,)."""

    def distance(self, points: Array) -> Array:
        """Signed distance [m] of points (..., 3)."""

    def surface(self, edge: float) -> Mesh:
        """Closed surface with edges of at most about `edge` [m]."""


@dataclass(frozen=True, eq=False)
class Box:
    """An axis-aligned box."""

    size: Array
    """Side lengths [m], shape (3,)."""

    @property
    def half_extents(self) -> Array:
        """Half side lengths [m]."""
        return np.asarray(0.5 * self.size)

    @property
    def volume(self) -> float:
        """Volume [m^3]."""
        return float(np.prod(self.size))

    @property
    def inertia_per_mass(self) -> Array:
        """Inertia per mass, (b^2 + c^2) / 12 and cyclic [m^2]."""
        squares = self.size**2
        return np.asarray((squares.sum() - squares) / 12.0)

    def distance(self, points: Array) -> Array:
        """Signed distance [m]."""
        excess = np.abs(points) - self.half_extents
        outside = np.linalg.norm(np.maximum(excess, 0.0), axis=-1)
        return np.asarray(outside + np.minimum(excess.max(axis=-1), 0.0))

    def surface(self, edge: float) -> Mesh:
        """Surface of six regular grids of triangles."""
        counts = np.clip(np.ceil(self.size / edge).astype(int), 1, 160)
        return self.surface_on([h * np.linspace(-1, 1, n + 1) for h, n in zip(self.half_extents, counts, strict=True)])

    def surface_on(self, planes: Sequence[Array]) -> Mesh:
        """Six grids of triangles with vertices on the given planes x, y and z [m], from side to side."""
        vertices, faces, offset = [], [], 0
        for axis in range(3):
            u, v = (axis + 1) % 3, (axis + 2) % 3
            grid_u, grid_v = np.meshgrid(planes[u], planes[v], indexing="ij")
            corner = np.arange(grid_u.size).reshape(grid_u.shape)
            a, b, c, d = (corner[s].ravel() for s in (np.s_[:-1, :-1], np.s_[1:, :-1], np.s_[1:, 1:], np.s_[:-1, 1:]))
            quads = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
            for side, sign in ((-1, 1), (0, -1)):
                points = np.empty((grid_u.size, 3))
                points[:, axis], points[:, u], points[:, v] = planes[axis][side], grid_u.ravel(), grid_v.ravel()
                vertices.append(points)
                faces.append((quads if sign > 0 else quads[:, ::-1]) + offset)
                offset += len(points)
        import trimesh  # takes a quarter of a second, which cached results need not wait for

        merged = trimesh.Trimesh(np.concatenate(vertices), np.concatenate(faces), process=True)
        return Mesh.of(merged.vertices, merged.faces)


@dataclass(frozen=True, eq=False)
class Capsule:
    """A cylinder with hemispherical ends; `length` is the straight part, zero makes a sphere."""

    radius: float
    length: float

    @property
    def half_extents(self) -> Array:
        """Half side lengths [m]."""
        return np.array([self.radius, self.radius, self.radius + 0.5 * self.length])

    @property
    def volume(self) -> float:
        """Volume [m^3]."""
        return float(np.pi * self.radius**2 * (self.length + 4.0 / 3.0 * self.radius))

    @property
    def inertia_per_mass(self) -> Array:
        """Inertia per mass of a cylinder and two half spheres moved by Steiner's theorem [m^2]."""
        r, h = self.radius, self.length
        cylinder, caps = np.pi * r**2 * h, 4.0 / 3.0 * np.pi * r**3
        axial = cylinder * r**2 / 2.0 + caps * 0.4 * r**2
        across = cylinder * (r**2 / 4.0 + h**2 / 12.0) + caps * (0.4 * r**2 + h**2 / 4.0 + 3.0 * h * r / 8.0)
        return np.array([across, across, axial]) / (cylinder + caps)

    def distance(self, points: Array) -> Array:
        """Signed distance [m]."""
        on_axis = np.clip(points[..., 2], -0.5 * self.length, 0.5 * self.length)
        return np.asarray(np.hypot(np.hypot(points[..., 0], points[..., 1]), points[..., 2] - on_axis) - self.radius)

    def surface(self, edge: float) -> Mesh:
        """Surface of a subdivided octahedron, with its halves separated by the straight part."""
        rounds = int(np.clip(np.ceil(np.log2(np.sqrt(2.0) * self.radius / edge)), 2, 6))
        ball = octahedral_sphere(rounds)
        points = ball.vertices * self.radius
        if self.length > 0.0:
            return _stretched(ball, points, self.length, edge)
        return Mesh.of(points, ball.faces)


@dataclass(frozen=True, eq=False)
class Cylinder:
    """A circular cylinder."""

    radius: float
    height: float

    @property
    def half_extents(self) -> Array:
        """Half side lengths [m]."""
        return np.array([self.radius, self.radius, 0.5 * self.height])

    @property
    def volume(self) -> float:
        """Volume [m^3]."""
        return float(np.pi * self.radius**2 * self.height)

    @property
    def inertia_per_mass(self) -> Array:
        """Inertia per mass [m^2]."""
        across = self.radius**2 / 4.0 + self.height**2 / 12.0
        return np.array([across, across, self.radius**2 / 2.0])

    def distance(self, points: Array) -> Array:
        """Signed distance [m]."""
        radial = np.hypot(points[..., 0], points[..., 1]) - self.radius
        axial = np.abs(points[..., 2]) - 0.5 * self.height
        outside = np.hypot(np.maximum(radial, 0.0), np.maximum(axial, 0.0))
        return np.asarray(outside + np.minimum(np.maximum(radial, axial), 0.0))

    def surface(self, edge: float) -> Mesh:
        """Surface of side rings, and concentric rings on the ends."""
        count = 4 * int(np.clip(np.ceil(0.5 * np.pi * self.radius / edge), 4, 60))
        rings = int(np.clip(np.ceil(self.radius / edge), 1, 60))
        levels = int(np.clip(np.ceil(self.height / edge), 1, 160))
        radii = [
            *np.linspace(0, self.radius, rings + 1)[1:],
            *[self.radius] * (levels - 1),
            *np.linspace(self.radius, 0, rings + 1)[:-1],
        ]
        half = 0.5 * self.height
        heights = [*[-half] * rings, *np.linspace(-half, half, levels + 1)[1:-1], *[half] * rings]
        return _lathe(np.array(radii), np.array(heights), half, count)


def octahedral_sphere(rounds: int) -> "trimesh.Trimesh":
    """Unit sphere from an octahedron, which always has the six axis points as vertices."""
    import trimesh  # takes a quarter of a second, which cached results need not wait for

    ball = trimesh.Trimesh(
        [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]],
        [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]],
        process=False,
    )
    for _ in range(rounds):
        ball = ball.subdivide()
        ball.vertices /= np.linalg.norm(ball.vertices, axis=1)[:, None]
    return ball


def _stretched(ball: "trimesh.Trimesh", points: Array, length: float, edge: float) -> Mesh:
    """A ball cut at its equator, with the straight part inserted."""
    levels = max(1, int(np.ceil(length / edge)))
    upper = points[:, 2] >= -1e-9
    faces = np.asarray(ball.faces)
    top = faces[upper[faces].all(axis=1)]
    bottom = faces[(points[:, 2] <= 1e-9)[faces].all(axis=1)]
    equator = np.flatnonzero(np.abs(points[:, 2]) <= 1e-9)
    equator = equator[np.argsort(np.arctan2(points[equator, 1], points[equator, 0]))]
    lift = np.array([0.0, 0.0, 0.5 * length])
    rings = [points[equator] + lift * s for s in np.linspace(-1.0, 1.0, levels + 1)]
    count = len(equator)
    side = []
    for level in range(levels):
        a = level * count + np.arange(count)
        b = level * count + (np.arange(count) + 1) % count
        side += [np.stack([a, b, b + count], 1), np.stack([a, b + count, a + count], 1)]
    pieces = [(points + lift, top), (points - lift, bottom), (np.concatenate(rings), np.concatenate(side))]
    joined = Mesh.concatenate([Mesh.of(v, f) for v, f in pieces])
    import trimesh  # takes a quarter of a second, which cached results need not wait for

    merged = trimesh.Trimesh(joined.vertices, joined.faces, process=True)  # welds the rings, drops unused vertices
    return Mesh.of(merged.vertices, merged.faces)


def _lathe(radii: Array, heights: Array, half: float, count: int) -> Mesh:
    """Rings of `count` vertices closed by two poles at -half and +half."""
    angle = 2.0 * np.pi * np.arange(count) / count
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    rows = [np.c_[r * ring, np.full(count, h)] for r, h in zip(radii, heights, strict=True)]
    vertices = np.concatenate([*rows, [[0, 0, -half]], [[0, 0, half]]])
    south, north = len(vertices) - 2, len(vertices) - 1
    here, following = np.arange(count), (np.arange(count) + 1) % count
    faces = [np.stack([np.full(count, south), following, here], 1)]
    for level in range(len(rows) - 1):
        a, b = level * count + here, level * count + following
        faces += [np.stack([a, b, b + count], 1), np.stack([a, b + count, a + count], 1)]
    last = (len(rows) - 1) * count
    faces.append(np.stack([last + here, last + following, np.full(count, north)], 1))
    return Mesh.of(vertices, np.concatenate(faces))
