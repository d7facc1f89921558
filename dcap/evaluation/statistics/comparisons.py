"""One comparison of two methods on one sample, by a model, by the metric rubric or by a person, and its table.

In: comparisons. Out: counts by sample, from which ratings and win rates are computed, and a Parquet file.
A sample is a scene with a prompt: all its comparisons show the same room, so they are one cluster for every interval.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from enum import StrEnum
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from dcap.scene.errors import FormatError, InputError
from dcap.scene.written_files import whole_file


class JudgedAxis(StrEnum):
    """Axes of a comparison."""

    RIGHT_PLACE = "right_place"
    PHYSICS_NATURALNESS = "physics_naturalness"
    OVERALL = "overall"


AXES = (JudgedAxis.RIGHT_PLACE, JudgedAxis.PHYSICS_NATURALNESS)
"""The two axes that make up the paper's overall."""


class Winner(StrEnum):
    """Winner of a comparison."""

    LEFT = "left"
    RIGHT = "right"
    TIE = "tie"

    @property
    def flipped(self) -> "Winner":
        """The same outcome with the sides exchanged."""
        return {Winner.LEFT: Winner.RIGHT, Winner.RIGHT: Winner.LEFT, Winner.TIE: Winner.TIE}[self]


@dataclass(frozen=True, slots=True, order=True)
class Comparison:
    """One judgement of two methods side by side."""

    sample: str
    """Id of the sample."""
    axis: JudgedAxis
    left_method: str
    right_method: str
    winner: Winner
    judge: str
    """The judge: a model, `metric rubric`, or the token of a person."""

    def __post_init__(self) -> None:
        if self.left_method == self.right_method:
            raise InputError(f"comparison of {self.sample}: {self.left_method} is compared with itself")

    @property
    def winning_method(self) -> str:
        """The method that won; empty for a tie."""
        return {Winner.LEFT: self.left_method, Winner.RIGHT: self.right_method, Winner.TIE: ""}[self.winner]

    @property
    def pair(self) -> tuple[str, str]:
        """The two methods in alphabetical order."""
        first, second = sorted((self.left_method, self.right_method))
        return first, second


COLUMNS = tuple(field.name for field in fields(Comparison))
SCHEMA = pa.schema([(name, pa.string()) for name in COLUMNS])


def write_comparisons(path: Path, comparisons: Iterable[Comparison]) -> None:
    """The table as Parquet, rows in their order."""
    rows = [{name: str(getattr(one, name)) for name in COLUMNS} for one in comparisons]
    with whole_file(path) as draft:
        pq.write_table(pa.Table.from_pylist(rows, schema=SCHEMA), draft)


def read_comparisons(path: Path) -> list[Comparison]:
    """The table from Parquet; FormatError, with the row, if it is invalid."""
    try:
        table = pq.read_table(path)
    except (OSError, pa.ArrowInvalid) as error:
        raise FormatError(f"{path}: no table of comparisons ({type(error).__name__})") from None
    missing = [name for name in COLUMNS if name not in table.column_names]
    if missing:
        raise FormatError(f"{path}: no column {missing[0]!r}; a table of comparisons has {', '.join(COLUMNS)}")
    return [comparison_of(row, f"{path}: row {k}") for k, row in enumerate(table.select(COLUMNS).to_pylist())]


def comparison_of(row: dict[str, str | None], where: str) -> Comparison:
    """One row; FormatError if a value is not allowed in its column."""
    for name, known in (("axis", JudgedAxis), ("winner", Winner)):
        if row[name] not in list(known):
            raise FormatError(f"{where}: {name} {row[name]!r} is not one of {', '.join(known)}")
    words = {name: row[name] or "" for name in COLUMNS}
    try:
        return Comparison(
            words["sample"],
            JudgedAxis(words["axis"]),
            words["left_method"],
            words["right_method"],
            Winner(words["winner"]),
            words["judge"],
        )
    except InputError as error:
        raise FormatError(f"{where}: {error}") from None


def methods_of(comparisons: Iterable[Comparison]) -> tuple[str, ...]:
    """All methods that are compared, in alphabetical order."""
    return tuple(sorted({name for one in comparisons for name in one.pair}))


def on_axis(comparisons: Iterable[Comparison], axis: JudgedAxis) -> list[Comparison]:
    """Comparisons of one axis."""
    return [one for one in comparisons if one.axis is axis]


@dataclass(frozen=True, eq=False, slots=True)
class PairCounts:
    """Wins and ties by sample, from which ratings and win rates are computed."""

    methods: tuple[str, ...]
    samples: tuple[str, ...]
    """In alphabetical order."""
    wins: NDArray[np.float64]
    """wins[k, i, j]: how often method i was preferred to method j on sample k, shape (k, m, m)."""
    ties: NDArray[np.float64]
    """ties[k, i, j] = ties[k, j, i]: how often neither was, shape (k, m, m)."""

    @property
    def shared_wins(self) -> NDArray[np.float64]:
        """Wins with half of each tie, shape (k, m, m)."""
        return self.wins + 0.5 * self.ties

    @property
    def won(self) -> NDArray[np.float64]:
        """How often each method won on each sample, with half of each tie, shape (k, m)."""
        return np.asarray(self.shared_wins.sum(axis=2))

    @property
    def met(self) -> NDArray[np.float64]:
        """How often each method was compared on each sample, shape (k, m)."""
        return np.asarray(self.shared_wins.sum(axis=2) + self.shared_wins.sum(axis=1))

    def samples_of_both(self, first: int, second: int) -> int:
        """Number of samples on which two methods, by their columns, were both compared."""
        met = self.met > 0
        return int((met[:, first] & met[:, second]).sum())


def pair_counts(comparisons: Sequence[Comparison], methods: Sequence[str] = ()) -> PairCounts:
    """Counts of comparisons of one axis; `methods` gives the order, alphabetical by default."""
    if len({one.axis for one in comparisons}) > 1:
        raise InputError("comparisons of several axes cannot be counted together; choose one axis")
    if not comparisons:
        raise InputError("there are no comparisons: nothing can be rated")
    names = tuple(methods) or methods_of(comparisons)
    samples = tuple(sorted({one.sample for one in comparisons}))
    row, column = {name: k for k, name in enumerate(samples)}, {name: k for k, name in enumerate(names)}
    unknown = sorted(set(methods_of(comparisons)) - set(names))
    if unknown:
        raise InputError(f"comparisons name the method {unknown[0]!r}, which is not one of {', '.join(names)}")
    wins = np.zeros((len(samples), len(names), len(names)))
    ties = np.zeros_like(wins)
    for one in comparisons:
        k, i, j = row[one.sample], column[one.left_method], column[one.right_method]
        if one.winner is Winner.TIE:
            ties[k, i, j] += 1
            ties[k, j, i] += 1
        else:
            i, j = (i, j) if one.winner is Winner.LEFT else (j, i)
            wins[k, i, j] += 1
    return PairCounts(names, samples, wins, ties)
