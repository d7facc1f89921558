"""Segments that form one thing, by statics: a segment that cannot stand by itself is part of its holder.

A segment belongs to a neighbour if it covers most of its support (a mattress on its frame, a top on its legs), if a
good part of its surface lies sideways against it (the front of a drawer), or if it would fall without it: nothing below
it, or too narrow a foot. A segment that stands steadily on a larger surface is a separate thing (a lamp on a table),
and so is one that hangs on a wall.
"""

from dataclasses import dataclass

import numpy as np

from dcap.arrays import IntArray, Mask
from dcap.geometry.segmentation.rooms.contacts import (
    FEW,
    UP,
    Segment,
    Segments,
    all_of,
    inner_distance,
    patch_area,
    plan_area,
)

ON_FLOOR = 0.03
"""Largest distance of a segment on the floor from it [m]."""
CRUMB = 0.01
"""Surface of the largest fragment [m^2]."""
COVERED = 0.55
"""Covered share of a support from which the covering segment belongs to it [-]."""
AGAINST = 0.2
"""Least share of a segment's surface that lies sideways against another segment for both to be one [-]."""
WEDGED = 0.03
"""Share below which such contact is a coincidence [-]."""
STEADY = np.tan(np.deg2rad(8.0))
"""Least lean at which a segment that stands by itself may tip over [-]."""
LEVEL = 0.02
"""Tolerance of points of a carrying surface around its level [m]."""
HANGING = 0.4
"""Least share of a hanging segment's surface near its wall [-]."""
FOOT = 0.2
"""Share of its own plan below which a segment touches its support but does not stand on it [-]."""
FALLING = 0.1
"""Certainty that a small falling segment belongs to its holder [-]: less than that of measurable reasons."""


@dataclass(frozen=True, eq=False, slots=True)
class Surroundings:
    """Floor and walls, which can also hold a segment."""

    floor: float
    """Height of the floor [m]; nan if there is none."""
    near_wall: Mask
    """Mask of the points near walls or the ceiling, shape (n,)."""


@dataclass(frozen=True, eq=False, slots=True)
class SegmentContact:
    """Contact of a segment with one neighbour."""

    belongs: float
    """Certainty that the segment continues or covers the neighbour, 0: it does not."""
    against: float
    """Share of the segment's surface that lies sideways against the neighbour [-]."""
    mutual: float
    """Mean of that share and the neighbour's corresponding share [-]."""
    points: IntArray
    """Points of the segment, shape (k,)."""
    on: Mask
    """Mask of the pairs in which the segment stands on the neighbour, shape (k,)."""
    under: Mask
    """Mask of the pairs in which the neighbour stands on the segment, shape (k,)."""

    @property
    def stands(self) -> bool:
        """Whether in most of the contact the segment stands on the neighbour."""
        return float(self.on.mean()) > 0.5

    @property
    def carries(self) -> bool:
        """Whether in most of the contact the neighbour stands on the segment."""
        return float(self.under.mean()) > 0.5


SegmentContacts = dict[int, dict[int, SegmentContact]]
"""Contacts of each segment, by index of the neighbour; valid until one of the two is merged."""


def grouped(segments: Segments, around: Surroundings) -> None:
    """Merge segments until every one stands or hangs by itself, the most certain merges first."""
    known: SegmentContacts = {name: {} for name in segments.alive}
    wanted = {name: _wish(segments, around, name, known[name]) for name in segments.alive}
    while True:
        certainty, name, other = max(((c, -n, -o) for n, (c, o) in wanted.items()), default=(0.0, 0, 0))
        if certainty <= 0.0:
            return
        keep, gone = sorted((-name, -other), key=lambda n: (-segments.alive[n].area, n))
        neighbours = {*segments.alive[keep].touches, *segments.alive[gone].touches} - {keep, gone}
        segments.merge(keep, gone)
        del wanted[gone], known[gone]
        known[keep] = {}
        for one in neighbours:
            known[one].pop(keep, None)
            known[one].pop(gone, None)
        for one in (keep, *neighbours):
            wanted[one] = _wish(segments, around, one, known[one])


def _wish(
    segments: Segments, around: Surroundings, name: int, contacts: dict[int, SegmentContact]
) -> tuple[float, int]:
    """Certainty that a segment belongs to one of its neighbours, 0: to none, and the index of that neighbour; completes
    its contacts."""
    segment = segments.alive[name]
    for other, touch in segment.touches.items():
        if other not in contacts and len(touch.a) >= FEW:
            contacts[other] = _contact(segments, name, other)
    choices = [(0.0, -1), _leaning(contacts), *((contact.belongs, other) for other, contact in contacts.items())]
    below = all_of(c.points[c.on] for c in contacts.values() if c.on.sum() >= FEW)
    if not _stands(segments, around, segment, below) and not _hangs(segments, around, segment, below, contacts):
        holder = _holder(segments, around, name, contacts, falls_off=not len(below))
        choices.append((FALLING / (1.0 + segment.area) if holder >= 0 else 0.0, holder))
    return max(choices)


def _contact(segments: Segments, name: int, other: int) -> SegmentContact:
    """Contact of two segments; the one with more points above the other stands on it."""
    on, under = segments.standing(name, other), segments.standing(other, name)
    if on.sum() < under.sum():
        on = np.zeros_like(on)
    touch = segments.alive[name].touches[other]
    area = patch_area(segments.position[touch.a[segments.sideways(touch)]])
    against, again = (area / max(segments.alive[one].area, 1e-12) for one in (name, other))
    belongs = max(_continuing(segments, name, other), _covering(segments, name, other, on))
    return SegmentContact(belongs, against, min(0.5 * (against + again), 1.0), touch.a, on, under)


def _continuing(segments: Segments, name: int, other: int) -> float:
    """Certainty that a fragment belongs to the surface next to it: the visible rest of a board between the books on
    it."""
    segment, touch = segments.alive[name], segments.alive[name].touches[other]
    if segment.area > CRUMB or segment.area > segments.alive[other].area:
        return 0.0
    flush = segments.flush(touch)
    return 2.0 + float(flush.mean()) if flush.sum() >= FEW else 0.0


def _covering(segments: Segments, name: int, other: int, on: Mask) -> float:
    """Certainty that a segment belongs to its support because it covers it; above 1, or 0 if it does not."""
    if on.sum() < FEW:
        return 0.0
    touch = segments.alive[name].touches[other]
    carrier = touch.b[on]
    height = float(np.median(segments.position[carrier, 2]))
    points = segments.alive[other].points
    level = np.abs(segments.position[points, 2] - height) < LEVEL
    level &= segments.normal[points, 2] > UP
    whole = plan_area(segments.position[np.concatenate([points[level], carrier])])
    share = plan_area(segments.position[touch.a[on]]) / max(whole, 1e-9)
    return 1.0 + min(share, 1.0) if share > COVERED else 0.0


def _leaning(contacts: dict[int, SegmentContact]) -> tuple[float, int]:
    """Certainty that a segment belongs to the neighbour that it lies against sideways, larger for segments of similar
    size, and the index of the neighbour.

    A good part of its surface must lie against one neighbour, or be wedged between several.
    """
    leaning = {other: c for other, c in contacts.items() if c.against > WEDGED}
    if sum(c.against for c in leaning.values()) <= AGAINST:
        return 0.0, -1
    return max((c.mutual, other) for other, c in leaning.items())


def _stands(segments: Segments, around: Surroundings, segment: Segment, below: IntArray) -> bool:
    """Return whether a segment stays upright on the floor and on its points that stand on others."""
    position = segments.position[segment.points]
    points = np.concatenate([position[position[:, 2] < around.floor + ON_FLOOR], segments.position[below]])
    if not len(points):
        return False
    height = float(segment.center[2] - points[:, 2].max())
    return bool(inner_distance(points, segment.center) > STEADY * max(height, 0.0))


def _hangs(
    segments: Segments, around: Surroundings, segment: Segment, below: IntArray, contacts: dict[int, SegmentContact]
) -> bool:  # fmt: skip
    """Return whether a segment hangs on a wall: without a foot, and not held at both ends by another segment."""
    if plan_area(segments.position[below]) > FOOT * plan_area(segments.position[segment.points]):
        return False
    return _by_wall(segments, around, segment) and not any(_clamps(segments, segment, c) for c in contacts.values())


def _by_wall(segments: Segments, around: Surroundings, segment: Segment) -> bool:
    """Return whether a good part of a segment that does not reach the floor is near a wall or the ceiling."""
    if segment.low[2] < around.floor + ON_FLOOR:
        return False
    near = segment.points[around.near_wall[segment.points]]
    return float(segments.weight[near].sum()) > HANGING * segment.area


def _clamps(segments: Segments, segment: Segment, contact: SegmentContact) -> bool:
    """Return whether a neighbour holds a segment at both ends of its longer side."""
    size = segment.high - segment.low
    axis = int(np.argmax(size[:2]))
    margin = 0.05 * size[axis] + LEVEL
    along = segments.position[contact.points[~contact.under], axis]
    return bool(
        len(along) and along.min() < segment.low[axis] + margin and along.max() > segment.high[axis] - margin
    )  # fmt: skip


def _holder(
    segments: Segments, around: Surroundings, name: int, contacts: dict[int, SegmentContact], *, falls_off: bool
) -> int:  # fmt: skip
    """Segment that most likely holds a falling one (off its support, or tipping over on its foot); -1 if there is none.

    Segments that do not hang are preferred; for one that tips over those that are not below it, for one that falls off
    those that it does not carry; then the one with most contact in its lower half. A thing never belongs to a smaller
    one on top of it.
    """
    segment = segments.alive[name]
    rank = {
        other: (
            not _by_wall(segments, around, segments.alive[other]),
            not (c.carries if falls_off else c.stands),
            int((segments.position[c.points, 2] < segment.center[2]).sum()),
            -other,
        )
        for other, c in contacts.items()
        if not c.carries or segments.alive[other].area > segment.area
    }
    return max(rank, key=lambda other: rank[other], default=-1)
