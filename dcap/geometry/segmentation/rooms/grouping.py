"""Segments that make up one thing, by statics: what cannot stand by itself is part of what holds it.

A segment belongs to a neighbour if it covers most of what it stands on (a mattress on its frame, a top on its legs), if
a good part of its surface lies sideways against it (the front of a drawer), or if it would fall without it: nothing
below it, or too narrow a foot. What stands steadily on a larger surface is a thing of its own (a lamp on a table), and
so is what hangs on a wall.
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
"""Segments this near to the floor stand on it [m]."""
CRUMB = 0.01
"""Surface of the largest crumb [m^2]."""
COVERED = 0.55
"""Share of a carrying surface from which on what covers it belongs to what it covers [-]."""
AGAINST = 0.2
"""Share of a segment's surface that lies sideways against another one from which on they are one [-]."""
WEDGED = 0.03
"""Less than this share is chance [-]."""
STEADY = np.tan(np.deg2rad(8.0))
"""Segments that tip over when they lean by less do not stand by themselves [-]."""
LEVEL = 0.02
"""Points of a carrying surface lie within this of its level [m]."""
HANGING = 0.4
"""Share of a segment's surface that is near the wall it hangs at [-]."""
FOOT = 0.2
"""Segments that stand on a smaller share of their own plan do not stand there but touch it [-]."""
FALLING = 0.1
"""Certainty that a small falling segment belongs to its holder [-]: less than of the reasons that can be measured."""


@dataclass(frozen=True, eq=False, slots=True)
class Surroundings:
    """Floor and walls, which can hold a segment as well."""

    floor: float
    """Height [m]; nan where there is none."""
    near_wall: Mask
    """Points that are near walls or the ceiling, shape (n,)."""


@dataclass(frozen=True, eq=False, slots=True)
class SegmentContact:
    """A segment and one neighbour."""

    belongs: float
    """How certainly the segment continues or covers the neighbour, 0: it does not."""
    against: float
    """Share of the segment's surface that lies sideways against the neighbour [-]."""
    mutual: float
    """Mean of that share and the neighbour's [-]."""
    points: IntArray
    """Of the segment, shape (k,)."""
    on: Mask
    """Pairs in which the segment stands on the neighbour, shape (k,)."""
    under: Mask
    """Pairs in which the neighbour stands on the segment, shape (k,)."""

    @property
    def stands(self) -> bool:
        """Whether most of the contact is the segment standing on the neighbour."""
        return float(self.on.mean()) > 0.5

    @property
    def carries(self) -> bool:
        """Whether most of the contact is the neighbour standing on the segment."""
        return float(self.under.mean()) > 0.5


SegmentContacts = dict[int, dict[int, SegmentContact]]
"""Of each segment, by number of the neighbour; kept until one of the two is merged."""


def grouped(segments: Segments, around: Surroundings) -> None:
    """Merge segments until every one stands or hangs by itself; the most certain merge first."""
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
    """How certainly a segment belongs to one of its neighbours, 0: to none, and to which; completes its contacts."""
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
    """Contact of two segments. The one with more points above the other stands on it."""
    on, under = segments.standing(name, other), segments.standing(other, name)
    if on.sum() < under.sum():
        on = np.zeros_like(on)
    touch = segments.alive[name].touches[other]
    area = patch_area(segments.position[touch.a[segments.sideways(touch)]])
    against, again = (area / max(segments.alive[one].area, 1e-12) for one in (name, other))
    belongs = max(_continuing(segments, name, other), _covering(segments, name, other, on))
    return SegmentContact(belongs, against, min(0.5 * (against + again), 1.0), touch.a, on, under)


def _continuing(segments: Segments, name: int, other: int) -> float:
    """Certainty that a crumb is a segment of the surface next to it: what shows of a board between the books on it."""
    segment, touch = segments.alive[name], segments.alive[name].touches[other]
    if segment.area > CRUMB or segment.area > segments.alive[other].area:
        return 0.0
    flush = segments.flush(touch)
    return 2.0 + float(flush.mean()) if flush.sum() >= FEW else 0.0


def _covering(segments: Segments, name: int, other: int, on: Mask) -> float:
    """Certainty that a segment belongs to what it stands on, as it covers it; above 1, 0 if it does not."""
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
    """How certainly a segment belongs to what it lies against sideways, more for segments of like size, and to which.

    A good part of its surface must, against one neighbour or wedged between several.
    """
    leaning = {other: c for other, c in contacts.items() if c.against > WEDGED}
    if sum(c.against for c in leaning.values()) <= AGAINST:
        return 0.0, -1
    return max((c.mutual, other) for other, c in leaning.items())


def _stands(segments: Segments, around: Surroundings, segment: Segment, below: IntArray) -> bool:
    """Whether a segment keeps upright on the floor and on its points that stand on others."""
    position = segments.position[segment.points]
    points = np.concatenate([position[position[:, 2] < around.floor + ON_FLOOR], segments.position[below]])
    if not len(points):
        return False
    height = float(segment.center[2] - points[:, 2].max())
    return bool(inner_distance(points, segment.center) > STEADY * max(height, 0.0))


def _hangs(
    segments: Segments, around: Surroundings, segment: Segment, below: IntArray, contacts: dict[int, SegmentContact]
) -> bool:  # fmt: skip
    """Whether a segment hangs at a wall: without a foot, and not held from both ends by another segment."""
    if plan_area(segments.position[below]) > FOOT * plan_area(segments.position[segment.points]):
        return False
    return _by_wall(segments, around, segment) and not any(_clamps(segments, segment, c) for c in contacts.values())


def _by_wall(segments: Segments, around: Surroundings, segment: Segment) -> bool:
    """Whether a good part of a segment that does not reach the floor is near a wall or the ceiling."""
    if segment.low[2] < around.floor + ON_FLOOR:
        return False
    near = segment.points[around.near_wall[segment.points]]
    return float(segments.weight[near].sum()) > HANGING * segment.area


def _clamps(segments: Segments, segment: Segment, contact: SegmentContact) -> bool:
    """Whether a neighbour holds a segment at both ends of its longer side."""
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
    """Segment that most likely holds one that falls (off what is below, or over on its foot); -1 if nothing does.

    Rather what does not hang; for one that falls over rather what is not below it, for one that falls off rather what
    it does not carry; then what touches it most in its lower half. A thing never belongs to a smaller one on top of it.
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
