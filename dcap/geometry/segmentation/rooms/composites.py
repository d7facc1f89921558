"""Things that belong together by kind: pillows to their bed, books to their row, legs to their table.

Statics divides a room into things that stand by themselves; a pillow does, and yet it is part of the bed. In: the label
of each thing, its measures and the contacts. Out: composites with their members, by ATTACHMENT_RULES.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from dcap.geometry.segmentation.rooms.contacts import FEW, Segments
from dcap.geometry.segmentation.rooms.traits import Traits

ANY = "*"
SLACK = 0.02
"""Tolerance for counting a thing as inside a box [m]."""
FLOATING = 0.12
"""Largest distance of floating parts above, below or around something with which they belong together [m]: a shade and
its lamp."""


class Attachment(StrEnum):
    """Relation that joins a part to its whole."""

    ON = "on"
    """The whole carries it."""
    TOUCHING = "touching"
    UNDER = "under"
    """It touches the whole from below."""
    INSIDE = "inside"
    """It is within the box of the whole."""
    AROUND = "around"
    """It is above, below or around the whole, possibly without contact."""


@dataclass(frozen=True, slots=True)
class AttachmentRule:
    """A thing with one label belongs to a thing with another."""

    part: str
    whole: str
    attachment: Attachment
    becomes: str = ""
    """Name of the whole with the part; empty: unchanged."""


ATTACHMENT_RULES = (
    AttachmentRule("mattress", "bed", Attachment.ON),
    AttachmentRule("pillow", "bed", Attachment.ON),
    AttachmentRule("blanket", "bed", Attachment.ON),
    AttachmentRule("headboard", "bed", Attachment.TOUCHING),
    AttachmentRule("seat cushion", "sofa", Attachment.ON),
    AttachmentRule("seat cushion", "sofa base", Attachment.ON, "sofa"),
    AttachmentRule("seat cushion", "armchair", Attachment.ON),
    AttachmentRule("back cushion", "sofa", Attachment.TOUCHING),
    AttachmentRule("back cushion", "sofa base", Attachment.TOUCHING, "sofa"),
    AttachmentRule("back cushion", "armchair", Attachment.TOUCHING),
    AttachmentRule("sofa back", "sofa", Attachment.TOUCHING),
    AttachmentRule("sofa back", "sofa base", Attachment.TOUCHING, "sofa"),
    AttachmentRule("sofa arm", "sofa", Attachment.TOUCHING),
    AttachmentRule("sofa arm", "sofa base", Attachment.TOUCHING, "sofa"),
    AttachmentRule("basin", "cabinet", Attachment.ON, "basin cabinet"),
    AttachmentRule("basin", "counter", Attachment.ON),
    AttachmentRule("tap", "cabinet", Attachment.ON, "basin cabinet"),
    AttachmentRule("tap", "counter", Attachment.ON),
    AttachmentRule("tap", "bathtub", Attachment.TOUCHING),
    AttachmentRule("tap", "basin", Attachment.TOUCHING),
    AttachmentRule("toilet tank", "toilet", Attachment.TOUCHING),
    AttachmentRule("lamp shade", "table lamp", Attachment.AROUND),
    AttachmentRule("lamp shade", "floor lamp", Attachment.AROUND),
    AttachmentRule("lamp shade", "vase", Attachment.AROUND, "table lamp"),
    AttachmentRule("book", "book", Attachment.TOUCHING),
    AttachmentRule("rug", "rug", Attachment.TOUCHING),
    AttachmentRule("rug", "rug", Attachment.INSIDE),
    AttachmentRule(ANY, "box", Attachment.INSIDE),
    AttachmentRule("leg", ANY, Attachment.UNDER),
)
"""Rules that join parts to wholes, the strongest first."""
ONLY_PARTS = frozenset(
    {
        "leg",
        "headboard",
        "seat cushion",
        "back cushion",
        "sofa base",
        "sofa back",
        "sofa arm",
        "toilet tank",
        "lamp shade",
        "tap",
    }
)
"""Labels of parts that are not things on their own."""


@dataclass(frozen=True, slots=True)
class CompositeThing:
    """Several things that form one."""

    label: str
    """Label; empty if nothing is known."""
    main: int
    """Index of the thing that gives the whole its name."""
    members: tuple[int, ...]
    """Indices of all its things, in order."""


def composites(labels: Sequence[str], traits: Sequence[Traits], segments: Segments) -> list[CompositeThing]:
    """Join things by their labels (empty: unknown); the composites are in the order of their main things."""
    owner = list(range(len(labels)))
    name = list(labels)
    for i in range(len(labels)):
        rule, other = _whole_of(i, labels, traits, segments)
        if rule is None or _root(owner, other) == i:
            continue
        owner[i] = _root(owner, other)
        name[other] = rule.becomes or name[other]
    roots = [_root(owner, i) for i in range(len(labels))]
    members = {root: tuple(i for i, other in enumerate(roots) if other == root) for root in sorted(set(roots))}
    return [CompositeThing(_called(name, root, them), root, them) for root, them in members.items()]


def _called(name: Sequence[str], root: int, members: tuple[int, ...]) -> str:
    """Name of a whole: the name of its main thing or, if that is only a part, of the first member that is a thing."""
    return next((name[i] for i in (root, *members) if name[i] and name[i] not in ONLY_PARTS), "")


def _root(owner: list[int], i: int) -> int:
    while owner[i] != i:
        i = owner[i]
    return i


def _whole_of(
    i: int, labels: Sequence[str], traits: Sequence[Traits], segments: Segments
) -> tuple[AttachmentRule | None, int]:
    """The first rule by which a thing belongs to a larger one of its kind, or to another thing, and the index of that
    thing."""
    for rule in ATTACHMENT_RULES:
        if rule.part not in (ANY, labels[i]):
            continue
        strength = {
            j: _strength(rule.attachment, i, j, traits, segments)
            for j in range(len(labels))
            if j != i
            and rule.whole in (ANY, labels[j])
            and (labels[i] != labels[j] or j < i or rule.attachment is Attachment.INSIDE)
        }
        best = max(strength, key=lambda j: (strength[j], -j), default=-1)
        if best >= 0 and strength[best] > 0.0:
            return rule, best
    return None, -1


def _strength(attachment: Attachment, i: int, j: int, traits: Sequence[Traits], segments: Segments) -> float:
    """Strength of this relation between two things, 0: none."""
    if attachment is Attachment.ON:
        return float(_carried(i, j, traits))
    a, b = segments.alive[i], segments.alive[j]
    if attachment in (Attachment.TOUCHING, Attachment.UNDER):
        touch = a.touches.get(j)
        if touch is None:
            return 0.0
        counted = (
            segments.position[touch.b, 2] > a.center[2]
            if attachment is Attachment.UNDER
            else np.ones(len(touch.b), dtype=bool)
        )
        return float(counted.sum()) if counted.sum() >= FEW else 0.0
    if attachment is Attachment.INSIDE:
        return float(((a.low > b.low - SLACK) & (a.high < b.high + SLACK)).all())
    gap = np.maximum(a.low, b.low) - np.minimum(a.high, b.high)
    apart = float(np.linalg.norm(0.5 * (a.low + a.high - b.low - b.high)[:2]))
    reach = 0.5 * float(max((a.high - a.low)[:2].max(), (b.high - b.low)[:2].max()))
    return max(1.0 - apart / reach, 0.0) if gap[2] < FLOATING else 0.0


def _carried(i: int, j: int, traits: Sequence[Traits]) -> bool:
    """Return whether one thing rests on another one, directly or on things between them."""
    seen = {i}
    while (holder := traits[i].holder) >= 0 and holder not in seen:
        if holder == j:
            return True
        seen.add(holder)
        i = holder
    return False
