"""The embedded rooms, segmented from their files alone and compared with the truth they were made from."""

import pytest

from perf.segments import means, read_room, room_scores

SUPPORT_PARTS = {"mattress", "blanket", "pillow", "seat cushion", "seat", "top", "board", "shade", "rim"}
"""Parts that things are placed on."""

SOME_ROOMS = ("kids_02", "bathroom_01", "living_03", "dining_02")
"""Rooms of different kinds; python -m perf.segments measures all."""


@pytest.mark.parametrize("name", ["bedroom_01", *(pytest.param(n, marks=pytest.mark.slow) for n in SOME_ROOMS)])
def test_embedded_rooms(name: str) -> None:
    """With boxes instances overlap the truth by 0.9 on average and half each, the parts that carry by 0.7 each."""
    rows = room_scores(*read_room(name))
    assert len(rows) >= 5
    assert means(rows).instances > 0.9
    assert means(rows).parts > 0.8
    assert min(row.iou for row in rows) > 0.5
    assert min((iou for row in rows for part, iou in row.parts if part in SUPPORT_PARTS), default=1.0) > 0.7, rows
