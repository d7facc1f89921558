"""Name of the indicated thing: the scene's label if it is certain, else the sentence's noun."""

from dataclasses import dataclass

from dcap.language.offline.lexicon import first_part, in_line, label_words, thing_of
from dcap.language.offline.nouns import Noun
from dcap.language.offline.placing import names_support, placing_of, whole
from dcap.language.offline.sentence import read
from dcap.scene.errors import LanguageError
from dcap.scene.types.caution import Cause, Caution
from dcap.scene.types.segmentation import Instance

SURE = 0.9
"""Confidence below which a label is a guess that the sentence overrides [-]."""
PLAIN_PART = "top"
"""The part of an unknown thing."""


@dataclass(frozen=True, slots=True)
class Name:
    """A label with notes on its origin."""

    label: str
    renamed: bool
    notes: tuple[str, ...] = ()


def asked_thing(prompt: str) -> Noun | None:
    """The support that the sentence names; None if it names none with known words."""
    try:
        place = placing_of(read(prompt)).place
    except LanguageError:
        return None
    noun = whole(place)
    return noun if names_support(place) and noun.thing and noun.thing != "room" else None


def name_of(owner: Instance, asked: Noun | None, option: str) -> Name:
    """Name of an instance that a sentence and a person have pointed at."""
    if asked is None or fits(asked, owner.label):
        return Name(owner.label, renamed=False)
    if owner.structure or owner.confidence >= SURE:
        said = f"the sentence says {asked.text!r}, but {option} lies on {owner.label} ({owner.id}): {option} decides"
        return Name(owner.label, renamed=False, notes=(Caution(Cause.NOT_MET, said),))
    label = asked.name or asked.thing.replace("_", " ")
    guess = f"{owner.label!r} ({owner.confidence:.0%})"
    taken = f"what {option} lies on was taken for {guess}; it is called {label!r} as in the sentence"
    return Name(label, renamed=True, notes=(Caution(Cause.WHICH, taken),))


def fits(noun: Noun, label: str) -> bool:
    """Whether a label matches a noun, is a kind of it, or the noun is a kind of the label."""
    if tuple(label_words(noun.name)) == tuple(label_words(label)):
        return True
    thing = thing_of(label)
    return thing is not None and in_line(thing.id, noun.thing)


def carrying_part(label: str) -> str:
    """The part with which a thing of this label usually carries."""
    thing = thing_of(label)
    return first_part(thing.id if thing else "") or PLAIN_PART
