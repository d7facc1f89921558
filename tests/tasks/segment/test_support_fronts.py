"""Fronts of supports, found from the room's files, compared with how the rooms were furnished."""

import numpy as np
import pytest

from dcap.language.offline.client import OfflineClient
from perf.segments import read_room
from tasks.segment.stage import SegmentConfig, segment

WITH_FRONT = (
    "armchair", "basin cabinet", "bed", "bedside table", "bookshelf", "cabinet", "chair", "desk", "multi person sofa",
    "shoe cabinet", "sofa", "storage cabinet", "tv cabinet", "wardrobe",
)  # fmt: skip
"""Supports that have a headboard, a backrest or doors, or that stand at a wall; stools and tables have no front."""


@pytest.mark.slow
@pytest.mark.parametrize("name", ["bedroom_02", "living_02", "study_01"])
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
