"""What placement.json says of where the object came to rest, and of how it came there."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from box_rooms import ROOM
from furnished_views import ask

from dcap.language.offline.client import OfflineClient
from dcap.language.protocol.questions import INTENT
from dcap.language.protocol.replies import IntentReply
from dcap.scene.types.outcome import Cause, Caution, about, cautions, explanations
from flows.placement_json import off_its_part
from tasks.intent.rescale import rescale

ON_THE_MATTRESS = (0.0, -0.5, 0.48)
ON_A_PILLOW = (-0.35, 0.7, 0.6)


@pytest.mark.parametrize(
    ("asked", "rests", "lean", "off"),
    [
        ("mattress", ON_THE_MATTRESS, None, False),
        ("mattress", ON_A_PILLOW, None, True),
        ("", ON_A_PILLOW, None, False),  # no part was asked for
        ("mattress", ON_A_PILLOW, "against the headboard", False),  # what leans touches other parts, too
    ],
)
def test_rest_beside_the_part_that_was_asked(
    asked: str, rests: tuple[float, float, float], lean: str | None, off: bool
) -> None:
    """The part that the sentence names counts, and where the contact is at rest."""
    bounds = np.array([np.subtract(rests, 0.03), np.add(rests, 0.1)])
    body = SimpleNamespace(name="object", surface=SimpleNamespace(bounds=bounds))
    values: Any = SimpleNamespace(
        scene=ROOM, intent=SimpleNamespace(region=SimpleNamespace(part=asked)),
        anchor=SimpleNamespace(base_id="bed", part="mattress", lean=lean),
        settled=SimpleNamespace(bodies=(body,), contact_points=np.array([rests])),
    )  # fmt: skip
    assert off_its_part(values) is off


def test_messages_are_warnings_or_notes() -> None:
    """What asks for action is a warning, the most important first; the rest are notes, in the order of the stages; each
    is there once."""
    messages = [
        "cut around the object", Caution(Cause.WHICH, "this table"), Caution(Cause.NOT_MET, "asked seated"),
        "cut around the object", Caution(Cause.ASSUMED, "centimetres"), Caution(Cause.NOT_MET, "asked seated"),
        Caution(Cause.NOT_UNDERSTOOD, "'gently'"), "mass 1 kg",
    ]  # fmt: skip
    assert cautions(messages) == ["asked seated", "'gently'", "centimetres", "this table"]
    assert explanations(messages) == ["cut around the object", "mass 1 kg"]
    assert isinstance(about("object", messages[1]), Caution)
    assert type(about("object", messages[0])) is str


def test_guesses_of_a_stage_reach_the_warnings() -> None:
    """A mesh of the usual size is a note, one that is scaled to it a warning, for such is the result."""
    usual = np.array([[0.12, 0.09, 0.09]])
    kept = rescale(usual, usual[0], 1.4, (1e-3, 1e3))
    scaled = rescale(usual, 3.0 * usual[0], 1.4, (1e-3, 1e3))
    assert (kept.scale, explanations([kept.note])) == (1.0, [kept.note])
    assert scaled.scale != 1.0
    assert cautions([scaled.note])[0].cause is Cause.ASSUMED


def test_cautions_of_a_reply_stay_cautions() -> None:
    """The embedded reader's slips are warnings; what a model writes as JSON are texts."""
    reply = OfflineClient().ask(INTENT, ask("put the ball on the tabel"))
    assert any(one.cause is Cause.WHICH for one in cautions(reply.notes))
    assert cautions(IntentReply.model_validate_json(reply.model_dump_json()).notes) == []
