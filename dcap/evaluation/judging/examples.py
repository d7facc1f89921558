"""The rubric's examples, with scores and pictures: a scoring model sees them before the placement.

They are rendered on demand from an embedded room (known_room.py), always the same, with the cameras used for
placements. The room is not used for validating judges, and no validation placement is an example.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from dcap.evaluation.judging.known_room import BED, FLOOR, PROMPTS, SETTLED, BallPlace, RoomWithBall
from dcap.language.protocol.requests import Picture
from dcap.scene.types.pictures import PLACED
from dcap.synthetic.rooms import build_room

ROOM = "guest_01"
"""An embedded room with a bed."""
CAPTIONS = {"overview": "overview", "closeup": "close-up of the contact"}
"""Captions of a placement's pictures for a model."""


@dataclass(frozen=True, slots=True)
class Example:
    """A placement and its scores."""

    asked: str
    """BED or FLOOR."""
    place: BallPlace
    words: str
    """Description of the picture."""
    right_place: float
    physics_naturalness: float

    @property
    def caption(self) -> str:
        """Caption for a model."""
        return (
            f'"{PROMPTS[self.asked]}": {self.words}. '
            f"right_place {self.right_place:g}, physics_naturalness {self.physics_naturalness:g}"
        )


EXAMPLES = (
    Example(BED, SETTLED, "it lies in the middle of the mattress in a dent of its own shape", 10, 10),
    Example(BED, BallPlace(BED), "it touches the mattress in one point, nothing gives way", 10, 6),
    Example(BED, BallPlace(BED, 0.08), "it hovers a hand's breadth above the middle of the mattress", 9, 2),
    Example(BED, BallPlace(BED, -0.1), "half of it is inside a mattress that did not give way", 10, 2),
    Example(FLOOR, SETTLED, "it lies in a dent of the bed", 2, 10),
)


@cache
def example_room() -> RoomWithBall:
    """The room of all examples."""
    return RoomWithBall(ROOM, build_room(ROOM, 0))


def example_pictures() -> tuple[Picture, ...]:
    """Two pictures of each example, with captions for a model."""
    found = []
    for number, one in enumerate(EXAMPLES, 1):
        for view in PLACED:
            said = f"example {number}, {CAPTIONS[view]}" + (f"; {one.caption}" if view == PLACED[0] else "")
            found.append(Picture(said, lambda one=one, view=view: drawn(one, view)))  # type: ignore[misc]
    return tuple(found)


def drawn(example: Example, view: str) -> NDArray[np.uint8]:
    """One picture of an example."""
    compared = tuple(dict.fromkeys(one.place for one in EXAMPLES if one.asked == example.asked))
    return example_room().seen(example.place, example.asked, compared, view)
