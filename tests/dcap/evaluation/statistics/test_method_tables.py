"""Rows of the two tables from scores and comparisons of methods whose order is known."""

import numpy as np
import pytest
from simulated_judge import simulated

from dcap.evaluation.statistics.comparisons import Comparison, JudgedAxis, Winner
from dcap.evaluation.statistics.method_tables import DAGGER, ScoreRow, composite, preference_rows, score_rows
from dcap.scene.errors import InputError

METHODS = ("dcap", "fireplace", "layoutgpt")
BASELINES = METHODS[1:]
FEW = 500
COLUMNS = ("right_place", "physics_naturalness", "composite", "elo")


def marks(row: ScoreRow) -> dict[str, str]:
    """The marks of the columns."""
    return {name: row.mark(name) for name in COLUMNS}


def scores() -> dict[str, np.ndarray]:
    """dcap is better by more than a point on physics and by nothing on the place."""
    random = np.random.default_rng(1)
    place = random.normal(7, 0.8, 40)
    means = {"dcap": 9.0, "fireplace": 7.0, "layoutgpt": 5.0}
    return {
        name: np.stack([place + random.normal(0, 0.3, 40), random.normal(mean, 0.5, 40)], axis=1)
        for name, mean in means.items()
    }


def preferences() -> list[Comparison]:
    """dcap beats fireplace three to one, fireplace beats layoutgpt likewise."""
    strengths = {name: (2 - k) * np.log(3) for k, name in enumerate(METHODS)}
    return simulated(strengths, 60, 2, np.random.default_rng(2))


def test_a_row_has_means_composite_elo_and_its_marks():
    """Marked where it is better than the best baseline of the column, and there alone."""
    given = scores()
    rows = {row.method: row for row in score_rows(given, preferences(), BASELINES, resamples=FEW)}
    assert list(rows) == list(METHODS)
    dcap = rows["dcap"]
    assert dcap.composite == pytest.approx(composite(list(given["dcap"].mean(axis=0))))
    assert marks(dcap) == {"right_place": "", "physics_naturalness": DAGGER, "composite": DAGGER, "elo": DAGGER}
    assert set(marks(rows["layoutgpt"]).values()) == {""}
    assert rows["fireplace"].mark("elo") == DAGGER  # against the best of the other baselines
    elo = [row.elo.rating for row in rows.values() if row.elo]
    assert elo[-1] == 1000.0
    assert elo == sorted(elo, reverse=True)


def test_elo_is_not_marked_by_one_sample():
    """dcap meets the best baseline on one of 30 samples and wins it: p is 1, however sure the baselines' order is."""
    rows = simulated({"fireplace": np.log(3), "layoutgpt": 0.0}, 30, 2, np.random.default_rng(3))
    rows.append(Comparison("s0000", JudgedAxis.OVERALL, "dcap", "fireplace", Winner.LEFT, "simulated"))
    dcap = score_rows({name: value[:30] for name, value in scores().items()}, rows, BASELINES, resamples=FEW)[0]
    assert dcap.elo is not None
    assert (dcap.mark("elo"), dcap.p("elo")) == ("", 1.0)


def test_preferences_have_rates_a_rating_and_marks():
    """By axis, where there were comparisons; the rating is that of the overall ones."""
    rows = preference_rows(METHODS, preferences(), BASELINES, resamples=FEW)
    assert [row.method for row in rows] == list(METHODS)
    assert set(rows[0].rates) == {JudgedAxis.OVERALL}
    assert rows[0].mark(JudgedAxis.OVERALL) == DAGGER
    assert rows[2].mark(JudgedAxis.OVERALL) == ""
    assert all(row.rating for row in rows)
    assert sum(row.rates[JudgedAxis.OVERALL].rate for row in rows) == pytest.approx(1.5)


def test_scores_without_comparisons_have_no_elo():
    """And one method alone has no mark."""
    (row,) = score_rows({"dcap": scores()["dcap"]}, [], BASELINES, resamples=FEW)
    assert (row.elo, set(marks(row).values())) == (None, {""})
    assert preference_rows(METHODS, [], BASELINES) == []


def test_an_axis_without_scores_is_none():
    """The other keeps its mean and its mark, and there is no composite; nothing is tested where no sample is shared."""
    given = {name: value.copy() for name, value in scores().items()}
    for value in given.values():
        value[:, 0] = np.nan
    dcap = score_rows(given, preferences(), BASELINES, resamples=FEW)[0]
    assert (set(dcap.scores), dcap.composite, dcap.samples) == ({"physics_naturalness"}, None, 40)
    assert marks(dcap) == {"right_place": "", "physics_naturalness": DAGGER, "composite": "", "elo": DAGGER}
    assert set(dcap.tests) == {"physics_naturalness", "elo"}
    given["dcap"][20:] = np.nan
    for name in BASELINES:
        given[name][:20] = np.nan
    assert set(score_rows(given, [], BASELINES, resamples=FEW)[0].tests) == set()


def test_scores_of_other_samples_are_refused():
    """Rows must be the same samples."""
    given = scores()
    with pytest.raises(InputError, match="the same order of samples"):
        score_rows(given | {"holodeck": given["dcap"][:5]}, [], BASELINES)
