"""Phrases that distinguish several similar things, each verified by reading it, so that a question back can be
answered.

In: the instances that a sentence may mean, and the scene. Out: for each a noun phrase that names only it: by things
that stand on it or next to it, by its colour, its size, its side; otherwise by its id.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from dcap.knowledge.lexicon import label_words
from dcap.language.offline.ground import COLOURS, candidates, choose, gap, right_of, stands_on
from dcap.language.offline.likelihood import label_thing
from dcap.language.offline.sentence import read
from dcap.language.offline.where import is_any
from dcap.language.offline.words import SceneWords
from dcap.language.protocol.requests import InstanceView
from dcap.scene.errors import LanguageError

BESIDE = 0.6
"""Largest distance of a thing that identifies another by its position [m]."""
ORDINALS = ("first", "second", "third", "fourth", "fifth")
NEAREST = 6
"""Number of surrounding things that are tried [-]."""


def told_apart(
    found: Sequence[InstanceView], instances: Sequence[InstanceView], room_center: Sequence[float]
) -> list[str]:
    """A phrase for each instance that means only it, with its id."""
    return [f"{phrase_for(one, found, instances, room_center)} (id {one.id})" for one in found]


def phrase_for(
    one: InstanceView, found: Sequence[InstanceView], instances: Sequence[InstanceView], room_center: Sequence[float]
) -> str:
    """The first phrase that leaves no other candidate when read in the scene."""
    for phrase in phrases(one, found, instances):
        if means(phrase, one, found, instances, room_center):
            return phrase
    return f"the {one.label}"


def phrases(one: InstanceView, found: Sequence[InstanceView], instances: Sequence[InstanceView]) -> Iterator[str]:
    """Phrases for an instance, in the order in which a person would use them."""
    label = name_of(one)
    others = [i for i in instances if i not in found and not is_any(i) and label_words(i.label)]
    for other in others:
        if stands_on(other, one) and not other.structure:
            yield f"the {label} with the {name_of(other)} on it"
    unlike = max(float(np.linalg.norm(np.subtract(a.color, b.color))) for a in found for b in found)
    if unlike > 0.15:
        colour = min(COLOURS, key=lambda word: float(np.linalg.norm(np.subtract(one.color, COLOURS[word]))))
        yield f"the {colour} {label}"
    yield f"the empty {label}"
    beside = sorted((i for i in others if gap(i, one) < BESIDE), key=lambda i: (gap(i, one), i.id))
    for other in beside[:NEAREST]:
        yield f"the {label} next to the {name_of(other)}"
    right = right_of(found)
    along = sorted(found, key=lambda i: (float(np.dot(i.center, right)), i.id))
    if one is along[0] or one is along[-1]:
        yield f"the {'left' if one is along[0] else 'right'} {label}"
    for other in sorted(others, key=lambda i: (gap(i, one), i.id))[:NEAREST]:
        for side in ("left", "right", "middle"):
            yield f"the {side} {label} by the {name_of(other)}"
    for word in ("larger", "smaller", "taller", "lower", "upper", "middle"):
        yield f"the {word} {label}"
    for other in sorted(others, key=lambda i: (gap(i, one), i.id))[:NEAREST]:
        yield f"the {label} nearest the {name_of(other)}"
    for index, there in enumerate(along):
        if there is one and index < len(ORDINALS):
            yield f"the {ORDINALS[index]} {label} from the left"


def name_of(instance: InstanceView) -> str:
    """Label of an instance in words."""
    return " ".join(label_words(instance.label)) or instance.label


def means(
    phrase: str,
    one: InstanceView,
    found: Sequence[InstanceView],
    instances: Sequence[InstanceView],
    room_center: Sequence[float],
) -> bool:
    """Return whether the phrase, used in a sentence, leaves only this instance of all in the scene."""
    scene = SceneWords.of((i.id, i.label) for i in instances)
    try:
        reading = read(f"put it on {phrase}", scene)
    except LanguageError:
        return False
    if not reading.places or reading.not_understood:
        return False
    noun = reading.places[0].nouns[0]
    known = candidates(noun, instances)
    if one not in known or label_thing(one) == "":
        return False
    chosen = choose(known, noun, reading.places[1:], instances, room_center)
    return chosen.best is one and not chosen.open and chosen.scores[0] > 0.0
