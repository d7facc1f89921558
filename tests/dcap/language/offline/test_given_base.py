"""A sentence whose support was pointed at: it may say where on it, and need not say on what."""

import pytest

from dcap.language.offline.client import OfflineClient
from dcap.language.protocol.questions import INTENT
from dcap.language.protocol.replies import IntentReply
from dcap.language.protocol.requests import InstanceView, IntentRequest, ObjectView, PartView


def box(name: str, label: str, x: float, *parts: str) -> InstanceView:
    views = tuple(PartView(k, part, (x, 0, 0.5), (1, 1, 0.1), 1.0) for k, part in enumerate(parts))
    return InstanceView(
        name, label, (x, 0, 0.25), (1, 1, 0.5), (x - 0.5, -0.5, 0), (x + 0.5, 0.5, 0.5), (0, -1, 0), False, (0.5,) * 3,
        views,
    )  # fmt: skip


ROOM = (
    box("bed_0", "bed", 0.0, "mattress", "pillow"), box("bed_1", "bed", 3.0, "mattress", "pillow"),
    box("thing", "thing", 6.0, "body"), box("lamp", "table lamp", 1.2, "shade"),
)  # fmt: skip


def read(prompt: str, base: str) -> IntentReply:
    request = IntentRequest(prompt, ObjectView("ball", (0.2, 0.2, 0.2), ()), ROOM, (0, 0, 0), (), base)
    return OfflineClient().ask(INTENT, request)


@pytest.mark.parametrize(
    ("prompt", "base", "part", "regions"),
    [
        ("put the ball there", "thing", "", ()),
        ("put the ball on the bed", "bed_1", "", ()),  # of two alike the one pointed at, not the first
        ("put the ball on the left edge of the bed", "bed_1", "", ("left", "edge")),
        ("put the ball on the pillow", "bed_1", "pillow", ()),
        ("put the ball in the corner of the sofa", "thing", "", ("corner",)),  # whatever it is called
        ("put the ball on the pillow", "thing", "", ()),  # which it does not have
    ],
)
def test_the_base_is_given_and_the_place_is_read(prompt: str, base: str, part: str, regions: tuple[str, ...]) -> None:
    """Part and region as for any support."""
    reply = read(prompt, base)
    assert (reply.base_id, reply.missing) == (base, "")
    assert (reply.part, reply.regions) == (part, regions)


def test_references_stay() -> None:
    """Near another thing, on what was pointed at."""
    reply = read("put the ball near the lamp on the bed", "bed_0")
    assert (reply.base_id, reply.references) == ("bed_0", ("lamp",))


def test_a_thing_that_is_not_there_is_told() -> None:
    """The person has said where; the word that leads nowhere is a note."""
    reply = read("put the ball next to the piano", "bed_0")
    assert reply.base_id == "bed_0"
    assert any("piano" in note for note in reply.notes)
