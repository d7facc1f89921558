"""`dcap language check` asks the real questions, tells what it took, and ends at the first refusal."""

import json
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from fake_api import FakeApi, fails, message, offline_model, question_of, says
from questions_at_hand import label_request

from flows.cli.app import main
from flows.language_check import label_answer


@pytest.fixture(autouse=True)
def own_data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A data folder of the test's own."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path / "data"))


class Model:
    """Answers like the embedded reader, and knows which of two placements is better."""

    def __init__(self) -> None:
        self.better = iter(("B", "A"))

    def __call__(self, body: dict[str, Any]) -> Any:
        if question_of(body) != "judge_pair":
            return offline_model(body)
        said = next(self.better)
        return message(json.dumps({"analysis": "", "right_place": "tie", "physics_naturalness": said, "overall": said}))


@pytest.mark.slow
@pytest.mark.long
def test_a_dozen_questions_are_asked_and_told(api: FakeApi, capsys: pytest.CaptureFixture[str]) -> None:
    """Each kind of the stages' questions and the judge's, with what is right, tokens and cost."""
    api.answers = [Model()]
    assert main(["language", "check", "--language", "anthropic"]) == 0
    lines = capsys.readouterr().out.splitlines()
    kinds = ["intent", "rotation", "anchor", "materials"] * 2 + ["label", "label", "parts", "judge_pair"]
    assert [line.split()[1] for line in lines[:-1]] == kinds
    assert all(line.startswith("right") for line in lines[:-1])
    assert lines[-1].startswith("12 of 12 right; 14300 tokens, ")
    assert [question_of(body) for body in api.asked] == [*kinds, "judge_pair"]


def test_wrong_answers_are_rows_too(
    api: FakeApi, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A model that says nothing of use is wrong in each row, and the next question is asked."""
    monkeypatch.setattr("flows.language_check.make_dataset", lambda *_, **__: None)
    monkeypatch.setattr(
        "flows.language_check.answers",
        lambda _, meter: [
            meter.row("label", wanted, partial(label_answer, meter, label_request(), wanted))
            for wanted in ("bed", "sofa")
        ],
    )
    api.answers = [says("nonsense")]
    assert main(["language", "check", "--language", "anthropic"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines[:-1]] == ["wrong", "wrong"]
    assert lines[-1].startswith("0 of 2 right")


def test_the_first_refusal_ends_it(api: FakeApi, capsys: pytest.CaptureFixture[str]) -> None:
    """Exit code 2 and one line with the server's words; nothing else is asked."""
    api.answers = [fails(401, "authentication_error")]
    assert main(["language", "check", "--language", "anthropic"]) == 2
    assert "claude-sonnet-5-5 answered HTTP 401: the server says authentication_error" in capsys.readouterr().err
    assert len(api.asked) == 1


def test_it_needs_a_model(capsys: pytest.CaptureFixture[str]) -> None:
    """Offline there is nothing to try."""
    assert main(["language", "check"]) == 2
    assert "needs --language anthropic or openai" in capsys.readouterr().err
