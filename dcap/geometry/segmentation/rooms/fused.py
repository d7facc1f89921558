"""Things of a room that a scan has fused with its floor, walls and clutter: unions of pieces around supporting patches.

In: the faces that are not the shell's. Out: the faces of each thing with its rough shape. Which unions are things, the
caller says; pieces that are in none are things of their own if they are large.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.segmentation.faces import FaceTable
from dcap.geometry.segmentation.rooms.pieces import carrying_pieces
from dcap.geometry.segmentation.rooms.shell import ScannedShell
from dcap.geometry.segmentation.rooms.surfels import surfels_of
from dcap.geometry.segmentation.rooms.unions import LONGEST, PieceGraph, RoughShape, piece_graph

Index = NDArray[np.int64]
Likely = Callable[[Sequence[frozenset[int]], Sequence[RoughShape]], list[frozenset[int]]]
"""From unions and their shapes those that are things, without overlap."""

LEAST_LEFT = 0.1
"""Surface of the smallest piece that is a thing although it looks like none [m^2]."""

HIGH = 2.0
"""Height above the floor out of people's reach: things that begin higher get nothing put on or next to them [m]."""


@dataclass(frozen=True, eq=False, slots=True)
class FusedThing:
    """A thing with what a scan tells of its shape."""

    faces: Index
    shape: RoughShape
    held_by: int
    """Number of the thing that carries it; -1: none, or what `shape` says."""
    likely: bool
    """Whether it looks like a thing; else it is a piece that is too large to be nothing."""


def fused_things(table: FaceTable, faces: Index, shell: ScannedShell, likely: Likely) -> list[FusedThing]:
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
    """Large pieces that are in no chosen union; what is longer than any thing, or high up, is a scrap of the shell."""
    taken = frozenset[int]().union(*chosen)
    alone = {i: graph.shape(frozenset([i])) for i in graph.pieces if i not in taken and area[i] > LEAST_LEFT}
    return [frozenset([i]) for i, one in alone.items() if one.length < LONGEST and (one.bottom or 0.0) < HIGH]
