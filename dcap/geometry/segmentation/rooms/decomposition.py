"""Things in a room without annotations: the shell, and the things that stand or hang in it, not yet named.

Things of a room that a scan has fused with its floor, walls and clutter: unions of pieces around supporting patches.

In: the faces outside the shell. Out: the faces of each thing with its rough shape. The caller decides which unions are
things; large pieces in no union are separate things.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.arrays import IntArray, Mask
from dcap.geometry.segmentation.faces import FaceTable, connected_regions, surface_heights
from dcap.geometry.segmentation.oversegmentation import convex_pieces
from dcap.geometry.segmentation.rooms.contacts import segments_of, surfels_of
from dcap.geometry.segmentation.rooms.grouping import Surroundings, grouped
from dcap.geometry.segmentation.rooms.pieces import carrying_pieces
from dcap.geometry.segmentation.rooms.shell import LARGEST_FLUSH, ScannedShell, find_shell
from dcap.geometry.segmentation.rooms.unions import LONGEST, PieceGraph, RoughShape, piece_graph

Likely = Callable[[Sequence[frozenset[int]], Sequence[RoughShape]], list[frozenset[int]]]
"""Function that selects, from unions and their shapes, disjoint ones that are things."""

LEAST_LEFT = 0.1
"""Least surface of a piece that counts as a thing although it does not look like one [m^2]."""

HIGH = 2.0
"""Height above the floor out of people's reach [m]: nothing is put on or next to things that begin higher."""

FUSED = 0.05
"""Share of a component's area on the shell above which it is fused with the room [-]."""
MOSTLY = 0.5
"""Least share of the faces outside the shell that is connected to it in a room scanned as one surface [-]."""
MAIN = 0.2
"""Least share of the shell in a component connected to it that is the room, not a box standing in it [-]."""
HIGHEST = 0.75
"""Least share of the room's height of a fused component with more surface than any thing on a wall [-]."""
BY_WALL = 0.15
"""Largest distance from a wall or the ceiling of a thing that may hang there [m]: curtains are a hand's breadth
away."""
LEAST_THING = 0.015
"""Surface of the smallest thing [m^2]: a tea cup."""


@dataclass(frozen=True, eq=False, slots=True)
class FusedThing:
    """A thing with the shape measures available from a scan."""

    faces: IntArray
    shape: RoughShape
    held_by: int
    """Index of the thing that carries it; -1: none, or as stated by `shape`."""
    likely: bool
    """Whether it looks like a thing; otherwise it is a piece that is too large to ignore."""


def fused_things(table: FaceTable, faces: IntArray, shell: ScannedShell, likely: Likely) -> list[FusedThing]:
    """The things among faces (k,), the largest first."""
    levels = shell.levels
    floor = float(table.center[faces, 2].min(initial=0.0)) if np.isnan(levels.floor) else levels.floor
    surfels = surfels_of(table, faces)
    pieces = carrying_pieces(surfels, floor)
    graph = piece_graph(surfels, pieces, shell.planes, floor, levels.ceiling)
    unions = graph.unions()
    things = likely(unions, [graph.shape(union) for union in unions])
    area = np.bincount(pieces.owner + 1, surfels.area, pieces.count + 1)[1:].astype(np.float64)
    chosen = things + _left(graph, things, area)
    thing_of = np.full(pieces.count + 1, -1, dtype=np.int64)
    for number, union in enumerate(chosen):
        thing_of[list(union)] = number
    owner = surfels.faces_of(thing_of[pieces.owner], len(table.area))
    found = [(np.flatnonzero(owner == number), union) for number, union in enumerate(chosen)]
    found = [(mine, union) for mine, union in found if len(mine)]
    found.sort(key=lambda one: (-float(table.area[one[0]].sum()), int(one[0][0])))
    rank = {i: number for number, (_, union) in enumerate(found) for i in union}
    shapes = [graph.shape(union) for _, union in found]
    return [
        FusedThing(mine, shape, rank.get(shape.holder, -1), union in things)
        for (mine, union), shape in zip(found, shapes, strict=True)
    ]


def _left(graph: PieceGraph, chosen: Sequence[frozenset[int]], area: NDArray[np.float64]) -> list[frozenset[int]]:
    """Large pieces that are in no chosen union; a piece longer than any thing, or high up, is a scrap of the shell."""
    taken = frozenset[int]().union(*chosen)
    alone = {i: graph.shape(frozenset([i])) for i in graph.pieces if i not in taken and area[i] > LEAST_LEFT}
    return [frozenset([i]) for i, one in alone.items() if one.length < LONGEST and (one.bottom or 0.0) < HIGH]


@dataclass(frozen=True, eq=False, slots=True)
class DecomposedRoom:
    """A room divided into things."""

    shell: ScannedShell
    things: tuple[IntArray, ...]
    """Faces of each thing, in order of decreasing surface."""
    fused: tuple[FusedThing, ...] = ()
    """The same things if a scan has fused most of the room; else empty."""


def decompose_room(table: FaceTable, inside: Mask, likely: Likely) -> DecomposedRoom:
    """Divide the faces in `inside`, shape (m,), into things; fragments are left out.

    If most of the faces outside the shell are connected to it, whether in one surface or in the many of a scan written
    cell by cell, things are unions of pieces that are `likely`; otherwise they are components, cut in grooves where
    they are fused, and grouped by statics.
    """
    shell = find_shell(table, inside)
    rest = inside & ~shell.any
    fused = rest & (_hangs_together(table, shell) | _room_large(table, rest))[table.component]
    if table.area[fused].sum() > MOSTLY * table.area[rest].sum():
        things = fused_things(table, np.flatnonzero(rest), shell, likely)
        return DecomposedRoom(shell, tuple(one.faces for one in things), tuple(things))
    pieces = segments_of(table, _segments(table, rest, shell))
    grouped(pieces, Surroundings(shell.levels.floor, shell.distance(pieces.position) < BY_WALL))
    found = sorted(pieces.alive.items(), key=lambda one: (-one[1].area, one[0]))
    return DecomposedRoom(shell, tuple(np.sort(piece.faces) for _, piece in found if piece.area > LEAST_THING))


def _segments(table: FaceTable, rest: Mask, shell: ScannedShell) -> IntArray:
    """Segment of each face, -1 for the shell, shape (m,): components, with those of a fused scan cut in grooves."""
    fused = _hangs_together(table, shell)
    alone, cut = np.flatnonzero(rest & ~fused[table.component]), np.flatnonzero(rest & fused[table.component])
    piece = np.full(len(rest), -1, dtype=np.int64)
    inside = rest[table.pairs[:, 0]] & rest[table.pairs[:, 1]]
    piece[alone] = connected_regions(len(rest), table.pairs, inside)[alone]
    piece[cut] = len(rest) + convex_pieces(table, cut)
    return piece


def _hangs_together(table: FaceTable, shell: ScannedShell) -> Mask:
    """Mask of the components that are fused with the shell, shape (components,): all false if the components beyond the
    shell contain little of it, like a box in an empty room."""
    count = int(table.component.max(initial=-1)) + 1
    on_shell = np.bincount(table.component, table.area * shell.any, count)
    area = np.bincount(table.component, table.area, count)
    touching = on_shell > FUSED * area
    more = touching & (on_shell < (1.0 - FUSED) * area)
    return touching & bool(on_shell[more].sum() > MAIN * on_shell.sum())


def _room_large(table: FaceTable, rest: Mask) -> Mask:
    """Mask of the components that are larger than any thing, shape (components,)."""
    count = int(table.component.max(initial=-1)) + 1
    low, high = np.full(count, np.inf), np.full(count, -np.inf)
    np.minimum.at(low, table.component, table.corners[..., 2].min(axis=1))
    np.maximum.at(high, table.component, table.corners[..., 2].max(axis=1))
    bottom, top = surface_heights(table.center[:, 2], table.area)
    large = np.bincount(table.component, table.area * rest, count) > LARGEST_FLUSH
    return np.asarray(large & (high - low > HIGHEST * (top - bottom)))
