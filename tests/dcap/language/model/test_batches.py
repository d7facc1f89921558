"""Questions in batches: sent together at half the price, and what becomes of those that are lost on the way."""

import json
import os
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from fake_api import FakeApi, fails, offline_model, says

from dcap.language.connect import connect
from dcap.language.model import batch
from dcap.language.model.anthropic_api import size_of
from dcap.language.model.batch import BatchQueue, batch_queue
from dcap.language.model.ledger import (
    Ledger,
    Usage,
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
from dcap.scene.errors import BudgetError, LanguageError

NAME = "claude-sonnet-5-5"
MODEL = LanguageConfig(client=ClientName.ANTHROPIC, model=NAME)


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """A queue that does not wait for long."""
    monkeypatch.setattr(batch, "QUIET_S", 0.3)
    monkeypatch.setattr(batch, "POLL_S", 0.02)
    monkeypatch.setattr(batch, "ASK_AGAIN_S", 0.1)


def in_batches(session: Session, requests: list[Any]) -> list[Any]:
    """Answers or errors, each asked in a thread of its own."""

    def one(request: Any) -> Any:
        try:
            return connect(MODEL, session).ask(INTENT, request)
        except LanguageError as error:
            return error

    with batch_queue(Path(session.batch), session), ThreadPoolExecutor(len(requests)) as pool:
        return list(pool.map(one, requests))


def test_questions_go_together_at_half_the_price(api: FakeApi, quick, ask, tmp_path):
    """Many questions, one batch; an invalid answer goes into the next; every reply is kept."""
    api.answers = [says("nonsense"), offline_model]
    session = Session(ledger=str(tmp_path / "usage.jsonl"), batch=str(tmp_path / "queue"), sample="a")
    requests = [ask(f"put the mug on the desk {'please ' * n}") for n in range(5)]
    found = in_batches(session, requests)
    assert [reply.base_id for reply in found] == ["desk_0"] * 5
    assert [len(batch) for batch in api.batches.values()] == [5, 1]
    total, price = spending_of(tmp_path / "usage.jsonl"), price_of(NAME)
    assert price is not None
    assert total.batch == 6
    assert total.usd == pytest.approx(0.5 * 6 * Usage(1000, 100).cost(price))
    asked = len(api.asked)
    assert connect(MODEL, Session()).ask(INTENT, requests[0]) == found[0]
    assert len(api.asked) == asked


def test_what_fails_in_a_batch_fails_alone(api: FakeApi, quick, ask, tmp_path):
    """One question that errs and one that expires are errors in a line; the others get their answers."""
    api.answers = [fails(400, "invalid_request_error"), fails(410, "expired"), offline_model]
    found = in_batches(
        Session(batch=str(tmp_path / "queue")), [ask(f"put the mug on the desk {'please ' * n}") for n in range(4)]
    )
    errors = sorted(str(one) for one in found if isinstance(one, LanguageError))
    assert len(errors) == 2
    assert "expired" in errors[0]
    assert "invalid_request_error" in errors[1]


def test_one_question_of_many_samples_is_sent_and_paid_once(api: FakeApi, quick, ask, tmp_path):
    """Samples that ask the same share one place in the batch, its answer and its cost; or its failure."""
    ledger = tmp_path / "usage.jsonl"
    session = Session(ledger=str(ledger), batch=str(tmp_path / "queue"))
    found = in_batches(session, [ask("put the mug on the desk")] * 4)
    assert [reply.base_id for reply in found] == ["desk_0"] * 4
    assert [len(batch) for batch in api.batches.values()] == [1]
    assert spending_of(ledger).batch == 1
    api.answers = [fails(410, "expired")]
    found = in_batches(session, [ask("put the mug on the shelf")] * 4)
    assert all(isinstance(one, LanguageError) for one in found)
    assert [len(batch) for batch in api.batches.values()] == [1, 1]


def test_a_batch_that_cannot_be_sent_is_told_to_all(api: FakeApi, quick, ask, tmp_path, monkeypatch):
    """If the API does not take the batch, each question fails with its words, and nothing is booked."""
    monkeypatch.setattr(api, "post", lambda call: fails(403, "permission_error")(call.body))
    ledger = tmp_path / "usage.jsonl"
    found = in_batches(
        Session(batch=str(tmp_path / "queue"), ledger=str(ledger), max_cost=9.0), [ask("put the mug on the desk")]
    )
    assert "403" in str(found[0])
    assert spending_of(ledger).usd == 0.0
    assert read_lines(ledger)[-1].usd == 0.0


def test_a_batch_keeps_to_the_budget(api: FakeApi, quick, ask, tmp_path):
    """What does not fit is not sent and says so; the rest is answered."""
    requests = [ask(f"put the mug on the desk {'please ' * n}") for n in range(4)]
    price = price_of(NAME)
    assert price is not None
    budget = 2.5 * 0.5 * most(size_of(payload_of(INTENT, requests[-1])), price, MAX_TOKENS)
    session = Session(ledger=str(tmp_path / "usage.jsonl"), max_cost=budget, batch=str(tmp_path / "queue"))
    found = in_batches(session, requests)
    assert sum(isinstance(one, BudgetError) for one in found) == 2
    assert [len(batch) for batch in api.batches.values()] == [2]


def test_whoever_waits_gets_an_error_when_the_run_ends(api: FakeApi, quick, ask, tmp_path):
    """A question whose batch takes a day does not keep an interrupted run: it fails as soon as the queue closes."""
    api.polls = 10**6
    session, said = Session(batch=str(tmp_path / "queue")), []

    def wait() -> None:
        with pytest.raises(LanguageError, match="the run ended") as error:
            connect(MODEL, session).ask(INTENT, ask("put the mug on the desk"))
        said.append(str(error.value))

    with batch_queue(tmp_path / "queue", session):
        waiting = threading.Thread(target=wait)
        waiting.start()
        while not api.batches:
            waiting.join(0.02)
    waiting.join(5.0)
    assert said
    assert not (tmp_path / "queue").exists()


def test_a_killed_run_s_batch_is_collected_by_the_next(api: FakeApi, quick, ask, tmp_path, monkeypatch):
    """Replies of a batch that nobody waited for are kept and booked by the next queue: nothing is sent twice."""
    request, ledger = ask("put the mug on the desk"), tmp_path / "usage.jsonl"
    test_whoever_waits_gets_an_error_when_the_run_ends(api, quick, ask, tmp_path)
    (left,) = (Session().kept_folder / "batches").glob("*.json")
    left.write_text(json.dumps(json.loads(left.read_text()) | {"process": 2**22 + 1}))  # beyond any process of Linux
    api.polls = 1
    (reply,) = in_batches(Session(batch=str(tmp_path / "queue2"), ledger=str(ledger)), [request])
    assert reply.base_id == "desk_0"
    assert len(api.batches) == 1
    assert spending_of(ledger).batch == 1
    assert not left.exists()


def test_a_batch_of_another_run_is_left_alone(api: FakeApi, ask, tmp_path):
    """What a run that is alive has sent is its own to collect."""
    left = Session().kept_folder / "batches" / "msgbatch_7.json"
    left.parent.mkdir(parents=True)
    left.write_text(json.dumps({"process": os.getppid(), "questions": {}}))
    assert (
        BatchQueue(tmp_path, ReplyFolder(Session().kept_folder), Ledger(None), lambda text: None).open_batches() == []
    )


def test_many_questions_of_one_stage_give_its_slot_back_once(api: FakeApi, quick, ask, tmp_path):
    """While a stage waits for a batch its slot is free, and taken again afterwards, however many questions it has."""
    free = []

    class Slot:
        def __enter__(self) -> None:
            free.append(1)

        def __exit__(self, *_: object) -> None:
            free.append(-1)

    session = Session(batch=str(tmp_path / "queue"))
    with batch_queue(tmp_path / "queue", session):
        requests = [ask(f"put the mug on the desk {'please ' * n}") for n in range(4)]
        assert len(connect(MODEL, session, Slot).ask_all(INTENT, requests)) == 4
    assert free == [1, -1]
