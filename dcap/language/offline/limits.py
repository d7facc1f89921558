"""Constraints on a place in addition to its region: excluded places, distances, and what the object leans on.

In: a target whose base is found, and a place of the sentence. Out: the target with constraints in the words of the
reply, or with the place among what was not understood.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dcap.language.offline.ground import candidates, is_stacked, named, part_of
from dcap.language.offline.grounded import Target, is_any
from dcap.language.offline.likelihood import label_thing
from dcap.language.offline.placing import BESIDE, whole
from dcap.language.offline.reading import Place
from dcap.language.offline.sentence import SIDED, SUPPORT
from dcap.language.offline.where import references_of, regions_of
from dcap.language.protocol.replies import Constraint
from dcap.language.protocol.requests import PART_SIDES, InstanceView, IntentRequest

PART_SIDES_OF = {**{side: side for side in PART_SIDES}, "1": "bottom", "last": "top", "1 from bottom": "bottom",
                 "1 from top": "top", "shortest": "bottom", "tallest": "top"}  # fmt: skip
"""Which of several parts of one name a side means."""
LEANED_PARTS = ("back", "headboard", "side")
"""Parts that a thing leans on when it stands on something that has them: the sofa's back."""


def limit(target: Target, place: Place, request: IntentRequest) -> None:
    """Distances, "as far as possible from" and "away from": a constraint to the edge or to things."""
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
    """ "Not on the pillow", "not near the lamp", "not at the edge"."""
    assert target.base is not None
    noun = place.nouns[0]
    if place.measure is not None:  # not closer than so many metres is said by "at least"
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
            target.not_understood.append(place.text)  # on the bed, and not on it
        target.words.append(place.text)  # what is not there is kept off by itself
        return
    if place.relation in (*SUPPORT, "at", "under", "against"):
        keep(target, place, "not_on", [], found, 0.0)
    elif place.relation in BESIDE:
        keep(target, place, "not_in", list(BESIDE[place.relation]), found, 0.0)
    else:
        target.not_understood.append(place.text)


def nearest_to_references(found: str, target: Target, request: IntentRequest) -> str:
    """Of walls the one at which the other things stand that the sentence names: "against the wall by the door"."""
    by_id = {one.id: one for one in request.instances}
    one, beside = by_id.get(found), [by_id[name] for name in target.references if name in by_id]
    if one is None or not is_any(one) or not beside:
        return found
    walls = [i for i in request.instances if is_any(i) and label_thing(i) == label_thing(one)]
    return min(walls, key=lambda wall: (round(off_wall(wall, beside[0]), 3), wall.id)).id


def off_wall(wall: InstanceView, other: InstanceView) -> float:
    """How far the middle of a thing is from a wall [m]."""
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
