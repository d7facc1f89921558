"""Questions in batches, at half the price: stages add questions to a queue and wait, the queue sends them together.

`ask_in_batch` (in a stage, in any process) writes a file to the queue's folder and waits for the reply. `BatchQueue`
(in the process of the run) sends all waiting questions as one batch of the Message Batches API when none has arrived
for a while, keeps each reply as soon as its batch has ended, and records its cost. A question is sent once, however
many stages wait for it. A batch that was open when a run was killed is collected by the next run.
"""

import json
import os
import shutil
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from dcap.language.model.ledger import BATCH_FACTOR, Ledger, is_alive, locked
from dcap.language.model.payload import Payload
from dcap.language.model.reply_folder import Message, ReplyFolder, write_whole
from dcap.language.protocol.client import Idle, LanguageConfig
from dcap.language.protocol.session import Session
from dcap.scene import errors
from dcap.scene.errors import BudgetError, DcapError, LanguageError, RefusedError

POLL_S = 0.2
"""Interval at which waiting questions and the queue check the folder [s]."""
QUIET_S = 5.0
"""A batch is sent once no question has come for this time [s]."""
ASK_AGAIN_S = 20.0
"""Interval at which the API is asked whether a batch has ended [s]; batches take minutes to hours."""
MOST_BYTES = 100_000_000
"""Largest batch [bytes]; the API accepts 256 MB."""
OPEN = "batches"
"""Folder of the open batches, next to the kept replies."""
CLOSED = "closed"
"""File that marks a closed queue."""


def ask_in_batch(config: LanguageConfig, payload: Payload, session: Session, kept: ReplyFolder, idle: Idle) -> Message:
    """Queue a question and wait for its reply."""
    from dcap.language.model.anthropic_api import call_of, size_of

    queue, digest = Path(session.batch), payload.digest
    (queue / f"{digest}.error").unlink(missing_ok=True)  # from an earlier attempt
    asked = {"question": payload.question, **payload.readable()}
    entry = {
        "name": config.source, "model": config.model, "sample": session.sample,
        "call": call_of(config, payload, session), "asked": asked,
    }  # fmt: skip
    if queue.is_dir():
        write_whole(queue / f"{digest}.json", entry | {"size": size_of(payload)})
    with idle():
        return waited_for(queue, kept, config.source, digest)


def waited_for(queue: Path, kept: ReplyFolder, name: str, digest: str) -> Message:
    """The reply, after the queue has stored it."""
    failed, closed = queue / f"{digest}.error", queue / CLOSED
    while True:
        message = kept.read(name, digest)
        if message is not None:
            return message
        if failed.is_file():
            raise told_error(failed)
        if closed.is_file() or not queue.is_dir():
            raise LanguageError("the run ended before the batch was answered; the next run collects it")
        time.sleep(POLL_S)


def told_error(path: Path) -> DcapError:
    """The error written by the queue."""
    with suppress(OSError, ValueError, KeyError):
        told = json.loads(path.read_bytes())
        kind: type[DcapError] = getattr(errors, told["type"])
        return kind(told["message"])
    return LanguageError("the question could not be asked")  # another process has queued it again


@contextmanager
def batch_queue(folder: Path, session: Session, tell: Callable[[str], None] = lambda text: None) -> Iterator[None]:
    """A queue for the questions asked in this block; questions that still wait afterwards get an error."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    ledger = Ledger(Path(session.ledger) if session.ledger else None, session.max_cost)
    queue = BatchQueue(folder, ReplyFolder(session.kept_folder), ledger, tell)
    thread = threading.Thread(target=queue.serve, name="batch queue", daemon=True)
    thread.start()
    try:
        yield
    finally:
        queue.stopped.set()
        (folder / CLOSED).touch()
        thread.join(timeout=5.0)
        shutil.rmtree(folder, ignore_errors=True)


@dataclass(slots=True)
class BatchQueue:
    """Sends the questions waiting in its folder, batch by batch."""

    folder: Path
    kept: ReplyFolder
    ledger: Ledger
    tell: Callable[[str], None]
    stopped: threading.Event = field(default_factory=threading.Event)
    asked_at: dict[str, float] = field(default_factory=dict)
    """Time of the last query to the API about each open batch [s of the monotonic clock]."""

    def serve(self) -> None:
        """Work until stopped; a fatal error is reported and passed to all waiting questions."""
        try:
            while not self.stopped.wait(POLL_S):
                self.step()
        except Exception as error:  # every waiting question raises it in its own sample
            self.tell(f"the batch queue has failed: {type(error).__name__}: {error}")
        finally:
            with suppress(OSError):
                (self.folder / CLOSED).touch()

    def step(self) -> None:
        """Send the collected questions, and collect the batches that have ended."""
        batches = self.open_batches()
        sent = {digest for _, batch in batches for digest in batch["questions"]}
        waiting = [path for path in sorted(self.folder.glob("*.json")) if path.stem not in sent]
        if waiting and time.time() - max(path.stat().st_mtime for path in waiting) >= QUIET_S:
            for paths in bundles(waiting):
                self.send(paths)
        for path, batch in batches:
            if time.monotonic() - self.asked_at.get(path.stem, -ASK_AGAIN_S) >= ASK_AGAIN_S:
                self.asked_at[path.stem] = time.monotonic()
                self.collect(path, batch)

    def open_batches(self) -> list[tuple[Path, dict[str, Any]]]:
        """Open batches of this queue, and of runs that no longer exist; batches taken over here are not collected by
        other queues."""
        folder = self.kept.root / OPEN
        found = []
        for path in sorted(folder.glob("*.json")):
            with locked(folder / "lock"), suppress(FileNotFoundError):
                batch = json.loads(path.read_bytes())
                if batch["process"] != os.getpid() and not is_alive(int(batch["process"])):
                    batch |= {"process": os.getpid(), "inherited": True}
                    write_whole(path, batch)
                if batch["process"] == os.getpid():
                    found.append((path, batch))
        return found

    def send(self, paths: list[Path]) -> None:
        """Send one batch of these questions, as far as the budget allows."""
        from dcap.language.model.anthropic_api import connection, told_in_a_line

        queued: dict[str, dict[str, Any]] = {}
        for path in paths:
            question = json.loads(path.read_bytes())
            if self.kept.read(question["name"], path.stem) is not None:  # stored while the question was being queued
                path.unlink(missing_ok=True)
                continue
            try:
                booked = self.ledger.reserve(
                    question["model"], question["asked"]["question"], question["size"],
                    question["call"]["max_tokens"], BATCH_FACTOR,
                )  # fmt: skip
            except BudgetError as error:
                self.fail([path.stem], error)
                continue
            queued[path.stem] = question | {"booked": booked}
        if not queued:
            return
        requests: list[Any] = [{"custom_id": digest, "params": one["call"]} for digest, one in queued.items()]
        try:
            with told_in_a_line("the batch"):
                batch = connection().messages.batches.create(requests=requests)
        except LanguageError as error:
            if isinstance(error, RefusedError):
                for one in queued.values():
                    self.ledger.release(one["booked"])
            self.fail(queued, error)
            return
        questions = {
            digest: {name: one[name] for name in ("name", "model", "sample", "asked", "booked")}
            for digest, one in queued.items()
        }
        write_whole(self.kept.root / OPEN / f"{batch.id}.json", {"process": os.getpid(), "questions": questions})
        self.tell(f"batch {batch.id} of {len(queued)} questions sent")

    def collect(self, path: Path, batch: Mapping[str, Any]) -> None:
        """Keep the replies of a batch if it has ended."""
        from dcap.language.model.anthropic_api import connection, told_in_a_line

        questions, own = batch["questions"], not batch.get("inherited", False)
        try:
            with told_in_a_line("the batch"):
                if connection().messages.batches.retrieve(path.stem).processing_status != "ended":
                    return
                results = {one.custom_id: one.result for one in connection().messages.batches.results(path.stem)}
        except RefusedError as error:
            self.tell(f"batch {path.stem}: {error}; giving up")
            self.give_up(questions, error, own=own)
            path.unlink(missing_ok=True)
            return
        except LanguageError as error:
            self.tell(f"batch {path.stem}: {error}; retrying later")
            return
        for digest, question in questions.items():
            result = results.get(digest)
            message = reply_of(result)
            if message is None:
                self.give_up({digest: question}, LanguageError(f"{question['model']}: {why(result)}"), own=own)
            else:
                self.kept.write(question["name"], digest, question["asked"], message)
                self.book(digest, question, message, own=own)
            if own or message is not None:
                (self.folder / f"{digest}.json").unlink(missing_ok=True)
        path.unlink(missing_ok=True)
        self.tell(f"batch {path.stem}: {len(results)} replies")

    def book(self, digest: str, question: Mapping[str, Any], message: Message, *, own: bool) -> None:
        """Record the cost of a reply; a reply to a run that no longer exists is recorded again."""
        self.ledger.settle(
            question["booked"] if own else f"collected {question['booked']}",
            question["model"],
            question["asked"]["question"],
            message,
            how="batch",
            factor=BATCH_FACTOR,
            sample=question["sample"],
            digest=digest,
        )

    def give_up(self, questions: Mapping[str, Any], error: DcapError, *, own: bool) -> None:
        """Fail the questions that a batch of ours left open; those of a run that no longer exists are asked again."""
        if not own:
            return
        for question in questions.values():
            self.ledger.release(question["booked"])  # only replies are charged
        self.fail(questions, error)

    def fail(self, digests: Iterable[str], error: DcapError) -> None:
        """Tell the waiting questions that there will be no reply."""
        for digest in digests:
            write_whole(self.folder / f"{digest}.error", {"type": type(error).__name__, "message": str(error)})
            (self.folder / f"{digest}.json").unlink(missing_ok=True)


def bundles(paths: list[Path]) -> Iterator[list[Path]]:
    """Groups of questions, each small enough for a batch."""
    group: list[Path] = []
    size = 0
    for path in paths:
        if group and size + path.stat().st_size > MOST_BYTES:
            yield group
            group, size = [], 0
        group.append(path)
        size += path.stat().st_size
    if group:
        yield group


def reply_of(result: Any) -> Message | None:
    """The reply in a batch's result; None if there is no usable one."""
    from dcap.language.model.anthropic_api import well_formed

    if result is None or result.type != "succeeded":
        return None
    message = result.message.model_dump(mode="json", exclude_unset=True)
    return message if well_formed(message) else None


def why(result: Any) -> str:
    """Reason why a question of a batch has no reply."""
    if result is None:
        return "the batch ended without an answer to the question"
    if result.type == "errored":
        inner = getattr(result.error, "error", None)
        return f"the question failed: {getattr(inner, 'message', 'unknown error')}"
    told = {"expired": "expired before it was answered", "canceled": "was cancelled", "succeeded": "got no message"}
    return f"the question {told.get(result.type, f'came back as {result.type}')}"
