"""Things in a room without annotations: the shell, and what stands or hangs in it, not yet named."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.segmentation.convex import convex_pieces
from dcap.geometry.segmentation.faces import FaceTable, connected_regions
from dcap.geometry.segmentation.rooms.contacts import segments_of
from dcap.geometry.segmentation.rooms.fused import FusedThing, Likely, fused_things
from dcap.geometry.segmentation.rooms.grouping import Surroundings, grouped
from dcap.geometry.segmentation.rooms.shell import ScannedShell, find_shell

Index = NDArray[np.int64]
Mask = NDArray[np.bool_]

FUSED = 0.05
"""A component with more than this share of its area on the shell is fused with the room [-]."""
MOSTLY = 0.5
"""Share of what is not the shell that hangs together with it in a room that was scanned as one surface [-]."""
MAIN = 0.2
"""Share of the shell in one component from which on that is the room, and not a box that stands in it [-]."""
BY_WALL = 0.15
"""What comes this near to a wall or the ceiling may hang there [m]: curtains do at a hand's breadth."""
LEAST_THING = 0.015
"""Surface of the smallest thing [m^2]: a tea cup."""


@dataclass(frozen=True, eq=False, slots=True)
class DecomposedRoom:
    """A room taken apart."""

    shell: ScannedShell
    things: tuple[Index, ...]
    """Faces of each thing, largest surface first."""
    fused: tuple[FusedThing, ...] = ()
    """The same things where a scan has fused most of the room; else nothing."""


def decompose_room(table: FaceTable, inside: Mask, likely: Likely) -> DecomposedRoom:
    """Take the faces in `inside`, shape (m,), apart; crumbs are left out.

    Where most of what is not the shell hangs together with it, things are unions of pieces that are `likely`; else they
    are components, cut in grooves where they are fused, and grouped by statics.
    """
    shell = find_shell(table, inside)
    rest = inside & ~shell.any
    count = int(table.component.max(initial=-1)) + 1
    on_shell = np.bincount(table.component, table.area * shell.any, count)
    main = on_shell > MAIN * on_shell.sum()
    fused = rest & (_hangs_together(table, shell) & main)[table.component]
    if table.area[fused].sum() > MOSTLY * table.area[rest].sum():
        things = fused_things(table, np.flatnonzero(rest), shell, likely)
        return DecomposedRoom(shell, tuple(one.faces for one in things), tuple(things))
    pieces = segments_of(table, _segments(table, rest, shell))
    grouped(pieces, Surroundings(shell.levels.floor, shell.distance(pieces.position) < BY_WALL))
    found = sorted(pieces.alive.items(), key=lambda one: (-one[1].area, one[0]))
    return DecomposedRoom(shell, tuple(np.sort(piece.faces) for _, piece in found if piece.area > LEAST_THING))


def _segments(table: FaceTable, rest: Mask, shell: ScannedShell) -> Index:
    """Segment of each face, -1 where it is the shell's, shape (m,): components, those of a fused scan cut in
    grooves."""
    fused = _hangs_together(table, shell)
    alone, cut = np.flatnonzero(rest & ~fused[table.component]), np.flatnonzero(rest & fused[table.component])
    piece = np.full(len(rest), -1, dtype=np.int64)
    inside = rest[table.pairs[:, 0]] & rest[table.pairs[:, 1]]
    piece[alone] = connected_regions(len(rest), table.pairs, inside)[alone]
    piece[cut] = len(rest) + convex_pieces(table, cut)
    return piece


def _hangs_together(table: FaceTable, shell: ScannedShell) -> Mask:
    """Which components are fused with the shell, shape (components,)."""
    count = int(table.component.max(initial=-1)) + 1
    share = np.bincount(table.component, table.area * shell.any, count)
    return np.asarray(share > FUSED * np.bincount(table.component, table.area, count))
