"""Pieces that make up one thing, by statics: what cannot stand by itself is part of what holds it.

A piece belongs to a neighbour if it covers most of what it stands on (a mattress on its frame, a top on its legs), if a
good part of its surface lies sideways against it (the front of a drawer), or if it would fall without it: nothing below
it, or too narrow a foot. What stands steadily on a larger surface is a thing of its own (a lamp on a table), and so is
what hangs on a wall.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.segmentation.contacts import FEW, UP, Piece, Pieces, all_of, inner_distance, patch_area, plan_area

Index = NDArray[np.int64]
Mask = NDArray[np.bool_]

ON_FLOOR = 0.03
"""What comes this near to the floor stands on it [m]."""
CRUMB = 0.01
"""Surface of the largest crumb [m^2]."""
COVERED = 0.55
"""Share of a carrying surface from which on what covers it belongs to what it covers [-]."""
AGAINST = 0.2
"""Share of a piece's surface that lies sideways against another one from which on they are one [-]."""
WEDGED = 0.03
"""Less than this share is chance [-]."""
STEADY = np.tan(np.deg2rad(8.0))
"""What tips over when it leans by less does not stand by itself [-]."""
LEVEL = 0.02
"""Points of a carrying surface lie within this of its level [m]."""
HANGING = 0.4
"""Share of a piece's surface that is near the wall it hangs at [-]."""
FOOT = 0.2
"""What stands on a smaller share of its own plan does not stand there but touches it [-]."""
FALLING = 0.1
"""Certainty that a small falling piece belongs to its holder [-]: less than of the reasons that can be measured."""


@dataclass(frozen=True, eq=False, slots=True)
class Surroundings:
    """What else can hold a piece."""

    floor: float
    """Height [m]; nan where there is none."""
    near_wall: Mask
    """Points that are near walls or the ceiling, shape (n,)."""


@dataclass(frozen=True, eq=False, slots=True)
class Contact:
    """A piece and one neighbour."""

    belongs: float
    """How certainly the piece continues or covers the neighbour, 0: it does not."""
    against: float
    """Share of the piece's surface that lies sideways against the neighbour [-]."""
    mutual: float
    """Mean of that share and the neighbour's [-]."""
    points: Index
    """Of the piece, shape (k,)."""
    on: Mask
    """Pairs in which the piece stands on the neighbour, shape (k,)."""
    under: Mask
    """Pairs in which the neighbour stands on the piece, shape (k,)."""

    @property
    def stands(self) -> bool:
        """Whether most of the contact is the piece standing on the neighbour."""
        return float(self.on.mean()) > 0.5

    @property
    def carries(self) -> bool:
        """Whether most of the contact is the neighbour standing on the piece."""
        return float(self.under.mean()) > 0.5


Contacts = dict[int, dict[int, Contact]]
"""Of each piece, by number of the neighbour; kept until one of the two is merged."""


def grouped(pieces: Pieces, around: Surroundings) -> None:
    """Merge pieces until every one stands or hangs by itself; the most certain merge first."""
    known: Contacts = {name: {} for name in pieces.alive}
    wanted = {name: _wish(pieces, around, name, known[name]) for name in pieces.alive}
    while True:
        certainty, name, other = max(((c, -n, -o) for n, (c, o) in wanted.items()), default=(0.0, 0, 0))
        if certainty <= 0.0:
            return
        keep, gone = sorted((-name, -other), key=lambda n: (-pieces.alive[n].area, n))
        neighbours = {*pieces.alive[keep].touches, *pieces.alive[gone].touches} - {keep, gone}
        pieces.merge(keep, gone)
        del wanted[gone], known[gone]
        known[keep] = {}
        for one in neighbours:
            known[one].pop(keep, None)
            known[one].pop(gone, None)
        for one in (keep, *neighbours):
            wanted[one] = _wish(pieces, around, one, known[one])


def _wish(pieces: Pieces, around: Surroundings, name: int, contacts: dict[int, Contact]) -> tuple[float, int]:
    """How certainly a piece belongs to one of its neighbours, 0: to none, and to which; completes its contacts."""
    piece = pieces.alive[name]
    for other, touch in piece.touches.items():
        if other not in contacts and len(touch.a) >= FEW:
            contacts[other] = _contact(pieces, name, other)
    choices = [(0.0, -1), _leaning(contacts), *((contact.belongs, other) for other, contact in contacts.items())]
    below = all_of(c.points[c.on] for c in contacts.values() if c.on.sum() >= FEW)
    if not _stands(pieces, around, piece, below) and not _hangs(pieces, around, piece, below, contacts):
        holder = _holder(pieces, around, name, contacts, falls_off=not len(below))
        choices.append((FALLING / (1.0 + piece.area) if holder >= 0 else 0.0, holder))
    return max(choices)


def _contact(pieces: Pieces, name: int, other: int) -> Contact:
    """Who stands on whom: a pair of pieces of which each has points above the other is decided by their number."""
    on, under = pieces.standing(name, other), pieces.standing(other, name)
    if on.sum() < under.sum():
        on = np.zeros_like(on)
    touch = pieces.alive[name].touches[other]
    area = patch_area(pieces.position[touch.a[pieces.sideways(touch)]])
    against, again = (area / max(pieces.alive[one].area, 1e-12) for one in (name, other))
    belongs = max(_continuing(pieces, name, other), _covering(pieces, name, other, on))
    return Contact(belongs, against, min(0.5 * (against + again), 1.0), touch.a, on, under)


def _continuing(pieces: Pieces, name: int, other: int) -> float:
    """Certainty that a crumb is a piece of the surface beside it: what shows of a board between the books on it."""
    piece, touch = pieces.alive[name], pieces.alive[name].touches[other]
    if piece.area > CRUMB or piece.area > pieces.alive[other].area:
        return 0.0
    flush = pieces.flush(touch)
    return 2.0 + float(flush.mean()) if flush.sum() >= FEW else 0.0


def _covering(pieces: Pieces, name: int, other: int, on: Mask) -> float:
    """Certainty that a piece belongs to what it stands on, as it covers it; above 1, 0 if it does not."""
    if on.sum() < FEW:
        return 0.0
    touch = pieces.alive[name].touches[other]
    carrier = touch.b[on]
    height = float(np.median(pieces.position[carrier, 2]))
    points = pieces.alive[other].points
    level = np.abs(pieces.position[points, 2] - height) < LEVEL
    level &= pieces.normal[points, 2] > UP
    whole = plan_area(pieces.position[np.concatenate([points[level], carrier])])
    share = plan_area(pieces.position[touch.a[on]]) / max(whole, 1e-9)
    return 1.0 + min(share, 1.0) if share > COVERED else 0.0


def _leaning(contacts: dict[int, Contact]) -> tuple[float, int]:
    """How certainly a piece belongs to what it lies against sideways, more for pieces of like size, and to which.

    A good part of its surface must, against one neighbour or wedged between several.
    """
    leaning = {other: c for other, c in contacts.items() if c.against > WEDGED}
    if sum(c.against for c in leaning.values()) <= AGAINST:
        return 0.0, -1
    return max((c.mutual, other) for other, c in leaning.items())


def _stands(pieces: Pieces, around: Surroundings, piece: Piece, below: Index) -> bool:
    """Whether a piece keeps upright on the floor and on its points that stand on others."""
    position = pieces.position[piece.points]
    points = np.concatenate([position[position[:, 2] < around.floor + ON_FLOOR], pieces.position[below]])
    if not len(points):
        return False
    height = float(piece.center[2] - points[:, 2].max())
    return bool(inner_distance(points, piece.center) > STEADY * max(height, 0.0))


def _hangs(
    pieces: Pieces, around: Surroundings, piece: Piece, below: Index, contacts: dict[int, Contact]
) -> bool:  # fmt: skip
    """Whether a piece hangs at a wall: without a foot, and not held from both ends by another piece."""
    if plan_area(pieces.position[below]) > FOOT * plan_area(pieces.position[piece.points]):
        return False
    return _by_wall(pieces, around, piece) and not any(_clamps(pieces, piece, c) for c in contacts.values())


def _by_wall(pieces: Pieces, around: Surroundings, piece: Piece) -> bool:
    """Whether a good part of a piece that does not reach the floor is near a wall or the ceiling."""
    if piece.low[2] < around.floor + ON_FLOOR:
        return False
    near = piece.points[around.near_wall[piece.points]]
    return float(pieces.weight[near].sum()) > HANGING * piece.area


def _clamps(pieces: Pieces, piece: Piece, contact: Contact) -> bool:
    """Whether a neighbour holds a piece at both ends of its longer side."""
    size = piece.high - piece.low
    axis = int(np.argmax(size[:2]))
    margin = 0.05 * size[axis] + LEVEL
    along = pieces.position[contact.points[~contact.under], axis]
    return bool(
        len(along) and along.min() < piece.low[axis] + margin and along.max() > piece.high[axis] - margin
    )  # fmt: skip


def _holder(
    pieces: Pieces, around: Surroundings, name: int, contacts: dict[int, Contact], *, falls_off: bool
) -> int:  # fmt: skip
    """What most likely holds a piece that falls (off what is below, or over on its foot); -1 if nothing does.

    Rather what does not hang; for one that falls over rather what is not below it, for one that falls off rather what
    it does not carry; then what touches it most in its lower half. A thing never belongs to a smaller one on top of it.
    """
    piece = pieces.alive[name]
    rank = {
        other: (
            not _by_wall(pieces, around, pieces.alive[other]),
            not (c.carries if falls_off else c.stands),
            int((pieces.position[c.points, 2] < piece.center[2]).sum()),
            -other,
        )
        for other, c in contacts.items()
        if not c.carries or pieces.alive[other].area > piece.area
    }
    return max(rank, key=lambda other: rank[other], default=-1)
