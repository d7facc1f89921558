"""Sides that depend on who looks: of a landmark without a front somebody's left is taken, and that is said."""

import pytest
from furnished_views import thing

from dcap.language.offline.client import intent
from dcap.language.protocol.replies import IntentReply
from dcap.language.protocol.requests import InstanceView, IntentRequest, ObjectView
from dcap.scene.types.outcome import Cause, Caution, cautions

Direction = tuple[float, float, float]
AROUND = {"west": (-1.1, 0.0), "east": (1.1, 0.0), "north": (0.0, 0.9), "south": (0.0, -0.9)}
"""Middles of four stools around a table in the middle of the room [m]."""


def room(front: Direction | None, label: str = "table") -> tuple[InstanceView, ...]:
    """Stools, which have no front, around a thing 1.2 x 0.7 m with this front."""
    stools = (thing(f"stool_{name}", "stool", (x, y, 0.25), (0.4, 0.4, 0.5)) for name, (x, y) in AROUND.items())
    floor = thing("floor_0", "floor", (0.0, 0.0, -0.05), (4.0, 4.0, 0.1), structure=True)
    return (floor, thing("landmark_0", label, (0.0, 0.0, 0.4), (1.2, 0.7, 0.8), front=front), *stools)


def answer(prompt: str, instances: tuple[InstanceView, ...]) -> IntentReply:
    return intent(IntentRequest(prompt, ObjectView("book", (0.2, 0.15, 0.03), ()), instances, (0.0, 0.0, 1.25)))


def sides_guessed(reply: IntentReply) -> list[Caution]:
    return [one for one in cautions(reply.notes) if one.cause is Cause.WHICH and "seen from" in one]


SIDES = [
    ("to the left of", "west", "east"),
    ("to the right of", "east", "west"),
    ("in front of", "south", "north"),
    ("behind", "north", "south"),
]
"""Words, and the stool that is meant by who looks from -y, where no front says so, and by who looks from +y."""


@pytest.mark.parametrize(("words", "plan", "turned"), SIDES)
def test_side_of_a_landmark(words: str, plan: str, turned: str) -> None:
    """Without a front the viewer of a floor plan decides, and a caution names him; a front decides, and a note
    says so."""
    prompt = f"put the book on the stool {words} the"
    guessed, told = answer(f"{prompt} table", room(None)), answer(f"{prompt} cabinet", room((0.0, 1.0, 0.0), "cabinet"))
    assert guessed.base_id == f"stool_{plan}"
    (caution,) = sides_guessed(guessed)
    assert "seen from -y" in caution
    assert "by its id" in caution
    assert (told.base_id, sides_guessed(told)) == (f"stool_{turned}", [])
    assert any("the front of the cabinet" in note for note in told.notes)


UNSEEN = ["put the book on the left stool", "put the book on the second stool from the right"]
SEEN = [
    "put the book on stool_west",
    "put the book on the largest stool",
    "put the book on the stool nearest the window",
    "put the book on the table",
]


@pytest.mark.parametrize("prompt", [*UNSEEN, *SEEN])
def test_left_one_of_several(prompt: str) -> None:
    """The left one of things that have no front in common comes with a caution; ids, sizes and neighbours need none."""
    window = thing("window_0", "window", (-2.0, 0.0, 1.5), (0.1, 1.0, 1.0), structure=True)
    assert bool(sides_guessed(answer(prompt, (*room(None), window)))) == (prompt in UNSEEN)


def test_left_of_a_door_is_seen_from_the_room() -> None:
    """Doors have one side from which one looks: from the room, whose middle is south of this one."""
    door = thing("door_0", "door", (0.0, 2.0, 1.0), (0.9, 0.1, 2.0), structure=True)
    stools = [thing(f"stool_{name}", "stool", (x, 1.7, 0.25), (0.4, 0.4, 0.5)) for name, x in (("a", -0.8), ("b", 0.8))]
    reply = answer("put the book on the stool to the left of the door", (door, *stools))
    assert (reply.base_id, sides_guessed(reply)) == ("stool_a", [])
