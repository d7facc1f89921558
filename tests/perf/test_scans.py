"""What the table of scans counts: overlaps, what came second, and how often what is likely is right."""

import numpy as np
import pytest

from perf.scans import NounScore, calibration, overlap

UNIT = np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]])


def score(likelihood: float, share: float, *, over: bool = True) -> NounScore:
    return NounScore("room", "sofa", share, over, likelihood, "", "sofa")


def test_boxes_overlap_by_intersection_over_union() -> None:
    """Half a cube beside itself: 1/2 over 3/2; of what is flat the plans alone."""
    half = UNIT + np.array([0.5, 0.0, 0.0])
    flat = np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 0.01]])
    assert overlap(UNIT, half) == pytest.approx(1 / 3)
    assert overlap(flat, flat + np.array([0.0, 0.0, 0.05])) == pytest.approx(1.0)
    assert overlap(UNIT, UNIT + np.array([2.0, 0.0, 0.0])) == 0.0


def test_calibration_counts_answers_and_refusals() -> None:
    """Two answers at 0.7 and 0.8 less a hair, one of them over the wrong thing; one refusal."""
    found = [score(0.7, 0.9), score(0.79, 0.9, over=False), score(0.0, 0.0), score(1.0, 0.6)]
    table = calibration(found)
    cells = zip(*(column.cells for column in table.columns), strict=True)
    rows = {str(row[0]): tuple(map(str, row[1:])) for row in cells}
    assert rows["0.60 to 0.80"] == ("2", "0.74", "0.50")
    assert rows["0.95 to 1.00"] == ("1", "1.00", "1.00")
    assert rows["refused"] == ("1", "-", "-")
