"""Two runs differ where their outcomes, poses, numbers, settings or versions do; times are no difference."""

import math
from collections.abc import Mapping

import numpy as np
import pytest

from flows.diff import Pose, RunFacts, SampleFacts, angle_between_deg, diff_runs


def pose(x: float = 0.0, turn_deg: float = 0.0, sign: float = 1.0) -> Pose:
    """At x [m], turned about the vertical."""
    half = math.radians(turn_deg) / 2.0
    return np.array([x, 0.0, 0.0]), sign * np.array([math.cos(half), 0.0, 0.0, math.sin(half)])


def sample(
    verdict: str = "at_rest",
    at: Pose | None = None,
    numbers: Mapping[str, float | None] | None = None,
    took: float = 1.0,
) -> SampleFacts:
    """A sample of a run."""
    return SampleFacts({"prompt": "put it"}, {"verdict": verdict}, at or pose(), numbers or {}, {"drop": took})


def run(config: Mapping[str, object] | None = None, /, **samples: SampleFacts) -> RunFacts:
    """A run of these samples."""
    return RunFacts("run", samples, config or {"drop.share": 0.5}, {"numpy": "2.4"})


def test_equal_runs_have_no_difference() -> None:
    """The same facts, taken in other times; a quaternion and its negative are one rotation."""
    found = diff_runs(run(a=sample(took=1.0)), run(a=sample(at=pose(sign=-1.0), took=2.0)))
    assert found.equal
    assert [(one["metric"], one["difference"], one["relative"]) for one in found.times] == [("drop", 1.0, 0.5)]


def test_poses_differ_by_distance_and_angle() -> None:
    """3 mm and 10 degrees apart."""
    found = diff_runs(run(a=sample(at=pose(0.1, 20.0))), run(a=sample(at=pose(0.103, 30.0, -1.0))))
    (row,) = found.poses
    assert row["position_m"] == pytest.approx(0.003)
    assert row["angle_deg"] == pytest.approx(10.0)


@pytest.mark.parametrize("angle", [1e-5, 1.0, 90.0, 180.0])
def test_small_angles_are_exact(angle: float) -> None:
    """An arc cosine of a dot product near 1 would lose half of the digits."""
    assert angle_between_deg(pose()[1], pose(turn_deg=angle)[1]) == pytest.approx(angle, rel=1e-9)


def test_numbers_are_sorted_by_their_relative_change() -> None:
    """What only one has comes first, then the largest share of the larger of the two; two NaN are equal."""
    before = {"gap": 0.001, "mass": 10.0, "same": 1.0, "lost": 1.0, "nan": math.nan}
    after = {"gap": 0.002, "mass": 11.0, "same": 1.0, "lost": None, "nan": math.nan}
    found = diff_runs(run(a=sample(numbers=before)), run(a=sample(numbers=after)))
    assert [(one["metric"], one["relative"]) for one in found.metrics] == [
        ("lost", None),
        ("gap", 0.5),
        ("mass", pytest.approx(1.0 / 11.0)),
    ]


def test_samples_settings_and_versions() -> None:
    """Each is told with both values."""
    found = diff_runs(run(a=sample(), b=sample()), run({"drop.share": 0.6}, b=sample("infeasible"), c=sample()))
    assert (found.only_a, found.only_b) == (["a"], ["c"])
    assert [tuple(one.values()) for one in found.outcomes] == [("b", "verdict", "at_rest", "infeasible")]
    assert [tuple(one.values()) for one in found.config] == [("drop.share", 0.5, 0.6)]
    assert not found.equal


def test_what_one_side_does_not_know_is_no_difference() -> None:
    """The folder of one placement has no versions."""
    known = run(a=sample())
    assert diff_runs(known, RunFacts("placement", known.samples, known.config, {})).versions == []
