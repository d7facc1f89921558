"""A choice that the sentence leaves open is asked back; its answers are sentences; on demand the likeliest is taken."""

import re

import pytest
from furnished_views import ask

from dcap.language.offline.client import OfflineClient
from dcap.language.protocol.questions import INTENT
from dcap.language.protocol.replies import IntentReply
from dcap.language.protocol.requests import IntentRequest
from dcap.scene.errors import LanguageError
from tasks.intent.request import settle_choice


def asked(prompt: str) -> tuple[IntentReply, IntentRequest]:
    request = ask(prompt)
    return OfflineClient().ask(INTENT, request), request


def question(prompt: str) -> str:
    with pytest.raises(LanguageError) as open_choice:
        settle_choice(*asked(prompt), ask=True)
    return str(open_choice.value)


def test_two_beds_are_asked_about_in_one_line() -> None:
    """Both are listed with their ids and with something that tells them apart, and the option that settles it."""
    said = question("put the ball on the bed")
    assert "(id bed_0)" in said
    assert "(id bed_1)" in said
    assert "--ambiguous best" in said
    assert "\n" not in said


@pytest.mark.parametrize("base", ["bed_0", "bed_1"])
def test_each_phrase_of_the_question_is_an_answer(base: str) -> None:
    """Saying the phrase, or the id, instead of "the bed" takes that bed without a question."""
    said = question("put the ball on the bed").partition(" mean: ")[2]
    listed = {one: phrase for phrase, one in re.findall(r"(the [^,(]+?) \(id (\w+)\)", said)}
    for phrase in (listed[base], f"the bed with id {base}", base):
        reply, request = asked(f"put the ball on {phrase}")
        assert reply.base_id == base, phrase
        assert settle_choice(reply, request, ask=True) == ()


def test_the_likeliest_is_taken_and_told() -> None:
    """With best the first is taken, and a note names the others."""
    reply, request = asked("put the ball on the bed")
    (note,) = settle_choice(reply, request, ask=False)
    assert reply.base_id in note
    assert "also bed_1" in note


@pytest.mark.parametrize(
    "prompt",
    ["put the ball on the left bed", "put the ball on the red bed", "put the ball on the bed near the window",
     "put the ball on the sofa", "put the ball on the floor next to the wall",
     "put the ball on a pillow of the left bed"],
)  # fmt: skip
def test_what_is_settled_is_not_asked(prompt: str) -> None:
    """One thing of its kind, a side, a colour, a place: no question. Walls are as good as one another."""
    assert settle_choice(*asked(prompt), ask=True) == ()


@pytest.mark.parametrize(("second", "open_choice"), [(0.5, True), (0.49, False)])
def test_half_as_likely_is_asked(second: float, open_choice: bool) -> None:
    """Whoever answered: from half of the best one's likelihood another may be meant."""
    reply, request = asked("put the ball on the sofa")
    listed = [{"id": "sofa_0", "likelihood": 1.0}, {"id": "desk_0", "likelihood": second}]
    doubtful = IntentReply.model_validate(reply.model_dump() | {"candidates": listed})
    assert (settle_choice(doubtful, request, ask=False) != ()) == open_choice
