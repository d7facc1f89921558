"""The bootstrap of means, differences and composites against scipy's, closed forms and known truths."""

import numpy as np
import pytest
from scipy import stats

from dcap.evaluation.statistics.bootstrap import (
    CHUNK,
    draws,
    interval_of,
    mean_interval,
    paired_difference,
    resampled_means,
    two_sided_p,
)
from dcap.evaluation.statistics.method_tables import DAGGER, composite, score_test, summary_of
from dcap.scene.errors import InputError

PUBLISHED = {"dcap": (8.61, 8.94, 8.77), "fireplace": (7.48, 6.27, 6.85), "layoutgpt": (6.91, 5.58, 6.21),
             "holodeck": (6.34, 5.01, 5.64)}  # fmt: skip
"""Means of the two axes and composite, as the published table 1 prints them."""


@pytest.mark.parametrize("method", PUBLISHED)
def test_the_composite_is_that_of_the_published_table(method: str):
    """The geometric mean of the printed means is the printed composite, as far as means of two digits tell."""
    place, physics, printed = PUBLISHED[method]
    # each mean is rounded by up to 0.005, the composite too
    assert composite([place, physics]) == pytest.approx(printed, abs=0.01)


def test_every_resample_draws_as_many_samples():
    """Weights of a resample add up to the number of samples, whatever chunks they come in."""
    chunks = list(draws(30_000, resamples=100))
    assert len(chunks) == -(-100 // (CHUNK // 30_000)) > 1
    assert sum(len(one) for one in chunks) == 100
    assert all((one.sum(axis=1) == 30_000).all() for one in chunks)


def test_resampled_means_spread_like_the_error_of_the_mean():
    """Their deviation is the plug-in error s / sqrt(n), with s the population form."""
    values = np.random.default_rng(1).normal(5, 2, 80)
    resampled = resampled_means(values[:, None])[:, 0]
    # the deviation of a deviation over B resamples is 1 / sqrt(2 B) of it: 0.7 %; four of them
    assert resampled.std() == pytest.approx(values.std() / np.sqrt(80), rel=0.03)
    assert resampled.mean() == pytest.approx(values.mean(), abs=4 * values.std() / np.sqrt(80 * 10_000))


def test_the_interval_is_scipys():
    """scipy.stats.bootstrap with its percentile method gives the same interval of a paired difference."""
    random = np.random.default_rng(2)
    ours, theirs = random.normal(8, 1, 60), random.normal(7, 1.5, 60)
    found = paired_difference(ours, theirs).interval
    other = stats.bootstrap(
        (ours, theirs), lambda a, b, axis: (a - b).mean(axis=axis), paired=True, n_resamples=10_000,
        method="percentile", rng=np.random.default_rng(3), vectorized=True,
    ).confidence_interval  # fmt: skip
    # a 2.5 % quantile of B values deviates by sqrt(p q / B) / density: 0.027 deviations; five of them, twice
    assert (found.low, found.high) == pytest.approx((other.low, other.high), abs=0.2 * (ours - theirs).std() / 60**0.5)


def test_the_p_value_is_that_of_a_t_test_where_that_holds():
    """For 200 normal differences the two-sided p is near the t test's."""
    values = np.random.default_rng(4).normal(0, 1, 200)
    ours = (values - values.mean()) / values.std(ddof=1) + 1.8 / np.sqrt(200)
    expected = stats.ttest_1samp(ours, 0).pvalue
    assert expected == pytest.approx(2 * stats.t.sf(1.8, 199))
    # Monte-Carlo: 3 sqrt(p / B) = 0.02; the bootstrap lacks the t correction and sees the sample's skewness
    assert paired_difference(ours, np.zeros(200)).p == pytest.approx(expected, abs=0.03)


def test_p_values_have_their_bounds():
    """Equal scores: 1. Always better: 2 / (B + 1), never 0."""
    assert two_sided_p(np.zeros(999), 20) == 1.0
    assert two_sided_p(np.ones(999), 20) == pytest.approx(2 / 1000)
    assert two_sided_p(-np.ones(999), 20) == pytest.approx(2 / 1000)
    assert [two_sided_p(np.ones(999), few) for few in (1, 2, 8)] == [1.0, 0.5, 2 / 256]  # all signs of n coins alike


def test_the_same_scores_give_the_same_numbers():
    """Seeds are fixed; swapping the methods mirrors the difference and keeps p."""
    random = np.random.default_rng(5)
    a, b = random.normal(6, 1, 40), random.normal(6.2, 1, 40)
    first, again, mirrored = paired_difference(a, b), paired_difference(a, b), paired_difference(b, a)
    assert first == again
    assert (mirrored.difference, mirrored.p) == (pytest.approx(-first.difference), first.p)
    assert mirrored.interval.low == pytest.approx(-first.interval.high)


def test_pairing_removes_what_samples_have_in_common():
    """Hard and easy samples do not widen the interval of a difference that is the same on all of them."""
    level = np.random.default_rng(6).uniform(2, 9, 50)
    found = paired_difference(level + 0.5, level)
    assert found.difference == pytest.approx(0.5)
    assert found.interval.high - found.interval.low == pytest.approx(0, abs=1e-9)


def test_missing_scores_are_left_out():
    """A sample counts where both methods have all their scores."""
    ours, theirs = np.array([8.0, np.nan, 7.0, 9.0]), np.array([7.0, 6.0, np.nan, 6.0])
    found = paired_difference(ours, theirs, resamples=100)
    assert (found.difference, found.samples) == (pytest.approx(2.0), 2)
    summary = summary_of(ours, resamples=100)
    assert (summary.mean, summary.samples) == (pytest.approx(8.0), 3)
    assert summary.spread == pytest.approx(1.0)
    with pytest.raises(InputError, match="no sample has a value of both"):
        paired_difference(np.array([1.0, np.nan]), np.array([np.nan, 1.0]))
    with pytest.raises(InputError, match="there are no scores"):
        summary_of(np.array([np.nan]))


def test_composites_are_compared_as_composites():
    """The difference of two columns is that of the geometric means of their means."""
    random = np.random.default_rng(7)
    ours, theirs = random.uniform(6, 10, (30, 2)), random.uniform(3, 8, (30, 2))
    expected = composite(list(ours.mean(axis=0))) - composite(list(theirs.mean(axis=0)))
    found = paired_difference(ours, theirs, resamples=500)
    assert found.difference == pytest.approx(expected)
    assert found.interval.low < expected < found.interval.high


def test_the_dagger_needs_the_best_baseline_beaten():
    """Marked where it is better than the best baseline with p < 0.01; not where it is worse, or by chance."""
    random = np.random.default_rng(8)
    scores = {"dcap": random.normal(8.6, 0.7, 40), "fireplace": random.normal(7.4, 0.9, 40),
              "holodeck": random.normal(6.3, 1.0, 40)}  # fmt: skip
    found = score_test(scores, "dcap", ["holodeck", "fireplace", "layoutgpt"])
    assert found is not None
    assert (found.rival, found.mark) == ("fireplace", DAGGER)
    worse = score_test(scores, "holodeck", ["fireplace"])
    assert worse is not None
    assert worse.p < 0.01
    assert worse.mark == ""
    equal = score_test(scores | {"twin": scores["dcap"]}, "dcap", ["twin"])
    assert equal is not None
    assert equal.mark == ""
    assert score_test(scores, "dcap", []) is None


@pytest.mark.parametrize("values", [[], [0.0, 1.0], [-1.0], [float("nan")]])
def test_a_composite_needs_positive_numbers(values: list[float]):
    """Said in one line."""
    with pytest.raises(InputError, match="positive"):
        composite(values)


@pytest.mark.slow
def test_intervals_of_differences_cover_the_truth():
    """95 % intervals of a paired difference over 80 skewed scores hold it in about 95 % of 500 repetitions, and
    p < 0.05 comes up in about 5 % where nothing differs."""
    random, repetitions, n = np.random.default_rng(9), 500, 80
    held = rejected = 0
    for _ in range(repetitions):
        ours, theirs = 10 - random.gamma(2, 0.5, n), 10 - random.gamma(2, 1.0, n)  # means 9 and 8
        found = paired_difference(ours, theirs, resamples=1000)
        held += found.interval.low <= 1.0 <= found.interval.high
        rejected += paired_difference(ours, 10 - random.gamma(2, 0.5, n), resamples=1000).p < 0.05
    # three times sqrt(0.95 * 0.05 / 500) = 2.9 %; a normal quantile of a plug-in deviation covers 0.6 % less at n = 80
    assert held / repetitions == pytest.approx(0.95, abs=0.029 + 0.006)
    assert rejected / repetitions == pytest.approx(0.05, abs=0.029 + 0.006)


def test_a_mean_without_spread_has_an_interval_without_width():
    """Equal values: both ends are the value."""
    found = mean_interval(np.full(9, 4.0), resamples=50)
    assert (found.low, found.high) == (pytest.approx(4.0), pytest.approx(4.0))
    assert interval_of(np.arange(101.0)).low == pytest.approx(2.5)
