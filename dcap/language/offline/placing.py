"""The placement that a sentence requests, without a scene, and the name of the object in questions.

In: a `Reading`. Out: a `Placing`, with the place among those of the reading that names the support; grounding in a
scene starts from the same place.

Name of the object for questions to a model: given by a person, by its file or folder, or by the sentence.

In: the known names. Out: words, never the hash, id or number that a dataset may use as a file name.
"""

from dataclasses import dataclass
from pathlib import Path

from dcap.language.offline.nouns import Noun
from dcap.language.offline.reading import Place, Reading
from dcap.language.offline.sentence import SUPPORT, read
from dcap.scene.errors import LanguageError
from dcap.scene.readers.scenes.sugar import describe
from dcap.scene.text import readable

BESIDE = {
    "near": ("near",),
    "against": ("near",),
    "next_to": ("next_to",),
    "between": ("between",),
    "under": ("under",),
    "left_of": ("left", "next_to"),
    "right_of": ("right", "next_to"),
    "front_of": ("front", "next_to"),
    "behind": ("back", "next_to"),
    "nearest": ("near",),
    "distance": ("near",),
}
"""Regions requested by a relation to another thing."""
PLACEABLE = frozenset({"at", *SUPPORT})
NAMELESS = "object"


@dataclass(frozen=True, slots=True)
class Placing:
    """An object in a relation to a reference."""

    object: Noun | None
    """Moved thing; None if the sentence only says "it"."""
    relation: str
    """on, in, at, under, next_to, near, nearest, distance, against, between, left_of, right_of, front_of or behind."""
    reference: Noun
    """The thing or part to which the relation refers; the first of several (between)."""
    place: Place
    """The phrase that states the relation."""
    not_understood: tuple[str, ...]


def placing_of(reading: Reading) -> Placing:
    """The placement that a sentence requests; raises LanguageError if it names nothing to put the object on or next
    to."""
    place = support_place(reading) or neighbour_place(reading)
    if place is None:
        said = ", ".join(repr(place.text) for place in reading.places) or "it"
        raise LanguageError(f"the prompt names no support in {said}; say what to put it on, for example: on the table")
    reference = reference_of(place)
    return Placing(reading.theme, relation_of(place, reference), reference, place, reading.not_understood)


def support_place(reading: Reading) -> Place | None:
    """The first place that names the support of the object."""
    return next((place for place in reading.places if names_support(place)), None)


def neighbour_place(reading: Reading) -> Place | None:
    """The first place next to, between or under something, if no support is named."""
    beside = (place for place in reading.places if place.relation in BESIDE and not place.excluded)
    return next((place for place in beside if not place.restrict and names_thing(whole(place))), None)


def reference_of(place: Place) -> Noun:
    """The thing or part of a place: the bed in "on the left edge of the bed", the drawer in "in its drawer"."""
    noun = place.nouns[0]
    while noun.owner is not None and (noun.region or not (noun.thing or noun.parts)):
        noun = noun.owner
    return noun


def relation_of(place: Place, reference: Noun) -> str:
    """The relation to the reference: in a drawer, and on a bed if the place is in the middle of it."""
    if place.relation in PLACEABLE and reference.encloses:
        return "on" if place.relation == "on" else "in"
    of_a_region = reference is not place.nouns[0]
    return "on" if of_a_region and place.relation in (*PLACEABLE, "near", "against") else place.relation


def whole(place: Place) -> Noun:
    """The noun that names a thing in "on the edge of the bed", "on the bed"."""
    noun = place.nouns[0]
    while noun.owner is not None:
        noun = noun.owner
    return noun


def names_support(place: Place) -> bool:
    """Return whether the place can name the support."""
    noun = place.nouns[0]
    edge_of = (
        place.relation in ("near", "nearest", "against", "distance") and noun.region != "" and noun.owner is not None
    )
    on_it = place.relation in PLACEABLE or edge_of
    return (
        on_it
        and not place.restrict
        and not place.excluded
        and names_thing(whole(place))
        and not bare_region(whole(place))
    )


def names_thing(noun: Noun) -> bool:
    """Return whether a noun is more than a region or a pronoun."""
    return not noun.is_region and noun.pronoun == ""


def bare_region(noun: Noun) -> bool:
    """Return whether a noun is a word like "back" or "head" that could be a part but has no owner."""
    return bool(noun.sides or noun.region) and not noun.thing and noun.owner is None and not plain_part(noun)


def plain_part(noun: Noun) -> bool:
    """Return whether a noun without owner certainly names a part ("mattress", not "back")."""
    ambiguous = {"back", "top", "side", "head", "base"}
    return any(part not in ambiguous for part in noun.parts)


def object_name(path: Path, prompt: str, given: str = "") -> str:
    """The given name, else the name of the file or its folder, else the sentence's noun: "ball"."""
    return readable(given) or readable(describe(path)) or noun_of_sentence(prompt) or NAMELESS


def noun_of_sentence(prompt: str) -> str:
    """The sentence's name for the placed thing; empty if it is a pronoun, or if the sentence cannot be read."""
    try:
        theme = read(prompt).theme
    except LanguageError:
        return ""
    return "" if theme is None or theme.pronoun else theme.name
