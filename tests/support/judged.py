"""Placements as a judge gets them, with flat pictures, and models that judge."""

import numpy as np

from dcap.evaluation.judging.judge import JudgedPlacement
from dcap.evaluation.judging.rubric import Metrics
from dcap.language.protocol.requests import Picture

GOOD: Metrics = {
    "support_hit": True, "part_hit": True, "region_distance_m": 0.01, "orientation_error_deg": None,
    "penetration_m": 2e-5, "gap_m": 1e-4,
    "referee_drift_m": 1e-4, "referee_drift_deg": 0.02, "visible_fraction": 0.8, "com_supported": True,
}  # fmt: skip
REPLY = {"analysis": "seen", "right_place": "A", "physics_naturalness": "A", "overall": "A"}
SCORES = {"analysis": "seen", "right_place": 8, "physics_naturalness": 6.5}


def flat(name: str, shade: int) -> Picture:
    return Picture(name, lambda: np.full((8, 10, 3), shade, dtype=np.uint8))


def placement(sample: str, method: str, shade: int, **metrics: float | bool | None) -> JudgedPlacement:
    before = (flat("clean", 1), flat("asset", 2))
    views = (flat("overview", shade), flat("closeup", shade + 1))
    return JudgedPlacement(sample, method, f"put it on {sample}", "ball", {**GOOD, **metrics}, before, views)


def three_methods(samples: int = 2) -> list[JudgedPlacement]:
    """dcap settles, holodeck hovers by 1 cm, layoutgpt is 3 cm inside and off."""
    return [
        one
        for k in range(samples)
        for one in (
            placement(f"s{k}", "dcap", 10 + 50 * k),
            placement(f"s{k}", "holodeck", 20 + 50 * k, gap_m=0.01, referee_drift_m=0.01),
            placement(f"s{k}", "layoutgpt", 30 + 50 * k, penetration_m=0.03, region_distance_m=0.4),
        )
    ]
