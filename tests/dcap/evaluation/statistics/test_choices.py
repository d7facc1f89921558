"""Tables of comparisons, win rates, agreement between raters, and preferences for a side."""

from itertools import combinations, product
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats
from simulated_judge import row, table

from dcap.evaluation.statistics.agreement import (
    SIDES,
    krippendorff_alpha,
    percent_agreement,
    ratings_of,
    side_report,
)
from dcap.evaluation.statistics.comparisons import (
    Comparison,
    JudgedAxis,
    Winner,
    on_axis,
    pair_counts,
    read_comparisons,
    write_comparisons,
)
from dcap.evaluation.statistics.method_tables import DAGGER, wilson_interval, win_rate_test, win_rates
from dcap.scene.errors import FormatError, InputError

OBSERVERS = ("123321412...", "1233224125.3", ".3332342251.", "12332441251.")
"""Four observers, twelve units, missing values, of Krippendorff 2011, section C; alpha is 0.743."""


def test_a_table_survives_its_file(tmp_path: Path):
    """What is written is read again, in its order."""
    rows = [
        Comparison("s/1", JudgedAxis.RIGHT_PLACE, "dcap", "holodeck", Winner.TIE, "m"),
        Comparison("s/1", JudgedAxis.OVERALL, "holodeck", "dcap", Winner.RIGHT, "m"),
    ]
    write_comparisons(tmp_path / "c.parquet", rows)
    assert read_comparisons(tmp_path / "c.parquet") == rows
    first = (tmp_path / "c.parquet").read_bytes()
    write_comparisons(tmp_path / "c.parquet", rows)
    assert (tmp_path / "c.parquet").read_bytes() == first
    assert [path.name for path in tmp_path.iterdir()] == ["c.parquet"]
    assert on_axis(rows, JudgedAxis.OVERALL) == rows[1:]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"winner": "middle"}, "row 0: winner 'middle' is not one of left, right, tie"),
        ({"axis": "beauty"}, "row 0: axis 'beauty' is not one of right_place"),
        ({"right_method": "a"}, "row 0: comparison of s: a is compared with itself"),
        ({"judge": None}, "no column 'judge'"),
    ],
)
def test_a_wrong_table_is_named(tmp_path: Path, change: dict[str, str | None], said: str):
    """File, row and value in one line."""
    values = {"sample": "s", "axis": "overall", "left_method": "a", "right_method": "b", "winner": "left", "judge": "j"}
    kept = {name: value for name, value in (values | change).items() if value is not None}
    pq.write_table(pa.Table.from_pylist([kept]), tmp_path / "c.parquet")
    with pytest.raises(FormatError, match=said):
        read_comparisons(tmp_path / "c.parquet")
    (tmp_path / "d.parquet").write_text("no")
    with pytest.raises(FormatError, match=r"d\.parquet: no table"):
        read_comparisons(tmp_path / "d.parquet")


def test_what_cannot_be_counted_is_refused():
    """Nothing, several axes, or a method that is not listed."""
    with pytest.raises(InputError, match="no comparisons"):
        pair_counts([])
    with pytest.raises(InputError, match="several axes"):
        pair_counts(
            [row("s", "a", "b", Winner.TIE), Comparison("s", JudgedAxis.RIGHT_PLACE, "a", "b", Winner.TIE, "j")]
        )
    with pytest.raises(InputError, match="method 'b', which is not one of a, c"):
        pair_counts([row("s", "a", "b", Winner.TIE)], ["a", "c"])


def test_win_rates_are_shares_with_half_ties():
    """Six wins, two ties, two losses: 70 %. The two rates add up to one."""
    rows = table([[0, 6], [2, 0]], "ab") + [row(f"t{k}", "a", "b", Winner.TIE) for k in range(2)]
    first, second = win_rates(pair_counts(rows), resamples=200)
    assert (first.rate, second.rate, first.comparisons) == (pytest.approx(0.7), pytest.approx(0.3), 10)
    assert first.interval.low < 0.7 < first.interval.high


@given(st.integers(1, 400), st.data())
def test_wilsons_interval_is_scipys(trials: int, data: st.DataObject):
    """The same score interval as scipy's, for all shares."""
    wins = data.draw(st.integers(0, trials))
    found, other = wilson_interval(wins, trials), stats.binomtest(wins, trials).proportion_ci(method="wilson")
    assert (found.low, found.high) == pytest.approx((other.low, other.high), abs=1e-12)


def test_a_win_rate_is_marked_where_it_is_significantly_higher():
    """40 to 10 against the best baseline over 50 samples is, 26 to 24 is not."""
    clear = win_rate_test(pair_counts(table([[0, 40], [10, 0]], ["dcap", "holodeck"])), "dcap", ["holodeck"])
    close = win_rate_test(pair_counts(table([[0, 26], [24, 0]], ["dcap", "holodeck"])), "dcap", ["holodeck"])
    assert clear is not None
    assert close is not None
    assert (clear.mark, close.mark) == (DAGGER, "")
    assert close.difference == pytest.approx(0.04)
    assert win_rate_test(pair_counts(table([[0, 4], [1, 0]], "ab")), "a", []) is None


def test_a_win_rate_is_tested_whichever_samples_are_drawn():
    """A method that was compared on one sample of thirty is missing from many a resample and is tested too."""
    rows = [Comparison(f"s{k:02}", JudgedAxis.OVERALL, "a", "b", Winner.LEFT, "j") for k in range(30)]
    rows.append(Comparison("s07", JudgedAxis.OVERALL, "c", "a", Winner.LEFT, "j"))
    for seed in range(8):
        found = win_rate_test(pair_counts(rows), "a", ["c"], resamples=50, seed=seed)
        assert found is not None
        assert found.difference == pytest.approx(30 / 31 - 1.0)


def test_agreement_of_a_textbook_example():
    """Krippendorff's four observers: 0.743."""
    units = [{f"o{k}": seen[u] for k, seen in enumerate(OBSERVERS) if seen[u] != "."} for u in range(12)]
    assert krippendorff_alpha(units) == pytest.approx(0.743, abs=5e-4)


def test_agreement_has_its_bounds():
    """All alike: 1. One category only: not defined for alpha; one rater only: not defined."""
    alike = [{"a": "x", "b": "x"}, {"a": "y", "b": "y"}]
    assert (percent_agreement(alike), krippendorff_alpha(alike)) == (1.0, 1.0)
    one = [{"a": "x", "b": "x"}]
    assert (percent_agreement(one), krippendorff_alpha(one)) == (1.0, None)
    alone = [{"a": "x"}, {"a": "y"}]
    assert (percent_agreement(alone), krippendorff_alpha(alone)) == (None, None)


def votes(names: str, right: float) -> list[Comparison]:
    """Four raters of 40 samples and all pairs of methods, from the best to the worst: each vote is right with that
    probability, the same votes for all names."""
    random = np.random.default_rng(4)
    return [
        row(f"s{k:02}", better, worse, Winner.LEFT if random.random() < right else Winner.RIGHT, f"r{rater}")
        for k in range(40)
        for better, worse in combinations(names, 2)
        for rater in range(4)
    ]


def test_agreement_does_not_depend_on_names():
    """Raters who are right with p = 0.93 differ in 2 p (1 - p) of pairs: alpha is 1 - 2 * 2 p (1 - p) = 0.740, whether
    the better method of a pair is the first in alphabetical order always, never, or now and then."""
    found = []
    for names in ("abcde", "edcba", "cadbe"):
        ratings = ratings_of(votes(names, 0.93))
        found.append((krippendorff_alpha(ratings, SIDES), percent_agreement(ratings)))
    assert found == [pytest.approx(found[0])] * 3
    # of an item 0 to 2/3 of the pairs of raters differ, 0.13 on average: its variance is at most 0.13 (2/3 - 0.13), and
    # alpha has twice the error of the mean over 400 items; four of it
    differ = 2 * 0.93 * 0.07
    assert found[0][0] == pytest.approx(1 - 2 * differ, abs=4 * 2 * np.sqrt(differ * (2 / 3 - differ) / 400))


def test_ties_are_one_category_whatever_methods_are_called():
    """Units TT, T1, 11, 22: 2 of 8 values differ from their unit's other; 3 are ties and 5 are none, so two are alike
    by chance in 5 * 4 / 2 + 3 * 2 = 16 of 8 * 7 cases. A unit turned round changes nothing; ties alone tell nothing."""
    for one, other in product(SIDES, repeat=2):
        units = [("tie", "tie"), ("tie", one), (one, one), (other, other)]
        found = krippendorff_alpha([{"a": a, "b": b} for a, b in units], SIDES)
        assert found == pytest.approx(1 - (2 / 8) / (1 - 16 / 56))
    assert krippendorff_alpha([{"a": "tie", "b": "tie"}], SIDES) is None


@pytest.mark.parametrize("items", [1, 2, 4])
def test_coins_agree_as_by_chance_however_few(items: int):
    """The mean of alpha over all that two coins for each item can show is 0 to the last digit."""
    pairs = list(product(SIDES, repeat=2))
    alphas = [krippendorff_alpha([{"a": a, "b": b} for a, b in shown], SIDES) for shown in product(pairs, repeat=items)]
    assert np.mean([one for one in alphas if one is not None]) == pytest.approx(0.0, abs=1e-9)
    assert None not in alphas


def test_percent_agreement_counts_pairs_of_raters():
    """Two of three agree: one pair of three."""
    assert percent_agreement([{"a": "x", "b": "x", "c": "y"}, {"a": "x"}]) == pytest.approx(1 / 3)


def test_raters_agree_on_methods_not_on_sides():
    """Two raters who saw the sides exchanged agree if they prefer the same method; one who contradicts himself ties."""
    rows = [
        row("s", "a", "b", Winner.LEFT, "r1"),
        row("s", "b", "a", Winner.RIGHT, "r2"),
        row("t", "a", "b", Winner.LEFT, "r1"),
        row("t", "b", "a", Winner.LEFT, "r1"),
    ]
    assert ratings_of(rows) == [{"r1": "first", "r2": "first"}, {"r1": "tie"}]


def test_a_preference_for_a_side_is_found():
    """20 of 24 decided for the left: p is the exact binomial's; ties count in the tie rate only."""
    rows = [row(f"s{k}", "a", "b", Winner.LEFT if k < 20 else Winner.RIGHT) for k in range(24)]
    rows += [row(f"t{k}", "a", "b", Winner.TIE) for k in range(6)]
    found = side_report(rows)
    assert (found.tie_rate, found.left_share) == (pytest.approx(0.2), pytest.approx(20 / 24))
    assert found.p == pytest.approx(2 * stats.binom.sf(19, 24, 0.5))
    assert found.interval is not None
    assert 0.5 < found.interval.low < 20 / 24 < found.interval.high


def test_contradictions_between_orders_are_counted():
    """The same method preferred from both sides is consistent; always the left side is not."""
    rows = [
        row("s", "a", "b", Winner.LEFT), row("s", "b", "a", Winner.RIGHT),
        row("t", "a", "b", Winner.LEFT), row("t", "b", "a", Winner.LEFT),
        row("u", "a", "b", Winner.LEFT),
    ]  # fmt: skip
    found = side_report(rows)
    assert (found.both_orders, found.consistent) == (2, 1)
    nothing = side_report([])
    assert (nothing.tie_rate, nothing.left_share, nothing.p, nothing.interval) == (0.0, None, None, None)
