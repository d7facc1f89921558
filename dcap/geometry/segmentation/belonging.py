"""Things that belong together because of what they are: pillows to their bed, books to their row, legs to their table.

Statics takes a room apart into what stands by itself; a pillow does, and yet it is part of the bed. In: the label of
each thing, its measures and what touches what. Out: wholes with their members. BELONGS says what belongs to what.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from dcap.geometry.segmentation.contacts import FEW, Pieces
from dcap.geometry.segmentation.traits import Traits

ANY = "*"
SLACK = 0.02
"""What sticks out of a box by no more than this is inside [m]."""
FLOATING = 0.12
"""What floats no farther than this above or below something, or around it, goes with it [m]: a shade and its lamp."""


class Bond(StrEnum):
    """How a part is joined to its whole."""

    ON = "on"
    """The whole carries it."""
    TOUCHING = "touching"
    UNDER = "under"
    """It touches the whole, and that is above it."""
    INSIDE = "inside"
    """It is within the box of the whole."""
    AROUND = "around"
    """It is above, below or around the whole, and may not touch it."""


@dataclass(frozen=True, slots=True)
class Belongs:
    """A thing of one label belongs to a thing of another."""

    part: str
    whole: str
    bond: Bond
    becomes: str = ""
    """What the whole is called with the part; empty: as before."""


BELONGS = (
    Belongs("mattress", "bed", Bond.ON),
    Belongs("pillow", "bed", Bond.ON),
    Belongs("blanket", "bed", Bond.ON),
    Belongs("headboard", "bed", Bond.TOUCHING),
    Belongs("seat cushion", "sofa", Bond.ON),
    Belongs("seat cushion", "sofa base", Bond.ON, "sofa"),
    Belongs("seat cushion", "armchair", Bond.ON),
    Belongs("back cushion", "sofa", Bond.TOUCHING),
    Belongs("back cushion", "sofa base", Bond.TOUCHING, "sofa"),
    Belongs("back cushion", "armchair", Bond.TOUCHING),
    Belongs("sofa back", "sofa", Bond.TOUCHING),
    Belongs("sofa back", "sofa base", Bond.TOUCHING, "sofa"),
    Belongs("sofa arm", "sofa", Bond.TOUCHING),
    Belongs("sofa arm", "sofa base", Bond.TOUCHING, "sofa"),
    Belongs("basin", "cabinet", Bond.ON, "basin cabinet"),
    Belongs("basin", "counter", Bond.ON),
    Belongs("tap", "cabinet", Bond.ON, "basin cabinet"),
    Belongs("tap", "counter", Bond.ON),
    Belongs("tap", "bathtub", Bond.TOUCHING),
    Belongs("tap", "basin", Bond.TOUCHING),
    Belongs("toilet tank", "toilet", Bond.TOUCHING),
    Belongs("lamp shade", "table lamp", Bond.AROUND),
    Belongs("lamp shade", "floor lamp", Bond.AROUND),
    Belongs("lamp shade", "vase", Bond.AROUND, "table lamp"),
    Belongs("book", "book", Bond.TOUCHING),
    Belongs("rug", "rug", Bond.TOUCHING),
    Belongs("rug", "rug", Bond.INSIDE),
    Belongs(ANY, "box", Bond.INSIDE),
    Belongs("leg", ANY, Bond.UNDER),
)
"""What belongs to what, the strongest bond first."""
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
"""Labels of what is no thing by itself."""


@dataclass(frozen=True, slots=True)
class Whole:
    """Things that are one."""

    label: str
    """Empty where nothing is known."""
    main: int
    """Number of the thing that gives the whole its name."""
    members: tuple[int, ...]
    """Numbers of all its things, in order."""


def wholes(labels: Sequence[str], traits: Sequence[Traits], pieces: Pieces) -> list[Whole]:
    """Join things by their labels (empty: unknown); the wholes come in the order of their main things."""
    owner = list(range(len(labels)))
    name = list(labels)
    for i in range(len(labels)):
        rule, other = _whole_of(i, labels, traits, pieces)
        if rule is None or _root(owner, other) == i:
            continue
        owner[i] = _root(owner, other)
        name[other] = rule.becomes or name[other]
    roots = [_root(owner, i) for i in range(len(labels))]
    members = {root: tuple(i for i, other in enumerate(roots) if other == root) for root in sorted(set(roots))}
    return [Whole(_called(name, root, them), root, them) for root, them in members.items()]


def _called(name: Sequence[str], root: int, members: tuple[int, ...]) -> str:
    """What a whole is called: as its main thing or, where that is only a part, as the first member that is a thing."""
    return next((name[i] for i in (root, *members) if name[i] and name[i] not in ONLY_PARTS), "")


def _root(owner: list[int], i: int) -> int:
    while owner[i] != i:
        i = owner[i]
    return i


def _whole_of(i: int, labels: Sequence[str], traits: Sequence[Traits], pieces: Pieces) -> tuple[Belongs | None, int]:
    """The first rule by which a thing belongs to a larger one of its kind, or to another thing, and to which."""
    for rule in BELONGS:
        if rule.part not in (ANY, labels[i]):
            continue
        bond = {
            j: _strength(rule.bond, i, j, traits, pieces)
            for j in range(len(labels))
            if j != i
            and rule.whole in (ANY, labels[j])
            and (labels[i] != labels[j] or j < i or rule.bond is Bond.INSIDE)
        }
        best = max(bond, key=lambda j: (bond[j], -j), default=-1)
        if best >= 0 and bond[best] > 0.0:
            return rule, best
    return None, -1


def _strength(bond: Bond, i: int, j: int, traits: Sequence[Traits], pieces: Pieces) -> float:
    """How strongly two things are joined in that way, 0: not at all."""
    if bond is Bond.ON:
        return float(_carried(i, j, traits))
    a, b = pieces.alive[i], pieces.alive[j]
    if bond in (Bond.TOUCHING, Bond.UNDER):
        touch = a.touches.get(j)
        if touch is None:
            return 0.0
        counted = pieces.position[touch.b, 2] > a.center[2] if bond is Bond.UNDER else np.ones(len(touch.b), dtype=bool)
        return float(counted.sum()) if counted.sum() >= FEW else 0.0
    if bond is Bond.INSIDE:
        return float(((a.low > b.low - SLACK) & (a.high < b.high + SLACK)).all())
    gap = np.maximum(a.low, b.low) - np.minimum(a.high, b.high)
    apart = float(np.linalg.norm(0.5 * (a.low + a.high - b.low - b.high)[:2]))
    reach = 0.5 * float(max((a.high - a.low)[:2].max(), (b.high - b.low)[:2].max()))
    return max(1.0 - apart / reach, 0.0) if gap[2] < FLOATING else 0.0


def _carried(i: int, j: int, traits: Sequence[Traits]) -> bool:
    """Whether one thing rests on another one, directly or by way of things between them."""
    seen = {i}
    while (holder := traits[i].holder) >= 0 and holder not in seen:
        if holder == j:
            return True
        seen.add(holder)
        i = holder
    return False
