"""Compares the size and mass priors with published sizes.

In: a CSV file with the columns name, length_m, width_m, height_m, mass_kg, source, note; extents and mass may be empty,
extents in any order. Out: one row per thing with the ratios prior over published, and the share within a factor. A name
is read like the label of a file. A thing that the lexicon does not know counts as a miss.

Sizes are compared as in the rescale: the median (of logarithms) over the axes, sorted by length, of the shape that fits
best. Where only some extents are published, the largest of them is the thing's largest; of two the
other may be either of the thing's other axes, for a disc is published as diameter and height.
"""

import csv
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np

from dcap.language.offline.kinds import prior_of
from dcap.language.offline.lexicon import Size, thing_of
from dcap.scene.errors import InputError

COLUMNS = ("name", "length_m", "width_m", "height_m", "mass_kg", "source", "note")
EXTENTS = COLUMNS[1:4]
SIZE_FACTOR = 1.5
"""Factor within which a size prior is right [-]."""
MASS_FACTOR = 2.0
"""Factor within which a mass prior is right [-]."""


@dataclass(frozen=True, slots=True)
class Published:
    """Published size of one thing."""

    name: str
    extents: tuple[float, ...]
    """Extents that the source states, largest first [m]."""
    mass: float | None
    """[kg]."""
    source: str


@dataclass(frozen=True, slots=True)
class PriorScore:
    """Ratio of prior to published; None if nothing is published, infinite if the lexicon does not know the thing."""

    name: str
    thing: str
    """Thing id, empty if unknown."""
    size_ratio: float | None
    mass_ratio: float | None


def read_published(path: Path) -> tuple[Published, ...]:
    """Rows of a file of published sizes."""
    with path.open(newline="", encoding="utf-8") as text:
        reader = csv.DictReader(text)
        if tuple(reader.fieldnames or ()) != COLUMNS:
            raise InputError(f"{path}: columns are {reader.fieldnames}, expected {', '.join(COLUMNS)}")
        return tuple(published(row, f"{path}:{reader.line_num}") for row in reader)


def published(row: dict[str, str], where: str) -> Published:
    """One row; InputError for an invalid number."""
    try:
        extents = sorted((float(row[name]) for name in EXTENTS if row[name]), reverse=True)
        mass = float(row["mass_kg"]) if row["mass_kg"] else None
    except ValueError as error:
        raise InputError(f"{where}: {error}") from error
    if not all(0.0 < number < np.inf for number in (*extents, *([] if mass is None else [mass]))):
        raise InputError(f"{where}: extents {extents} and mass {mass} must be positive")
    return Published(row["name"], tuple(extents), mass, row["source"])


def prior_score(one: Published) -> PriorScore:
    """Error of the prior of the named thing."""
    thing = thing_of(one.name)
    if thing is None:
        return PriorScore(one.name, "", np.inf if one.extents else None, np.inf if one.mass is not None else None)
    prior = prior_of(None, one.name, thing.size)
    ratios = [size_ratio(size, one.extents) for size in prior.sizes] if one.extents else []
    best = min(ratios, key=lambda ratio: abs(np.log(ratio)), default=None)
    return PriorScore(one.name, prior.name, best, None if one.mass is None else prior.mass / one.mass)


def size_ratio(size: Size, extents: tuple[float, ...]) -> float:
    """Median ratio of a prior's extents to the published ones, both largest first [-]."""
    rest = combinations(size[1:], len(extents) - 1)
    logs = [np.log(np.array([size[0], *chosen]) / np.array(extents)) for chosen in rest]
    return float(np.exp(np.median(min(logs, key=lambda one: float(np.abs(one).sum())))))


def share_within(ratios: Iterable[float | None], factor: float) -> float:
    """Share of the ratios within a factor of 1; missing ones do not count; 1 for none."""
    known = [ratio for ratio in ratios if ratio is not None]
    return float(np.mean([1.0 / factor <= ratio <= factor for ratio in known])) if known else 1.0


def misses(scores: Iterable[PriorScore]) -> list[str]:
    """The things whose size or mass is wrong, in words."""
    return [
        f"{one.name} ({one.thing or 'unknown'}): {kind} {ratio:.2f}"
        for one in scores
        for kind, ratio, factor in (("size", one.size_ratio, SIZE_FACTOR), ("mass", one.mass_ratio, MASS_FACTOR))
        if ratio is not None and not 1.0 / factor <= ratio <= factor
    ]
