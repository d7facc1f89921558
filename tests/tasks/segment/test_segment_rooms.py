"""The embedded rooms, segmented from their files alone and compared with the truth they were made from."""

import pytest

from dcap.synthetic.recipes import room_names
from perf.repair import SUPPORTS
from perf.segments import means, read_room, room_scores

QUICK = ("bedroom_01", "living_01", "kids_02", "bathroom_01")
"""Rooms of the slow test; the others are left to the long ones."""


@pytest.mark.slow
@pytest.mark.parametrize("name", [pytest.param(n, marks=[pytest.mark.long] * (n not in QUICK)) for n in room_names()])
def test_embedded_rooms(name: str) -> None:
    """With boxes instances overlap the truth by 0.9 on average and half each, the parts that carry by 0.7 each."""
    rows = room_scores(*read_room(name))
    assert len(rows) >= 5
    assert means(rows).instances > 0.9
    assert means(rows).parts > 0.8
    assert min(row.iou for row in rows) > 0.5
    assert min((iou for row in rows for part, iou in row.parts if part in SUPPORTS), default=1.0) > 0.7, rows
