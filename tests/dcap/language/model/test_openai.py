"""The client for servers of chat completions: a stand-in on the loopback interface answers, never the network."""

import importlib.util
import json
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from fake_api import KEY, fails, offline_model, reason_of, says
from fake_openai import FakeOpenAi
from questions_at_hand import AT_HAND, rotation_request

from dcap.language.connect import connect
from dcap.language.model.ledger import ReplyLine, read_lines
from dcap.language.offline.client import OfflineClient
from dcap.language.protocol.client import LanguageConfig
from dcap.language.protocol.questions import ROTATION
from dcap.language.protocol.session import Session
from dcap.scene.errors import InputError, LanguageError, RefusedError
from flows.configure import LanguageOptions

NAME = "local/some-vlm"
HERE = pytest.mark.skipif(importlib.util.find_spec("openai") is None, reason="the extra `openai` is not installed")


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[FakeOpenAi]:
    """A stand-in; the environment points to it, and no reply of another test is kept."""
    api = FakeOpenAi()
    monkeypatch.setenv("OPENAI_API_KEY", KEY)
    monkeypatch.setenv("OPENAI_BASE_URL", api.url)
    monkeypatch.setenv("NO_PROXY", "127.0.0.1")
    monkeypatch.setenv("DCAP_DATA", str(tmp_path / "data"))
    yield api
    api.close()


def config() -> LanguageConfig:
    return LanguageOptions("openai", NAME).config()


@HERE
@pytest.mark.parametrize(("question", "request_of"), AT_HAND, ids=[question.name for question, _ in AT_HAND])
def test_every_question_is_answered(server: FakeOpenAi, question, request_of):
    """The form of every reply is one that strict mode takes; text and pictures arrive; the reply passes its check."""
    request = request_of()
    assert connect(config(), Session()).ask(question, request) == OfflineClient().ask(question, request)
    images = [block for block in server.asked[0]["messages"][0]["content"] if block["type"] == "image"]
    assert len(images) == len(getattr(request, "pictures", ()))


@HERE
def test_an_invalid_answer_goes_back_with_the_reason(server: FakeOpenAi):
    """As a turn of the model and one of ours; what is cut off is asked again with more room."""
    server.answers = [says({"pose_id": "sideways"}), says('{"pose', "max_tokens"), offline_model]
    connect(config(), Session()).ask(ROTATION, rotation_request())
    assert [turn["role"] for turn in server.asked[1]["messages"]] == ["user", "assistant", "user"]
    assert "sideways" in reason_of(server.asked[1])
    assert [body["max_tokens"] for body in server.raw] == [16_000, 16_000, 32_000]
    assert server.raw[2]["messages"] == server.raw[1]["messages"]


@HERE
def test_replies_are_kept_recorded_and_replayed(server: FakeOpenAi, tmp_path: Path):
    """The same ledger, kept replies and recordings as for the other API; the completion is kept as it came."""
    server.answers = [says({"pose_id": "flip_y", "facing_id": "keep"}, input_tokens=70, cache_read_input_tokens=30)]
    ledger = tmp_path / "usage.jsonl"
    session = Session(ledger=str(ledger), record=str(tmp_path / "r"))
    first = connect(config(), session).ask(ROTATION, rotation_request())
    assert connect(config(), session).ask(ROTATION, rotation_request()) == first
    lines = [line for line in read_lines(ledger) if isinstance(line, ReplyLine)]
    assert [line.how for line in lines] == ["asked", "kept"]
    assert (lines[0].input_tokens, lines[0].cache_read_tokens, lines[0].output_tokens) == (70, 30, 100)
    assert lines[0].usd is None  # its price is not known
    (path,) = (tmp_path / "r").rglob("*/*/*.json")
    assert json.loads(path.read_text())["message"]["completion"]["object"] == "chat.completion"
    assert KEY not in path.read_text()
    replay = LanguageOptions(replay=str(tmp_path / "r"))
    session = Session(replay=str(tmp_path / "r"), kept=str(tmp_path / "none"))
    assert connect(replay.config(), session).ask(ROTATION, rotation_request()) == first
    assert len(server.asked) == 1


@HERE
@pytest.mark.parametrize(
    ("answer", "said", "kind"),
    [
        (fails(401, "invalid_api_key"), "answered HTTP 401: the server says invalid_api_key", RefusedError),
        (fails(404, "model_not_found"), "answered HTTP 404: the server says model_not_found", RefusedError),
        (says("no", "refusal"), "refused to answer", LanguageError),
    ],
)
def test_failures_are_one_line_without_the_key(server: FakeOpenAi, answer, said: str, kind: type[LanguageError]):
    """What the server says, once."""
    server.answers = [answer]
    with pytest.raises(kind, match=said) as error:
        connect(config(), Session()).ask(ROTATION, rotation_request())
    assert "\n" not in str(error.value)
    assert KEY not in str(error.value)


@HERE
def test_a_server_of_one_s_own_needs_no_key(server: FakeOpenAi, monkeypatch: pytest.MonkeyPatch):
    """Without a key the usual address is refused in a line, another one is asked."""
    monkeypatch.delenv("OPENAI_API_KEY")
    assert connect(config(), Session()).ask(ROTATION, rotation_request()).pose_id == "flip_y"
    assert "max_tokens" in server.raw[0]
    monkeypatch.delenv("OPENAI_BASE_URL")
    with pytest.raises(RefusedError, match="there is no key; set OPENAI_API_KEY, or OPENAI_BASE_URL"):
        connect(config().model_copy(update={"model": "other"}), Session()).ask(ROTATION, rotation_request())


def test_without_the_library_it_is_said_how_to_get_it(monkeypatch: pytest.MonkeyPatch):
    """One line, before anything is computed."""
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"not installed: `pip install 'dcap\[openai\]'`") as error:
        config()
    assert "\n" not in str(error.value)
    monkeypatch.undo()
    monkeypatch.setitem(sys.modules, "openai", None)
    assert connect(LanguageConfig(), Session())  # who does not ask it does not need it


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (LanguageOptions("openai"), "--language openai needs --model NAME"),
        (LanguageOptions("openai", NAME, batch=True), "--batch is for --language anthropic, not openai"),
        (LanguageOptions("openai", replay="x"), "is for --language replay, not openai"),
        (LanguageOptions("offline", record="x"), "--record is for --language anthropic or openai: offline asks no"),
    ],
)
def test_options_that_cannot_be_meant_are_named(options: LanguageOptions, said: str):
    """One line that names the option."""
    with pytest.raises(InputError, match=said):
        options.config()
