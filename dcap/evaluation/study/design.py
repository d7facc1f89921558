"""Designs a study: what can be compared, each rater's comparisons, their order, and the side of each placement.

In: the folder of a run and its rows. Out: for each (method, sample) the folder of the placement and its pictures, or
why it is not shown. People see the same placements as judges (dcap/evaluation/judging/judge.py). Nothing outside of
the run's folder is ever named.

Guaranteed, for any number of raters: a rater compares every pair of methods equally often, with each method equally
often (within one) on either side. About a fifth of a rater's comparisons are shared with the others of a group, to
measure how far raters agree; the rest are those shown least so far. A repeated comparison swaps its sides. Everything
follows from the seed, the rater's number and the comparisons of earlier raters. Attention checks, whose answer is
known, are mixed in.
"""

import json
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from itertools import combinations
from math import ceil
from pathlib import Path
from random import Random

from dcap.evaluation.judging.judge import Standing, standing_of
from dcap.evaluation.methods import DCAP, split_id
from dcap.evaluation.outcome_table import SampleOutcome
from dcap.evaluation.run_folder import placement_folder
from dcap.evaluation.statistics.comparisons import AXES, JudgedAxis
from dcap.scene.errors import InputError
from dcap.scene.types.pictures import BEFORE, PLACED

VIEWS = "views"
CLEAN, ASSET = BEFORE
"""Pictures of the scene before and of the asset alone, from the first method's folder."""
SCENE_GLB, OBJECT_GLB = "scene.glb", "object.glb"
PER_RATER = 40
"""Default number of comparisons per rater [-]."""
BETWEEN_CHECKS = 10
"""Comparisons per attention check [-]."""
SHARED = 0.2
"""Share of a rater's comparisons that the whole group gets [-]."""
GROUP = 4
"""Raters in a group [-]: one block for all would count twelve times in a study of twelve; one for two is lost if one
rater does not come."""


@dataclass(frozen=True, slots=True)
class ShownPlacement:
    """A placement that can be shown to people."""

    method: str
    sample: str
    folder: Path
    pictures: tuple[Path, ...]
    """Its views in the order in which judges see them."""
    verdict: str

    @property
    def scene_model(self) -> Path | None:
        """The scene with the object in it; None if it was not written."""
        path = self.folder / SCENE_GLB
        return path if path.is_file() else None


@dataclass(frozen=True, slots=True)
class StudyRun:
    """A run in the form for a study."""

    folder: Path
    methods: tuple[str, ...]
    prompts: Mapping[str, str]
    """The sentence of each sample, by its id, in the run's order."""
    shown: Mapping[tuple[str, str], ShownPlacement]
    """By (method, sample)."""
    left_out: Mapping[tuple[str, str], str]
    """Why a placement cannot be shown, by (method, sample)."""

    def clean_picture(self, sample: str) -> Path | None:
        """The scene before anything was placed."""
        return self._first_file(sample, f"{VIEWS}/{CLEAN}.png")

    def asset_picture(self, sample: str) -> Path | None:
        """The asset alone."""
        return self._first_file(sample, f"{VIEWS}/{ASSET}.png")

    def asset_model(self, sample: str) -> Path | None:
        """The asset alone, in three dimensions."""
        return self._first_file(sample, OBJECT_GLB)

    def _first_file(self, sample: str, name: str) -> Path | None:
        """A file for a sample, from the first method that has it."""
        paths = (placement_folder(self.folder, method, sample) / name for method in self.methods)
        return next((path for path in paths if path.is_file()), None)


def read_study_run(folder: Path, rows: Sequence[SampleOutcome]) -> StudyRun:
    """The comparable placements of a run; `rows` are its results. InputError for fewer than two methods, or without
    pictures."""
    methods, prompts = asked_of_folder(folder)
    if len(methods) < 2:
        named = f"only {methods[0]}" if methods else "none"
        raise InputError(f"{folder.name}: a study compares methods, and the run has {named}; benchmark --methods all")
    known = {(row.method, row.sample): row for row in rows}
    shown: dict[tuple[str, str], ShownPlacement] = {}
    left_out: dict[tuple[str, str], str] = {}
    for method in methods:
        for sample in prompts:
            found = show(folder, method, sample, known.get((method, sample)))
            if isinstance(found, str):
                left_out[method, sample] = found
            else:
                shown[method, sample] = found
    if not shown:
        where = placement_folder(folder, methods[0], next(iter(prompts), "SAMPLE")) / VIEWS
        raise InputError(
            f"{folder.name}: the run has no pictures of placements ({where}/*.png); run the benchmark again"
        )
    return StudyRun(folder, methods, prompts, shown, left_out)


def asked_of_folder(folder: Path) -> tuple[tuple[str, ...], dict[str, str]]:
    """Methods, and prompts by sample regardless of the method, from the run.json of a run."""
    path = folder / "run.json"
    try:
        tree = json.loads(path.read_text(encoding="utf-8"))
        samples = {split_id(str(one["id"]))[1]: str(one["prompt"]) for one in tree["samples"]}
        methods = tuple(dict.fromkeys(str(one) for one in tree.get("methods", [DCAP])))
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(f"{path}: not what a benchmark writes ({type(error).__name__}: {error})") from None
    for method in methods:
        if not method.replace("_", "").isalnum():
            raise InputError(f"{path}: {method!r} is not the name of a method")
    return methods, samples


def show(run: Path, method: str, sample: str, row: SampleOutcome | None) -> ShownPlacement | str:
    """A placement with its pictures; or why it is not shown."""
    if row is None:
        return "not in the results"
    if row.feasible_intended is False:
        return "meant to be impossible"
    if standing_of(row) is not Standing.JUDGED:
        return f"no placement: {row.reason or row.error or row.verdict}"
    folder = placement_folder(run, method, sample)
    pictures = views_of(folder / VIEWS)
    there = all(path.is_file() for path in pictures)
    return ShownPlacement(method, sample, folder, pictures, row.verdict) if there else "no pictures"


def views_of(folder: Path) -> tuple[Path, ...]:
    """The pictures of a placement in the order in which judges see them."""
    return tuple(folder / f"{name}.png" for name in PLACED)


class Side(StrEnum):
    """One of two placements side by side, a rater's choice. There is no tie."""

    LEFT = "left"
    RIGHT = "right"

    @property
    def other(self) -> "Side":
        """The other one."""
        return Side.RIGHT if self is Side.LEFT else Side.LEFT


def questions_of(asks_overall: bool) -> tuple[JudgedAxis, ...]:
    """Questions of each comparison."""
    return (*AXES, JudgedAxis.OVERALL) if asks_overall else AXES


@dataclass(frozen=True, slots=True)
class StudyItem:
    """One comparison of a rater."""

    item: str
    """Its name among the rater's comparisons, in order: 001, 002, ..."""
    sample: str
    left: str
    """Method of the placement on the left."""
    right: str
    lifted: Side | None = None
    """An attention check: both placements are the same, and the one on this side floats; None: a true comparison."""

    @property
    def expected(self) -> Side | None:
        """The known answer of an attention check to the question for physics."""
        return None if self.lifted is None else self.lifted.other


MethodPairs = Mapping[tuple[str, str], Sequence[str]]
"""Samples that both methods of a pair can show, by pair."""


def method_pairs(run: StudyRun) -> dict[tuple[str, str], tuple[str, ...]]:
    """The pairs of methods that can be compared, with the samples of each; InputError without any."""
    found = {}
    for one, two in combinations(run.methods, 2):
        both = [s for s in run.prompts if (one, s) in run.shown and (two, s) in run.shown]
        if both:
            found[one, two] = tuple(both)
    if not found:
        raise InputError(f"{run.folder.name}: no sample has a final state of two methods; nothing to compare")
    return found


def per_pair(pairs: MethodPairs, wanted: int | None) -> int:
    """Number of times a rater compares each pair of methods, for `wanted` comparisons in total, if there are as
    many."""
    most = min(len(samples) for samples in pairs.values())
    asked = PER_RATER if wanted is None else wanted
    if asked < len(pairs):
        if wanted is None:
            return 1
        raise InputError(
            f"--pairs {wanted}: there are {len(pairs)} pairs of methods, and each rater compares every one"
        )
    return min(most, asked // len(pairs))


@dataclass(slots=True)
class Showings:
    """Comparisons that raters were given so far."""

    seen: Counter[tuple[str, str, str]] = field(default_factory=Counter)
    """Number of times that a pair of methods was shown on a sample: (sample, one, two)."""
    lean: Counter[tuple[str, str, str]] = field(default_factory=Counter)
    """Number of times with `one` on the left minus on the right."""
    of_sample: Counter[str] = field(default_factory=Counter)
    """Number of times that a sample was shown."""

    def add(self, pairs: MethodPairs, items: Iterable[tuple[str, str, str]]) -> None:
        """Count comparisons (sample, left, right)."""
        for sample, left, right in items:
            known = (left, right) in pairs
            key = (sample, left, right) if known else (sample, right, left)
            self.seen[key] += 1
            self.lean[key] += 1 if known else -1
            self.of_sample[sample] += 1


def showings_of(pairs: MethodPairs, items: Iterable[StudyItem]) -> Showings:
    """Comparisons given to some raters, without attention checks."""
    found = Showings()
    found.add(pairs, ((one.sample, one.left, one.right) for one in items if one.lifted is None))
    return found


def shared_counts(pairs: int, count: int, group: int) -> list[int]:
    """Number of the `count` comparisons of each pair of methods that a group shares: SHARED of all, as evenly as
    possible; the pairs with one more change from group to group."""
    least, more = divmod(max(1, round(SHARED * pairs * count)), pairs)
    extra = {(group * more + k) % pairs for k in range(more)}
    return [least + (number in extra) for number in range(pairs)]


def comparisons(pairs: MethodPairs, count: int, rater: int, seed: int, before: Showings) -> list[tuple[str, str, str]]:
    """(sample, left, right) of the rater's comparisons, `count` of each pair of methods, one pair after the other."""
    group, found = rater // GROUP, list[tuple[str, str, str]]()
    earlier = [shared_counts(len(pairs), count, one) for one in range(group)]
    for number, (((one, two), samples), shares) in enumerate(
        zip(pairs.items(), shared_counts(len(pairs), count, group), strict=True)
    ):
        order = list(samples)
        Random(f"{seed} samples {one} {two}").shuffle(order)
        begin = sum(row[number] for row in earlier)  # blocks come from the front of the order, the rest from its back
        mine = [order[(begin + k) % len(order)] for k in range(shares)]
        place = {sample: k for k, sample in enumerate(reversed(order))}
        rest = sorted(
            (sample for sample in order if sample not in mine),
            key=lambda name: (before.seen[name, one, two], before.of_sample[name], place[name]),
        )
        mine += rest[: count - shares]
        first = count // 2 + (count % 2 and (rater + number) % 2)
        mine.sort(key=lambda name: before.lean[name, one, two])
        rows = [(name, one, two) if k < first else (name, two, one) for k, name in enumerate(mine)]
        before.add(pairs, rows)
        found += rows
    return found


def rater_items(
    pairs: MethodPairs, checks: Sequence[tuple[str, str]], count: int, rater: int, seed: int, before: Showings
) -> tuple[StudyItem, ...]:
    """A rater's comparisons, in order; `checks` are (method, sample) of the placements that have a floating copy.
    `before` counts the comparisons of earlier raters; these are added to it."""
    chance = Random(f"{seed} rater {rater}")
    rows: list[tuple[str, str, str, Side | None]] = [
        (*one, None) for one in comparisons(pairs, count, rater, seed, before)
    ]
    chance.shuffle(rows)
    wanted = ceil(len(rows) / BETWEEN_CHECKS) if checks else 0
    places = [len(rows) * (2 * n + 1) // (2 * wanted) for n in range(wanted)]
    for number in reversed(range(wanted)):
        method, sample = checks[(rater * wanted + number) % len(checks)]
        near = max(1, min(len(rows), places[number] + chance.randint(-2, 2)))
        rows.insert(near, (sample, method, method, (Side.LEFT, Side.RIGHT)[(rater + number) % 2]))
    return tuple(
        StudyItem(f"{number:03d}", sample, left, right, lifted)
        for number, (sample, left, right, lifted) in enumerate(rows, 1)
    )
