"""Differences between two runs: outcomes, poses, numbers, requests, settings and versions.

In: the facts of both. Out: a `RunDiff`. The same code, settings and inputs give the same bytes, so numbers are compared
exactly; times do not count as differences and are listed separately.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from math import inf, isfinite, isnan

import numpy as np
from numpy.typing import NDArray

Pose = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Position [m] and quaternion (w, x, y, z)."""


@dataclass(frozen=True, eq=False, slots=True)
class SampleFacts:
    """Facts of a sample in a run."""

    asked: Mapping[str, object]
    outcome: Mapping[str, object]
    """Verdict, reason, support and other words."""
    pose: Pose | None
    numbers: Mapping[str, float | None]
    times: Mapping[str, float]
    """[s]."""


@dataclass(frozen=True, eq=False, slots=True)
class RunFacts:
    """Facts of a run."""

    folder: str
    samples: Mapping[str, SampleFacts]
    config: Mapping[str, object]
    """Settings by dotted keys; empty if unknown."""
    versions: Mapping[str, object]


@dataclass(frozen=True, slots=True)
class KeyDifference:
    """A setting or version that differs."""

    key: str
    a: object
    b: object


@dataclass(frozen=True, slots=True)
class SampleDifference:
    """A word that differs for a sample."""

    sample: str
    key: str
    a: object
    b: object


@dataclass(frozen=True, slots=True)
class PoseDifference:
    """Poses at rest that differ."""

    sample: str
    position_m: float
    """Distance [m]."""
    angle_deg: float
    """Angle of the rotation between them."""


@dataclass(frozen=True, slots=True)
class NumberDifference:
    """A number that differs for a sample."""

    sample: str
    metric: str
    a: float | None
    b: float | None
    difference: float | None
    """Absolute difference; None if one of the two is missing or not finite."""
    relative: float | None
    """Difference over the larger of the two."""


@dataclass(frozen=True, slots=True)
class RunDiff:
    """Everything that differs between a run `a` and a run `b`."""

    a: str
    b: str
    only_a: tuple[str, ...]
    only_b: tuple[str, ...]
    """Samples that only one has."""
    outcomes: tuple[SampleDifference, ...]
    poses: tuple[PoseDifference, ...]
    metrics: tuple[NumberDifference, ...]
    """Numbers that only one run has first, then by relative change, the largest first."""
    asked: tuple[SampleDifference, ...]
    config: tuple[KeyDifference, ...]
    versions: tuple[KeyDifference, ...]
    times: tuple[NumberDifference, ...]
    """[s]; no difference between runs."""

    @property
    def equal(self) -> bool:
        """Whether nothing differs, apart from times."""
        return not any(getattr(self, one.name) for one in fields(self) if one.name not in ("a", "b", "times"))


def diff_runs(a: RunFacts, b: RunFacts) -> RunDiff:
    """Compare two runs, sample by sample."""
    both = [(name, a.samples[name], b.samples[name]) for name in a.samples if name in b.samples]
    return RunDiff(
        a=a.folder,
        b=b.folder,
        only_a=tuple(name for name in a.samples if name not in b.samples),
        only_b=tuple(name for name in b.samples if name not in a.samples),
        outcomes=tuple(one for name, x, y in both for one in words(name, x.outcome, y.outcome)),
        poses=tuple(one for name, x, y in both for one in poses(name, x.pose, y.pose)),
        metrics=sorted_numbers(one for name, x, y in both for one in numbers(name, x.numbers, y.numbers)),
        asked=tuple(one for name, x, y in both for one in words(name, x.asked, y.asked)),
        config=keys(a.config, b.config),
        versions=keys(a.versions, b.versions),
        times=sorted_numbers(one for name, x, y in both for one in numbers(name, x.times, y.times)),
    )


def keys(a: Mapping[str, object], b: Mapping[str, object]) -> tuple[KeyDifference, ...]:
    """Keys whose values differ; none if one side knows nothing at all."""
    names = dict.fromkeys([*a, *b]) if a and b else {}
    return tuple(KeyDifference(name, a.get(name), b.get(name)) for name in names if a.get(name) != b.get(name))


def words(sample: str, a: Mapping[str, object], b: Mapping[str, object]) -> Iterator[SampleDifference]:
    """Words that differ for a sample."""
    return (SampleDifference(sample, one.key, one.a, one.b) for one in keys(a, b))


def poses(sample: str, a: Pose | None, b: Pose | None) -> Iterator[PoseDifference]:
    """The difference of two poses, if any; a missing pose shows in the verdict instead."""
    if a is None or b is None:
        return
    distance, angle = float(np.linalg.norm(a[0] - b[0])), angle_between_deg(a[1], b[1])
    if distance > 0.0 or angle > 0.0:
        yield PoseDifference(sample, distance, angle)


def angle_between_deg(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    """Angle of the rotation between two unit quaternions, of which each and its negative are the same rotation."""
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    b = b if a @ b >= 0.0 else -b
    return float(np.degrees(4.0 * np.arcsin(min(1.0, 0.5 * float(np.linalg.norm(a - b))))))  # exact for small angles


def numbers(sample: str, a: Mapping[str, float | None], b: Mapping[str, float | None]) -> Iterator[NumberDifference]:
    """Numbers that differ for a sample."""
    for name in dict.fromkeys([*a, *b]):
        x, y = a.get(name), b.get(name)
        if x != y and not (x is not None and y is not None and isnan(x) and isnan(y)):
            yield NumberDifference(sample, name, x, y, *changes(x, y))


def changes(a: float | None, b: float | None) -> tuple[float | None, float | None]:
    """Absolute and relative change."""
    if a is None or b is None or not (isfinite(a) and isfinite(b)):
        return None, None
    return abs(b - a), abs(b - a) / max(abs(a), abs(b))


def sorted_numbers(found: Iterator[NumberDifference]) -> tuple[NumberDifference, ...]:
    """Largest relative change first."""
    return tuple(sorted(found, key=lambda one: -(inf if one.relative is None else one.relative)))
