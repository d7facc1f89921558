"""Ratings against closed forms, scipy's minimiser, and judges whose strengths are known."""

import numpy as np
import pytest
from scipy import stats
from scipy.optimize import minimize
from simulated_judge import row, simulated, table

from dcap.evaluation.statistics.comparisons import Comparison, PairCounts, Winner, pair_counts
from dcap.evaluation.statistics.method_tables import wilson_interval, win_rates
from dcap.evaluation.statistics.ratings import (
    POINTS,
    RIDGE,
    bradley_terry,
    elo_ratings,
    fit_strengths,
    fits,
    rating_difference_p,
)
from dcap.scene.errors import InputError

FEW = 50
"""Resamples where no interval is looked at."""


def bt_of(counts: PairCounts) -> dict[str, float]:
    return {one.method: one.rating for one in bradley_terry(counts, resamples=FEW)}


def test_two_methods_have_the_odds_of_their_wins():
    """Two methods: the difference is 400 log10(wins / losses), and their mean 1500."""
    first, second = bradley_terry(pair_counts(table([[0, 30], [10, 0]], "ab")), resamples=FEW)
    assert first.rating - second.rating == pytest.approx(400 * np.log10(3), abs=1e-6)
    assert first.rating + second.rating == pytest.approx(3000)
    assert not first.separable


def test_elo_counts_a_tie_for_both_and_holds_the_anchor():
    """20 wins, 5 losses, 10 ties: Elo's odds are 30 to 15, Bradley-Terry's 25 to 10."""
    rows = table([[0, 20], [5, 0]], "ab") + [row(f"t{k}", "b", "a", Winner.TIE) for k in range(10)]
    counts = pair_counts(rows)
    elo = {one.method: one for one in elo_ratings(counts, "b", resamples=FEW)}
    assert elo["b"].rating == 1000.0
    assert (elo["b"].interval.low, elo["b"].interval.high) == (1000.0, 1000.0)
    assert elo["a"].rating == pytest.approx(1000 + 400 * np.log10(30 / 15), abs=1e-6)
    assert bt_of(counts)["a"] - bt_of(counts)["b"] == pytest.approx(400 * np.log10(25 / 10), abs=1e-6)


def test_cyclic_wins_give_equal_ratings():
    """a beats b beats c beats a, equally often: nobody is stronger."""
    found = bt_of(pair_counts(table([[0, 7, 0], [0, 0, 7], [7, 0, 0]], "abc")))
    assert found == pytest.approx(dict.fromkeys("abc", 1500.0))


def test_the_gradient_of_the_fit_vanishes():
    """At the maximum expected wins equal won ones: sum_j n_ij p_ij = W_i."""
    wins = np.random.default_rng(3).integers(1, 40, (20, 6, 6)).astype(float) * (1 - np.eye(6))
    theta = fit_strengths(wins).theta
    chance = 1 / (1 + np.exp(theta[:, None, :] - theta[:, :, None]))
    expected = ((wins + wins.transpose(0, 2, 1)) * chance * (1 - np.eye(6))).sum(axis=2)
    np.testing.assert_allclose(expected, wins.sum(axis=2), atol=1e-8 * wins.sum(axis=(1, 2)).max())


@pytest.mark.parametrize("separable", [False, True])
def test_the_fit_is_scipys(separable: bool):
    """scipy's L-BFGS finds the same minimum of the same cost, with the ridge where somebody won everything."""
    wins = np.random.default_rng(5).integers(1, 30, (5, 5)).astype(float) * (1 - np.eye(5))
    if separable:
        wins[:, 0] = 0.0

    def cost(theta):
        penalty = 0.5 * RIDGE * (theta**2).sum() if separable else 0.5e-9 * theta.sum() ** 2
        return (wins * np.logaddexp(0, theta[None, :] - theta[:, None])).sum() + penalty

    found = minimize(cost, np.zeros(5), method="L-BFGS-B", options={"ftol": 1e-15, "gtol": 1e-9, "maxiter": 10_000}).x
    fit = fit_strengths(wins[None])
    assert bool(fit.separable[0]) is separable
    # numerical derivatives of L-BFGS: about the root of the machine's precision times the cost
    np.testing.assert_allclose(fit.theta[0], found - found.mean(), atol=2e-4)
    assert cost(fit.theta[0]) <= cost(found) + 1e-9


def test_who_wins_everything_is_rated_finitely_and_marked():
    """Ten wins of ten: the ridge's own equation -10 / (1 + exp(d)) + RIDGE d / 2 = 0 holds."""
    first, second = bradley_terry(pair_counts(table([[0, 10], [0, 0]], "ab")), resamples=FEW)
    gap = (first.rating - second.rating) / POINTS
    assert 10 / (1 + np.exp(gap)) == pytest.approx(RIDGE * gap / 2, rel=1e-6)
    assert first.separable


def test_methods_that_never_met_are_marked():
    """Two groups without a comparison between them: the ridge alone puts them side by side."""
    wins = [[0, 3, 0, 0], [3, 0, 0, 0], [0, 0, 0, 2], [0, 0, 2, 0]]
    found = bradley_terry(pair_counts(table(wins, "abcd")), resamples=FEW)
    assert all(one.separable for one in found)
    assert {one.method: one.rating for one in found} == pytest.approx(dict.fromkeys("abcd", 1500.0))


def test_sides_do_not_matter_to_a_rating():
    """Comparisons with their sides exchanged give the same ratings to the last bit."""
    rows = simulated({"a": 0.8, "b": 0.0, "c": -0.5}, 20, 2, np.random.default_rng(1))
    flipped = [row(one.sample, one.right_method, one.left_method, one.winner.flipped) for one in rows]
    assert elo_ratings(pair_counts(rows), "a", resamples=FEW) == elo_ratings(pair_counts(flipped), "a", resamples=FEW)


def test_the_order_of_comparisons_does_not_matter():
    """The same table in another order gives the same numbers, intervals included."""
    rows = simulated({"a": 0.8, "b": 0.0, "c": -0.5}, 20, 2, np.random.default_rng(1))
    assert bradley_terry(pair_counts(rows), resamples=200) == bradley_terry(pair_counts(rows[::-1]), resamples=200)


def test_strong_differences_are_significant_and_absent_ones_are_not():
    """Odds of 4 to 1 over 80 samples have p at its least; equal strengths do not fall below 1 %."""
    rows = simulated({"a": np.log(4), "b": 0.0, "c": 0.0}, 80, 2, np.random.default_rng(2))
    counts = pair_counts(rows)
    assert rating_difference_p(counts, "a", "b", resamples=1000) == pytest.approx(2 / 1001)
    assert rating_difference_p(counts, "b", "c", resamples=1000) > 0.01


def met_seldom(samples: int) -> list[Comparison]:
    """a and b are compared on thirty samples and win one each; c beats a on the first few, and nothing else."""
    rows = [row(f"s{k:02}", "a", "b", winner) for k in range(30) for winner in (Winner.LEFT, Winner.RIGHT)]
    return rows + [row(f"s{k:02}", "c", "a", Winner.LEFT) for k in range(samples)]


@pytest.mark.parametrize(("samples", "least"), [(1, 1.0), (2, 0.5), (7, 2.0**-6), (30, 2 / 1001)])
def test_two_methods_differ_by_what_both_were_compared_on(samples: int, least: float):
    """However many samples there are, p is at least 2^(1 - n) of the n on which both have comparisons."""
    assert rating_difference_p(pair_counts(met_seldom(samples)), "c", "a", resamples=1000) == pytest.approx(least)


def test_a_resample_without_a_method_says_nothing_of_it():
    """c is on one of thirty samples and is not drawn in (1 - 1/30)^30 of resamples: it has no rating there, and the
    others have the mean that they have with all samples. In all others c is above the mean, as it won, and above a."""
    counts, resamples = pair_counts(met_seldom(1)), 4000
    fit, resampled = fits(counts, counts.shared_wins, resamples, 0)
    without = np.isnan(resampled[:, 2])
    share = (29 / 30) ** 30
    assert without.mean() == pytest.approx(share, abs=4 * np.sqrt(share * (1 - share) / resamples))
    np.testing.assert_allclose(resampled[without, :2].mean(axis=1), fit.theta[0, :2].mean(), atol=1e-12)
    assert not np.isnan(resampled[:, :2]).any()
    assert bradley_terry(counts, resamples=400)[2].interval.low > 1500.0
    rated = {anchor: elo_ratings(counts, anchor, resamples=400) for anchor in "ac"}
    assert rated["a"][2].interval.low > 1000.0
    assert rated["c"][0].interval.high < 1000.0  # where the anchor is missing nobody is rated


def test_an_unknown_anchor_is_named():
    """One line with what there is."""
    with pytest.raises(InputError, match="anchor 'x' is not one of a, b"):
        elo_ratings(pair_counts(table([[0, 1], [1, 0]], "ab")), "x")


@pytest.mark.slow
@pytest.mark.parametrize(("samples", "judges"), [pytest.param(60, 500, marks=pytest.mark.long), (20, 150)])
def test_intervals_cover_known_strengths(samples: int, judges: int):
    """Of 95 % intervals about 95 % hold the truth, for ratings and win rates, and fewer with few samples.

    A percentile interval of a mean of n samples has the half width 1.96 sqrt((n - 1) / n) of its estimated errors: in
    94.3 % of cases Student's t with n - 1 degrees of freedom is within it for n = 60, in 92.9 % for n = 20. The numbers
    of one judge are dependent, so the Monte-Carlo error is taken for as many trials as judges, three times
    sqrt(p (1 - p) / judges); half a percent is for ratings and rates not being means.
    """
    strengths = {"a": 1.0, "b": 0.3, "c": -0.3, "d": -1.0}
    random = np.random.default_rng(11)
    truth = np.array(list(strengths.values()))
    chance = 1 / (1 + np.exp(truth[None, :] - truth[:, None]))
    true_rate = (chance.sum(axis=1) - 0.5) / 3
    held = {"rating": 0, "win rate": 0}
    for _ in range(judges):
        counts = pair_counts(simulated(strengths, samples, 1, random))
        for one, theta, rate, won in zip(
            bradley_terry(counts, 0.0, resamples=400), truth, true_rate, win_rates(counts, resamples=400), strict=True
        ):
            held["rating"] += one.interval.low <= POINTS * theta <= one.interval.high
            held["win rate"] += won.interval.low <= rate <= won.interval.high
    covered = {name: count / (judges * len(truth)) for name, count in held.items()}
    width = 1.96 * np.sqrt(1 - 1 / samples)
    by_samples = 1 - 2 * stats.t.sf(width, samples - 1)
    error = 3 * np.sqrt(by_samples * (1 - by_samples) / judges) + 0.005
    assert covered == pytest.approx(dict.fromkeys(covered, by_samples), abs=error)


@pytest.mark.slow
def test_only_resampled_samples_cover_where_samples_differ():
    """Where strengths differ from sample to sample (deviation 1.5) and each is asked six times, the cluster bootstrap
    still covers the mean win rate; Wilson's interval, which takes comparisons as independent, does not."""
    strengths, judges = {"a": 0.7, "b": 0.0, "c": -0.7}, 300
    random = np.random.default_rng(12)
    gap = np.array(list(strengths.values()))[:, None] - np.array(list(strengths.values()))[None, :]
    noise = np.random.default_rng(0).normal(0, 1.5 * np.sqrt(2), 400_000)
    chance = np.array([[(1 / (1 + np.exp(-(one + noise)))).mean() for one in line] for line in gap])
    true_rate = (chance.sum(axis=1) - 0.5) / 2
    bootstrap = wilson = 0
    for _ in range(judges):
        counts = pair_counts(simulated(strengths, 60, 6, random, sample_spread=1.5))
        for one, rate in zip(win_rates(counts, resamples=400), true_rate, strict=True):
            bootstrap += one.interval.low <= rate <= one.interval.high
            independent = wilson_interval(one.rate * one.comparisons, one.comparisons)
            wilson += independent.low <= rate <= independent.high
    # three times sqrt(0.95 * 0.05 / 300) = 3.8 %, and half a percent for 60 samples
    assert 0.95 - 0.038 - 0.005 <= bootstrap / (judges * 3) <= 0.95 + 0.038
    assert wilson / (judges * 3) < 0.85
