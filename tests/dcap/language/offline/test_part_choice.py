"""Which of several parts of one name an asked word means."""

import pytest

from dcap.language.offline.pose_choice import chosen_part
from dcap.language.protocol.requests import AnchorRequest, PartView

HEIGHTS = {"case with a roof": (0.09, 0.39, 0.70, 1.00), "three boards": (0.1, 0.5, 0.9)}


def board_height(which: str, heights: tuple[float, ...]) -> float:
    """Height of the board that is chosen [m]."""
    parts = tuple(PartView(i, "board", (0.0, 0.0, z), (0.8, 0.3, 0.02), 0.24) for i, z in enumerate(heights))
    request = AnchorRequest(
        prompt="", region_words="", object_name="book", footprint=(0.2, 0.15), base_label="bookcase", parts=parts,
        asked_part="board", asked_which=which, asked_regions=(), asked_references=(), right=(1.0, 0.0, 0.0),
        front=(0.0, -1.0, 0.0),
    )  # fmt: skip
    return chosen_part(request)[0].center[2]


@pytest.mark.parametrize(
    ("which", "case", "height"),
    [
        ("middle", "case with a roof", 0.39),
        ("middle", "three boards", 0.5),
        ("bottom", "case with a roof", 0.09),
        ("2 from bottom", "case with a roof", 0.39),
        ("2 from top", "three boards", 0.5),
        ("top", "three boards", 0.9),
    ],
)
def test_board_that_is_meant(which, case, height):
    assert board_height(which, HEIGHTS[case]) == height
