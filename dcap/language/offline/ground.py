"""Nouns tied to the instances of a scene: which bed is "the left bed", what does the lamp stand on.

In: noun phrases and instance views. Out: instances, part names and regions. Boxes decide; the sides of several alike
things are those of a viewer who looks at their fronts (at things without fronts: along +y, as on a floor plan).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.language.offline.lexicon import is_a, label_words, thing_of, things
from dcap.language.offline.nouns import Noun
from dcap.language.offline.sentence import Place
from dcap.language.protocol.requests import InstanceView

Vector = NDArray[np.float64]
COLOURS: dict[str, tuple[float, float, float]] = {
    "red": (0.75, 0.15, 0.15), "green": (0.2, 0.55, 0.25), "blue": (0.2, 0.35, 0.7), "yellow": (0.85, 0.75, 0.2),
    "orange": (0.9, 0.5, 0.15), "white": (0.92, 0.92, 0.92), "black": (0.08, 0.08, 0.08), "grey": (0.5, 0.5, 0.5),
    "brown": (0.45, 0.3, 0.2), "pink": (0.9, 0.6, 0.7), "purple": (0.5, 0.25, 0.6),
}  # fmt: skip
"""Typical sRGB values of colour words."""
NO_KIND = frozenset({"", "furniture", "structure"})
"""Parents that hold things together that nobody would take for each other."""
STANDS_ON = 0.12
"""A thing stands on what has its top within this height of its bottom [m]; a mattress gives way that much."""


@dataclass(frozen=True, slots=True)
class Found:
    """Instances that a noun may mean, best first."""

    instances: tuple[InstanceView, ...]
    note: str = ""
    """How one was chosen among several."""


def named(noun: Noun, instances: Sequence[InstanceView]) -> tuple[InstanceView, ...]:
    """Instances whose label is what the noun says: the same words or thing, a kind of it, or the kind that it is.

    An ottoman may be labelled as a stool; a piano is not what is labelled as furniture.
    """
    words = tuple(label_words(noun.name))
    exact = tuple(i for i in instances if words == tuple(label_words(i.label)))
    if exact:
        return exact
    if noun.thing:
        same = tuple(i for i in instances if label_thing(i) == noun.thing)
        kinds = tuple(i for i in instances if label_thing(i) and is_a(label_thing(i), noun.thing))
        return same or kinds or tuple(i for i in instances if is_wider(i, noun))
    return tuple(i for i in instances if words and contains_words(label_words(i.label), words))


def is_wider(instance: InstanceView, noun: Noun) -> bool:
    """Whether a label names the kind that the noun's thing is: a stool, where an ottoman is asked for."""
    parent = things()[noun.thing].parent if noun.thing in things() else ""
    return parent not in NO_KIND and label_thing(instance) == parent


def contains_words(label: list[str], words: tuple[str, ...]) -> bool:
    """Whether the words stand in the label side by side."""
    return any(tuple(label[i : i + len(words)]) == words for i in range(len(label)))


def label_thing(instance: InstanceView) -> str:
    """Thing id of an instance's label, empty if unknown."""
    thing = thing_of(instance.label)
    return thing.id if thing else ""


def owners(noun: Noun, instances: Sequence[InstanceView]) -> tuple[InstanceView, ...]:
    """Instances that have a part of that name."""
    return tuple(i for i in instances if any(part.name in noun.parts for part in i.parts) and not i.structure)


def part_of(noun: Noun, instance: InstanceView) -> str:
    """The instance's part that the noun means, empty if it has none."""
    names = [part.name for part in instance.parts]
    return next((part for part in noun.parts if part in names), "")


def candidates(noun: Noun, instances: Sequence[InstanceView]) -> tuple[InstanceView, ...]:
    """Instances that the noun itself names, else those that have such a part."""
    return named(noun, instances) or owners(noun, instances)


def choose(
    found: Sequence[InstanceView],
    noun: Noun,
    restrictions: Sequence[Place],
    instances: Sequence[InstanceView],
    room_center: Sequence[float],
) -> Found:
    """One of several: by colour, by restrictions, by sides; else the largest, the first of equals."""
    left = list(found)
    notes = []
    if noun.colour and len(left) > 1:
        left = [min(left, key=lambda i: colour_distance(i, noun.colour))]
        notes.append(f"the one that is most {noun.colour}")
    for place in restrictions:
        if len(left) > 1 and (narrowed := restricted(left, place, instances)):
            left = narrowed
            notes.append(f"the one {place.text}")
    for side in noun.sides:
        if len(left) > 1:
            left = [by_side(left, side, room_center)]
            notes.append(f"the {side} one")
    if len(left) > 1:
        left.sort(key=lambda i: (-round(float(np.prod(i.size)), 3), i.id))
        notes.append(f"{len(left)} match, the largest or first is taken: {left[0].id}")
    return Found(tuple(left), "; ".join(notes))


def colour_distance(instance: InstanceView, colour: str) -> float:
    """Distance of its mean colour from the word's in sRGB [-]."""
    return float(np.linalg.norm(np.subtract(instance.color, COLOURS[colour])))


def restricted(
    found: Sequence[InstanceView], place: Place, instances: Sequence[InstanceView]
) -> list[InstanceView] | None:
    """Those that stand in the relation to the named thing; None if that thing is not there."""
    noun = place.nouns[0]
    if noun.colour and noun.pronoun == "one":
        return [min(found, key=lambda i: colour_distance(i, noun.colour))]
    if place.relation == "which" or noun.is_region:
        return [by_side(list(found), side, (0, 0, 0)) for side in noun.sides[:1]] or None
    if place.relation in ("on", "in") and (meant := [i for i in named(noun, instances) if i in found]):
        return list(choose(meant, noun, (), instances, (0, 0, 0)).instances[:1])
    others = [i for i in candidates(noun, instances) if i not in found]
    if not others:
        return None
    if place.relation == "away":
        return [max(found, key=lambda i: min(gap(i, o) for o in others))]
    if place.relation in ("left_of", "right_of"):
        sign = -1.0 if place.relation == "left_of" else 1.0
        right = right_of(found)
        return [i for i in found if sign * float(np.dot(np.subtract(i.center, others[0].center), right)) > 0] or None
    return [min(found, key=lambda i: (min(gap(i, o) for o in others), i.id))]


def by_side(found: list[InstanceView], side: str, room_center: Sequence[float]) -> InstanceView:
    """The left one, the lower one, the second one, the largest one."""
    right = right_of(found)
    ordered = sorted(found, key=lambda i: (round(float(np.dot(i.center, right)), 3), i.id))
    toward = np.cross(right, (0.0, 0.0, 1.0))
    keys: dict[str, Callable[[InstanceView], float]] = {
        "top": lambda i: -i.center[2],
        "bottom": lambda i: i.center[2],
        "front": lambda i: -float(np.dot(i.center, toward)),
        "back": lambda i: float(np.dot(i.center, toward)),
        "largest": lambda i: -float(np.prod(i.size)),
        "smallest": lambda i: float(np.prod(i.size)),
        "nearest": lambda i: float(np.linalg.norm(np.subtract(i.center, room_center))),
    }
    if side in keys:
        return min(found, key=lambda i: (keys[side](i), i.id))
    if side == "middle":
        return ordered[len(ordered) // 2]
    index = {"left": 0, "right": -1, "last": -1}.get(side)
    if index is None:
        number = int(side.split()[0]) if side.split()[0].isdigit() else 1
        index = min(number, len(ordered)) - 1
        index = -1 - index if side.endswith("from right") else index
    return ordered[index]


def right_of(found: Sequence[InstanceView]) -> Vector:
    """Unit vector to the right of a viewer who looks at the fronts; +x where there is none."""
    fronts = [i.front for i in found if i.front is not None]
    front = np.mean(fronts, axis=0) if fronts else np.zeros(3)
    if np.linalg.norm(front) < 0.5:  # none, or they look in different directions
        return np.array([1.0, 0.0, 0.0])
    right = np.cross((0.0, 0.0, 1.0), front)
    return np.asarray(right / np.linalg.norm(right))


def gap(a: InstanceView, b: InstanceView) -> float:
    """Distance of two axis-aligned boxes [m]."""
    apart = np.maximum(np.subtract(a.low, b.high), np.subtract(b.low, a.high))
    return float(np.linalg.norm(np.maximum(apart, 0.0)))


def carrier(thing: InstanceView, instances: Sequence[InstanceView]) -> InstanceView | None:
    """What a thing stands on: the highest instance below its middle; the floor as the last resort."""
    below = [i for i in instances if i.id != thing.id and stands_on(thing, i)]
    below.sort(key=lambda i: (i.structure, -i.high[2], i.id))
    return next(iter(below), None) or floor_of(instances)


def stands_on(thing: InstanceView, base: InstanceView) -> bool:
    """Whether the base lies under the thing's middle and reaches up to its bottom."""
    x, y, _ = thing.center
    within = base.low[0] <= x <= base.high[0] and base.low[1] <= y <= base.high[1]
    tops = [base.high[2], *(part.center[2] + part.size[2] / 2 for part in base.parts)]
    return within and base.low[2] < thing.low[2] and any(abs(thing.low[2] - top) < STANDS_ON for top in tops)


def floor_of(instances: Sequence[InstanceView]) -> InstanceView | None:
    """The floor, if the scene has one."""
    return next((i for i in instances if label_thing(i) == "floor"), None)


def inventory(instances: Sequence[InstanceView]) -> str:
    """What there is, in words, for a person."""
    labels = sorted({i.label for i in instances if not (i.structure and label_thing(i) in ("wall", "ceiling"))})
    return ", ".join(labels) or "nothing"
