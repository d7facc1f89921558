"""Convex pieces that leave room for what the surface touches: split where a hull reaches into it.

A piece is the hull of a part of a surface and fills its hollows. Where something bulges into such a hollow, as a
mattress does between the legs of a toy, the piece overlaps it, and a simulator would push the two apart. Such a piece
is cut in two there, across the hollow, until what overlaps is within a tolerance.
"""

import heapq

import numpy as np
from numpy.typing import NDArray

from dcap.arrays import Array
from dcap.geometry.solid.convex_pieces import convex_hull, planes_of
from dcap.scene.types.mesh import Mesh

TOLERANCE = 3e-4  # overlap that is left [m]: what visible surfaces of a settled contact are off by
MOST_SPLITS = 120  # of all pieces of a body
INSIDE = 2e-5  # a vertex this far out of a piece [m] still belongs to it


def with_room(pieces: list[Mesh], surface: Mesh, others: Array, tolerance: float = TOLERANCE) -> list[Mesh]:
    """The pieces of a surface, split until points of other things (n, 3) are at most `tolerance` [m] inside them.

    What of the surface is in a piece is in one of its halves; no half reaches out of the piece.
    """
    edges = unique_edges(surface)
    queue = [(-overlap(one, others)[0], number, one) for number, one in enumerate(pieces)]
    heapq.heapify(queue)
    for number in range(len(pieces), len(pieces) + 2 * MOST_SPLITS, 2):
        if not queue or -queue[0][0] <= tolerance:
            break
        _, _, deepest = heapq.heappop(queue)
        halves = best_halves(deepest, surface, edges, others)
        for more, half in enumerate(halves):
            heapq.heappush(queue, (-overlap(half, others)[0] if len(halves) > 1 else 0.0, number + more, half))
    return sorted((one for _, _, one in queue), key=lambda one: one.vertices.min(axis=0).tolist())


def overlap(piece: Mesh, others: Array) -> tuple[float, Array, Array]:
    """How deep a point is in a piece at most [m], 0 if none is, that point and the normal out of the piece, (3,)."""
    low, high = piece.bounds
    near = others[((others >= low) & (others <= high)).all(axis=1)]
    if not len(near):
        return 0.0, low, np.zeros(3)
    planes = planes_of(piece)
    height = near @ planes[:, :3].T - planes[:, 3]
    depth = -height.max(axis=1)
    deepest = int(depth.argmax())
    return max(float(depth[deepest]), 0.0), near[deepest], planes[int(height[deepest].argmax()), :3]


def best_halves(piece: Mesh, surface: Mesh, edges: NDArray[np.int64], others: Array) -> list[Mesh]:
    """The two halves of a piece that are overlapped least, of the cuts through the deepest point along the piece's
    principal axes and across the facet above it; the piece itself where none divides it."""
    _, point, out = overlap(piece, others)
    axes = np.linalg.svd(piece.vertices - piece.vertices.mean(axis=0), full_matrices=False)[2]
    across = np.linalg.svd(axes - np.outer(axes @ out, out), full_matrices=False)[2][:2]
    best, least = [piece], np.inf
    for normal in (*axes, *across, across[0] + across[1], across[0] - across[1]):
        unit = normal / np.linalg.norm(normal)
        halves = halved(piece, surface, edges, unit, float(unit @ point))
        if len(halves) == 2 and (most := max(overlap(one, others)[0] for one in halves)) < least:
            best, least = halves, most
    return best


def halved(piece: Mesh, surface: Mesh, edges: NDArray[np.int64], normal: Array, offset: float) -> list[Mesh]:
    """The hulls of what of a surface is in a piece on either side of a plane; less than two where a side is empty."""
    planes = planes_of(piece)

    def within(points: Array) -> Array:
        low, high = piece.bounds + np.array([[-INSIDE], [INSIDE]])
        some = points[((points >= low) & (points <= high)).all(axis=1)]
        return np.asarray(some[(some @ planes[:, :3].T - planes[:, 3]).max(axis=1, initial=-np.inf) <= INSIDE])

    height = surface.vertices @ normal - offset
    start, end = height[edges[:, 0]], height[edges[:, 1]]
    across = start * end < 0.0
    share = (start[across] / (start[across] - end[across]))[:, None]
    a, b = surface.vertices[edges[across, 0]], surface.vertices[edges[across, 1]]
    crossing = within(a + share * (b - a))
    points = np.concatenate([piece.vertices, within(surface.vertices)])
    side = points @ normal - offset
    hulls = [convex_hull(np.concatenate([points[mine], crossing])) for mine in (side <= 0.0, side >= 0.0)]
    return [one for one in hulls if one is not None]


def unique_edges(mesh: Mesh) -> NDArray[np.int64]:
    """Edges of a mesh, each once, as vertex indices (n, 2)."""
    pairs = np.sort(mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).astype(np.int64), axis=1)
    return np.unique(pairs, axis=0)
