"""Questions in batches, at half the price: stages lay them on a desk and wait, the desk sends what has gathered.

`ask_in_batch` (in a stage, whatever its process) writes a file to the desk's folder and waits for the reply. `Desk`
(in the process of the run) sends all waiting questions as one batch of the Message Batches API when none has come for
a while, and keeps each reply as soon as its batch has ended. A batch that was open when a run was killed is collected
by the next.
"""

import json
import shutil
import threading
import time
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from language.ledger import BATCH_FACTOR
from language.payload import Payload
from language.reply_folder import Message, ReplyFolder, write_whole
from language.session import Session, idling
from scene.errors import LanguageError

POLL_S = 0.2
"""How often waiting questions and the desk look at the folder [s]."""
QUIET_S = 5.0
"""A batch goes off when no question has come for so long [s]."""
ASK_AGAIN_S = 20.0
"""How often the API is asked whether a batch has ended [s]; they take minutes to hours."""
MOST_BYTES = 100_000_000
"""Largest batch; the API takes 256 MB."""
OPEN = "batches"
"""Folder of the open batches, beside the kept replies."""


def ask_in_batch(model: str, payload: Payload, session: Session, kept: ReplyFolder) -> Message:
    """Lay a question on the desk and wait for its reply."""
    from language.anthropic_api import MAX_TOKENS, call_of, ledger_of

    desk, digest = Path(session.batch), payload.digest
    ledger = ledger_of(session)
    reservation = ledger.reserve(model, payload, MAX_TOKENS, BATCH_FACTOR)
    asked = {"question": payload.question, **payload.readable()}
    write_whole(desk / f"{digest}.json", {"model": model, "call": call_of(model, payload), "asked": asked})
    try:
        with idling():
            message = waited_for(desk, kept, model, digest)
    except LanguageError:
        ledger.release(reservation)
        raise
    ledger.settle(reservation, model, payload.question, message, how="batch", factor=BATCH_FACTOR)
    return message


def waited_for(desk: Path, kept: ReplyFolder, model: str, digest: str) -> Message:
    """The reply, once the desk has kept it."""
    failed, closed = desk / f"{digest}.error", desk / "closed"
    while True:
        message = kept.read(model, digest)
        if message is not None:
            return message
        if failed.is_file():
            text = failed.read_text()
            failed.unlink(missing_ok=True)  # the next run may ask again
            raise LanguageError(text)
        if closed.is_file():
            raise LanguageError(f"the batch desk has closed: {closed.read_text() or 'the run has ended'}")
        time.sleep(POLL_S)


@contextmanager
def batch_desk(folder: Path, session: Session, tell: Callable[[str], None] = lambda text: None) -> Iterator[None]:
    """A desk for the questions that are asked in this block."""
    for old in folder.glob("*"):
        old.unlink()
    folder.mkdir(parents=True, exist_ok=True)
    desk = Desk(folder, ReplyFolder(session.kept_folder), tell)
    thread = threading.Thread(target=desk.serve, name="batch desk", daemon=True)
    thread.start()
    try:
        yield
    finally:
        desk.stopped.set()
        thread.join(timeout=5.0)
    shutil.rmtree(folder, ignore_errors=True)  # nobody waits any more


@dataclass(slots=True)
class Desk:
    """Sends what waits in its folder, batch by batch."""

    folder: Path
    kept: ReplyFolder
    tell: Callable[[str], None]
    stopped: threading.Event = field(default_factory=threading.Event)
    asked_at: dict[str, float] = field(default_factory=dict)
    """When the API was last asked about each open batch [s of the monotonic clock]."""

    def serve(self) -> None:
        """Work until stopped; whatever ends it is told to those who wait."""
        reason = ""
        try:
            while not self.stopped.wait(POLL_S):
                self.step()
        except Exception as error:  # told to every waiting question, which raises it in its own sample
            reason = f"{type(error).__name__}: {error}"
        finally:
            (self.folder / "closed").write_text(reason)

    def step(self) -> None:
        """Send what has gathered, collect what has ended."""
        waiting = sorted(self.folder.glob("*.json"))
        if waiting and time.time() - max(path.stat().st_mtime for path in waiting) >= QUIET_S:
            for model, paths in grouped(waiting):
                self.send(model, paths)
        for path in sorted((self.kept.root / OPEN).glob("*.json")):
            if time.monotonic() - self.asked_at.get(path.stem, -ASK_AGAIN_S) >= ASK_AGAIN_S:
                self.asked_at[path.stem] = time.monotonic()
                self.collect(path)

    def send(self, model: str, paths: list[Path]) -> None:
        """One batch of these questions."""
        from language.anthropic_api import connection, told_in_a_line

        calls = {path.stem: json.loads(path.read_bytes()) for path in paths}
        requests: list[Any] = [{"custom_id": digest, "params": call["call"]} for digest, call in calls.items()]
        try:
            with told_in_a_line(model):
                batch = connection().messages.batches.create(requests=requests)
        except LanguageError as error:
            self.fail(calls, str(error))
            return
        told = {digest: {"model": model, "asked": call["asked"]} for digest, call in calls.items()}
        write_whole(self.kept.root / OPEN / f"{batch.id}.json", told)
        for path in paths:
            path.unlink()
        self.tell(f"batch {batch.id} of {len(calls)} questions sent")

    def collect(self, path: Path) -> None:
        """Keep the replies of a batch if it has ended."""
        from language.anthropic_api import connection, told_in_a_line

        told = json.loads(path.read_bytes())
        try:
            with told_in_a_line("the batch"):
                batch = connection().messages.batches.retrieve(path.stem)
                if batch.processing_status != "ended":
                    return
                results = list(connection().messages.batches.results(path.stem))
        except LanguageError as error:
            self.tell(f"batch {path.stem}: {error}; it is asked for again")
            return
        for one in results:
            digest = one.custom_id
            if one.result.type == "succeeded":
                message = one.result.message.model_dump(mode="json", exclude_unset=True)
                self.kept.write(told[digest]["model"], digest, told[digest]["asked"], message)
            else:
                self.fail([digest], f"{told[digest]['model']}: the question {why(one.result)}")
        missing = told.keys() - {one.custom_id for one in results}
        self.fail(missing, "the batch ended without an answer to the question")
        path.unlink()
        self.tell(f"batch {path.stem}: {len(results)} replies")

    def fail(self, digests: Any, reason: str) -> None:
        """Tell those who wait that there will be no reply."""
        for digest in digests:
            (self.folder / f"{digest}.json").unlink(missing_ok=True)
            draft = self.folder / f".{uuid.uuid4().hex[:8]}"
            draft.write_text(reason)
            draft.replace(self.folder / f"{digest}.error")


def grouped(paths: list[Path]) -> Iterator[tuple[str, list[Path]]]:
    """Questions by model, none of the groups too large for a batch."""
    groups: dict[str, list[Path]] = {}
    sizes: dict[str, int] = {}
    for path in paths:
        model = str(json.loads(path.read_bytes())["model"])
        size = path.stat().st_size
        if sizes.get(model, 0) + size > MOST_BYTES and groups.get(model):
            yield model, groups.pop(model)
            sizes[model] = 0
        groups.setdefault(model, []).append(path)
        sizes[model] = sizes.get(model, 0) + size
    yield from groups.items()


def why(result: Any) -> str:
    """Why a question of a batch has no reply."""
    if result.type == "errored":
        inner = getattr(result.error, "error", None)
        return f"failed: {getattr(inner, 'message', 'unknown error')}"
    told = {"expired": "expired before it was answered", "canceled": "was cancelled"}
    return told.get(result.type, f"came back as {result.type}")
