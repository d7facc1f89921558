"""The metric rubric: monotone in every metric, and as its anchors say."""

import math
import re
from dataclasses import fields
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from judged import GOOD

from dcap.evaluation.judging.rubric import (
    BEST,
    OWN,
    SCALES,
    WORST,
    MetricScale,
    TruthScale,
    axis_score,
    metric_scores,
    rubric_scores,
    worst_metric,
)
from dcap.evaluation.outcome_table import SampleOutcome
from dcap.evaluation.statistics.comparisons import JudgedAxis
from dcap.scene.errors import InputError
from dcap.scene.settings import PROJECT_ROOT

PLACE, PHYSICS = JudgedAxis.RIGHT_PLACE, JudgedAxis.PHYSICS_NATURALNESS
BY_NAME = {name: scale for scales in SCALES.values() for name, scale in scales.items()}
GROWING = {"visible_fraction", "support_hit", "part_hit", "com_supported"}
"""Metrics of which more is better."""
NUMBERS = sorted(name for name, scale in BY_NAME.items() if isinstance(scale, MetricScale))
TRUTHS = sorted(name for name, scale in BY_NAME.items() if isinstance(scale, TruthScale))
positive = st.floats(0, 1e3, allow_nan=False) | st.floats(1e-10, 1).map(lambda x: x**3) | st.just(math.inf)
METRICS = st.fixed_dictionaries(
    {name: st.none() | positive for name in NUMBERS} | {name: st.none() | st.booleans() for name in TRUTHS}
)


@given(METRICS, st.sampled_from(NUMBERS), positive, positive)
def test_a_worse_number_never_scores_higher(metrics, name, first, second):
    """Both axes, whatever the other metrics are."""
    good, bad = sorted((first, second), reverse=name in GROWING)
    better, worse = rubric_scores(metrics | {name: good}), rubric_scores(metrics | {name: bad})
    assert all(a is None or b is None or a >= b for a, b in zip(better, worse, strict=True))


@given(METRICS, st.sampled_from(TRUTHS))
def test_a_miss_never_scores_higher(metrics, name):
    """True is never worse than false."""
    hit, miss = rubric_scores(metrics | {name: True}), rubric_scores(metrics | {name: False})
    assert all(a is None or b is None or a >= b for a, b in zip(hit, miss, strict=True))


@given(METRICS)
def test_scores_stay_between_their_bounds(metrics):
    """1 to 10, or none where nothing of the axis is known."""
    for axis, score in zip((PLACE, PHYSICS), rubric_scores(metrics), strict=True):
        known = any(metrics[name] is not None for name in SCALES[axis])
        assert (score is not None) is known
        assert score is None or WORST <= score <= BEST


@given(METRICS, st.sampled_from(sorted(BY_NAME)))
def test_a_null_is_left_out(metrics, name):
    """A null score neither lifts nor lowers the other metrics: the axis is that of the rest alone."""
    axis = PLACE if name in SCALES[PLACE] else PHYSICS
    others = metric_scores(metrics | {name: None}, axis)
    rest = list(others.values())
    expected = None if not rest else 0.5 * min(rest) + 0.5 * sum(rest) / len(rest)
    assert name not in others
    assert axis_score(metrics | {name: None}, axis) == (None if expected is None else pytest.approx(expected, abs=6e-4))


@pytest.mark.parametrize("name", NUMBERS)
def test_a_scale_passes_through_its_anchors(name: str):
    """At each anchor its score; half way in the logarithm half way in the score; anchors grow, ends span 1 to 10."""
    scale = BY_NAME[name]
    assert isinstance(scale, MetricScale)
    for (a, first), (b, second) in pairwise(scale.anchors):
        assert 0 < a < b
        assert scale.score(a) == pytest.approx(first)
        assert scale.score(math.sqrt(a * b)) == pytest.approx(0.5 * (first + second))
        assert (second > first) is (name in GROWING)
    assert {scale.anchors[0][1], scale.anchors[-1][1]} == {BEST, WORST}
    assert (scale.score(0.0), scale.score(math.inf)) == (scale.anchors[0][1], scale.anchors[-1][1])


def test_what_the_anchors_stand_for():
    """A twentieth of a millimetre cannot be seen, a centimetre inside is clearly wrong, five are impossible."""
    scale = BY_NAME["penetration_m"]
    assert [scale.score(d) for d in (5e-5, 1e-2, 5e-2)] == [10.0, 4.0, 1.0]
    assert rubric_scores(GOOD) == (10.0, 10.0)


def floating(height: float) -> float:
    """Physics of a rigid thing that floats: it falls and lies."""
    metrics = {**GOOD, "gap_m": height, "referee_drift_m": height, "referee_drift_deg": 0.0}
    return axis_score(metrics, PHYSICS) or 0.0


def sunk(depth: float) -> float:
    """Physics of one that is as deep inside, and comes out."""
    metrics = {**GOOD, "penetration_m": depth, "gap_m": 0.0, "referee_drift_m": depth}
    return axis_score(metrics, PHYSICS) or 0.0


def test_no_cliff_between_above_and_inside():
    """As far above as inside is about as wrong, and a tenth more of it never changes the score by much."""
    for distance in np.geomspace(3e-4, 0.05, 40):
        assert abs(floating(distance) - sunk(distance)) < 1.6
        assert 0.0 <= floating(distance) - floating(1.1 * distance) < 0.5


def test_what_we_made_ourselves_is_in_no_score():
    """Neither is named by a scale, nor does it change a score, however bad it is; each is a column."""
    assert not set(OWN) & set(BY_NAME)
    assert set(OWN) <= {one.name for one in fields(SampleOutcome)}
    assert rubric_scores({**GOOD, **dict.fromkeys(OWN, 1e3)}) == rubric_scores(GOOD)


def test_an_axis_is_half_its_worst_and_half_its_mean():
    """Five centimetres inside, all else perfect: 0.5 * 1 + 0.5 * (5 * 10 + 1) / 6."""
    assert axis_score({**GOOD, "penetration_m": 0.05}, PHYSICS) == pytest.approx(0.5 + 0.5 * 51 / 6, abs=5e-4)
    assert worst_metric({**GOOD, "penetration_m": 0.05}, PHYSICS) == "penetration_m 0.05 (1.0)"
    assert worst_metric({**GOOD, "part_hit": False}, PLACE) == "part_hit false (4.0)"


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("gap_m", -0.1, "gap_m is -0.1, expected a number that is not negative"),
        ("gap_m", math.nan, "gap_m is nan"),
        ("referee_drift_m", "0.1", "referee_drift_m is '0.1'"),
        ("support_hit", 0.5, "support_hit is 0.5, expected true, false or null"),
    ],
)
def test_what_is_no_metric_is_refused(name: str, value, said: str):
    """The name and the value in one line."""
    with pytest.raises(InputError, match=said):
        rubric_scores({**GOOD, name: value})


def test_a_metric_that_is_not_named_is_refused():
    """A misspelt name does not pass for a null."""
    with pytest.raises(InputError, match="'gap_m' is not given"):
        rubric_scores({name: value for name, value in GOOD.items() if name != "gap_m"})


@pytest.mark.parametrize(("heading", "axis"), [("Right Place", PLACE), ("Physics and Naturalness", PHYSICS)])
def test_the_anchors_are_those_of_the_documents(heading: str, axis: JudgedAxis):
    """docs/metrics.md has each metric of the axis with its anchors, and no other."""
    text = (
        (PROJECT_ROOT / "docs" / "metrics.md").read_text().partition(f"### {heading} by metrics\n")[2].split("\n#")[0]
    )
    rows = dict(re.findall(r"^\| `(\w+)` \| ([^|]+) \|", text, re.MULTILINE))
    assert rows == {name: in_words(scale) for name, scale in SCALES[axis].items()}


def in_words(scale: MetricScale | TruthScale) -> str:
    if isinstance(scale, TruthScale):
        return f"no {scale.missed:g}"
    return ", ".join(f"{value:g} {score:g}" for value, score in scale.anchors)
