"""The embedded rooms, segmented from their files alone and compared with the truth they were made from."""

import numpy as np
import pytest

from dcap.language.offline.client import OfflineClient
from dcap.synthetic.recipes import room_names
from perf.repair import SUPPORTS
from perf.segments import means, read_room, room_scores
from tasks.segment.stage import SegmentConfig, segment

QUICK = ("bedroom_01", "living_01", "bathroom_01")
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


WITH_FRONT = (
    "armchair", "basin cabinet", "bed", "bedside table", "bookshelf", "cabinet", "chair", "desk", "multi person sofa",
    "shoe cabinet", "sofa", "storage cabinet", "tv cabinet", "wardrobe",
)  # fmt: skip
"""Supports that have a headboard, a backrest or doors, or that stand at a wall; stools and tables have no front."""


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["bedroom_02", *(pytest.param(n, marks=pytest.mark.long) for n in ("living_02", "study_01"))]
)
def test_supports_face_as_they_were_put(name):
    """Headboard, backrest or the wall behind tell the front of every support within 15 degrees."""
    room, scan = read_room(name)
    found = {one.id: one for one in segment(scan, SegmentConfig(), OfflineClient()).instances}
    checked = 0
    for label in room.record.labels:
        if label.box is None or label.id not in found or label.name.lower() not in WITH_FRONT:
            continue
        front = found[label.id].front
        assert front is not None, label.name
        # the annotated box has the axes of the piece, whose front is its +y
        assert float(front @ label.box.axes[:, 1]) > np.cos(np.radians(15)), label.name
        checked += 1
    assert checked >= 2
