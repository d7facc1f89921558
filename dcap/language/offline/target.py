"""The support, the part and the region that a sentence requests, in a given scene or on a given support.

In: a `Reading` and the instances. Out: a `Target`: the base or the missing thing, and part, regions and references as
in a reply. The first place that names a thing is the base; later places narrow it down or give the place on it.

If the user has pointed at the support (`given_target`), the sentence only gives the place on it.
"""

from collections.abc import Sequence
from dataclasses import replace

from dcap.knowledge.lexicon import default_parts, inside_parts, label_words, lineage
from dcap.language.offline.ground import (
    Found,
    boarded,
    candidates,
    carrier,
    choose,
    describes,
    fits,
    floor_of,
    gap,
    inventory,
    is_stacked,
    is_wider,
    named,
    nameless,
    near_miss,
    owners,
    part_of,
    stands_on,
    unlikely,
)
from dcap.language.offline.likelihood import label_thing
from dcap.language.offline.nouns import Noun
from dcap.language.offline.placing import BESIDE, PLACEABLE, bare_region, names_support, placing_of, whole
from dcap.language.offline.reading import Place, Reading
from dcap.language.offline.sentence import SUPPORT
from dcap.language.offline.where import (
    Target,
    as_candidates,
    exclude,
    ground_further,
    ground_own_region,
    is_any,
    lean,
    limit,
    set_part,
)
from dcap.language.protocol.requests import InstanceView, IntentRequest
from dcap.scene.errors import LanguageError
from dcap.scene.types.outcome import Cause, Caution

AT_IT = 0.05
"""Largest distance of a thing that is on the base or stands at it [m]."""
ON_ITS_SIDE = frozenset({"on the side of", "at the side of", "to the side of", "by the side of"})
"""Words that mean "next to a thing", or, for a thing that is not adjacent, the side that faces it."""
AROUND = 1.5
"""Largest distance of a thing from the place where a sentence says that it is, "the desk near the window" [m]."""


def target_of(reading: Reading, request: IntentRequest) -> Target:
    """Ground the places of a sentence; raises LanguageError if none names a support or a neighbour."""
    target = Target()
    main = placing_of(reading).place
    if names_support(main):
        ground_support(target, main, reading, request)
    else:
        ground_by_neighbour(target, main, reading, request)
    for place in reading.places:
        said = place is main and names_support(main)
        if target.base is None or said or place in target.used:
            continue
        if leans(reading, place):
            continue
        if place.excluded and not place.restrict:
            exclude(target, place, request)
        elif not place.restrict and (place.measure is not None or place.relation in ("away", "farthest")):
            limit(target, place, request)
        elif not place.restrict and (toward := side_at(place, target, request)) is not None:
            limit(target, toward, request)
        elif not place.restrict:
            ground_further(target, place, request)
        elif is_so(target.base, place, request):
            target.used = [*target.used, place]
        else:
            target.not_understood.append(place.nouns[0].text if place.nouns[0].is_unknown else place.text)
    if target.base is not None and main.measure is not None and names_support(main):
        limit(target, main, request)
    elif target.base is not None and names_support(main):
        ground_own_region(target, main, request)
    for place in reading.places:
        if target.base is not None and leans(reading, place):  # after other things next to it
            lean(target, place, request)
    target.not_understood[:0] = still_unknown(reading.not_understood, target, request)
    return target


def side_at(place: Place, target: Target, request: IntentRequest) -> Place | None:
    """A place such as "on the window side", "towards the window", or "on the side nearer the window" next to something,
    as "nearest"; None for others."""
    noun = place.nouns[0]
    if place.excluded:
        return None
    if place.relation == "nearest" and noun.thing and not noun.region:
        return place if target.references or is_off(noun, target.base, request) else None
    if place.literal in ON_ITS_SIDE and is_off(noun, target.base, request):
        return replace(place, relation="nearest")
    at_thing = noun.region == "side" and noun.owner is not None and noun.owner.thing and not noun.sides
    return replace(place, relation="nearest", nouns=(noun.owner,)) if at_thing and noun.owner is not None else None


def is_off(noun: Noun, base: InstanceView | None, request: IntentRequest) -> bool:
    """Return whether the things named by a noun are neither on a piece of furniture nor next to it."""
    found = [one for one in named(noun, request.instances) if one is not base]
    return base is not None and not base.structure and bool(found) and all(gap(one, base) > AT_IT for one in found)


def leans(reading: Reading, place: Place) -> bool:
    """Return whether the place is the thing that the object should lean on."""
    return reading.pose == "leaning" and place.relation == "against" and not place.excluded


def still_unknown(phrases: Sequence[str], target: Target, request: IntentRequest) -> list[str]:
    """Phrases whose words do not occur in a label that was found: a scene may name things that the lexicon does not
    know."""
    ids = {*target.references, target.base.id if target.base is not None else ""}
    told = " ".join(target.not_understood)
    said = {word for i in request.instances if i.id in ids for word in label_words(i.label)}
    return [phrase for phrase in phrases if phrase not in told and not said.issuperset(label_words(phrase))]


# the base -----------------------------------------------------------------------------------------------------------


def ground_support(target: Target, support: Place, reading: Reading, request: IntentRequest) -> None:
    """Determine the base from the place that names it."""
    noun = whole(support)
    found = candidates(noun, request.instances) or nameless(noun, request.instances)
    if noun.thing == "room":
        floor = floor_of(request.instances)
        found = (floor,) if floor else ()
    if not found:
        target.missing = noun.text
        target.notes.append(f"the scene has {inventory(request.instances)}")
        target.meant = near_miss(noun, request.instances)
        target.candidates = as_candidates(unlikely(noun, request.instances))
        return
    target.used = narrowing(reading, support, found, request)
    able = carrying(reading, support, found, request)
    if (unmet := unmet_load(able, target.used, request)) is not None:
        target.missing = f"{noun.text} {unmet.text}"
        return
    a_board = bool(boarded(noun, request.instances))
    told = replace(noun, sides=()) if a_board else noun  # the number belongs to the board
    chosen = choose(able, told, target.used, request.instances, request.room_center)
    target.base = chosen.best
    if noun.whichever and chosen.open:
        target.notes.append(f"{noun.text}: {chosen.best.id} is used, as any will do")
        chosen = replace(chosen, instances=chosen.instances[:1], scores=chosen.scores[:1])
    target.candidates = as_candidates(chosen)
    if chosen.note:
        target.notes.append(f"{noun.text}: {chosen.note}")
    target.notes += chosen.viewpoints
    if is_wider(target.base, noun):
        target.notes.append(Caution(Cause.WHICH, f"using the {target.base.label} as {noun.text}"))
    if target.base in nameless(noun, request.instances):
        taken = f"the scene is a single unnamed thing, assumed to be the {noun.thing}"
        target.notes.append(Caution(Cause.WHICH, taken))
    if target.base.guesses:
        target.notes.append(by_shape_alone(noun.text, chosen))
    if is_shut(support, target.base):
        target.missing, target.base = f"open {support.nouns[0].text.removeprefix('the ')}", None
        target.notes.append(f"the {chosen.best.label} is closed; things put on it lie on top")
        return
    only_a_part = noun is support.nouns[0] and not named(noun, request.instances)
    whole_one = support.topmost and describes(noun)  # "on top of the low shelf", but "on the second shelf"
    one_of_its_parts = len(found) == 1 and noun.sides and part_of(noun, target.base) and not whole_one
    if only_a_part or one_of_its_parts or a_board:
        set_part(target, noun)
    elif support.relation == "in" and inside(target.base) and support.nouns[0].owner is None:
        target.part = inside(target.base)
    elif support.topmost:
        set_topmost(target)


def by_shape_alone(text: str, found: Found) -> str:
    """Note on the certainty of a choice among unnamed things, and on the second best."""
    second = f", second {found.instances[1].id} ({found.scores[1]:.2f})" if len(found.scores) > 1 else ""
    return Caution(Cause.WHICH, f"{text}: {found.best.id} by its shape, likelihood {found.scores[0]:.2f}{second}")


def unmet_load(
    found: Sequence[InstanceView], places: Sequence[Place], request: IntentRequest
) -> Place | None:  # fmt: skip
    """The place whose load every candidate should carry or lack, but none does; None without one."""
    for place in places:
        fit = (
            fits(found, place, request.instances, request.room_center)
            if place.relation in ("carrying", "lacking")
            else None
        )
        if fit is not None and not any(fit):
            return place
    return None


def set_topmost(target: Target) -> None:
    """Choose the highest board for "on top of the bookcase", if its carrying parts are stacked."""
    assert target.base is not None
    names = {part.name for part in target.base.parts}
    usual = (name for one in lineage(label_thing(target.base)) for name in default_parts().get(one, ()))
    part = next((name for name in usual if name in names), "")
    if part and is_stacked(target.base, part):
        highest = max(target.base.parts, key=lambda one: one.center[2] + one.size[2] / 2)
        target.part, target.which = (highest.name, "") if highest.name == "top" else (part, "top")


def is_so(base: InstanceView, place: Place, request: IntentRequest) -> bool:
    """Return whether the chosen base matches the words of a place."""
    noun = place.nouns[0]
    if place.relation not in ("carrying", "lacking"):
        others = [one for one in candidates(noun, request.instances) if one is not base]
        near = any(gap(one, base) < AROUND for one in others)
        return noun.is_region or (bool(others) and near != place.excluded) or base in named(noun, request.instances)
    loaded = bool(part_of(noun, base)) or any(stands_on(one, base) for one in named(noun, request.instances))
    return loaded == ((place.relation == "carrying") != place.excluded)


def is_shut(support: Place, base: InstanceView) -> bool:
    """Return whether something should go into a drawer or a cupboard of which the scene only shows the outside."""
    noun = support.nouns[0]
    if support.relation != "in" or noun.is_region or inside(base) or part_of(noun, base):
        return False
    kinds = lineage(label_thing(base))
    return (noun.encloses and noun.owner is not None) or any(inside_parts().get(one) for one in kinds)


def inside(base: InstanceView) -> str:
    """The part meant by "in" for this base, if it has it."""
    names = {part.name for part in base.parts}
    wanted = (inside_parts().get(one, "") for one in lineage(label_thing(base)))
    return next((part for part in wanted if part in names), "")


def narrowing(reading: Reading, support: Place, found: Sequence[InstanceView], request: IntentRequest) -> list[Place]:
    """Places that select among several things."""
    if len(found) < 2:
        return []
    index = reading.places.index(support)
    chosen = [p for p in reading.places[index + 1 : index + 2] if says_side(p) and not whole(support).sides]
    again = [p for p in reading.places if p.excluded and p.nouns[0] == whole(support)]  # "... but not on top of it"
    later = [p for p in reading.places if p is not support and p not in chosen and p not in again]
    return chosen + [p for p in later if p.restrict or (p.clause == support.clause and says_which(p, found, request))]


def carrying(
    reading: Reading, support: Place, found: Sequence[InstanceView], request: IntentRequest
) -> Sequence[InstanceView]:
    """Those of several candidates that carry the lamp in "the table next to the lamp"; the place also says where on
    it."""
    if whole(support).sides or whole(support).colour:
        return found
    for place in reading.places:
        if place is not support and place.relation in BESIDE and place.relation != "between":
            others = [i for i in named(whole(place), request.instances) if i not in found]
            found = [one for one in found if any(stands_on(other, one) for other in others)] or found
    return found


def says_side(place: Place) -> bool:
    """Return whether a place selects one of two beds ("the bed on the left", without a pause), not a part of a bed."""
    noun = place.nouns[0]
    return place.attached and place.relation in PLACEABLE and noun.is_region and not noun.region


def says_which(place: Place, found: Sequence[InstanceView], request: IntentRequest) -> bool:
    """Return whether a place names something other than the candidates: "the bed near the window", "the tray on the
    desk"."""
    noun = whole(place)
    if noun.is_region or bare_region(noun) or place.relation == "between":
        return False
    meant = named(noun, request.instances)
    if place.relation in SUPPORT and place.nouns[0].owner is None and any(i in found for i in meant):
        return True  # "the pillow on the right bed"
    others = [i for i in meant if i not in found]
    return bool(others) and not any(stands_on(other, one) for other in others for one in found)


def ground_by_neighbour(target: Target, place: Place, reading: Reading, request: IntentRequest) -> None:
    """Without a named support, use the owner of the named part, the carrier of the named thing, or the floor."""
    noun = whole(place)
    if found := named(noun, request.instances):
        which = [p for p in reading.places if p is not place and p.restrict]
        chosen = choose(found, noun, which, request.instances, request.room_center)
        target.used, thing = which, chosen.best
        target.notes += chosen.viewpoints
        if not noun.plural and not is_any(thing):
            target.reference_candidates = as_candidates(chosen)
        of_it = noun is not place.nouns[0] and part_of(place.nouns[0], thing) and place.relation != "under"
        target.base = thing if of_it else carrier(thing, request.instances)
    elif found := owners(noun, request.instances):
        chosen = choose(found, noun, (), request.instances, request.room_center)
        target.base, target.candidates = chosen.best, as_candidates(chosen)
        target.notes += chosen.viewpoints
    if target.base is None:
        target.missing = noun.text if not found else "floor"
        target.meant = near_miss(noun, request.instances) if not found else ""
    else:
        target.notes.append(f"{place.text}: on {target.base.label}, as no support is named")


def given_target(reading: Reading, request: IntentRequest) -> Target:
    """Part, regions and references on the given base; the sentence need not name a support."""
    base = next(one for one in request.instances if one.id == request.given_base)
    try:
        main = placing_of(reading).place
    except LanguageError:
        return Target(base=base, not_understood=list(reading.not_understood))
    target = target_of(reading, replace(request, instances=with_one_support(base, main, request.instances)))
    if target.base is None:
        told = f"the scene has no {target.missing}; using the thing pointed at"
        target.notes.append(Caution(Cause.NOT_MET, told))
        target.missing, target.part, target.regions, target.references = "", "", [], []
    elif target.base.id != base.id:
        target.part, target.which = "", ""
    own = {part.name for part in base.parts}
    target.references = [one for one in target.references if one != base.id and part_of_it(one, own)]
    known = [one for one in target.constraints if one.reference != base.id and part_of_it(one.reference, own)]
    target.constraints, target.candidates = known, ()
    target.lean_on = target.lean_on if target.lean_on != base.id and part_of_it(target.lean_on, own) else ""
    target.base = base
    target.part = target.part if target.part in own else ""
    return target


def part_of_it(reference: str, own: set[str]) -> bool:
    """Return whether a reference is an instance's, or a part that the base has."""
    kind, _, name = reference.partition(":")
    return kind != "part" or name.partition("/")[0] in own


def with_one_support(base: InstanceView, main: Place, instances: Sequence[InstanceView]) -> tuple[InstanceView, ...]:
    """The instances, changed so that the sentence's support can only be the given one, whatever its name."""
    if not names_support(main):
        return tuple(instances)
    noun = whole(main)
    others = {one.id for one in candidates(noun, instances)} - {base.id}
    known = named(noun, [base]) or part_of(noun, base) or not noun.thing
    called = base if known else replace(base, label=noun.name or noun.thing, guesses=())
    return (*(one for one in instances if one.id not in others and one.id != base.id), called)
