"""What votes say, by closed forms and by simulated raters of known strengths."""

import csv
import io
from math import log

import numpy as np
import pytest

from dcap.evaluation.study.design import Side, StudyAxis, rater_items
from dcap.evaluation.study.journal import StudyVote
from dcap.evaluation.study.preferences import (
    PSEUDO,
    PreferenceCounts,
    bradley_terry_ratings,
    krippendorff_alpha,
    p_against_best,
    ratings,
    win_rates,
)
from dcap.evaluation.study.raters import RaterRow
from dcap.evaluation.study.tables import csv_text, shown_name, study_table, tex_text

STRENGTH = {"dcap": 2.0, "fireplace": 1.0, "layout_gpt": 0.5}
SAMPLES = 12


def votes_of(raters: int, lifted: Side | None = None) -> list[StudyVote]:
    """Votes of raters who prefer a method as often as its strength says [Bradley-Terry]."""
    chance = np.random.default_rng(7)
    names = tuple(f"s{n}" for n in range(SAMPLES))
    pairs = {("dcap", "fireplace"): names, ("dcap", "layout_gpt"): names, ("fireplace", "layout_gpt"): names}
    found = []
    for rater in range(raters):
        for one in rater_items(pairs, (), SAMPLES, rater, 0):
            for axis in StudyAxis:
                share = STRENGTH[one.left] / (STRENGTH[one.left] + STRENGTH[one.right])
                side = Side.LEFT if chance.random() < share else Side.RIGHT
                found.append(StudyVote(f"r{rater}", one.item, one.sample, axis, one.left, one.right, side, lifted, 1.0))
    return found


def test_two_methods_have_the_rating_of_their_odds() -> None:
    """R_1 - R_2 = 400 log10(w_12 / w_21), with the pseudo-wins on both sides; their mean is 1500."""
    value = ratings(np.array([[[0.0, 30.0], [10.0, 0.0]]]))[0]
    assert value.mean() == pytest.approx(1500.0)
    assert value[0] - value[1] == pytest.approx(400.0 * log((30 + PSEUDO) / (10 + PSEUDO)) / log(10.0))


def test_a_method_that_always_wins_has_a_finite_rating() -> None:
    value = ratings(np.array([[[0.0, 5.0], [0.0, 0.0]]]))[0]
    assert np.isfinite(value).all()
    assert value[0] > value[1]


def test_ratings_are_those_of_the_raters() -> None:
    """Strengths 2 : 1 : 0.5 are 120 points apart (400 log10 2), and so are the ratings."""
    table = study_table(votes_of(40), 0)
    assert [row.method for row in table.rows] == ["dcap", "fireplace", "layout_gpt"]
    for row in table.rows:
        truth = 1500.0 + 400.0 * log(STRENGTH[row.method]) / log(10.0)
        # 480 votes of a pair at p = 2/3: the log-odds have sigma sqrt(1 / (480 p q)) = 0.097, 17 points; three of it
        assert row.rating.value == pytest.approx(truth, abs=51.0)
        assert row.rating.low < row.rating.value < row.rating.high
    best = table.rows[0].wins[StudyAxis.OVERALL]
    assert best.low < (2 / 3 + 0.8) / 2 < best.high  # of 2 against 1 and of 2 against 0.5
    assert table.rows[0].marked(StudyAxis.OVERALL)
    assert not any(row.marked(axis) for row in table.rows[1:] for axis in StudyAxis)


def test_win_rates_draw_whole_samples() -> None:
    """Votes on one sample are one draw: with one sample there is no spread, however many votes; with two that
    contradict each other everything is possible."""
    one = PreferenceCounts(np.array([[[0.0, 60.0], [40.0, 0.0]]]))
    assert win_rates(one, 0)[0].all == pytest.approx((0.6, 0.6, 0.6))
    two = PreferenceCounts(np.array([[[0.0, 9.0], [0.0, 0.0]], [[0.0, 0.0], [9.0, 0.0]]]))
    assert win_rates(two, 0)[0].all == pytest.approx((0.5, 0.0, 1.0))


def test_p_counts_the_draws_that_say_otherwise() -> None:
    """Of two samples, one for each side, three of four draws do not favour the first: p is about 3/4."""
    two = PreferenceCounts(np.array([[[0.0, 9.0], [0.0, 0.0]], [[0.0, 0.0], [9.0, 0.0]]]))
    assert p_against_best(two, 0)[0] == pytest.approx(0.75, abs=0.02)  # 10,000 draws: sigma 0.0043
    sure = PreferenceCounts(np.array([[[0.0, 9.0], [0.0, 0.0]]] * 3))
    assert p_against_best(sure, 0) == pytest.approx([1 / 10_001, 1.0])


def test_krippendorff_alpha_of_a_worked_table() -> None:
    """Units 11, 11, 00, 01: n = 8, 5 ones, observed 2 ordered disagreements, 30 by chance: 1 - 7 * 2 / 30."""
    assert krippendorff_alpha([[True, True], [True, True], [False, False], [False, True]]) == pytest.approx(1 - 14 / 30)
    assert krippendorff_alpha([[True, True], [False, False]]) == 1.0
    assert krippendorff_alpha([[True], [False]]) is None
    assert krippendorff_alpha([[True, True]]) is None


def test_attention_checks_count_nowhere() -> None:
    true, checks = votes_of(2), votes_of(1, lifted=Side.LEFT)
    assert study_table([*true, *checks], 0) == study_table(true, 0)


def test_the_tables_hold_what_was_computed() -> None:
    """CSV: a row per method with rates, intervals, ratings and what is of the whole study; TeX: escaped names."""
    table = study_table(votes_of(3), 0)
    raters = [RaterRow("r0", 36, 36, 4, 1, True, 0.5, 3.0), RaterRow("r1", 36, 36, 4, 0, False, 0.5, 3.0)]
    rows = list(csv.DictReader(io.StringIO(csv_text(table, raters))))
    assert [row["method"] for row in rows] == [row.method for row in table.rows]
    assert rows[0]["name"] == "DCAP"
    assert float(rows[0]["overall_low"]) <= float(rows[0]["overall_wins"]) <= float(rows[0]["overall_high"])
    assert {row["attention_failures"] for row in rows} == {"1"}
    assert {row["attention_checks"] for row in rows} == {"8"}
    assert {row["raters_flagged"] for row in rows} == {"1"}
    assert {row["raters"] for row in rows} == {"3"}
    assert float(rows[0]["agreement_overall"]) < 1.0
    tex = tex_text(table, raters)
    assert tex.count("\\\\") == 1 + len(table.rows)
    assert "FirePlace*" in tex
    assert "Attention checks failed: 1 of 8" in tex
    assert csv_text(study_table(votes_of(3), 0), raters) == csv_text(table, raters)
    assert shown_name("rigid_drop") == "DCAP (rigid drop)"


def test_ratings_of_resamples_without_a_method_do_not_break() -> None:
    """A draw may hold no comparison of some method: its rating is then that of nothing known."""
    counts = np.zeros((2, 3, 3))
    counts[0, 0, 1], counts[1, 1, 2], counts[1, 2, 1] = 3, 2, 1
    assert all(np.isfinite(one.all).all() for one in bradley_terry_ratings(PreferenceCounts(counts), 0))
    assert all(np.isfinite(one.all).all() for one in win_rates(PreferenceCounts(counts), 0))
