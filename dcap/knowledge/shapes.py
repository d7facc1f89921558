"""Usual shapes of things: `lexicon/shapes.csv` states the usual values of each label.

In: measures of things, some of them unknown. Out: for each thing the label that fits best, and how much better it fits
than a thing of which nothing is known. A row gives four numbers for some measures: limits and, between them, the usual
range. They are household dimensions as commonly known (`estimate`), not measured from data. One rule scores all labels:
a measure has a density that is uniform over the usual range and falls off as a normal distribution beyond it, with the
limits two standard deviations away; a measure that a row leaves open, and the label `thing`, are uniform over
everything. Measures of a thing depend on each other, so only a part of their evidence counts.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from dcap.arrays import Array
from dcap.knowledge.lexicon import rows
from dcap.scene.errors import InputError

SHAPES = "lexicon/shapes.csv"
EVIDENCE = 0.5
"""Share of the evidence of one measure that is counted [-]: size, level and outline are not independent."""
FARTHEST = 6.0
"""Maximum number of standard deviations by which a measure counts against a label: scans have holes [-]."""
HELD, NOT_HELD = 0.9, 0.03
"""Probability that a thing is held by its usual holder, and by one other kind of thing [-]."""
NOTHING_KNOWN = 0.2
"""Frequency of things that no row describes, in the unit of the column `common` [-]."""
ROOM = frozenset({"floor", "wall", "ceiling", "nothing"})
"""Holders that are not things themselves."""
BLUR = 0.05
"""Least standard deviation [-]: of a logarithm for lengths, of a share for other measures."""

EVEN = {
    "length": 6.0, "width": 6.0, "height": 6.0, "bottom": 3.0, "level": 3.0, "rise": 3.0, "levels": 6.0, "closed": 1.0,
    "covered": 1.0, "waist": 1.0, "rough": 0.67, "gap": 3.0, "light": 1.0, "varied": 80.0,
    "green": 0.4, "share": 1.0, "balance": 1.0,
}  # fmt: skip
"""Range over which a measure is spread if nothing is known [its unit; natural logarithm for the three sizes]."""
LOGARITHMIC = frozenset({"length", "width", "height"})
"""Measures whose ratio counts, not their difference."""
LEAST_BLUR = {"levels": 0.5, "varied": 3.0, "bottom": 0.02, "gap": 0.02, "rise": 0.02, "rough": 0.02, "green": 0.01}
"""Least standard deviation of the measures that are not shares [their unit]."""

OUT_OF_PLACE = 0.02
"""Factor on the frequency of things of wet rooms in a dry room, and the other way round [-]."""


@dataclass(frozen=True, slots=True)
class UsualRange:
    """Usual range of one measure, with limits."""

    low: float
    high: float
    below: float
    """Standard deviation below the range."""
    above: float

    @classmethod
    def of(cls, name: str, numbers: list[float]) -> "UsualRange":
        """The range from limit, low, high, limit."""
        least, low, high, most = (math.log(n) for n in numbers) if name in LOGARITHMIC else numbers
        blur = LEAST_BLUR.get(name, BLUR)
        return cls(low, high, max(0.5 * (low - least), blur), max(0.5 * (most - high), blur))

    def log_density(self, value: float) -> float:
        """Logarithm of the density at a value."""
        away = max((self.low - value) / self.below, (value - self.high) / self.above, 0.0)
        whole = self.high - self.low + math.sqrt(0.5 * math.pi) * (self.below + self.above)
        return -0.5 * min(away, FARTHEST) ** 2 - math.log(whole)


@dataclass(frozen=True, slots=True)
class ShapePrior:
    """Usual shape of one label."""

    label: str
    """Label; several rows may have the same label."""
    room: str
    """wet or dry: such things stand in bathrooms, or outside; empty: anywhere."""
    held_by: tuple[str, ...]
    """floor, wall, ceiling, nothing, or labels."""
    common: float
    """Relative frequency of such things in a home."""
    traits: Mapping[str, UsualRange]

    def log_probability(self, held_by: str, measures: Mapping[str, float]) -> float:
        """Logarithm of the fit of the measures, up to a constant that is the same for all labels."""
        held = HELD / len(self.held_by) ** EVIDENCE if held_by in self.held_by else NOT_HELD
        fit = sum(
            usual.log_density(measures[name]) + math.log(EVEN[name])
            for name, usual in self.traits.items()
            if name in measures
        )
        return math.log(self.common) + math.log(held) + EVIDENCE * fit


@cache
def shapes() -> tuple[ShapePrior, ...]:
    """All rows."""
    return tuple(shape_row(row) for row in rows(SHAPES))


def shape_row(row: Mapping[str, str]) -> ShapePrior:
    """One row of shapes.csv, checked."""
    traits = {}
    for entry in row["traits"].split("|"):
        name, _, text = entry.partition("=")
        numbers = [float(number) for number in text.split()]
        if name not in EVEN or len(numbers) != 4 or numbers != sorted(numbers):
            raise InputError(f"{SHAPES}: {row['label']}: {entry!r} is not a measure with four rising numbers")
        traits[name] = UsualRange.of(name, numbers)
    return ShapePrior(row["label"], row["room"], tuple(row["held_by"].split("|")), float(row["common"]), traits)


def labels() -> tuple[str, ...]:
    """Labels that a thing may have."""
    return tuple(dict.fromkeys(shape.label for shape in shapes()))


def colour_measures(color: tuple[float, float, float]) -> dict[str, float]:
    """Lightness and greenness of an sRGB colour, 0..1."""
    red, green, blue = color
    return {"light": 0.2126 * red + 0.7152 * green + 0.0722 * blue, "green": green - 0.5 * (red + blue)}


def share_of(area: float | None, plan: float) -> float | None:
    """Share of the plan, both in m^2, covered by a level; None if unknown."""
    return None if area is None else min(area / plan, 1.0)


@dataclass(frozen=True, eq=False, slots=True)
class Evidence:
    """Evidence for the best label of each of n things."""

    label: tuple[str, ...]
    nats: Array
    """Logarithm of how much better the label fits than a thing of which nothing is known, shape (n,)."""


def evidence(
    measures: Sequence[Mapping[str, float]], holders: Sequence[str], room: str, excluded: Collection[str] = ()
) -> Evidence:
    """The best label of each thing in a wet or dry room.

    Args:
        measures: as `LabelRequest.measures` names them; what is missing is unknown.
        holders: floor, wall, ceiling, nothing, or empty for any thing.
        room: wet or dry.
        excluded: labels that are not meant.
    """
    if not measures:
        return Evidence((), np.zeros(0))
    rows = [one for one in shapes() if one.label not in excluded]
    names = list(EVEN)
    value = np.array([[one.get(name, np.nan) for name in names] for one in measures]).reshape(len(measures), len(names))
    held = np.array([[_holds(row, holder) for row in rows] for holder in sorted(set(holders))])
    rank = np.searchsorted(sorted(set(holders)), list(holders))
    score = np.array([math.log(row.common) + _context(row, room) for row in rows])
    total = score + EVIDENCE * np.stack([_fit(row, names, value) for row in rows], axis=1) + held[rank]
    best = np.argmax(total, axis=1)
    unknown = math.log(NOTHING_KNOWN * NOT_HELD)
    return Evidence(tuple(rows[i].label for i in best), total[np.arange(len(best)), best] - unknown)


def _context(row: ShapePrior, room: str) -> float:
    return math.log(OUT_OF_PLACE) if row.room not in ("", room) else 0.0


def _holds(row: ShapePrior, holder: str) -> float:
    """Logarithm of the probability of the actual holder; any thing will do if the usual holder is a thing."""
    usual = holder in row.held_by if holder else any(one not in ROOM for one in row.held_by)
    return math.log(HELD / len(row.held_by) ** EVIDENCE if usual else NOT_HELD)


def _fit(row: ShapePrior, names: Sequence[str], value: Array) -> Array:
    """Sum of the logarithms of density over uniform density, shape (n,)."""
    total = np.zeros(len(value))
    for name, usual in row.traits.items():
        x = value[:, names.index(name)]
        away = np.maximum(np.maximum((usual.low - x) / usual.below, (x - usual.high) / usual.above), 0.0)
        whole = usual.high - usual.low + math.sqrt(0.5 * math.pi) * (usual.below + usual.above)
        one = -0.5 * np.minimum(away, FARTHEST) ** 2 - math.log(whole) + math.log(EVEN[name])
        total += np.where(np.isnan(x), 0.0, one)
    return total
