"""Likelihood that a noun means an instance: one number for grounding, for questions back and for "did you mean".

In: a noun phrase and an instance with its label. Out: 0 to 1. The label's own words count most: a thing called by the
noun's words is that thing; a kind of it with another name is less likely, the wider kind less again, and a sibling only
a guess; scanners that know only a few categories call every shelf "storage". Words before the noun that are missing in
the label lower the likelihood, words that contradict the label lower it more. Colours, sides and places distinguish
several such things; they are weighed in `ground`.

A label guessed from shape alone counts by its probability: "coffee table" finds a low table that is more likely a
bench. Such labels confuse siblings, so siblings by shape count more there, and kinds by their usual size.
"""

import math
from collections.abc import Sequence
from functools import cache

from dcap.knowledge.kinds import NO_KIND, coarse
from dcap.knowledge.lexicon import (
    OPPOSITES,
    first_part,
    in_line,
    is_a,
    label_words,
    lineage,
    rows,
    thing_of,
    things,
    vocabulary,
)
from dcap.knowledge.shapes import EVIDENCE, ShapePrior, labels, shapes
from dcap.language.offline.nouns import Noun
from dcap.language.offline.words import may_be
from dcap.language.protocol.requests import InstanceView

CALLED = 0.9
"""A kind of the thing whose label contains the noun's words: a "dining table" for "table" [-]."""
KIND = 0.4
"""A kind of the thing with another name: an "armchair" for "chair"; less than half, so that a plain chair is not
doubted [-]."""
WIDER = 0.35
"""The kind to which the thing belongs: a "stool" for "ottoman" [-]."""
MISTYPED = 0.3
"""An unknown word that is a misspelling of a word of the label [-]."""
KIN = 0.1
"""Another kind of the same thing: a "side table" for "coffee table"; not an answer, but worth a question [-]."""
KIND_BY_SHAPE, KIN_BY_SHAPE = 0.6, 0.3
"""KIND and KIN if only the shape determines the label: a desk is easily confused with a dining table [-]."""
LEAST_SPREAD = 1.2
"""Spread in a scan of the sizes of things that all have the same size [-]."""
SIZE_ALONE = 0.1
"""Factor for a noun whose thing has no known shape, by size: not an answer, but worth mentioning [-]."""
ONE_SPREAD = math.exp(-0.5)
"""Factor for a size that is one standard deviation off [-]."""
PIECE = 0.3
"""Factor for a piece with the shape of a part only: a "sofa back" for "sofa"; less than half, as KIND [-]."""
SURELY_OTHER = 0.3
"""Ratio of the likelihood of the noun to that of the other possible labels below which a thing is hardly meant [-]."""
SCANNED = 0.5
"""Factor for a scanner's wide category: "storage" for "bookshelf" [-]."""
UNSAID = 0.45
"""Factor if a word before the noun is missing in the label [-]."""
CONTRADICTED = 0.1
"""Factor if the label's words exclude one: "single" for a label with "double" [-]."""
LEAST = 0.15
"""Least likelihood of a thing that is meant; "did you mean" asks about less likely things [-]."""
PLAUSIBLE = 0.5
"""Least likelihood of a further candidate, over that of the best [-]."""
FURNITURE = "furniture"


def likelihood(noun: Noun, instance: InstanceView) -> float:
    """Likelihood that the noun means the instance, 0..1, without parts, sides, colour and places."""
    if noun.id:
        return 1.0 if noun.id == instance.id else 0.0
    if not instance.guesses:
        return by_label(noun, instance)
    possible = [(share, share * by_shape(noun, label, instance)) for label, share in possible_labels(instance)]
    akin = sum(part for _, part in possible)
    other = max((share for share, part in possible if part < PLAUSIBLE * share), default=0.0)
    if akin < SURELY_OTHER * other:  # a sofa that might just be a bed is not meant by "bed"
        akin *= (akin / (SURELY_OTHER * other)) ** 2
    unknown = noun.thing and is_a(noun.thing, FURNITURE) and not (shapes_of(noun.thing) or told_by_shape(noun.thing))
    if not akin and unknown and not instance.structure:
        fit = usual_size(noun.thing, instance.size)
        return SIZE_ALONE * fit if fit > ONE_SPREAD else 0.0
    return min(akin, 1.0)


def by_label(noun: Noun, instance: InstanceView) -> float:
    """Likelihood that the noun means an instance whose label is correct."""
    label = label_words(instance.label)
    akin = kinship(noun, label, label_thing(instance))
    named_wider = noun.thing and label_thing(instance) == parent_of(noun.thing)
    if named_wider and akin <= WIDER:  # a large table is not a nightstand
        akin *= usual_size(noun.thing, instance.size)
    return max(akin, coarsely(noun, label, instance)) * fit_of_words(noun, label)


def coarsely(noun: Noun, label: Sequence[str], instance: InstanceView) -> float:
    """Likelihood if a label names one of the few wide categories that scanners know: "storage" for "bookshelf"."""
    kinds = coarse().get(tuple(label), ())
    narrower = [noun.thing if is_a(noun.thing, kind) else kind for kind in kinds if in_line(noun.thing, kind)]
    named = label_thing(instance)
    as_named = usual_size(named, instance.size) if named else 0.0
    fits = [(usual_size(one, instance.size), carries_like(one, instance)) for one in narrower]
    return SCANNED * max((carries * fit * fit / (fit + as_named) for fit, carries in fits), default=0.0)


def carries_like(thing: str, instance: InstanceView) -> float:
    """Factor for an instance without the part that first carries things on such a thing: without boards it is hardly a
    shelf."""
    first, names = first_part(thing), {part.name for part in instance.parts}
    return 1.0 if not first or not names or first in names else UNSAID


def possible_labels(instance: InstanceView) -> tuple[tuple[str, float], ...]:
    """Possible labels of an instance, with probabilities; its own label counts if it comes from parts and none of the
    labels is the whole."""
    guessed = instance.guesses
    if instance.label in [label for label, _ in guessed] or not label_thing(instance):
        return guessed
    return ((instance.label, instance.confidence), *guessed)


def by_shape(noun: Noun, text: str, instance: InstanceView) -> float:
    """Likelihood that the noun means an instance with this label, if only its shape suggests the label."""
    label, thing = label_words(text), thing_of(text)
    theirs = thing.id if thing else ""
    if theirs and label != label_words(noun.name) and not named_last(tuple(label)):
        return PIECE * kinship(noun, label, theirs, KIND_BY_SHAPE, KIN_BY_SHAPE)
    if theirs and theirs == told_by_shape(noun.thing):
        return CALLED * usual_size(noun.thing, instance.size)  # shapes identify boxes, not their content
    akin = kinship(noun, label, theirs, KIND_BY_SHAPE, KIN_BY_SHAPE) * fit_of_words(noun, label)
    if theirs == noun.thing or not akin:
        return akin
    return akin * (usual_size if is_a(theirs, noun.thing) else usual_shape)(noun.thing, instance.size)


@cache
def told_by_shape(thing: str) -> str:
    """The wider kind by which shapes are known for a thing without a usual shape of its own; empty if there is none."""
    known = {one.id for one in map(thing_of, labels()) if one}
    return "" if thing in known else next((kind for kind in lineage(thing) if kind in known), "")


def usual_size(thing: str, size: Sequence[float]) -> float:
    """Factor for extents that are unusual for a thing, with its spread as the standard deviation of the mean ratio [-];
    1 if no size is known."""
    if thing not in things():
        return 1.0
    known, extents = things()[thing], sorted((max(one, 1e-3) for one in size), reverse=True)
    away = min(math.dist([math.log(a) for a in usual], [math.log(b) for b in extents]) for usual in known.sizes)
    return math.exp(-0.5 * (away / (math.sqrt(3.0) * math.log(max(known.spread, LEAST_SPREAD)))) ** 2)


def usual_shape(thing: str, size: Sequence[float]) -> float:
    """Factor for extents, the last one upright, that are unusual for the shapes of a thing: a high table is not a
    coffee table."""
    known = shapes_of(thing)
    if not known:
        return usual_size(thing, size)
    length, width = max(size[:2]), min(size[:2])
    measures = {"length": length, "width": width, "height": size[2]}
    return max(math.prod(fit_of_size(one, name, extent) for name, extent in measures.items()) for one in known)


@cache
def shapes_of(thing: str) -> tuple[ShapePrior, ...]:
    """Usual shapes of a thing; empty if none is known."""
    return tuple(one for one in shapes() if (named := thing_of(one.label)) and named.id == thing)


def fit_of_size(row: ShapePrior, name: str, extent: float) -> float:
    """Fit of one extent [m] to a row, 1 within the usual range."""
    usual, value = row.traits.get(name), math.log(max(extent, 1e-3))
    away = max((usual.low - value) / usual.below, (value - usual.high) / usual.above, 0.0) if usual else 0.0
    return math.exp(-0.5 * EVIDENCE * away**2)


def kinship(noun: Noun, label: Sequence[str], theirs: str, kind: float = KIND, kin: float = KIN) -> float:
    """Likelihood from the kind of thing alone.

    Args:
        noun: a noun phrase.
        label: the words of the label.
        theirs: the thing that the label names, empty if unknown.
        kind: for a kind of the noun's thing by another name [-].
        kin: for another kind of the same [-].
    """
    words = tuple(label_words(noun.name))
    if words and words == tuple(label):
        return 1.0
    if not noun.thing:
        return CALLED if words and contains_words(label, words) else mistyped(words, label)
    if theirs == noun.thing:
        return 1.0
    if not theirs:
        return 0.0
    if len(words) > 1 and set(words) <= set(label) and in_line(theirs, noun.thing):
        return CALLED  # "single bed" and "bed single clone"
    if is_a(theirs, noun.thing):
        return CALLED if contains_words(label, words[len(noun.modifiers) :]) else kind
    parent = parent_of(noun.thing)
    if parent in NO_KIND:
        return 0.0
    return WIDER if theirs == parent else kin if parent_of(theirs) == parent else 0.0


def fit_of_words(noun: Noun, label: Sequence[str]) -> float:
    """Factor for words such as "single" before the noun: a word that belongs to the name of the thing, as in "coffee
    table", may be missing in the label, but nothing in the label may contradict it [-]."""
    before = label_words(noun.name)[:-1]
    if any(opposites().get(word, frozenset()) & set(label) for word in before if word not in label):
        return CONTRADICTED
    unsaid = any(word not in label for phrase in noun.modifiers for word in label_words(phrase))
    return UNSAID if unsaid else 1.0


def mistyped(words: Sequence[str], label: Sequence[str]) -> float:
    """Likelihood that unknown words are misspellings of the label's."""
    return MISTYPED if words and all(any(may_be(word, one) for one in label) for word in words) else 0.0


@cache
def named_last(label: tuple[str, ...]) -> bool:
    """Return whether a label ends with the name of a thing, as a thing called by two nouns is a kind of the second."""
    ends = (vocabulary().get(label[begin:], ()) for begin in range(len(label)))
    return any(meaning.kind == "thing" for meanings in ends for meaning in meanings)


def contains_words(label: Sequence[str], words: Sequence[str]) -> bool:
    """Return whether the words occur in the label consecutively."""
    return any(tuple(label[i : i + len(words)]) == tuple(words) for i in range(len(label)))


def label_thing(instance: InstanceView) -> str:
    """Thing id of an instance's label; empty if unknown."""
    thing = thing_of(instance.label)
    return thing.id if thing else ""


def parent_of(thing: str) -> str:
    """The kind to which a thing belongs; empty if there is none."""
    return things()[thing].parent if thing in things() else ""


@cache
def opposites() -> dict[str, frozenset[str]]:
    """The words that exclude a word."""
    found: dict[str, frozenset[str]] = {}
    for row in rows(OPPOSITES):
        words = frozenset(row["words"].split("|"))
        for word in words:
            found[word] = found.get(word, frozenset()) | (words - {word})
    return found
