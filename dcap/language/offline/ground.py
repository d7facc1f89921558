"""Grounds nouns in the instances of a scene: "the left bed", the thing that a lamp stands on.

In: noun phrases and instance views. Out: instances with the likelihood that each is meant, part names and regions.
`likelihood` gives the likelihood for the noun itself; colours, sides and places weigh several candidates against each
other. Boxes decide; the sides of several similar things are those of a viewer who looks at their fronts (at things
without fronts: along +y, as on a floor plan), the sides of a landmark those of a viewer who looks at its front. A
choice that depends on a side without a front comes with a caution.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.knowledge.kinds import NO_KIND
from dcap.knowledge.lexicon import is_a, label_words
from dcap.language.offline.likelihood import (
    FURNITURE,
    LEAST,
    PLAUSIBLE,
    by_label,
    label_thing,
    likelihood,
    parent_of,
    usual_size,
)
from dcap.language.offline.nouns import Noun
from dcap.language.offline.reading import Place
from dcap.language.protocol.requests import InstanceView
from dcap.scene.types.boxes import OrientedBox
from dcap.scene.types.choices import VIEWED, axis_word, viewer_side
from dcap.scene.types.outcome import Cause, Caution

Vector = NDArray[np.float64]
COLOURS: dict[str, tuple[float, float, float]] = {
    "red": (0.75, 0.15, 0.15), "green": (0.2, 0.55, 0.25), "blue": (0.2, 0.35, 0.7), "yellow": (0.85, 0.75, 0.2),
    "orange": (0.9, 0.5, 0.15), "white": (0.92, 0.92, 0.92), "black": (0.08, 0.08, 0.08), "grey": (0.5, 0.5, 0.5),
    "brown": (0.45, 0.3, 0.2), "pink": (0.9, 0.6, 0.7), "purple": (0.5, 0.25, 0.6),
}  # fmt: skip
"""Typical sRGB values of colour words."""
SHADE = 0.1
"""Difference of two distances from a colour word's value that distinguishes things by colour [sRGB]."""
HAND = 0.3
"""Distance at which a thing that should be "next to" another is half as likely to be meant as a touching one [m]."""
SAME_SIZE = 1.05
"""Factor of sizes below which things count as equally large [-]."""
SAME_PLACE = 0.05
"""Difference of distances and heights below which they count as equal [m]."""
SIZES = frozenset({"largest", "smallest", "tallest", "shortest", "widest", "narrowest"})
"""Sizes that words can select, comparative or not."""
POSITIVE = frozenset({"big", "large", "small", "little", "tiny", "tall", "low", "high"})
"""Sizes that do not compare."""
NAMELESS = "thing"
"""Label of a thing that is named neither by the source nor by its shape."""
NEAREST = 3
"""Number of unlikely candidates that are reported [-]."""
SIDED_RELATIONS = frozenset({"left_of", "right_of", "front_of", "behind"})
"""Relations to a side of a thing that depends on the viewer."""
PLAN_VIEWER = np.array([0.0, -1.0])
"""Direction towards the viewer of a floor plan."""
ALIKE = "they have no front in common"
"""Reason for using that viewer to find the left one of several things."""
STANDS_ON = 0.12
"""Maximum height difference between the top of a support and the bottom of a thing on it [m]; a mattress yields that
much."""


@dataclass(frozen=True, slots=True)
class Found:
    """Instances that a noun may mean, the likeliest first."""

    instances: tuple[InstanceView, ...]
    scores: tuple[float, ...]
    """Likelihood that each is meant, 0..1."""
    note: str = ""
    """How one was chosen among several."""
    viewpoints: tuple[str, ...] = ()
    """From where the sides were seen by which it was chosen; cautions where nothing says so."""

    @property
    def best(self) -> InstanceView:
        """The likeliest; among equals the first by id."""
        return self.instances[0]

    @property
    def open(self) -> bool:
        """Whether another instance may be meant as well."""
        return len(self.scores) > 1 and self.scores[1] >= PLAUSIBLE * self.scores[0]


def named(noun: Noun, instances: Sequence[InstanceView]) -> tuple[InstanceView, ...]:
    """Instances that the noun may mean: the likeliest, and those at least half as likely."""
    scores = [likelihood(noun, i) for i in instances]
    least = max(LEAST, PLAUSIBLE * max(scores, default=0.0))
    return tuple(i for i, score in zip(instances, scores, strict=True) if score >= least)


def near_miss(noun: Noun, instances: Sequence[InstanceView]) -> str:
    """The label nearest to a noun that names nothing here; empty if there is none."""
    scored = [(by_label(noun, i), i.label) for i in instances]
    best = max(scored, default=(0.0, ""))
    return best[1] if best[0] > 0.0 else ""


def unlikely(noun: Noun, instances: Sequence[InstanceView]) -> Found:
    """Instances nearest to a noun that names nothing here, by their possible labels: too unlikely to be chosen."""
    scored = [(likelihood(noun, i), i) for i in instances]
    left = sorted((one for one in scored if one[0] > 0.0), key=lambda one: (-one[0], one[1].id))[:NEAREST]
    return Found(tuple(i for _, i in left), tuple(round(score, 6) for score, _ in left))


def is_wider(instance: InstanceView, noun: Noun) -> bool:
    """Return whether a label names the kind to which the noun's thing belongs: a stool, if the noun is an ottoman."""
    parent = parent_of(noun.thing)
    return parent not in NO_KIND and label_thing(instance) == parent


def owners(noun: Noun, instances: Sequence[InstanceView]) -> tuple[InstanceView, ...]:
    """Instances that have a part with that name."""
    return tuple(i for i in instances if any(part.name in noun.parts for part in i.parts) and not i.structure)


def part_of(noun: Noun, instance: InstanceView) -> str:
    """The instance's part that the noun means; empty if it has none."""
    names = [part.name for part in instance.parts]
    return next((part for part in noun.parts if part in names), "")


def candidates(noun: Noun, instances: Sequence[InstanceView]) -> tuple[InstanceView, ...]:
    """Instances named by the noun itself, else those that have such a part.

    "The second shelf" is a board if a thing has several above each other.
    """
    found = boarded(noun, instances) or named(noun, instances) or owners(noun, instances)
    one = len(found) == 1 and found[0] in named(noun, instances)
    return widened(noun, instances) if one and noun.sides and not describes(noun) else found


def describes(noun: Noun) -> bool:
    """Return whether the noun's size is absolute, as in "the little table", and not relative, as in "the smaller
    table"."""
    return SIZES.issuperset(noun.sides) and not POSITIVE.isdisjoint(label_words(noun.text))


def nameless(noun: Noun, instances: Sequence[InstanceView]) -> tuple[InstanceView, ...]:
    """The only thing in the scene, if nothing names it and its size fits: a scan of one sofa in "scan.ply"."""
    things = tuple(i for i in instances if not i.structure)
    unknown = len(things) == 1 and not things[0].guesses and things[0].label == NAMELESS
    fits = unknown and is_a(noun.thing, FURNITURE) and usual_size(noun.thing, things[0].size) >= LEAST
    return things if fits else ()


def widened(noun: Noun, instances: Sequence[InstanceView]) -> tuple[InstanceView, ...]:
    """All instances that a noun may possibly mean: "the larger table" implies two, one of which may have another
    name."""
    return tuple(i for i in instances if likelihood(noun, i) >= LEAST)


def boarded(noun: Noun, instances: Sequence[InstanceView]) -> tuple[InstanceView, ...]:
    """Instances with a board counted by the noun: "the second shelf from the top"; empty for other nouns."""
    counts = any(side[0].isdigit() or side in ("top", "bottom", "middle", "last") for side in noun.sides)
    if not counts or "board" not in noun.parts or noun.owner is not None:
        return ()
    return tuple(i for i in owners(noun, instances) if is_stacked(i, part_of(noun, i)))


def is_stacked(instance: InstanceView, part: str) -> bool:
    """Return whether an instance has several parts with that name above each other."""
    heights = [one.center[2] for one in instance.parts if one.name == part]
    return len(heights) > 1 and max(heights) - min(heights) > 2.0 * SAME_PLACE


def choose(
    found: Sequence[InstanceView],
    noun: Noun,
    restrictions: Sequence[Place],
    instances: Sequence[InstanceView],
    room_center: Sequence[float],
) -> Found:
    """Likelihood that each of several instances is meant: by the noun, by colour, by places that select, by sides."""
    score = {i.id: likelihood(noun, i) or 1.0 for i in found}
    if noun.sides and sum(one >= PLAUSIBLE * max(score.values()) for one in score.values()) < 2:
        score = dict.fromkeys(score, max(score.values(), default=0.0))  # the side distinguishes them, see `widened`
    notes: list[str] = []
    viewpoints: list[str] = []

    def weigh(factors: Sequence[float], note: str) -> None:
        if len(found) > 1 and any(factors):
            score.update({i.id: score[i.id] * factor for i, factor in zip(found, factors, strict=True)})
            notes.append(note)

    if noun.colour:
        weigh(of_colour(found, noun.colour), f"the one that is most {noun.colour}")
    for place in restrictions:
        if (factors := fits(found, place, instances, room_center)) is not None:
            weigh(factors, f"the one {place.text}")
            viewpoints += viewpoint_of(found, place, instances, room_center)
    for side in noun.sides:
        best = max(score.values(), default=0.0)
        left = [i for i in found if score[i.id] >= PLAUSIBLE * best]
        picked = {i.id for i in by_side(left, side, room_center, instances)}
        weigh([float(i.id in picked) for i in found], f"the {side} one")
        if len(left) > 1 and is_viewed(side):
            viewpoints.append(seen_together(f"the {side} one", left))
    ordered = sorted(found, key=lambda i: (-round(score[i.id], 6), -round(float(np.prod(i.size)), 3), i.id))
    scores = tuple(round(score[i.id], 6) for i in ordered)
    return Found(tuple(ordered), scores, "; ".join(notes), tuple(viewpoints))


def seen_from(words: str, viewer: Vector, why: str) -> Caution:
    """Caution that a side was seen from a point of view nobody stated, with a way to state another."""
    taken = f"{words!r} is read as seen from {axis_word(viewer)} (world axes, z up), as {why}"
    return Caution(Cause.WHICH, f"{taken}; name another by its id or by what is nearest to it")


def seen_before(words: str, what: str) -> str:
    """That a side is the one that a viewer of a front sees."""
    return f"{words!r} is as seen by someone who looks at {what}"


def seen_together(words: str, found: Sequence[InstanceView]) -> str:
    """From where a side of several alike things is seen."""
    front = common_front(found)
    return seen_from(words, PLAN_VIEWER, ALIKE) if front is None else seen_before(words, "their fronts")


def is_viewed(side: str) -> bool:
    """Return whether a side, or a number counted from the left or right, depends on the viewer."""
    counted = side.split()[0].isdigit() and not side.endswith(("from top", "from bottom"))
    return side in VIEWED or side == "last" or counted


def viewpoint_of(
    found: Sequence[InstanceView], place: Place, instances: Sequence[InstanceView], room_center: Sequence[float]
) -> list[str]:
    """From where a place is seen that is a side of something, a caution where nothing says so; empty for others."""
    noun = place.nouns[0]
    if len(found) < 2:
        return []
    if place.relation == "which" or noun.is_region:
        viewed = bool(noun.sides) and is_viewed(noun.sides[0])
        return [seen_together(place.text, found)] if viewed else []
    others = [i for i in candidates(noun, instances) if i not in found]
    if place.relation not in SIDED_RELATIONS or not others:
        return []
    other = nearest_of(found[0], others)
    if other.structure:
        return []  # doors and walls are seen from the room
    if other.front is not None:
        return [seen_before(place.text, f"the front of the {other.label}")]
    return [seen_from(place.text, viewer_of(other, room_center), f"the {other.label} has no front")]


def viewer_of(thing: InstanceView, room_center: Sequence[float]) -> Vector:
    """Unit vector towards the viewer of a thing, as for places next to it, shape (2,)."""
    half = 0.5 * np.subtract(thing.high, thing.low)
    box = OrientedBox(np.array(thing.center, dtype=float), np.eye(3), half)
    front = None if thing.front is None or thing.structure else np.array(thing.front)
    return viewer_side(box, front, np.array(room_center, dtype=float))[0]


def nearest_of(thing: InstanceView, others: Sequence[InstanceView]) -> InstanceView:
    """The other thing that is nearest to a thing."""
    return min(others, key=lambda other: (gap(thing, other), other.id))


def of_colour(found: Sequence[InstanceView], colour: str) -> list[float]:
    """Fit of each instance to a colour word, relative to the best fit, 0..1."""
    away = [colour_distance(i, colour) for i in found]
    return [float(np.exp(-0.5 * ((one - min(away)) / SHADE) ** 2)) for one in away]


def colour_distance(instance: InstanceView, colour: str) -> float:
    """Distance of the instance's mean colour from the word's in sRGB [-]."""
    return float(np.linalg.norm(np.subtract(instance.color, COLOURS[colour])))


def fits(
    found: Sequence[InstanceView], place: Place, instances: Sequence[InstanceView], room_center: Sequence[float]
) -> list[float] | None:
    """Fit of each instance to a relation with the named thing, 0..1; None if that thing does not exist."""
    good = fits_as_said(found, place, instances, room_center)
    return None if good is None else [1.0 - min(one, 1.0) for one in good] if place.excluded else good


def fits_as_said(
    found: Sequence[InstanceView], place: Place, instances: Sequence[InstanceView], room_center: Sequence[float]
) -> list[float] | None:
    """The same, ignoring that the place is excluded."""
    noun = place.nouns[0]
    if noun.colour and noun.pronoun == "one":
        return of_colour(found, noun.colour)
    if place.relation == "which" or noun.is_region:
        picked = {i.id for i in by_side(found, noun.sides[0], (0, 0, 0), instances)} if noun.sides else set()
        return [float(i.id in picked) for i in found] if picked else None
    if place.relation in ("on", "in") and (meant := [i for i in named(noun, instances) if i in found]):
        best = choose(meant, noun, (), instances, (0, 0, 0)).best
        return [float(i is best) for i in found]
    others = [i for i in candidates(noun, instances) if i not in found]
    if place.relation in ("carrying", "lacking"):
        return by_load(found, place, others)
    if not others:
        return None
    return by_place(found, place.relation, others, room_center)


def by_load(found: Sequence[InstanceView], place: Place, others: Sequence[InstanceView]) -> list[float] | None:
    """Whether each instance carries the named thing or has it as a part, or does not; None if nothing here has that
    name."""
    noun = place.nouns[0]
    loaded = [bool(part_of(noun, i)) or any(stands_on(other, i) for other in others) for i in found]
    known = bool(others) or any(loaded)
    if not known:
        return None
    return [float(one == (place.relation == "carrying")) for one in loaded]


def by_place(
    found: Sequence[InstanceView], relation: str, others: Sequence[InstanceView], room_center: Sequence[float]
) -> list[float] | None:
    """Fit of each instance to being next to, far from, on one side of or under the nearest of other things; None if
    there are none."""
    gaps = [min(gap(i, o) for o in others) for i in found]
    if relation in ("away", "farthest", "opposite"):
        return [float(one > max(gaps) - SAME_PLACE) for one in gaps]
    if relation == "nearest":
        return [float(one < min(gaps) + SAME_PLACE) for one in gaps]
    near = [1.0 / (1.0 + (one / HAND) ** 2) for one in gaps]
    beyond = [True] * len(near)
    if relation in SIDED_RELATIONS:
        beyond = [is_beyond(i, nearest_of(i, others), relation, room_center) for i in found]
    good = [share * ahead for share, ahead in zip(near, beyond, strict=True)]
    return good if any(good) else None


def is_beyond(thing: InstanceView, other: InstanceView, relation: str, room_center: Sequence[float]) -> bool:
    """Return whether a thing is on that side of another thing."""
    toward = viewer_of(other, room_center)
    right = np.array([-toward[1], toward[0]])
    ways = {"left_of": -right, "right_of": right, "front_of": toward, "behind": -toward}
    return float(np.subtract(thing.center, other.center)[:2] @ ways[relation]) > 0.0


def by_side(
    found: Sequence[InstanceView], side: str, room_center: Sequence[float], instances: Sequence[InstanceView] = ()
) -> list[InstanceView]:
    """The left, lower, second or largest instance; several if they are equal."""
    if not found:
        return []
    if side == "empty":
        return [i for i in found if not any(stands_on(o, i) for o in instances if o.id != i.id and not o.structure)]
    right = right_of(found)
    toward = np.cross(right, (0.0, 0.0, 1.0))
    size = np.log(SAME_SIZE)
    keys = {
        "top": ([-i.center[2] for i in found], SAME_PLACE),
        "bottom": ([i.center[2] for i in found], SAME_PLACE),
        "front": ([-float(np.dot(i.center, toward)) for i in found], SAME_PLACE),
        "back": ([float(np.dot(i.center, toward)) for i in found], SAME_PLACE),
        "largest": ([-float(np.log(np.prod(i.size))) for i in found], size),
        "smallest": ([float(np.log(np.prod(i.size))) for i in found], size),
        "tallest": ([-float(np.log(i.size[2])) for i in found], size),
        "shortest": ([float(np.log(i.size[2])) for i in found], size),
        "widest": ([-float(np.log(max(i.size[:2]))) for i in found], size),
        "narrowest": ([float(np.log(max(i.size[:2]))) for i in found], size),
        "nearest": ([float(np.linalg.norm(np.subtract(i.center, room_center))) for i in found], SAME_PLACE),
    }
    if side in keys:
        values, alike = keys[side]
        return [i for i, value in zip(found, values, strict=True) if value <= min(values) + alike]
    along = sorted(found, key=lambda i: (round(float(np.dot(i.center, right)), 3), i.id))
    if side == "middle":
        return [along[len(along) // 2]]
    index = {"left": 0, "right": -1, "last": -1}.get(side)
    if index is None:
        if not side.split()[0].isdigit():
            return list(found)
        index = min(int(side.split()[0]), len(along)) - 1
        index = -1 - index if side.endswith("from right") else index
    return [along[index]]


def right_of(found: Sequence[InstanceView]) -> Vector:
    """Unit vector to the right of a viewer who looks at the fronts; +x if there are none."""
    front = common_front(found)
    if front is None:
        return np.array([1.0, 0.0, 0.0])
    right = np.cross((0.0, 0.0, 1.0), front)
    return np.asarray(right / np.linalg.norm(right))


def common_front(found: Sequence[InstanceView]) -> Vector | None:
    """The mean of the fronts, shape (3,); None if there are none, or if they differ in direction."""
    fronts = [i.front for i in found if i.front is not None]
    front = np.mean(fronts, axis=0) if fronts else np.zeros(3)
    return np.asarray(front) if np.linalg.norm(front) >= 0.5 else None


def gap(a: InstanceView, b: InstanceView) -> float:
    """Distance of two axis-aligned boxes [m]."""
    apart = np.maximum(np.subtract(a.low, b.high), np.subtract(b.low, a.high))
    return float(np.linalg.norm(np.maximum(apart, 0.0)))


def carrier(thing: InstanceView, instances: Sequence[InstanceView]) -> InstanceView | None:
    """Instance on which a thing stands: the highest instance below its middle, or the floor as the last resort."""
    below = [i for i in instances if i.id != thing.id and stands_on(thing, i)]
    below.sort(key=lambda i: (i.structure, -i.high[2], i.id))
    return next(iter(below), None) or floor_of(instances)


def stands_on(thing: InstanceView, base: InstanceView) -> bool:
    """Return whether the base lies under the thing's middle and reaches up to its bottom."""
    x, y, _ = thing.center
    within = base.low[0] <= x <= base.high[0] and base.low[1] <= y <= base.high[1]
    tops = [base.high[2], *(part.center[2] + part.size[2] / 2 for part in base.parts)]
    return within and base.low[2] < thing.low[2] and any(abs(thing.low[2] - top) < STANDS_ON for top in tops)


def floor_of(instances: Sequence[InstanceView]) -> InstanceView | None:
    """The floor, if the scene has one."""
    return next((i for i in instances if label_thing(i) == "floor"), None)


def inventory(instances: Sequence[InstanceView]) -> str:
    """Labels of the things in a scene, as text for a person."""
    labels = sorted({i.label for i in instances if not (i.structure and label_thing(i) in ("wall", "ceiling"))})
    return ", ".join(labels) or "nothing"
