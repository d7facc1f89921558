"""Interaction surfaces: planar surfaces grown on a mesh, and the plane, outline and area of each.

In: a mesh, or some faces of one. Out: `InteractionSurface` values, the largest first. A region grows from its largest
face over shared edges while normals stay within an angle of the region's plane and faces near to it; the plane is
fitted again after each ring. From the source: that surfaces are planar, fine-grained and taken from the mesh. Ours: the
thresholds, that coplanar pieces of one thing are one surface (the four feet of a chair), and a second, coarser growth
where a soft or rounded top has hardly any planar surface.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csr_matrix

from dcap.arrays import Array, IntArray
from dcap.geometry.placement.polygons import convex_hull
from dcap.geometry.segmentation.faces import shared_edges, surface_points, welded_index
from dcap.scene.types.mesh import Mesh


@dataclass(frozen=True, slots=True)
class Flatness:
    """Tolerances of a planar surface."""

    angle: float
    """Largest angle between a face's normal and the plane's [rad]."""
    offset: float
    """Largest distance of a face's middle from the plane [m]."""


FINE = Flatness(float(np.radians(10.0)), 0.005)
"""Tolerances for furniture, floors, and scans with their noise."""
COARSE = Flatness(float(np.radians(25.0)), 0.02)
"""Tolerances for a quilt, a cushion or a seat as one surface."""
LEAST_SHARE = 0.01
"""Share of the mesh's area below which a region is no surface [-]."""
COPLANAR_ANGLE = float(np.radians(5.0))
"""Pieces whose normals differ by less may be one surface [rad]..."""
MOST_SURFACES = 12
"""Most surfaces of one thing, the largest ones [-]."""
MOST_SEEDS = 200
"""Most regions started on one mesh; on a rough scan most faces would start one of their own [-]."""
SAMPLES = 240
"""Number of points that represent a surface's area [-]."""


@dataclass(frozen=True, eq=False, slots=True)
class InteractionSurface:
    """A planar surface of a thing."""

    name: str
    """Its name within the thing: `planar 0`, `top`, `left side`."""
    center: Array
    """Middle of its area [m], shape (3,)."""
    normal: Array
    """Unit outward normal, shape (3,)."""
    points: Array
    """Points spread over its area [m], shape (k, 3)."""
    outline: Array
    """Corners of the convex hull of its projection on its plane [m], shape (n, 3)."""
    area: float
    """[m^2]."""
    faces: IntArray
    """Faces of the mesh it was grown on, shape (m,); none for the side of a box."""

    def transformed(self, rotation: Array, shift: Array, scale: float = 1.0) -> "InteractionSurface":
        """The surface under x -> scale * rotation @ x + shift."""
        turned = scale * rotation
        return replace(
            self,
            center=turned @ self.center + shift,
            normal=rotation @ self.normal,
            points=self.points @ turned.T + shift,
            outline=self.outline @ turned.T + shift,
            area=scale**2 * self.area,
        )


def plane_axes(normal: Array) -> tuple[Array, Array]:
    """Two unit vectors that span the plane across a unit normal, horizontal the first; shape (3,) each."""
    side = np.cross((0.0, 0.0, 1.0), normal)
    length = float(np.linalg.norm(side))
    first = side / length if length > 1e-9 else np.array([1.0, 0.0, 0.0])
    return first, np.cross(normal, first)


def hull_on_plane(points: Array, center: Array, normal: Array) -> Array:
    """Corners of the convex hull of points (n, 3) projected along a normal on to a plane [m], shape (k, 3)."""
    first, second = plane_axes(normal)
    ring = convex_hull((points - center) @ np.stack([first, second], axis=1))
    return np.asarray(center + ring @ np.stack([first, second]))


def planar_surfaces(mesh: Mesh, flatness: Flatness = FINE, least_area: float | None = None) -> list[InteractionSurface]:
    """Planar surfaces of a mesh, the largest first; `least_area` [m^2] instead of LEAST_SHARE of the mesh's."""
    normal, area = mesh.face_normals, mesh.face_areas
    solid = np.flatnonzero(area > 1e-12)
    if len(solid) == 0:
        return []
    unit = normal[solid] / (2.0 * area[solid])[:, None]
    middle, weight = mesh.corners(solid).mean(axis=1), area[solid]
    graph = adjacency(mesh, solid)
    least = LEAST_SHARE * float(weight.sum()) if least_area is None else least_area
    regions = grown_regions(graph, unit, middle, weight, flatness)
    pieces = merged_coplanar(regions, unit, middle, weight, flatness)
    large = [piece for piece in pieces if weight[piece].sum() >= least]
    large.sort(key=lambda piece: (-round(float(weight[piece].sum()), 9), int(piece[0])))
    return [surface_of(mesh, solid[piece], f"planar {k}") for k, piece in enumerate(large[:MOST_SURFACES])]


def adjacency(mesh: Mesh, faces: IntArray) -> csr_matrix:
    """Adjacency of faces (k,) by shared edges, a symmetric (k, k) matrix."""
    a, b = shared_edges(welded_index(mesh.vertices)[mesh.faces[faces]]).T
    ones = np.ones(2 * len(a), dtype=np.int8)
    return coo_matrix((ones, (np.r_[a, b], np.r_[b, a])), shape=(len(faces), len(faces))).tocsr()


def grown_regions(
    graph: csr_matrix, normal: Array, middle: Array, area: Array, flatness: Flatness
) -> list[IntArray]:  # fmt: skip
    """Regions of faces, each grown ring by ring from the largest face that is left."""
    free = np.ones(len(area), dtype=bool)
    order = np.lexsort((np.arange(len(area)), -np.round(area, 12)))
    regions: list[IntArray] = []
    for seed in order:
        if not free[seed]:
            continue
        if len(regions) == MOST_SEEDS:
            break
        region = grown_from(int(seed), graph, normal, middle, area, free, flatness)
        free[region] = False
        regions.append(region)
    return regions


def grown_from(
    seed: int,
    graph: csr_matrix,
    normal: Array,
    middle: Array,
    area: Array,
    free: NDArray[np.bool_],
    flatness: Flatness,
) -> IntArray:
    """The region about one face."""
    region, ring = np.array([seed], dtype=np.int64), np.array([seed], dtype=np.int64)
    tried = np.zeros(len(area), dtype=bool)
    tried[seed] = True
    sums = area[seed] * normal[seed], area[seed] * middle[seed], float(area[seed])
    while len(ring):
        around = np.unique(np.concatenate([graph.indices[graph.indptr[f] : graph.indptr[f + 1]] for f in ring]))
        around = around[free[around] & ~tried[around]].astype(np.int64)
        direction = sums[0] / np.linalg.norm(sums[0])
        flat = normal[around] @ direction > np.cos(flatness.angle)
        near = np.abs((middle[around] - sums[1] / sums[2]) @ direction) < flatness.offset
        ring = around[flat & near]
        tried[ring] = True
        region = np.concatenate([region, ring])
        sums = (
            sums[0] + area[ring] @ normal[ring],
            sums[1] + area[ring] @ middle[ring],
            sums[2] + float(area[ring].sum()),
        )
    return np.sort(region)


def merged_coplanar(
    pieces: list[IntArray], normal: Array, middle: Array, area: Array, flatness: Flatness
) -> list[IntArray]:  # fmt: skip
    """Pieces in one plane as one surface, the largest piece's plane deciding."""
    pieces = sorted(pieces, key=lambda one: (-round(float(area[one].sum()), 12), int(one[0])))
    directions = np.array([area[one] @ normal[one] for one in pieces]).reshape(-1, 3)
    directions /= np.maximum(np.linalg.norm(directions, axis=1), 1e-30)[:, None]
    centers = np.array([np.average(middle[one], axis=0, weights=area[one]) for one in pieces]).reshape(-1, 3)
    taken = np.zeros(len(pieces), dtype=bool)
    found = []
    for k in range(len(pieces)):
        if taken[k]:
            continue
        level = np.abs((centers - centers[k]) @ directions[k]) < flatness.offset
        group = np.flatnonzero(level & (directions @ directions[k] > np.cos(COPLANAR_ANGLE)) & ~taken)
        taken[group] = True
        found.append(np.sort(np.concatenate([pieces[g] for g in group])))
    return found


def surface_of(mesh: Mesh, faces: IntArray, name: str) -> InteractionSurface:
    """The surface made of some faces (k,) of a mesh."""
    corners = mesh.corners(faces)
    weighted = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = 0.5 * np.linalg.norm(weighted, axis=1)
    direction = weighted.sum(axis=0)
    direction /= max(float(np.linalg.norm(direction)), 1e-30)
    center = np.average(corners.mean(axis=1), axis=0, weights=area)
    points, _ = surface_points(corners, area, float(np.sqrt(area.sum() / SAMPLES)))
    outline = hull_on_plane(corners.reshape(-1, 3), center, direction)
    return InteractionSurface(name, center, direction, points, outline, float(area.sum()), faces)


def rectangle_surface(name: str, center: Array, normal: Array, first: Array, half: Array) -> InteractionSurface:
    """A rectangle as a surface: `first` is a unit vector along its first side, `half` its half extents (2,) [m]."""
    second = np.cross(normal, first)
    half = np.maximum(half, 1e-6)
    signs = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)], dtype=float)
    axes = np.stack([half[0] * first, half[1] * second])
    ratio = float(np.clip(half[0] / half[1], 1.0 / SAMPLES, SAMPLES))
    columns = int(np.clip(round(np.sqrt(SAMPLES * ratio)), 1, SAMPLES))
    rows = max(SAMPLES // columns, 1)
    u, v = np.meshgrid((np.arange(columns) + 0.5) / columns * 2 - 1, (np.arange(rows) + 0.5) / rows * 2 - 1)
    points = center + np.c_[u.ravel(), v.ravel()] @ axes
    none = np.zeros(0, dtype=np.int64)
    return InteractionSurface(name, center, normal, points, center + signs @ axes, 4.0 * float(half.prod()), none)
