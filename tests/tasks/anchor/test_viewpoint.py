"""Whose left a side of a support is: its front decides, else somebody's is taken, and that is said."""

import pytest
from box_rooms import block, mug, segmentation, thing
from stage_chain import Stages

from dcap.scene.types.outcome import Cause, Caution
from dcap.scene.types.segmentation import Segmentation

OFFLINE = Stages()
FRONT = (0.0, -1.0, 0.0)


def room(front: tuple[float, float, float] | None) -> Segmentation:
    """A table with a lamp, and a floor."""
    return segmentation(
        {
            "table": ("table", front, [("top", block((-0.6, -0.35, 0.7), (0.6, 0.35, 0.75)))]),
            "lamp": ("table lamp", None, [("base", block((-0.05, 0.15, 0.75), (0.05, 0.25, 0.9)))]),
            "floor": ("floor", None, [("floor", block((-2.0, -2.0, -0.1), (2.0, 2.0, 0.0)))]),
        }
    )


GUESSED = [
    "put the mug on the left side of the table",
    "put the mug on the table near the right edge",
    "put the mug on the table to the left of the lamp",
    "put the mug on the table, 20 cm from the left edge",
    "put the mug on the table facing me",
]
SETTLED = [
    "put the mug on the table",
    "put the mug on the table next to the lamp",
    "put the mug at the edge of the table",
    "put the mug on the table, 20 cm from the lamp",
]


@pytest.mark.parametrize("prompt", [*GUESSED, *SETTLED])
def test_side_of_a_support(prompt: str) -> None:
    """A side of a table without a front is said to be seen from its long side at -y; nothing else is said."""
    _, _, found = OFFLINE.placed(prompt, thing("mug", mug()), room(None))
    sides = [one for one in found.notes if isinstance(one, Caution) and "seen from the -y side of the table" in one]
    assert len(sides) == (prompt in GUESSED)
    assert all(one.cause is Cause.WHICH for one in sides)


def test_front_settles_the_sides() -> None:
    """Of a table that has a front nothing is said."""
    for prompt in GUESSED:
        _, _, found = OFFLINE.placed(prompt, thing("mug", mug()), room(FRONT))
        assert not [one for one in found.notes if isinstance(one, Caution)], prompt
