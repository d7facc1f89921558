"""What asking leaves behind: kept replies, recordings, the ledger and its budget; and the key nowhere."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from fake_api import KEY, FakeApi, fails, offline_model, says

from dcap.language.connect import connect
from dcap.language.model.anthropic_api import endpoint, size_of
from dcap.language.model.ledger import (
    Ledger,
    ReplyLine,
    check_budget,
    in_words,
    most,
    price_of,
    read_lines,
    spending_of,
)
from dcap.language.model.payload import payload_of
from dcap.language.model.reply_folder import ReplyFolder
from dcap.language.protocol.client import ClientName, LanguageConfig
from dcap.language.protocol.questions import INTENT
from dcap.language.protocol.session import MAX_TOKENS, Session
from dcap.scene.errors import BudgetError, InputError, LanguageError

NAME = "claude-sonnet-5-5"
MODEL = LanguageConfig(client=ClientName.ANTHROPIC, model=NAME)
REPLAY = LanguageConfig(client=ClientName.REPLAY, model=NAME)


def files(root: Path) -> dict[str, bytes]:
    return {str(path.relative_to(root)): path.read_bytes() for path in sorted(root.rglob("*")) if path.is_file()}


def test_a_question_is_asked_once(api: FakeApi, ask, tmp_path):
    """The same question gets its kept reply, from any session; a fresh one asks again."""
    ledger = tmp_path / "usage.jsonl"
    first = connect(MODEL, Session(ledger=str(ledger), sample="a")).ask(INTENT, ask("put the mug on the desk"))
    session = Session(ledger=str(ledger), sample="a")
    assert connect(MODEL, session).ask(INTENT, ask("put the mug on the desk")) == first
    assert len(api.asked) == 1
    assert [line.how for line in read_lines(ledger) if isinstance(line, ReplyLine)] == ["asked", "kept"]
    connect(MODEL, Session(fresh=True)).ask(INTENT, ask("put the mug on the desk"))
    assert len(api.asked) == 2


def test_another_address_than_the_run_s_is_not_asked(api: FakeApi, ask, monkeypatch):
    """Its replies would be kept under the wrong name; what is kept already needs nobody."""
    asked = ask("put the mug on the desk")
    first = connect(MODEL, Session()).ask(INTENT, asked)
    monkeypatch.setattr("dcap.language.model.anthropic_api.USUAL", "api.anthropic.com")
    assert endpoint() == api.url.partition("//")[2].replace(":", "-")
    assert connect(MODEL, Session()).ask(INTENT, asked) == first
    with pytest.raises(InputError, match=r"the usual address, but \$ANTHROPIC_BASE_URL now names 127"):
        connect(MODEL, Session()).ask(INTENT, ask("put the mug on the bed"))
    assert len(api.asked) == 1


@pytest.mark.parametrize(
    ("url", "name"),
    [
        ("", ""),
        ("https://api.anthropic.com", ""),
        ("https://api.anthropic.com/", ""),
        ("https://me:secret@gate.example:8080/maker/v2/", "gate.example-8080-maker-v2"),
    ],
)
def test_an_address_names_a_folder(monkeypatch: pytest.MonkeyPatch, url: str, name: str):
    """The usual one none, another one its host and path without its password."""
    monkeypatch.setenv("ANTHROPIC_BASE_URL", url)
    assert endpoint() == name


def test_a_recording_holds_what_was_used_and_answers_alone(api: FakeApi, ask, tmp_path):
    """Kept replies are copied into a recording too; it answers when nobody can be asked, with the invalid turns."""
    good = offline_model
    api.answers = [says("nonsense"), good]
    asked = ask("put the mug on the desk")
    first = connect(MODEL, Session()).ask(INTENT, asked)
    connect(MODEL, Session(record=str(tmp_path / "r"))).ask(INTENT, asked)
    api.answers = [fails(500, "nobody")]
    assert ReplyFolder(tmp_path / "r").models() == [NAME]
    session = Session(replay=str(tmp_path / "r"), kept=str(tmp_path / "none"))
    assert connect(REPLAY, session).ask(INTENT, asked) == first
    with pytest.raises(LanguageError, match=r"no reply of claude-sonnet-5-5 to this question 'intent'.*--record"):
        connect(REPLAY, Session(replay=str(tmp_path / "r"), kept=str(tmp_path / "none"))).ask(
            INTENT, ask("put the mug on the shelf")
        )
    assert len(api.asked) == 2


def test_a_damaged_recording_is_named(api: FakeApi, ask, tmp_path):
    """A file that is no reply is an error with its path."""
    connect(MODEL, Session(record=str(tmp_path / "r"))).ask(INTENT, ask("put the mug on the desk"))
    (path,) = (tmp_path / "r").rglob("*.json")
    path.write_text("{")
    with pytest.raises(LanguageError, match=path.name):
        connect(REPLAY, Session(replay=str(tmp_path / "r"))).ask(INTENT, ask("put the mug on the desk"))


def test_the_key_is_nowhere(api: FakeApi, ask, tmp_path, capfd):
    """Neither kept replies nor recording nor ledger nor output hold the key; the server got it."""
    connect(MODEL, Session(record=str(tmp_path / "r"), ledger=str(tmp_path / "usage.jsonl"))).ask(
        INTENT, ask("put the mug on the desk")
    )
    assert KEY in " ".join(api.headers[0].values())
    found = files(tmp_path)
    assert len(found) > 2
    assert not [name for name, data in found.items() if KEY.encode() in data]
    assert KEY not in "".join(capfd.readouterr())


# ledger and budget --------------------------------------------------------------------------------------------------


def test_a_reply_costs_what_its_tokens_cost(api: FakeApi, ask, tmp_path):
    """Each kind of token at its own price per million; kept replies cost nothing."""
    tokens = {"input_tokens": 3000, "output_tokens": 500, "cache_creation_input_tokens": 2000,
              "cache_read_input_tokens": 10_000}  # fmt: skip
    price = price_of(NAME)
    assert price is not None
    expected = (3000 * price.input + 500 * price.output + 2000 * price.cache_write + 10_000 * price.cache_read) / 1e6
    api.answers = [lambda body: with_usage(offline_model(body), tokens)]
    ledger = tmp_path / "usage.jsonl"
    for _ in range(2):
        connect(MODEL, Session(ledger=str(ledger), sample="a")).ask(INTENT, ask("put the mug on the desk"))
    found = spending_of(ledger)
    assert found.usd == pytest.approx(expected, abs=1e-6)
    assert (found.asked, found.kept, found.output_tokens) == (1, 1, 500)
    assert "15000 tokens in (10000 from the cache), 500 out" in in_words(found)


def with_usage(answer: tuple[int, dict[str, Any]], tokens: dict[str, int]) -> tuple[int, dict[str, Any]]:
    return answer[0], answer[1] | {"usage": tokens}


def test_an_unknown_price_is_said(tmp_path):
    """Tokens of a model without a price are counted, their cost is unknown, and no budget can be kept for it."""
    ledger = Ledger(tmp_path / "usage.jsonl")
    ledger.settle("x", "someone-else", "intent", {"usage": {"input_tokens": 5, "output_tokens": 1}}, how="asked")
    assert spending_of(tmp_path / "usage.jsonl").usd is None
    assert "unknown price" in in_words(spending_of(tmp_path / "usage.jsonl"))
    with pytest.raises(InputError, match="someone-else is not known"):
        check_budget("someone-else", 1.0)
    with pytest.raises(InputError, match="someone-else is not known"):
        Ledger(tmp_path / "usage.jsonl", 1.0).reserve("someone-else", "intent", 1, 1)
    for wrong in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(InputError, match="--max-cost"):
            check_budget(NAME, wrong)


def test_a_budget_is_never_exceeded_and_stops_in_one_line(api: FakeApi, ask, tmp_path):
    """Many at once: what is asked fits, the others raise BudgetError; what was released can be spent."""
    requests = [ask(f"put the mug on the desk {'please ' * n}") for n in range(12)]
    price = price_of(NAME)
    assert price is not None
    bound = most(size_of(payload_of(INTENT, requests[-1])), price, MAX_TOKENS)
    budget = 3.5 * bound
    session = Session(ledger=str(tmp_path / "usage.jsonl"), max_cost=budget)

    def one(request: Any) -> str:
        try:
            connect(MODEL, session).ask(INTENT, request)
        except BudgetError as error:
            return str(error)
        return ""

    tokens = {"input_tokens": 0, "output_tokens": int(1e6 * bound / price.output)}
    api.answers = [lambda body: with_usage(offline_model(body), tokens)]
    with ThreadPoolExecutor(6) as pool:
        said = list(pool.map(one, requests))
    spent = spending_of(tmp_path / "usage.jsonl").usd
    assert spent is not None
    assert 0 < spent <= budget
    assert len(api.asked) == said.count("") == 3
    assert all("--max-cost" in text and "\n" not in text for text in said if text)


def test_a_failed_call_gives_its_reservation_back(api: FakeApi, ask, tmp_path):
    """An error of the server costs nothing."""
    price = price_of(NAME)
    assert price is not None
    budget = 1.2 * most(size_of(payload_of(INTENT, ask("put the mug on the desk"))), price, MAX_TOKENS)
    session = Session(ledger=str(tmp_path / "usage.jsonl"), max_cost=budget)
    api.answers = [fails(400, "invalid_request_error"), fails(400, "invalid_request_error"), offline_model]
    for _ in range(2):
        with pytest.raises(LanguageError, match="400"):
            connect(MODEL, session).ask(INTENT, ask("put the mug on the desk"))
    connect(MODEL, session).ask(INTENT, ask("put the mug on the desk"))
