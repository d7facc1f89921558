"""The metric rubric: turns the metrics of a placement into two scores from 1 to 10, by stated rules.

In: the metrics by name. Out: Right Place and Physics & Naturalness. Each metric has a scale of its own: piecewise
linear in the logarithm of the metric between anchors, flat beyond them, never rising where the metric gets worse. An
axis is half its worst metric and half the mean of its metrics: many small virtues cannot make up for one gross flaw,
and among equals the others decide. So both scores are monotone in every metric.

Metrics by our own solver or contact model (OWN) are in no score: a method that settles with them would be measured by
itself. The independent referee (`dcap/evaluation/referee`) measures rest.

A metric that is null (no requested direction, no referee available) does not count; a score without any metric is null.
docs/metrics.md gives reasons for the anchors.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from dcap.evaluation.outcome_table import SampleOutcome
from dcap.evaluation.statistics.comparisons import JudgedAxis
from dcap.scene.errors import InputError

RUBRIC = "metric rubric"
"""Name of this judge, which needs no model."""
Metrics = Mapping[str, float | bool | None]
"""Metrics by the names of SCALES; other names are ignored."""
BEST, WORST = 10.0, 1.0
WEIGHT_OF_WORST = 0.5
"""Share of the worst metric in the score of an axis; the mean has the rest."""
DIGITS = 3
"""Decimals of a score: differences in rounding between machines do not show."""


@dataclass(frozen=True, slots=True)
class MetricScale:
    """Scale from a number to a score."""

    anchors: tuple[tuple[float, float], ...]
    """(metric, score), metrics growing; the first must be positive."""

    def score(self, value: float) -> float:
        """The score of a metric that is not negative; infinity is the last anchor's."""
        (low, first), (high, last) = self.anchors[0], self.anchors[-1]
        if value <= low:
            return first
        if value >= high:
            return last
        for (a, from_score), (b, to_score) in zip(self.anchors, self.anchors[1:], strict=False):
            if value <= b:
                return from_score + (to_score - from_score) * math.log(value / a) / math.log(b / a)
        raise AssertionError("anchors grow")


@dataclass(frozen=True, slots=True)
class TruthScale:
    """Scale from yes or no to a score."""

    missed: float
    """Score of no; yes has the best score."""

    def score(self, value: float) -> float:
        """The score of 0 or 1."""
        return BEST if value else self.missed


RIGHT_PLACE: Mapping[str, MetricScale | TruthScale] = {
    "support_hit": TruthScale(WORST),
    "part_hit": TruthScale(4.0),
    "region_distance_m": MetricScale(((0.01, BEST), (0.1, 7.0), (0.5, 3.0), (2.0, WORST))),
    "orientation_error_deg": MetricScale(((5.0, BEST), (15.0, 8.0), (45.0, 4.0), (90.0, WORST))),
}
PHYSICS_NATURALNESS: Mapping[str, MetricScale | TruthScale] = {
    "penetration_m": MetricScale(((5e-5, BEST), (1e-3, 8.0), (1e-2, 4.0), (5e-2, WORST))),
    "gap_m": MetricScale(((2e-4, BEST), (2e-3, 8.0), (1e-2, 4.0), (5e-2, WORST))),
    "referee_drift_m": MetricScale(((5e-4, BEST), (5e-3, 7.0), (5e-2, 3.0), (0.3, WORST))),
    "referee_drift_deg": MetricScale(((0.5, BEST), (5.0, 7.0), (30.0, 3.0), (90.0, WORST))),
    "visible_fraction": MetricScale(((5e-3, WORST), (0.02, 2.0), (0.1, 5.0), (0.5, BEST))),
    "com_supported": TruthScale(3.0),
}
OWN = ("indentation_error_m", "force_residual", "drift_m", "drift_deg", "drift_s")
"""Columns of results.parquet made by our own solver or contact model: shown as "(ours)", and in no score."""
SCALES: Mapping[JudgedAxis, Mapping[str, MetricScale | TruthScale]] = {
    JudgedAxis.RIGHT_PLACE: RIGHT_PLACE,
    JudgedAxis.PHYSICS_NATURALNESS: PHYSICS_NATURALNESS,
}


def rubric_scores(metrics: Metrics) -> tuple[float | None, float | None]:
    """Right Place and Physics & Naturalness, 1..10, None if no metric of the axis is known; InputError if a metric
    is missing, negative, or no number."""
    place, physics = (axis_score(metrics, axis) for axis in (JudgedAxis.RIGHT_PLACE, JudgedAxis.PHYSICS_NATURALNESS))
    return place, physics


def axis_score(metrics: Metrics, axis: JudgedAxis) -> float | None:
    """The score of one axis."""
    scores = list(metric_scores(metrics, axis).values())
    if not scores:
        return None
    mean = math.fsum(scores) / len(scores)
    return round(WEIGHT_OF_WORST * min(scores) + (1.0 - WEIGHT_OF_WORST) * mean, DIGITS)


def metric_scores(metrics: Metrics, axis: JudgedAxis) -> dict[str, float]:
    """The score of each known metric of an axis, by name."""
    found = {}
    for name, scale in SCALES[axis].items():
        if name not in metrics:
            raise InputError(f"the metric {name!r} is not given; the rubric needs each of its metrics, null if unknown")
        value = metrics[name]
        if value is not None:
            found[name] = scale.score(checked(name, value, scale))
    return found


def checked(name: str, value: float | bool, scale: MetricScale | TruthScale) -> float:
    """A metric as a number; InputError if it is not a number."""
    if not isinstance(value, int | float) or math.isnan(value) or value < 0:
        raise InputError(f"the metric {name} is {value!r}, expected a number that is not negative, or null")
    if isinstance(scale, TruthScale) and value not in (0, 1):
        raise InputError(f"the metric {name} is {value!r}, expected true, false or null")
    return float(value)


def worst_metric(metrics: Metrics, axis: JudgedAxis) -> str:
    """The metric with the lowest score of an axis, in words; empty if none is known."""
    scores = metric_scores(metrics, axis)
    if not scores:
        return ""
    name = min(scores, key=lambda one: scores[one])
    value = metrics[name]
    said = str(value).lower() if isinstance(value, bool) else f"{value:.3g}"
    return f"{name} {said} ({scores[name]:.1f})"


def row_metrics(row: SampleOutcome) -> Metrics:
    """Metrics by the rubric's names. Whether the centre of mass is over its support is only a prediction: if the
    referee continued the simulation, its outcome counts instead."""
    found = {name: getattr(row, name) for axis in SCALES.values() for name in axis}
    return found if row.referee_drift_deg is None else found | {"com_supported": None}
