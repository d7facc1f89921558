"""The support, the part and the region that a sentence asks for, in a given scene.

In: a `Reading` and the instances. Out: a `Target`: the base or what is missing, and part, regions and references in
the words of the reply. The first place that names a thing is the base; later ones narrow it down or say where on it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

from dcap.language.offline.ground import (
    Found,
    candidates,
    carrier,
    choose,
    floor_of,
    gap,
    inventory,
    is_wider,
    label_thing,
    named,
    owners,
    part_of,
    stands_on,
)
from dcap.language.offline.lexicon import inside_parts, label_words, lineage
from dcap.language.offline.nouns import Noun
from dcap.language.offline.placing import BESIDE, PLACEABLE, bare_region, names_support, placing_of, whole
from dcap.language.offline.sentence import SUPPORT, Place, Reading
from dcap.language.protocol.requests import PART_SIDES, InstanceView, IntentRequest

SIDE_REGIONS = {"left": "left", "right": "right", "front": "front", "back": "back", "head": "head", "foot": "foot",
                "top": "back", "bottom": "front", "nearest": "front", "middle": "middle"}  # fmt: skip
"""Sides as regions of a horizontal surface, seen like a page: the top is far away."""
REACH = 0.5
"""Beside a second thing farther from the support than this nothing can be put [m]."""
PART_REGIONS = {"headboard": "head", "footboard": "foot", "back": "back"}
"""Where a part would be that the segmentation did not find."""


@dataclass(slots=True)
class Target:
    """What was found."""

    base: InstanceView | None = None
    missing: str = ""
    part: str = ""
    which: str = ""
    regions: list[str] = field(default_factory=list)
    references: list[str] = field(default_factory=list)
    words: list[str] = field(default_factory=list)
    not_understood: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    used: list[Place] = field(default_factory=list)
    """Places that chose the base and say nothing more."""

    def add_regions(self, names: Sequence[str]) -> None:
        """Regions that are not there yet."""
        self.regions.extend(name for name in names if name not in self.regions)

    def add_references(self, names: Sequence[str]) -> None:
        """References that are not there yet."""
        self.references.extend(name for name in names if name not in self.references)


def target_of(reading: Reading, request: IntentRequest) -> Target:
    """Ground the places of a sentence; LanguageError if none names a support or a neighbour."""
    target = Target()
    main = placing_of(reading).place
    if names_support(main):
        ground_support(target, main, reading, request)
    else:
        ground_by_neighbour(target, main, request)
    for place in reading.places:
        said = place is main and names_support(main)
        if target.base is not None and not said and not place.restrict and place not in target.used:
            ground_further(target, place, request)
    if target.base is not None and names_support(main):
        ground_own_region(target, main, request)
    target.not_understood[:0] = still_unknown(reading.not_understood, target, request)
    return target


def still_unknown(phrases: Sequence[str], target: Target, request: IntentRequest) -> list[str]:
    """Phrases whose words are not those of a label that was found: a scene may name what the lexicon does not know."""
    ids = {*target.references, target.base.id if target.base is not None else ""}
    told = " ".join(target.not_understood)
    said = {word for i in request.instances if i.id in ids for word in label_words(i.label)}
    return [phrase for phrase in phrases if phrase not in told and not said.issuperset(label_words(phrase))]


# the base -----------------------------------------------------------------------------------------------------------


def ground_support(target: Target, support: Place, reading: Reading, request: IntentRequest) -> None:
    """The base from the place that names it."""
    noun = whole(support)
    found = candidates(noun, request.instances)
    if noun.thing == "room":
        floor = floor_of(request.instances)
        found = (floor,) if floor else ()
    if not found:
        target.missing = noun.text
        target.notes.append(f"the scene has {inventory(request.instances)}")
        return
    target.used = narrowing(reading, support, found, request)
    able = carrying(reading, support, found, request)
    chosen = choose(able, noun, target.used, request.instances, request.room_center)
    target.base = chosen.instances[0]
    if chosen.note:
        target.notes.append(f"{noun.text}: {chosen.note}")
    if is_wider(target.base, noun):
        target.notes.append(f"using the {target.base.label} as {noun.text}")
    only_a_part = noun is support.nouns[0] and not named(noun, request.instances)
    one_of_its_parts = len(found) == 1 and noun.sides and part_of(noun, target.base)  # "the second shelf"
    if only_a_part or one_of_its_parts:
        set_part(target, noun)
    elif support.relation == "in" and inside(target.base) and support.nouns[0].owner is None:
        target.part = inside(target.base)


def inside(base: InstanceView) -> str:
    """The part that "in" means for this base, if it has it."""
    names = {part.name for part in base.parts}
    wanted = (inside_parts().get(one, "") for one in lineage(label_thing(base)))
    return next((part for part in wanted if part in names), "")


def narrowing(reading: Reading, support: Place, found: Sequence[InstanceView], request: IntentRequest) -> list[Place]:
    """Places that say which of several is meant."""
    if len(found) < 2:
        return []
    index = reading.places.index(support)
    chosen = [p for p in reading.places[index + 1 : index + 2] if says_side(p) and not whole(support).sides]
    later = [p for p in reading.places if p is not support and p not in chosen]
    return chosen + [p for p in later if p.restrict or (p.clause == support.clause and says_which(p, found, request))]


def carrying(
    reading: Reading, support: Place, found: Sequence[InstanceView], request: IntentRequest
) -> Sequence[InstanceView]:
    """Of several, those that carry what a place is beside, "the table next to the lamp"; the place says where too."""
    if whole(support).sides or whole(support).colour:
        return found
    for place in reading.places:
        if place is not support and place.relation in BESIDE and place.relation != "between":
            others = [i for i in named(whole(place), request.instances) if i not in found]
            found = [one for one in found if any(stands_on(other, one) for other in others)] or found
    return found


def says_side(place: Place) -> bool:
    """ "the bed on the left", without a pause: one of two beds, not the left of a bed."""
    noun = place.nouns[0]
    return place.attached and place.relation in PLACEABLE and noun.is_region and not noun.region


def says_which(place: Place, found: Sequence[InstanceView], request: IntentRequest) -> bool:
    """A place that names something apart from the candidates: "the bed near the window", "the tray on the desk"."""
    noun = whole(place)
    if noun.is_region or bare_region(noun) or place.relation == "between":
        return False
    meant = named(noun, request.instances)
    if place.relation in SUPPORT and place.nouns[0].owner is None and any(i in found for i in meant):
        return True  # "the pillow on the right bed"
    others = [i for i in meant if i not in found]
    return bool(others) and not any(stands_on(other, one) for other in others for one in found)


def set_part(target: Target, noun: Noun) -> None:
    """Ask for the part that the noun names."""
    assert target.base is not None
    part = part_of(noun, target.base)
    if part:
        target.part = part
        target.which = " ".join([side for side in noun.sides if side != part][:1])
        target.words.append(noun.text)


def ground_by_neighbour(target: Target, place: Place, request: IntentRequest) -> None:
    """No support is named: what has the part or carries the thing of which the place speaks, or the floor."""
    noun = whole(place)
    if found := named(noun, request.instances):
        thing = choose(found, noun, (), request.instances, request.room_center).instances[0]
        of_it = noun is not place.nouns[0] and part_of(place.nouns[0], thing) and place.relation != "under"
        target.base = thing if of_it else carrier(thing, request.instances)
    elif found := owners(noun, request.instances):
        target.base = choose(found, noun, (), request.instances, request.room_center).instances[0]
    if target.base is None:
        target.missing = noun.text if not found else "floor"
    else:
        target.notes.append(f"{place.text}: on {target.base.label}, as no support is named")


# where on it --------------------------------------------------------------------------------------------------------


def ground_own_region(target: Target, support: Place, request: IntentRequest) -> None:
    """The region or part in front of "of the bed"."""
    noun = support.nouns[0]
    assert target.base is not None
    if noun.owner is None:
        return
    part = part_of(noun, target.base)
    if part and support.relation in SUPPORT:
        set_part(target, noun)
    elif noun.region or noun.sides:
        region_words(target, noun, request)
    elif part:
        set_part(target, noun)
    part_of_whole = noun.owner.owner is not None or not named(noun.owner, request.instances)
    if part_of_whole and not target.part:  # "the corner of the mattress of the bed"
        set_part(target, noun.owner)


def region_words(target: Target, noun: Noun, request: IntentRequest) -> None:
    """Sides and region of a noun as region names; of an edge, what it looks at as reference."""
    names = [SIDE_REGIONS[side] for side in noun.sides if side in SIDE_REGIONS]
    if noun.region and noun.region != "side":
        names.append(noun.region)
    target.add_regions(names)
    (target.words if names else target.not_understood).append(noun.text)
    if noun.toward is not None:
        seen = references_of(noun.toward, target, request, several=False)
        target.add_references(seen)
        (target.words if seen else target.not_understood).append(noun.toward.text)


def ground_further(target: Target, place: Place, request: IntentRequest) -> None:
    """A place beside the one that named the base."""
    noun = place.nouns[0]
    assert target.base is not None
    unclear = place.relation == "between" and any(noun.region for noun in place.nouns)
    if place.relation in ("away", "which") or unclear:
        target.not_understood.append(place.text)
    elif place.relation in PLACEABLE:
        ground_on_again(target, place, request)
    elif (noun.region or noun.is_region) and (
        noun.owner is None or noun.region in ("edge", "corner", "center", "middle")
    ):
        region_words(target, noun, request)
    else:
        beside(target, place, request)


def ground_on_again(target: Target, place: Place, request: IntentRequest) -> None:
    """ "... on the mattress", "... on the left", "... in the corner"."""
    noun = place.nouns[0]
    assert target.base is not None
    names = {part.name for part in target.base.parts}
    own = next((part for part in noun.parts if part in names), "")
    if own and not noun.is_region and not bare_region(noun):
        set_part(target, noun)
    elif noun.region or noun.sides:
        owner = named(noun.owner, request.instances) if noun.owner is not None else ()
        if owner and target.base not in owner:
            beside(
                target, Place(f"{(noun.sides or ('near',))[0]}_of", (noun.owner or noun,), False, place.text), request
            )
        else:
            region_words(target, noun, request)
    elif noun.pronoun != "it" and target.base not in named(noun, request.instances):  # a second support
        target.not_understood.append(place.text)


def beside(target: Target, place: Place, request: IntentRequest) -> None:
    """Near, next to, between, under: regions with references."""
    assert target.base is not None
    references: list[str] = []
    for noun in place.nouns:
        if references and place.relation != "between" and not within_reach(noun, target.base, request):
            target.not_understood.append(noun.text)
            continue
        found = references_of(noun, target, request, several=place.relation == "between" and len(place.nouns) == 1)
        if not found:
            part = next((p for p in noun.parts if p in PART_REGIONS), "")
            if part and place.relation in ("near", "against", "next_to"):
                target.add_regions([PART_REGIONS[part]])
                target.words.append(place.text)
                return
            target.missing = noun.text
            target.base = None
            target.notes.append(f"the scene has {inventory(request.instances)}")
            return
        references.extend(found)
    if references == [target.base.id]:
        return
    target.add_regions(BESIDE.get(place.relation, ("near",)))
    target.add_references(references)
    target.words.append(place.text)


def within_reach(noun: Noun, base: InstanceView, request: IntentRequest) -> bool:
    """Whether a thing of that name is so near the base that one can be beside it there."""
    return any(gap(i, base) < REACH for i in named(noun, request.instances)) or part_of(noun, base) != ""


def references_of(noun: Noun, target: Target, request: IntentRequest, *, several: bool) -> list[str]:
    """Ids of the things, or `part:NAME`, that a relation speaks of; those nearest to the base."""
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
    return [chosen.instances[0].id]


def facing_of(reading: Reading, target: Target, request: IntentRequest) -> tuple[str, tuple[str, ...]]:
    """What the front shall look at, and what of it was not understood."""
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
