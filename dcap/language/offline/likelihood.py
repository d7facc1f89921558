"""How likely a noun means an instance: one number for grounding, for questions back and for "did you mean".

In: a noun phrase and an instance with what its label says. Out: 0 to 1. The label's own words weigh first: a thing that
is called by the noun's words is what it says, a kind of it that goes by another name is that less, the wider kind less
again, its kin only a guess. Words before the noun that the label has not lower it, words that contradict the label's
lower it more. Colours, sides and places tell several such things apart; they are weighed in `ground`.
"""

from collections.abc import Sequence
from functools import cache

from dcap.language.offline.lexicon import is_a, label_words, rows, thing_of, things
from dcap.language.offline.nouns import Noun
from dcap.language.offline.typos import may_be
from dcap.language.protocol.requests import InstanceView

CALLED = 0.9
"""A kind of it whose label has the noun's words: a "dining table" for "table" [-]."""
KIND = 0.4
"""A kind of it by another name: an "armchair" for "chair"; less than half, so that a plain chair is not doubted [-]."""
WIDER = 0.35
"""The kind that it is: a "stool" for "ottoman" [-]."""
MISTYPED = 0.3
"""An unknown word that a slip makes of a word of the label [-]."""
KIN = 0.1
"""Another kind of the same: a "side table" for "coffee table"; no answer, but worth a question [-]."""
UNSAID = 0.45
"""Factor where a word before the noun is none of the label's [-]."""
CONTRADICTED = 0.1
"""Factor where the label's words exclude one: "single", where the label says "double" [-]."""
LEAST = 0.15
"""What is less likely is not meant; it is what "did you mean" asks [-]."""
PLAUSIBLE = 0.5
"""What has at least this share of the best one's likelihood may be meant as well [-]."""
NO_KIND = frozenset({"", "furniture", "structure"})
"""Parents that hold things together that nobody would take for each other."""
OPPOSITES = "lexicon/opposites.csv"


def likelihood(noun: Noun, instance: InstanceView) -> float:
    """How likely the noun means the instance, 0..1; parts, sides, colour and places are not looked at."""
    if noun.id:
        return 1.0 if noun.id == instance.id else 0.0
    label = label_words(instance.label)
    return kinship(noun, label, label_thing(instance)) * fit_of_words(noun, label)


def kinship(noun: Noun, label: Sequence[str], theirs: str) -> float:
    """How likely from the thing alone; `theirs`: the thing that the label names."""
    words = tuple(label_words(noun.name))
    if words and words == tuple(label):
        return 1.0
    if not noun.thing:
        return CALLED if words and contains_words(label, words) else mistyped(words, label)
    if theirs == noun.thing:
        return 1.0
    if not theirs:
        return 0.0
    if len(words) > 1 and set(words) <= set(label) and (is_a(theirs, noun.thing) or is_a(noun.thing, theirs)):
        return CALLED  # "single bed" and "bed single clone"
    if is_a(theirs, noun.thing):
        return CALLED if contains_words(label, words[len(noun.modifiers) :]) else KIND
    parent = parent_of(noun.thing)
    if parent in NO_KIND:
        return 0.0
    return WIDER if theirs == parent else KIN if parent_of(theirs) == parent else 0.0


def fit_of_words(noun: Noun, label: Sequence[str]) -> float:
    """Factor for words such as "single" before the noun: one that belongs to the name of the thing, as in "coffee
    table", need not stand in the label, but nothing in the label may contradict it [-]."""
    before = label_words(noun.name)[:-1]
    if any(opposites().get(word, frozenset()) & set(label) for word in before if word not in label):
        return CONTRADICTED
    unsaid = any(word not in label for phrase in noun.modifiers for word in label_words(phrase))
    return UNSAID if unsaid else 1.0


def mistyped(words: Sequence[str], label: Sequence[str]) -> float:
    """How likely unknown words are the label's with slips."""
    return MISTYPED if words and all(any(may_be(word, one) for one in label) for word in words) else 0.0


def contains_words(label: Sequence[str], words: Sequence[str]) -> bool:
    """Whether the words stand in the label side by side."""
    return any(tuple(label[i : i + len(words)]) == tuple(words) for i in range(len(label)))


def label_thing(instance: InstanceView) -> str:
    """Thing id of an instance's label, empty if unknown."""
    thing = thing_of(instance.label)
    return thing.id if thing else ""


def parent_of(thing: str) -> str:
    """The kind that a thing is, empty if none."""
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
