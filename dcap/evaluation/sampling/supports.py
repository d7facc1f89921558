"""Surfaces of a scene that can carry things: by label and parts, with their free room and their names in sentences.

In: the instances as clients see them. Out: `CarryingSurface` rows. Only labels from the source, or equally certain
ones, count: a truth must not rest on a guess. The embedded reader has no influence: things it would misread are kept.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dcap.knowledge.kinds import deformable_kind
from dcap.knowledge.lexicon import default_parts, in_line, is_a, label_words, lineage, thing_of, vocabulary
from dcap.language.offline.ground import stands_on
from dcap.language.protocol.requests import InstanceView, PartView

SURE = 0.9
"""Least confidence of a label on which a truth may rest [-]."""
CARRIERS = ("bed", "sofa", "armchair", "chair", "bench", "stool", "table", "desk", "nightstand", "shelf", "cabinet",
            "rug", "floor")  # fmt: skip
"""Kinds of things that requests name as supports; shades, rims and sills carry badly."""
FLAT_TOPS = ("table", "desk", "nightstand", "cabinet")
"""Kinds on whose edges and corners things stay."""
WALKED_ON = ("floor", "rug")
HIGHEST = 1.5
"""Height above which a surface is out of reach [m]."""
LEAST_SIDE = 0.15
"""Least width of a surface for placing things [m]."""
CELLS = 24
"""Cells along each side of a surface in which standing things are counted [-]."""
CLEAR = 0.02
"""Largest gap between a surface and a thing that stands on it [m]."""
OVERHEAD = 2.2
"""Free height with nothing above [m]."""
LONGEST_NAME = 2
"""Most words of a label that is used as a name [-]."""
LYING = ("book", "pillow", "cushion", "blanket", "clothes")
"""Things that lie on furniture but are no landmarks there."""


@dataclass(frozen=True, slots=True)
class CarryingSurface:
    """A surface for requests."""

    base: InstanceView
    thing: str
    """Its kind, a thing of the lexicon."""
    names: tuple[str, ...]
    """Nouns that mean it and nothing else."""
    several: bool
    """Whether other instances have the same label: then a sentence means any of them."""
    part: str
    """Name of the part that carries; empty where more than one may."""
    sides: tuple[float, float]
    """Longer and shorter side [m]."""
    headroom: float
    """Free height above most of it [m]."""
    free: float
    """Free share of the surface [-]."""
    center_free: bool
    """Whether its middle is free."""
    soft: bool
    """Whether it is deformable."""
    landmarks: tuple[InstanceView, ...]
    """Nameable things that stand on it, or on a floor next to it."""

    def is_kind(self, *kinds: str) -> bool:
        """Whether it is one of some kinds."""
        return any(is_a(self.thing, kind) for kind in kinds)


def carrying_surfaces(instances: Sequence[InstanceView]) -> tuple[CarryingSurface, ...]:
    """One row for each label that requests can name, in the order of ids."""
    found: dict[str, CarryingSurface] = {}
    for one in sorted(instances, key=lambda one: one.id):
        surface = surface_of(one, instances)
        if surface is not None:
            key = " ".join(label_words(one.label))
            known = found.get(key)
            # of several similar ones the one with the least room decides what fits
            if known is None or surface.free * np.prod(surface.sides) < known.free * np.prod(known.sides):
                found[key] = surface
    return tuple(sorted(found.values(), key=lambda one: one.base.id))


def is_sure(instance: InstanceView) -> bool:
    """Whether its label is certain."""
    return not instance.guesses and instance.confidence >= SURE


def thing_name(instance: InstanceView) -> str:
    """The thing that its label means; empty if the lexicon does not know it."""
    thing = thing_of(instance.label)
    return thing.id if thing is not None else ""


def surface_of(base: InstanceView, instances: Sequence[InstanceView]) -> CarryingSurface | None:
    """The surface of one instance, None if it can carry nothing or cannot be named."""
    thing = thing_name(base)
    if not is_sure(base) or not any(is_a(thing, kind) for kind in CARRIERS):
        return None
    several, names = naming(base, instances)
    if not names:
        return None
    part, only = carrying_part(base, thing)
    sides = plan_sides(part, base)
    top = level_of(part, base)
    free, headroom, center_free = room_on(part, base, top, instances)
    if min(sides) < LEAST_SIDE or (top > HIGHEST and not base.structure) or headroom <= 0.0:
        return None
    return CarryingSurface(
        base=base,
        thing=thing,
        names=names,
        several=several,
        part=part.name if part is not None and only else "",
        sides=(max(sides), min(sides)),
        headroom=headroom,
        free=free,
        center_free=center_free,
        soft=bool(deformable_kind(base.label)),
        landmarks=landmarks_of(base, thing, instances),
    )


def naming(base: InstanceView, instances: Sequence[InstanceView]) -> tuple[bool, tuple[str, ...]]:
    """Whether there are several of its label, and the nouns that mean only these; none if others are of its kind with
    another name."""
    thing, words = thing_name(base), label_words(base.label)
    alike = [one for one in instances if one.id != base.id and is_a(thing_name(one), thing)]
    if any(label_words(one.label) != words or not is_sure(one) for one in alike):
        return True, ()
    name = " ".join(words)
    known = any(meaning.kind == "thing" for meaning in vocabulary().get(tuple(words), ()))
    as_labelled = (name,) if known and len(words) <= LONGEST_NAME else ()
    return bool(alike), tuple(dict.fromkeys((*as_labelled, thing)))


def carrying_part(base: InstanceView, thing: str) -> tuple[PartView | None, bool]:
    """The part that carries things on such a thing, and whether it is the only one; None if it has none."""
    for kind in lineage(thing):
        wanted = default_parts().get(kind, ())
        carrying = [name for name in wanted if any(p.name == name and p.support_area > 0 for p in base.parts)]
        if carrying:
            alike = sorted((p for p in base.parts if p.name == carrying[0]), key=lambda p: (p.center[2], p.index))
            covered = kind == "bed" and len([name for name in carrying if name != "frame"]) > 1
            return alike[(len(alike) - 1) // 2], not covered
    return None, False


def plan_sides(part: PartView | None, base: InstanceView) -> tuple[float, float]:
    """Horizontal sides of a part along x and y, or along its own axes if it is rotated [m]."""
    if part is None:
        return base.size[0], base.size[1]
    across = base.high[0] - base.low[0], base.high[1] - base.low[1]
    kept, swapped = (abs(across[0] - base.size[k]) + abs(across[1] - base.size[1 - k]) for k in (0, 1))
    return (part.size[0], part.size[1]) if kept <= swapped else (part.size[1], part.size[0])


def level_of(part: PartView | None, base: InstanceView) -> float:
    """Height of the surface [m]."""
    return base.high[2] if part is None else part.center[2] + part.size[2] / 2


def room_on(
    part: PartView | None, base: InstanceView, top: float, instances: Sequence[InstanceView]
) -> tuple[float, float, bool]:
    """Free share of the surface [-], free height above the free part [m], and whether its middle is free."""
    center = base.center if part is None else part.center
    sides = plan_sides(part, base)
    x, y = (center[k] + sides[k] * ((np.arange(CELLS) + 0.5) / CELLS - 0.5) for k in (0, 1))
    roof = np.full((CELLS, CELLS), top + OVERHEAD)
    boxes = [(one.low, one.high) for one in instances if one.id != base.id and not one.structure]
    own = [p for p in base.parts if part is not None and p.name == part.name and p.center[2] > part.center[2] + 0.1]
    boxes += [tuple(tuple(c + s * e / 2 for c, e in zip(p.center, p.size, strict=True)) for s in (-1, 1)) for p in own]  # type: ignore[misc]
    for low, high in boxes:
        if high[2] <= top + CLEAR or low[2] >= top + OVERHEAD:
            continue
        inside = np.outer((x >= low[0]) & (x <= high[0]), (y >= low[1]) & (y <= high[1]))
        roof[inside] = np.minimum(roof[inside], max(low[2], top))
    heights = roof - top
    open_cells = heights > CLEAR + 0.05
    if not open_cells.any():
        return 0.0, 0.0, False
    middle = slice(CELLS // 2 - CELLS // 6, CELLS // 2 + CELLS // 6)
    headroom = float(np.quantile(heights[open_cells], 0.25))
    return float(open_cells.mean()), headroom, bool(open_cells[middle, middle].all())


def landmarks_of(base: InstanceView, thing: str, instances: Sequence[InstanceView]) -> tuple[InstanceView, ...]:
    """Things that stand on a base (on a floor: furniture) and are the only ones of their kind."""
    on_floor = is_a(thing, "floor")
    found = []
    for one in instances:
        kind = thing_name(one)
        others = [other for other in instances if other.id != one.id and in_line(thing_name(other) or "?", kind)]
        if not kind or one.structure or one.id == base.id or others or not is_sure(one):
            continue
        if any(is_a(kind, lying) for lying in LYING) or len(label_words(one.label)) > LONGEST_NAME:
            continue
        here = is_a(kind, "furniture") and one.low[2] < CLEAR + 0.1 if on_floor else stands_on(one, base)
        if here and not any(is_a(kind, one_kind) for one_kind in ("rug", "floor")):
            found.append(one)
    return tuple(found)
