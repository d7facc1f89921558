"""Grounds places on the base: parts, regions, places next to other things, and constraints.

In: a target whose base is known, and a place of the sentence. Out: the target with regions, references and constraints
(excluded places, distances, a thing to lean on), named as in the reply, and with the phrases that were not understood.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from dcap.knowledge.lexicon import lineage
from dcap.language.offline.ground import (
    Found,
    candidates,
    choose,
    gap,
    inventory,
    is_stacked,
    named,
    near_miss,
    part_of,
)
from dcap.language.offline.likelihood import label_thing
from dcap.language.offline.nouns import Noun
from dcap.language.offline.placing import BESIDE, PLACEABLE, bare_region, whole
from dcap.language.offline.reading import Place, Reading
from dcap.language.offline.sentence import SIDED, SUPPORT
from dcap.language.protocol.replies import Candidate, Constraint
from dcap.language.protocol.requests import PART_SIDES, InstanceView, IntentRequest

SIDE_REGIONS = {"left": "left", "right": "right", "front": "front", "back": "back", "head": "head", "foot": "foot",
                "top": "back", "bottom": "front", "nearest": "front", "middle": "middle"}  # fmt: skip
"""Sides as regions of a horizontal surface, viewed like a page: the top is far away."""
REACH = 0.5
"""Largest gap between a support and another thing for a place next to that thing [m]."""
PART_REGIONS = {"headboard": "head", "footboard": "foot", "back": "back"}
"""Region of a part that the segmentation did not find."""
PART_SIDES_OF = {**{side: side for side in PART_SIDES}, "1": "bottom", "last": "top", "1 from bottom": "bottom",
                 "1 from top": "top", "shortest": "bottom", "tallest": "top"}  # fmt: skip
"""Meaning of a side for several parts with the same name."""
LEANED_PARTS = ("back", "headboard", "side")
"""Parts on which a thing leans when it stands on something that has them: the sofa's back."""


@dataclass(slots=True)
class Target:
    """Base, regions, references and constraints found so far."""

    base: InstanceView | None = None
    missing: str = ""
    meant: str = ""
    """The label nearest to the missing thing."""
    part: str = ""
    which: str = ""
    regions: list[str] = field(default_factory=list)
    references: list[str] = field(default_factory=list)
    words: list[str] = field(default_factory=list)
    not_understood: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    used: list[Place] = field(default_factory=list)
    """Places that selected the base and have no further meaning."""
    candidates: tuple[Candidate, ...] = ()
    """Candidates for the base's noun, the base first."""
    reference_candidates: tuple[Candidate, ...] = ()
    """Candidates for a reference, if it is ambiguous."""
    constraints: list[Constraint] = field(default_factory=list)
    lean_on: str = ""

    def add_regions(self, names: Sequence[str]) -> None:
        """Add regions that are not there yet."""
        self.regions.extend(name for name in names if name not in self.regions)

    def add_references(self, names: Sequence[str]) -> None:
        """Add references that are not there yet."""
        self.references.extend(name for name in names if name not in self.references)


def as_candidates(found: Found) -> tuple[Candidate, ...]:
    """Candidates for a noun in the form of the reply; instances that are too unlikely are left out."""
    pairs = zip(found.instances, found.scores, strict=True)
    return tuple(Candidate(id=one.id, likelihood=score) for one, score in pairs if score > 0.0)


def is_any(instance: InstanceView) -> bool:
    """Return whether any instance of its kind will do, as with walls: a thing may stand against any of them."""
    return instance.structure and label_thing(instance) in ("wall", "floor", "ceiling")


def ground_own_region(target: Target, support: Place, request: IntentRequest) -> None:
    """Set the region or part named before "of the bed"."""
    noun = support.nouns[0]
    assert target.base is not None
    if noun.owner is None:
        return
    part = part_of(noun, target.base)
    if part and support.relation in SUPPORT:
        set_part(target, noun)
    elif noun.region or noun.sides:
        region_words(target, noun, request, noun.text)
    elif part:
        set_part(target, noun)
    part_of_whole = noun.owner.owner is not None or not named(noun.owner, request.instances)
    if part_of_whole and not target.part:  # "the corner of the mattress of the bed"
        set_part(target, noun.owner)


def region_words(target: Target, noun: Noun, request: IntentRequest, text: str) -> None:
    """Add a noun's sides and region as region names; for an edge, the thing that it faces as a reference."""
    names = regions_of(noun, target.base)
    target.add_regions(names)
    (target.words if names else target.not_understood).append(text)
    if noun.toward is not None:
        seen = references_of(noun.toward, target, request, several=False)
        target.add_references(seen)
        (target.words if seen else target.not_understood).append(noun.toward.text)


def regions_of(noun: Noun, base: InstanceView | None) -> list[str]:
    """Sides and region of a noun as region names; the end of a bed is its foot."""
    names = [SIDE_REGIONS[side] for side in noun.sides if side in SIDE_REGIONS]
    bed = base is not None and "bed" in lineage(label_thing(base))
    if noun.region == "end" and bed and noun.toward is None:
        names = [name for name in names if name in ("head", "foot")] or ["foot"]
    elif noun.region and noun.region != "side" and not (noun.region == "end" and names):  # "left end" means left
        names += ["long", "edge"] if noun.region == "long_edge" else [noun.region]
    return names


def ground_further(target: Target, place: Place, request: IntentRequest) -> None:
    """Ground a place other than the one that named the base."""
    noun = place.nouns[0]
    assert target.base is not None
    unclear = place.relation == "between" and any(noun.region for noun in place.nouns)
    if place.relation in ("opposite", "which", "carrying", "lacking") or unclear:
        target.not_understood.append(place.text)
    elif place.relation in PLACEABLE:
        ground_on_again(target, place, request)
    elif (noun.region or noun.is_region) and (
        noun.owner is None or noun.region in ("edge", "long_edge", "corner", "center", "middle")
    ):
        region_words(target, noun, request, place.text)
    else:
        add_neighbour_regions(target, place, request)


def ground_on_again(target: Target, place: Place, request: IntentRequest) -> None:
    """Ground "... on the mattress", "... on the left", "... in the corner"."""
    noun = place.nouns[0]
    assert target.base is not None
    names = {part.name for part in target.base.parts}
    own = next((part for part in noun.parts if part in names), "")
    if own and not noun.is_region and not bare_region(noun):
        set_part(target, noun)
    elif noun.region or noun.is_region or bare_region(noun):
        owner = named(noun.owner, request.instances) if noun.owner is not None else ()
        if owner and target.base not in owner:
            add_neighbour_regions(
                target, Place(f"{(noun.sides or ('near',))[0]}_of", (noun.owner or noun,), False, place.text), request
            )
        else:
            region_words(target, noun, request, place.text)
    elif noun.pronoun == "it" or target.base in named(noun, request.instances):  # the same thing again
        target.used = [*target.used, place]
    else:
        target.not_understood.append(place.text)  # a second support


def add_neighbour_regions(target: Target, place: Place, request: IntentRequest) -> None:
    """Ground near, next to, between, under: regions with references."""
    assert target.base is not None
    references: list[str] = []
    for noun in place.nouns:
        if references and place.relation != "between" and not within_reach(noun, target.base, request):
            target.not_understood.append(noun.text)
            continue
        found = references_of(noun, target, request, several=place.relation == "between" and len(place.nouns) == 1)
        if not found and target.base in named(noun, request.instances):  # "parallel to the wall behind the desk"
            target.not_understood.append(place.text)
            return
        if not found:
            part = next((p for p in noun.parts if p in PART_REGIONS), "")
            if part and place.relation in ("near", "against", "next_to", "nearest"):
                target.add_regions([PART_REGIONS[part]])
                target.words.append(place.text)
                return
            target.missing = noun.text
            target.meant = near_miss(noun, request.instances)
            target.base = None
            target.notes.append(f"the scene has {inventory(request.instances)}")
            return
        references.extend(found)
    if references == [target.base.id]:
        target.not_understood.append(place.text)
        return
    target.add_regions(BESIDE.get(place.relation, ("near",)))
    target.add_references(references)
    target.words.append(place.text)


def within_reach(noun: Noun, base: InstanceView, request: IntentRequest) -> bool:
    """Return whether a thing with that name is near enough to the base for a place next to it on the base."""
    return any(gap(i, base) < REACH for i in named(noun, request.instances)) or part_of(noun, base) != ""


def references_of(noun: Noun, target: Target, request: IntentRequest, *, several: bool) -> list[str]:
    """Ids of the things, or `part:NAME`, to which a relation refers; the nearest to the base win."""
    assert target.base is not None
    base = target.base
    found = [i for i in named(noun, request.instances) if i.id != base.id]
    near_ones = [i for i in found if gap(i, base) < 0.05]
    part = part_of(noun, base)
    if part and not near_ones:
        side = next((side for side in noun.sides if side in PART_SIDES and side != part), "")
        return [f"part:{part}/{side}" if side and not several else f"part:{part}"]
    if not found:
        return []
    if several:
        pool = near_ones if len(near_ones) > 1 else found
        return [i.id for i in sorted(pool, key=lambda i: (gap(i, base), i.id))[:2]]
    pool = near_ones or found
    nearest = min(gap(i, base) for i in pool)
    chosen: Found = choose(
        [i for i in pool if gap(i, base) <= nearest + 0.05], noun, (), request.instances, request.room_center
    )
    target.notes += chosen.viewpoints
    told = target.reference_candidates[0].id if target.reference_candidates else ""
    if any(i.id == told for i in chosen.instances) and not noun.sides and not noun.colour:
        return [told]  # the thing that identified the base
    if (chosen.open or chosen.best.guesses) and not noun.plural and not is_any(chosen.best):
        target.reference_candidates = as_candidates(chosen)
    return [chosen.best.id]


def facing_of(reading: Reading, target: Target, request: IntentRequest) -> tuple[str, tuple[str, ...]]:
    """Target that the front should face, and the phrases about it that were not understood."""
    facing = reading.facing
    if facing is None or target.base is None:
        return "", ()
    away = "away:" if facing.mode == "away" else ""
    noun = facing.noun
    if noun.pronoun == "viewer":
        return f"{away}viewer", ()
    if noun.thing == "room" or (noun.owner is not None and noun.owner.thing == "room"):
        return f"{away}room", ()
    part = part_of(noun, target.base)
    if not part or named(noun, request.instances):
        found = list(named(noun, request.instances))
        if found:
            nearest = min(found, key=lambda i: (gap(i, target.base or i), i.id))
            return f"{away}{nearest.id}", ()
    if part:
        return f"{away}part:{part}", ()
    if noun.thing in ("wall", "door"):
        return f"{away}{noun.thing}", ()
    side = next((s for s in noun.sides if s in ("left", "right", "front", "back")), "")
    return (f"{away}{side}", ()) if side else ("", (facing.text,))


def set_part(target: Target, noun: Noun) -> None:
    """Request the part named by the noun."""
    assert target.base is not None
    part = part_of(noun, target.base)
    if part:
        target.part = part
        target.which = " ".join([side for side in noun.sides if side != part][:1])
        target.words.append(noun.text)


def limit(target: Target, place: Place, request: IntentRequest) -> None:
    """Ground distances, "as far as possible from" and "away from" as constraints relative to edges or things."""
    assert target.base is not None
    noun, measure = place.nouns[0], place.measure
    whose = noun.owner if noun.region == "side" and noun.sides else None
    if whose is not None and whose.thing and target.base not in candidates(whose, request.instances):
        relation = next((one for one, side in SIDED.items() if (side,) == noun.sides), place.relation)
        noun, place = (
            whose,
            replace(place, relation=relation, nouns=(whose,)),
        )  # "10 cm from the right side of the lamp"
    kind = {"exactly": "exactly", "least": "at_least", "most": "at_most"}[measure.mode] if measure else place.relation
    metres = measure.metres if measure else 0.0
    if noun.region or noun.is_region:
        names = regions_of(noun, target.base)
        if not names or (noun.owner is not None and target.base not in candidates(noun.owner, request.instances)):
            target.not_understood.append(place.text)
            return
        kind = "away" if kind == "farthest" else kind
        facing = references_of(noun.toward, target, request, several=False) if noun.toward else [""]
        if facing:
            keep(target, place, kind, names, facing, metres)
        else:
            target.not_understood.append(place.text)
        return
    sides = [name for name in BESIDE.get(place.relation, ()) if name in ("left", "right", "front", "back")]
    for one in place.nouns:
        found = references_of(one, target, request, several=one.plural)
        if not found:
            target.not_understood.append(place.text)
            return
        if sides:
            target.add_regions([*sides, "near"])
            target.add_references(found)
        keep(target, place, kind, [], found, metres)


def exclude(target: Target, place: Place, request: IntentRequest) -> None:
    """Ground "not on the pillow", "not near the lamp", "not at the edge"."""
    assert target.base is not None
    noun = place.nouns[0]
    if place.measure is not None:  # only "at least" states a least distance
        target.not_understood.append(place.text)
        return
    if noun.region or noun.is_region:
        names = regions_of(noun, target.base)
        if names:
            keep(target, place, "not_in", names, [""], 0.0)
        else:
            target.not_understood.append(place.text)
        return
    found = [i.id for i in named(noun, request.instances) if i.id != target.base.id]
    part = part_of(noun, target.base)
    if part and place.relation in (*SUPPORT, "at") and not (found and not is_stacked(target.base, part)):
        side = next((PART_SIDES_OF[side] for side in noun.sides if side in PART_SIDES_OF), "")
        if noun.sides and not side:
            target.not_understood.append(place.text)
            return
        found = [f"part:{part}/{side}" if side else f"part:{part}"]
    elif part:
        found = found or [f"part:{part}"]
    if not found:
        if place.relation in SUPPORT and target.base in named(noun, request.instances):
            target.not_understood.append(place.text)  # contradicts "on the bed"
        target.words.append(place.text)  # a thing that is not there needs no exclusion
        return
    if place.relation in (*SUPPORT, "at", "under", "against"):
        keep(target, place, "not_on", [], found, 0.0)
    elif place.relation in BESIDE:
        keep(target, place, "not_in", list(BESIDE[place.relation]), found, 0.0)
    else:
        target.not_understood.append(place.text)


def nearest_to_references(found: str, target: Target, request: IntentRequest) -> str:
    """Among walls, the one at which the other named things stand: "against the wall by the door"."""
    by_id = {one.id: one for one in request.instances}
    one, beside = by_id.get(found), [by_id[name] for name in target.references if name in by_id]
    if one is None or not is_any(one) or not beside:
        return found
    walls = [i for i in request.instances if is_any(i) and label_thing(i) == label_thing(one)]
    return min(walls, key=lambda wall: (round(off_wall(wall, beside[0]), 3), wall.id)).id


def off_wall(wall: InstanceView, other: InstanceView) -> float:
    """Distance of the middle of a thing from a wall [m]."""
    apart = np.maximum(np.subtract(wall.low, other.center), np.subtract(other.center, wall.high))
    return float(np.linalg.norm(np.maximum(apart, 0.0)))


def keep(
    target: Target, place: Place, kind: str, regions: Sequence[str], references: Sequence[str], metres: float
) -> None:  # fmt: skip
    """Add a constraint for each reference."""
    for reference in references:
        tree = {"kind": kind, "regions": tuple(regions), "reference": reference, "metres": metres, "words": place.text}
        target.constraints.append(Constraint.model_validate(tree))
    target.words.append(place.text)


def lean(target: Target, place: Place, request: IntentRequest) -> None:
    """Set the support that the object leans on: a part of the base, or a thing or wall next to it."""
    assert target.base is not None
    noun = place.nouns[0]
    part = part_of(noun, target.base)
    whole_noun = whole(place)
    if part and (noun.owner is None or target.base in named(whole_noun, request.instances)):
        target.lean_on = f"part:{part}"
    elif target.base in named(whole_noun, request.instances) and noun.owner is None:
        back = next((one for one in LEANED_PARTS if any(p.name == one for p in target.base.parts)), "")
        target.lean_on = f"part:{back}" if back else ""
    elif found := references_of(whole_noun, target, request, several=False):
        target.lean_on = nearest_to_references(found[0], target, request)
    (target.words if target.lean_on else target.not_understood).append(place.text)
