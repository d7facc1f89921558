"""Per-face quantities of a mesh, the graph of faces that share an edge, and the level with most upward area."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from skimage.color import rgb2lab

from dcap.scene.types.mesh import Mesh

MAX_POINTS = 400_000
"""Maximum number of points of `surface_points`; above it the spacing grows [-]."""
STRAY = 0.005
"""Share of a surface that may be stray points of a scan, at either end of its height [-]."""
UPWARD = 0.8
"""Least cosine to the vertical of an upward face [-]."""
BAND = 0.03
"""Height within which faces are on one level [m]."""


@dataclass(frozen=True, eq=False, slots=True)
class FaceTable:
    """Properties of every face for segmentation."""

    corners: NDArray[np.float64]
    """Corner positions [m], shape (m, 3, 3)."""
    center: NDArray[np.float64]
    """Centres of the faces [m], shape (m, 3)."""
    normal: NDArray[np.float64]
    """Unit normals (zero for faces without area), shape (m, 3)."""
    area: NDArray[np.float64]
    """Areas of the faces [m^2], shape (m,)."""
    lab: NDArray[np.float64]
    """Mean colour in CIELAB (D65), shape (m, 3)."""
    pairs: NDArray[np.int64]
    """Faces that share an edge, shape (e, 2)."""
    component: NDArray[np.int64]
    """Connected component by shared edges, shape (m,)."""

    @classmethod
    def of(cls, mesh: Mesh) -> "FaceTable":
        """Measure a mesh."""
        corners = mesh.triangles
        weighted = mesh.face_normals
        length = np.linalg.norm(weighted, axis=1)
        pairs = shared_edges(welded_index(mesh.vertices)[mesh.faces])
        return cls(
            corners=corners,
            center=corners.mean(axis=1),
            normal=weighted / np.maximum(length, 1e-30)[:, None],
            area=0.5 * length,
            lab=rgb2lab(mesh.colors[mesh.faces].mean(axis=1) / 255.0),
            pairs=pairs,
            component=connected_regions(len(corners), pairs, np.ones(len(pairs), dtype=bool)),
        )


def welded_index(vertices: NDArray[np.float64]) -> NDArray[np.int64]:
    """A number per position, so that vertices split for colour or texture are the same, shape (n,)."""
    step = 1e-6 * max(float(np.ptp(vertices, axis=0).max()), 1e-9)
    keys = np.rint((vertices - vertices.min(axis=0)) / step).astype(np.int64)
    # One number per place: 2^21 > 1e6 steps per axis.
    packed = (keys[:, 0] << 42) | (keys[:, 1] << 21) | keys[:, 2]
    return np.asarray(np.unique(packed, return_inverse=True)[1]).reshape(-1)


def shared_edges(faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """Pairs of faces that share an edge, shape (e, 2).

    An edge of more than two faces does not connect them: separate solids touch there (a mattress on its frame).
    """
    sides = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]], axis=2).reshape(-1, 2)
    key = sides[:, 0] * (int(faces.max(initial=0)) + 1) + sides[:, 1]
    order = np.argsort(key, kind="stable")
    same = key[order][1:] == key[order][:-1]
    alone = np.r_[True, ~same]
    only_two = same & alone[:-1] & np.r_[~same[1:], True]
    owner = order // 3
    return np.stack([owner[:-1][only_two], owner[1:][only_two]], axis=1)


def pairs_among(pairs: NDArray[np.int64], faces: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """The pairs of `count` faces that join two of the given faces (k,), as indices into the given faces, shape (p,
    2)."""
    number = np.full(count, -1)
    number[faces] = np.arange(len(faces))
    first = number[pairs[:, 0]]
    kept = np.flatnonzero(first >= 0)  # in a room with many things only few pairs are left for the second test
    second = number[pairs[kept, 1]]
    both = second >= 0
    return np.stack([first[kept[both]], second[both]], axis=1)


def connected_regions(count: int, pairs: NDArray[np.int64], joined: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Index of the region of each face if only the `joined` pairs connect, shape (count,)."""
    a, b = pairs[joined].T
    graph = coo_matrix((np.ones(len(a), dtype=np.int8), (a, b)), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)


def surface_pieces(mesh: Mesh, faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """Index of the piece of each of some faces (k,), connected only by edges among these faces, shape (k,)."""
    pairs = shared_edges(welded_index(mesh.vertices)[mesh.faces[faces]])
    return connected_regions(len(faces), pairs, np.ones(len(pairs), dtype=bool))


def plan_cells(corners: NDArray[np.float64], area: NDArray[np.float64], step: float) -> int:
    """Number of cells of size `step` [m] of a grid in plan that are covered by faces (m, 3, 3) with areas (m,)
    [m^2]."""
    points, _ = surface_points(corners, area, 0.5 * step)
    return len(np.unique(np.floor(points[:, :2] / step).astype(np.int64), axis=0))


def surface_heights(z: NDArray[np.float64], area: NDArray[np.float64]) -> tuple[float, float]:
    """Lowest and highest height of faces at z (m,) [m] with these areas, without stray faces at either end [m]."""
    order = np.argsort(z)
    sums = np.cumsum(area[order])
    low, high = np.searchsorted(sums, np.array([STRAY, 1.0 - STRAY]) * sums[-1])
    return float(z[order[low]]), float(z[order[min(int(high), len(order) - 1)]])


def surface_points(
    corners: NDArray[np.float64], area: NDArray[np.float64], spacing: float
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Points about `spacing` apart, at least one per face, and the face of each point."""
    spacing = max(spacing, float(np.sqrt(area.sum() / MAX_POINTS)))
    count = 1 + (area / spacing**2).astype(np.int64)
    owner = np.repeat(np.arange(len(area)), count)
    number = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
    # R2 sequence (M. Roberts, 2018): even and without a random generator.
    u = (0.5 + 0.7548776662466927 * number) % 1.0
    v = (0.5 + 0.5698402909980532 * number) % 1.0
    beyond = u + v > 1.0
    u, v = np.where(beyond, 1.0 - u, u), np.where(beyond, 1.0 - v, v)
    a, b, c = corners[owner].transpose(1, 0, 2)
    return a + u[:, None] * (b - a) + v[:, None] * (c - a), owner


def renumbered(labels: NDArray[np.integer]) -> NDArray[np.int64]:
    """The same partition numbered 0, 1, 2 ... in order of value."""
    return np.asarray(np.unique(labels, return_inverse=True)[1], dtype=np.int64).reshape(-1)


def level_of(height: NDArray[np.float64], weight: NDArray[np.float64], width: float) -> float:
    """The height [m] with most weight within `width` [m]: the mean of the heaviest window; nan without weight.

    Heights [m] and weights [any unit] of shape (n,).
    """
    if not len(height) or weight.sum() <= 0:
        return float("nan")
    order = np.argsort(height, kind="stable")
    sorted_height, total = height[order], np.cumsum(weight[order])
    end = np.searchsorted(sorted_height, sorted_height + width, side="right") - 1
    inside = total[end] - total + weight[order]
    best = int(np.argmax(inside))
    window = order[best : int(end[best]) + 1]
    return float(np.average(height[window], weights=weight[window]))


def main_level(mesh: Mesh, faces: NDArray[np.integer]) -> float:
    """Height of the main upward surface of some faces [m]; nan without upward faces."""
    corner = mesh.corners(faces)
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    length = np.linalg.norm(normal, axis=1)
    up = normal[:, 2] > UPWARD * np.maximum(length, 1e-30)
    return level_of(corner[up, :, 2].mean(axis=1), length[up], BAND)
