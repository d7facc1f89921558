"""PlaceIt3D's rules for a placement, on boxes: those that a sample requires, and those that a final state meets.

In: boxes of the scene's things and of the object in its final state, the `Intent` that all methods of a sample share,
and the truth. Out: yes or no for each rule. The numbers are those that the paper prints: Abdelreheem et al., PlaceIt3D
(ICCV 2025, arXiv 2505.05288), supplement 9.1. IoM is intersection over the smaller of the two. Its evaluator is a
closed program on scans that are not ours: the results here are its rules on our boxes and sentences, not numbers of its
benchmark. Where the printed rule is ambiguous, our choice is stated at the rule.

A sample requires `on` by its truth (the reading's base without one), for `near`, `adjacent` and `between` by
the words near, next_to and between of the region together with instances as references, and for `facing` by an
instance that the orientation names. Not counted, for want of a counterpart: references to parts of the base, facings
of a wall, a door or the viewer, sides, edges, distances, exclusions, poses, and our `under`, which means beneath a top
and so inside the box of a table, while PlaceIt3D's `below` keeps a centimetre off the thing. Our
sentences never require its relations `above`, `below`, `is_visible` and `not_visible`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from itertools import combinations

import numpy as np
import shapely

from dcap.arrays import Array
from dcap.evaluation.metrics.touching import TOUCHING
from dcap.evaluation.outcome_table import ExpectedOutcome
from dcap.scene.types.boxes import OrientedBox
from dcap.scene.types.choices import Intent
from dcap.scene.types.segmentation import Instance

NEAR_SHARE = 0.01
"""Largest distance of `near` over the size of the room [-], as printed."""
ADJACENT_M = 0.03
"""Largest distance of `adjacent` [m]."""
IOM = 0.5
"""Least IoM of `on` in plan, of `between` in plan and height, of `facing` across the front [-]."""
ON_M = 0.01
"""Largest |dz| of `on` [m]; also, by our choice, the largest gap of an object that rests on a surface."""
OVER_ANCHOR = 0.3
"""Largest overlap of `between` with either anchor [-]."""
ANCHORS_APART_M = 1.5
"""Largest distance between the anchors of `between` [m]."""
CONE_DEG = 30.0
"""Angle of `facing` [degrees]; here to either side of the front, as the paper does not say whether it is the whole
opening."""
FACING_M = 2.0
"""Largest distance of `facing` [m]."""
ROUNDING = 1e-9
"""Tolerance of thresholds [m or -]: boxes are sums and differences of doubles."""


class ConstraintKind(StrEnum):
    """Relations of PlaceIt3D that our sentences require."""

    ON = "on"
    NEAR = "near"
    ADJACENT = "adjacent"
    BETWEEN = "between"
    FACING = "facing"


BY_WORD = {
    "near": ConstraintKind.NEAR,
    "next_to": ConstraintKind.ADJACENT,
    "between": ConstraintKind.BETWEEN,
}
"""Region words that have a counterpart."""


@dataclass(frozen=True, slots=True)
class AskedConstraint:
    """One relation to things of the scene."""

    kind: ConstraintKind
    anchors: tuple[str, ...]
    """Ids of instances: it holds with any one of them, `between` with any two."""


@dataclass(frozen=True, eq=False, slots=True)
class FinalBox:
    """An object in its final state."""

    box: OrientedBox
    """Along the world's axes."""
    front: Array
    """World xy of its front, of any length, shape (2,)."""
    support_id: str
    """Instance that carries it or is nearest below; empty over nothing."""
    dz: float
    """Vertical distance to the surface that carries: gap or penetration, whichever is larger, not negative [m]. Not to
    the top of the carrier's box, which for a bed is the upper end of its headboard."""


def asked_constraints(
    instances: Sequence[Instance], intent: Intent, truth: ExpectedOutcome | None
) -> tuple[AskedConstraint, ...]:
    """Constraints of a sample; a relation word with several references is one constraint."""
    bases: tuple[str, ...] | None = (intent.base_id,)
    if truth is not None:
        same = tuple(one.id for one in instances if one.label == truth.base)
        bases = (truth.base_id,) if truth.base_id else same if truth.base else None
    found = [] if bases is None else [AskedConstraint(ConstraintKind.ON, bases)]
    known = {one.id for one in instances}
    references = tuple(dict.fromkeys(one for one in intent.region.references if one in known))
    for word in dict.fromkeys(intent.region.names):
        kind = BY_WORD.get(word)
        if kind is not None and len(references) >= (2 if kind is ConstraintKind.BETWEEN else 1):
            found.append(AskedConstraint(kind, references))
    if intent.orientation.facing in known:
        found.append(AskedConstraint(ConstraintKind.FACING, (intent.orientation.facing,)))
    return tuple(found)


def met(asked: AskedConstraint, final: FinalBox, boxes: Mapping[str, OrientedBox], room: float) -> bool:
    """Whether a constraint holds.

    Args:
        asked: the constraint; anchors that are not among `boxes` never fulfil it.
        final: the object.
        boxes: of the scene's instances, by id, as segmented before the placement.
        room: size of the room, see `room_size` [m].
    """
    there = [one for one in asked.anchors if one in boxes]
    if asked.kind is ConstraintKind.BETWEEN:
        return any(between(final.box, boxes[a], boxes[b]) for a, b in combinations(there, 2))
    if asked.kind is ConstraintKind.ON:
        return any(one == final.support_id and on(final.box, boxes[one], final.dz) for one in there)
    if asked.kind is ConstraintKind.FACING:
        return any(facing(final.box, final.front, boxes[one]) for one in there)
    reach = ADJACENT_M if asked.kind is ConstraintKind.ADJACENT else NEAR_SHARE * room
    return any(within(final.box, boxes[one], reach) for one in there)


def room_size(bounds: Array) -> float:
    """Our definition of "room size": the diagonal in plan of the box (2, 3) of the whole scene [m]."""
    return float(np.linalg.norm((bounds[1] - bounds[0])[:2]))


def upright_box(bounds: Array) -> OrientedBox:
    """The box along the world's axes between a lowest and a highest corner, shape (2, 3) [m]."""
    low, high = bounds
    return OrientedBox(0.5 * (low + high), np.eye(3), 0.5 * (high - low))


def physical(penetration: float | None, gap: float | None) -> bool:
    """No intersection, and it rests on a surface.

    Theirs are a test of meshes for any intersection, and no printed tolerance. Ours: nothing deeper than the millimetre
    below which surfaces count as touching, and a gap of at most a centimetre [m]; None: over nothing.
    """
    if penetration is None or gap is None:
        return False
    return penetration <= TOUCHING + ROUNDING and gap <= ON_M + ROUNDING


def within(a: OrientedBox, b: OrientedBox, reach: float) -> bool:
    """`near` and `adjacent`: whether two boxes are within `reach` [m]."""
    return box_distance(a, b) <= reach + ROUNDING


def on(thing: OrientedBox, base: OrientedBox, dz: float) -> bool:
    """Over the base, and |dz| from the surface of it that carries, see `FinalBox.dz`."""
    return plan_iom(thing, base) >= IOM - ROUNDING and abs(dz) <= ON_M + ROUNDING


def between(thing: OrientedBox, a: OrientedBox, b: OrientedBox) -> bool:
    """In the box along the world's axes that two anchors span, and not over either. Their overlap is taken as IoM in
    plan, their distance as that of their boxes."""
    corners = np.concatenate([a.corners, b.corners])
    whole = upright_box(np.stack([corners.min(axis=0), corners.max(axis=0)]))
    inside = plan_iom(thing, whole) >= IOM - ROUNDING and interval_iom(heights(thing), heights(whole)) >= IOM - ROUNDING
    clear_of_anchors = max(plan_iom(thing, a), plan_iom(thing, b)) <= OVER_ANCHOR + ROUNDING
    return inside and clear_of_anchors and within(a, b, ANCHORS_APART_M)


def facing(thing: OrientedBox, front: Array, target: OrientedBox) -> bool:
    """Front towards the middle of the target's box in plan; boxes no farther apart than printed; and, across the front,
    their extents overlap."""
    way = (target.center - thing.center)[:2]
    lengths = float(np.linalg.norm(front)), float(np.linalg.norm(way))
    if min(lengths) < ROUNDING:
        return False
    ahead = front / lengths[0]
    if ahead @ way / lengths[1] < np.cos(np.radians(CONE_DEG)) - ROUNDING:
        return False
    across = np.array([-ahead[1], ahead[0]])
    sides = [one.corners[:4, :2] @ across for one in (thing, target)]
    lateral = interval_iom(*((float(one.min()), float(one.max())) for one in sides))
    return lateral >= IOM - ROUNDING and within(thing, target, FACING_M)


def box_distance(a: OrientedBox, b: OrientedBox) -> float:
    """Distance of two boxes that are turned about the vertical only [m]; 0 where they overlap."""
    level = float(shapely.distance(plan(a), plan(b)))
    return float(np.hypot(level, max(a.bottom - b.top, b.bottom - a.top, 0.0)))


def plan_iom(a: OrientedBox, b: OrientedBox) -> float:
    """IoM of two boxes seen from above [-]; 0 where one has no area."""
    smaller = min(plan(a).area, plan(b).area)
    return float(plan(a).intersection(plan(b)).area / smaller) if smaller > 0.0 else 0.0


def interval_iom(a: tuple[float, float], b: tuple[float, float]) -> float:
    """IoM of two intervals [-]; 0 where one has no length."""
    smaller = min(a[1] - a[0], b[1] - b[0])
    return max(min(a[1], b[1]) - max(a[0], b[0]), 0.0) / smaller if smaller > 0.0 else 0.0


def heights(box: OrientedBox) -> tuple[float, float]:
    """Heights of its lower and upper face [m]."""
    return box.bottom, box.top


def plan(box: OrientedBox) -> shapely.Polygon:
    """Its rectangle seen from above [m]."""
    return shapely.Polygon(box.corners[:4, :2])
