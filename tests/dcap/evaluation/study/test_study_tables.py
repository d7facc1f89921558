"""What votes say, by closed forms and by simulated raters of known strengths."""

import csv
import io
from itertools import combinations
from math import log

import numpy as np
import pytest

from dcap.evaluation.statistics.comparisons import AXES, JudgedAxis
from dcap.evaluation.statistics.method_tables import DAGGER, PreferenceRow
from dcap.evaluation.study.design import Showings, Side, rater_items
from dcap.evaluation.study.study_folder import StudyDesign, StudyVote
from dcap.evaluation.study.tables import RaterRow, csv_text, study_table, tex_text

STRENGTH = {"dcap": 2.0, "fireplace": 1.0, "layoutgpt": 0.5}
SAMPLES = 12


def votes_of(raters: int, lifted: Side | None = None) -> list[StudyVote]:
    """Votes of raters who prefer a method as often as its strength says [Bradley-Terry]."""
    chance = np.random.default_rng(7)
    names = tuple(f"s{n}" for n in range(SAMPLES))
    pairs = {("dcap", "fireplace"): names, ("dcap", "layoutgpt"): names, ("fireplace", "layoutgpt"): names}
    found, before = [], Showings()
    for rater in range(raters):
        for one in rater_items(pairs, (), SAMPLES, rater, 0, before):
            for axis in AXES:
                share = STRENGTH[one.left] / (STRENGTH[one.left] + STRENGTH[one.right])
                side = Side.LEFT if chance.random() < share else Side.RIGHT
                found.append(StudyVote(f"r{rater}", one.item, one.sample, axis, one.left, one.right, side, lifted, 1.0))
    return found


def given(*counts: tuple[str, str, str, int]) -> list[StudyVote]:
    """Votes on a sample: so often the first method was preferred to the second."""
    return [
        StudyVote("r0", f"{sample} {winner} {k}", sample, axis, winner, loser, Side.LEFT, None, 1.0)
        for sample, winner, loser, count in counts
        for k in range(count)
        for axis in AXES
    ]


def test_two_methods_have_the_rating_of_their_odds() -> None:
    """R_1 - R_2 = 400 log10(w_12 / w_21); their mean is 1500."""
    table = study_table(given(("s", "dcap", "fireplace", 30), ("s", "fireplace", "dcap", 10)), 0)
    first, second = (row.rating.rating for row in table.rows if row.rating)
    assert first + second == pytest.approx(3000.0)
    assert first - second == pytest.approx(400.0 * log(3.0) / log(10.0))


def test_a_method_that_always_wins_has_a_finite_rating() -> None:
    """And the table says that it is bounded by a rule, not by votes."""
    table = study_table(given(("s", "dcap", "fireplace", 5)), 0)
    first, second = (row.rating for row in table.rows)
    assert first is not None
    assert second is not None
    assert np.isfinite([first.rating, first.interval.low, first.interval.high]).all()
    assert first.rating > second.rating
    assert {row["bradley_terry_separable"] for row in csv.DictReader(io.StringIO(csv_text(table, [])))} == {"True"}


def test_ratings_are_those_of_the_raters() -> None:
    """Strengths 2 : 1 : 0.5 are 120 points apart (400 log10 2), and so are the ratings."""
    table = study_table(votes_of(40), 0)
    assert [row.method for row in table.rows] == ["dcap", "fireplace", "layoutgpt"]
    for row in table.rows:
        truth = 1500.0 + 400.0 * log(STRENGTH[row.method]) / log(10.0)
        # 480 votes of a pair at p = 2/3: the log-odds have sigma sqrt(1 / (480 p q)) = 0.097, 17 points; three of it
        assert row.rating is not None
        assert row.rating.rating == pytest.approx(truth, abs=51.0)
        assert row.rating.interval.low < row.rating.rating < row.rating.interval.high
    best = table.rows[0].rates[JudgedAxis.OVERALL].interval
    assert best.low < (2 / 3 + 0.8) / 2 < best.high  # of 2 against 1 and of 2 against 0.5
    assert table.rows[0].mark(JudgedAxis.OVERALL) == DAGGER
    assert not any(row.mark(axis) for row in table.rows[1:] for axis in AXES)


def test_win_rates_draw_whole_samples() -> None:
    """Votes on one sample are one draw, however many: the interval is Wilson's of one trial, z^2 = 3.8415; with two
    samples that contradict each other everything is possible."""
    one = study_table(given(("s", "dcap", "fireplace", 60), ("s", "fireplace", "dcap", 40)), 0)
    center, half = (0.6 + 1.92073) / 4.84146, np.sqrt(3.84146 * (0.24 + 0.960365)) / 4.84146
    assert rate_and_ends(one.rows[0]) == pytest.approx((0.6, center - half, center + half), abs=1e-5)
    two = study_table(given(("s", "dcap", "fireplace", 9), ("t", "fireplace", "dcap", 9)), 0)
    assert rate_and_ends(two.rows[0]) == pytest.approx((0.5, 0.0, 1.0))


def rate_and_ends(row: PreferenceRow) -> tuple[float, float, float]:
    """Win rate of the overall votes with its interval."""
    won = row.rates[JudgedAxis.OVERALL]
    return won.rate, won.interval.low, won.interval.high


def test_p_counts_the_draws_that_say_otherwise() -> None:
    """Of two samples for the first and one for the second, of 27 draws 7 (no more than one of the first) do not favour
    it: p is twice 7/27. Where every draw says the same, it is 2^(1 - n) of n samples, and the better one is marked
    where these are eight."""
    three = given(("s", "dcap", "fireplace", 9), ("t", "dcap", "fireplace", 9), ("u", "fireplace", "dcap", 9))
    p = study_table(three, 0).rows[0].p(JudgedAxis.OVERALL)
    assert p == pytest.approx(14 / 27, abs=0.03)  # 10,000 draws: sigma 2 * 0.0044
    for names, marks in (("stuvwxyz", [DAGGER, ""]), ("stu", ["", ""])):
        sure = study_table(given(*((name, "dcap", "fireplace", 9) for name in names)), 0)
        assert [row.p(JudgedAxis.OVERALL) for row in sure.rows] == pytest.approx([2 ** (1 - len(names))] * 2)
        assert [row.mark(JudgedAxis.OVERALL) for row in sure.rows] == marks


def test_a_baseline_is_marked_only_where_it_beats_ours() -> None:
    """One that beats another baseline, and loses to ours, is not; nor is ours where it beats its own variant alone."""
    rows = [(name, *pair, 9) for name in "stuvwxyz" for pair in (("dcap", "fireplace"), ("fireplace", "layoutgpt"))]
    marks = {row.method: row.mark(JudgedAxis.OVERALL) for row in study_table(given(*rows), 0).rows}
    assert marks == {"dcap": DAGGER, "fireplace": "", "layoutgpt": ""}
    rows = [(name, *pair, 9) for name in "stuvwxyz" for pair in (("dcap", "no_drop"), ("holodeck", "dcap"))]
    marks = {row.method: row.mark(JudgedAxis.OVERALL) for row in study_table(given(*rows), 0).rows}
    assert marks == {"dcap": "", "no_drop": "", "holodeck": DAGGER}


def test_raters_agree_by_krippendorff_s_alpha() -> None:
    """Units 11, 11, 00, 01: 2 of 8 values differ from their unit's other, by chance one half: 1 - (2 / 8) / (1 / 2)."""

    def said(*answers: str) -> float | None:
        votes = [
            StudyVote(f"r{rater}", f"{k}", f"s{k}", JudgedAxis.RIGHT_PLACE, "dcap", "fireplace", side, None, 1.0)
            for k, unit in enumerate(answers)
            for rater, one in enumerate(unit)
            for side in (Side.LEFT if one == "1" else Side.RIGHT,)
        ]
        return study_table(votes, 0).agreement[JudgedAxis.RIGHT_PLACE].alpha

    assert said("11", "11", "00", "01") == pytest.approx(0.5)
    assert said("11", "00") == 1.0
    assert said("11") == 1.0  # coins agree that way half of the time, whichever method it is
    assert said("1", "0") is None


def test_raters_who_toss_coins_do_not_agree() -> None:
    """Alpha is 0, also over three methods, of which each comparison shows two: 120 units of four raters."""
    chance, names = np.random.default_rng(3), ("dcap", "fireplace", "layoutgpt")
    votes = [
        StudyVote(
            f"r{rater}", f"{k}", f"s{k}", JudgedAxis.RIGHT_PLACE, names[k % 3], names[(k + 1) % 3], side, None, 1.0
        )
        for k in range(120)
        for rater in range(4)
        for side in (Side.LEFT if chance.random() < 0.5 else Side.RIGHT,)
    ]
    # six pairs of raters per unit: sigma of the observed share is 0.5 / sqrt(6 * 120), twice that of alpha; four of it
    assert study_table(votes, 0).agreement[JudgedAxis.RIGHT_PLACE].alpha == pytest.approx(0.0, abs=0.15)


def test_a_usual_study_tells_how_far_raters_agree() -> None:
    """57 samples, five methods, 40 comparisons each: raters who all judge by the sample agree wholly, and it is known
    for two raters as for twelve."""
    names = tuple(f"s{n}" for n in range(57))
    design = StudyDesign(0, 4, dict.fromkeys(combinations("abcde", 2), names), (), {}, {}).with_raters(12)
    votes = [
        StudyVote(rater, one.item, one.sample, axis, one.left, one.right, side, None, 1.0)
        for rater, items in design.raters.items()
        for one in items
        for side in (Side.LEFT if (one.left < one.right) == (int(one.sample[1:]) % 2 == 0) else Side.RIGHT,)
        for axis in AXES
    ]
    for raters, shared in ((2, 8), (12, 24)):
        table = study_table([vote for vote in votes if vote.rater <= f"r{raters:02d}"], 0)
        assert (table.raters, table.comparisons) == (raters, 40 * raters)
        for agreed in table.agreement.values():
            assert (agreed.alpha, agreed.share) == (1.0, 1.0)
            assert agreed.comparisons >= shared


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
    assert float(rows[0]["agreement_right_place"]) < 1.0
    assert 0.0 < float(rows[0]["percent_agreement_right_place"]) < 100.0
    assert rows[0]["shared_comparisons"] == "36"
    assert f"({rows[0]['percent_agreement_right_place']} % of pairs of raters)" in tex_text(table, raters)
    tex = tex_text(table, raters)
    assert tex.count("\\\\") == 1 + len(table.rows)
    assert "FirePlace*" in tex
    assert "Attention checks failed: 1 of 8" in tex
    assert csv_text(study_table(votes_of(3), 0), raters) == csv_text(table, raters)
    assert "LayoutGPT (offline rules)" in tex_text(study_table(votes_of(3), 0, offline=True), raters)
    assert "(offline rules)" not in tex


def test_a_method_that_placed_nothing_has_a_row() -> None:
    """The last, with how often it refused and nothing else; the note names those who refused."""
    refused = {"dcap": 0, "fireplace": 2, "holodeck": 3}
    table = study_table(given(("s", "dcap", "fireplace", 5)), 0, without_placement=refused)
    rows = list(csv.DictReader(io.StringIO(csv_text(table, []))))
    assert [(row["method"], row["without_placement"]) for row in rows] == [
        ("dcap", "0"), ("fireplace", "2"), ("holodeck", "3"),
    ]  # fmt: skip
    assert (rows[2]["comparisons"], rows[2]["overall_wins"], rows[2]["bradley_terry"]) == ("0", "", "")
    assert "Holodeck & -- & -- & -- & -- \\\\" in tex_text(table, [])
    assert "% No placement where one was intended: FirePlace* 2, Holodeck 3." in tex_text(table, [])


def test_ratings_of_resamples_without_a_method_do_not_break() -> None:
    """A draw may hold no comparison of some method: its rating is then that of nothing known."""
    table = study_table(
        given(("s", "dcap", "fireplace", 3), ("t", "fireplace", "layoutgpt", 2), ("t", "layoutgpt", "fireplace", 1)), 0
    )
    for row in table.rows:
        assert row.rating is not None
        assert np.isfinite([*rate_and_ends(row), row.rating.interval.low, row.rating.interval.high]).all()
