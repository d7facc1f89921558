"""The client for answers of a model, live or recorded: asks, checks, and asks again with the reason.

In: a question. Out: a reply that passed pydantic and its check against the request. An invalid answer is returned to
the model with the reason, a limited number of times; then the replies are set aside for a person to read, and the stage
fails.
"""

import json
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from dcap.language.model.ledger import Ledger, Usage
from dcap.language.model.payload import Payload, payload_of, rejection
from dcap.language.model.reply_folder import Message, ReplyFolder
from dcap.language.protocol.client import ClientName, Idle, LanguageConfig
from dcap.language.protocol.questions import Question, ReplyT, RequestT
from dcap.language.protocol.session import MAX_TOKENS, Session
from dcap.scene.errors import InputError, LanguageError

ATTEMPTS = 3
"""Number of attempts at a question before an invalid answer becomes an error."""
AT_A_TIME = 4
"""Maximum number of questions of one stage in progress at a time."""
MOST_IN_A_BATCH = 256
"""The same for questions that wait for a batch: the threads only sleep."""
CUT_OFF = "max_tokens"
"""Stop reason of a reply that was cut off."""
SHOWN = 300
"""Maximum length of a bad answer in an error [characters]."""

Send = Callable[[Payload, Idle], Message]
"""Sends one call and returns the reply to a question; `Idle` is entered while it waits for a batch."""


@dataclass(frozen=True, slots=True)
class ModelClient:
    """Asks one model through `send`."""

    model: str
    send: Send
    reject: Callable[[Sequence[str]], Path | None]
    """Sets aside the replies to these questions for a person; returns their folder, or None if nothing was stored."""
    batched: bool = False
    """Whether questions wait for a batch."""
    max_tokens: int = MAX_TOKENS
    """Maximum length of an answer before the first cut-off."""
    idle: Idle = nullcontext
    """Entered while a question waits for a batch."""

    def ask(self, question: Question[RequestT, ReplyT], request: RequestT) -> ReplyT:
        """The answer, after at most ATTEMPTS attempts."""
        payload = payload_of(question, request)
        sent: list[str] = []
        problem = answer = ""
        for _ in range(ATTEMPTS):
            message = self.send(payload, self.idle)
            sent.append(payload.digest)
            if message.get("stop_reason") == "refusal":
                raise LanguageError(f"{self.model} refused to answer the question {question.name!r}{self._aside(sent)}")
            answer = text_of(message)
            if message.get("stop_reason") == CUT_OFF:
                problem = f"the answer was cut off after {written(message)} tokens, thoughts included (--max-tokens)"
                more = payload.with_more_room()
                if more.tokens(self.max_tokens) == payload.tokens(self.max_tokens):
                    raise LanguageError(f"{self.model}: {problem}; longer answers are not requested{self._aside(sent)}")
                payload = more
                continue
            try:
                return question.parsed(json_of(answer), request)
            except ValueError as error:
                problem = reason_of(error)
            payload = payload.followed_by(*turn_of(message), rejection(problem))
        raise LanguageError(
            f"{self.model} gave {ATTEMPTS} invalid answers to {question.name!r}, last: {problem}; "
            f"{' '.join(answer.split())[:SHOWN]}{self._aside(sent)}"
        )

    def ask_all(self, question: Question[RequestT, ReplyT], requests: Sequence[RequestT]) -> list[ReplyT]:
        """Answers to several questions at a time, in a batch to all at once; the first failure ends it."""
        if len(requests) < 2:
            return [self.ask(question, request) for request in requests]
        at_once = min(len(requests), MOST_IN_A_BATCH if self.batched else AT_A_TIME)
        # in a batch all wait together: the slot is lent once here, not by each thread
        waiting = replace(self, idle=nullcontext)
        with self.idle() if self.batched else nullcontext(), ThreadPoolExecutor(at_once) as pool:
            tasks = [pool.submit(waiting.ask, question, one) for one in requests]
            try:
                return [task.result() for task in tasks]
            except BaseException:
                pool.shutdown(wait=False, cancel_futures=True)  # questions not yet started are not asked
                raise

    def _aside(self, digests: Sequence[str]) -> str:
        path = self.reject(digests)
        return "" if path is None else f"; the reply is kept in {path}"


def model_client(config: LanguageConfig, session: Session, idle: Idle = nullcontext) -> ModelClient:
    """The client for a model in this session: the API together with stored replies, or a recording."""
    if config.client is ClientName.REPLAY:
        replay = replayed(config.source, session)
        return ModelClient(config.model, replay, lambda _: None, max_tokens=session.max_tokens)
    kept = ReplyFolder(session.kept_folder)
    return ModelClient(
        config.model,
        kept_or_asked(config, session, kept),
        lambda digests: kept.reject(config.source, digests),
        bool(session.batch),
        session.max_tokens,
        idle,
    )


def replayed(name: str, session: Session) -> Send:
    """Answers only from a recording."""
    folder = ReplyFolder(Path(session.replay))

    def send(payload: Payload, idle: Idle) -> Message:
        if not session.replay:
            raise InputError("--language replay needs --replay DIR, a folder that --record DIR has written")
        message = folder.read(name, payload.digest)
        if message is None:
            raise LanguageError(
                f"{folder.root} has no reply of {name} to this question {payload.question!r} ({payload.digest[:12]}): "
                "scene, prompt, pictures or our templates have changed since; record it again, with the "
                "--language that it was recorded with and --record"
            )
        return message

    return send


def kept_or_asked(config: LanguageConfig, session: Session, kept: ReplyFolder) -> Send:
    """Answers from stored replies, else from the API; every reply used is added to the recording."""
    from dcap.language.model.apis import APIS
    from dcap.language.model.batch import ask_in_batch

    name, model, api = config.source, config.model, APIS[config.client]
    recording = ReplyFolder(Path(session.record)) if session.record else None

    def send(payload: Payload, idle: Idle) -> Message:
        message = None if session.fresh else kept.read(name, payload.digest)
        if message is not None:
            note_kept(model, payload, message, session)
        elif api.endpoint() != config.endpoint:
            raise InputError(
                f"the run asks {config.endpoint or 'the usual address'}, but ${api.address_variable} now names "
                f"{api.endpoint() or 'none'}; set it back, or start a new run"
            )
        elif session.batch:
            message = ask_in_batch(config, payload, session, kept, idle)
        else:
            message = api.ask_at_once(config, payload, session)
            kept.keep(name, payload, message)
        if recording is not None:
            recording.keep(name, payload, message)
        return message

    return send


def note_kept(model: str, payload: Payload, message: Message, session: Session) -> None:
    """Record a stored reply, which costs nothing, in the ledger."""
    ledger = Ledger(Path(session.ledger) if session.ledger else None, sample=session.sample)
    ledger.settle("", model, payload.question, message, how="kept", digest=payload.digest)


def written(message: Message) -> int:
    """Number of tokens written by a model, including thoughts."""
    return Usage.of(message).output_tokens


def turn_of(message: Message) -> list[dict[str, Any]]:
    """A reply as a turn of the conversation, up to its last text: the API rejects turns that end in a thought, and
    empty turns or texts."""
    content = [one for one in message.get("content", []) if one.get("type") != "text" or one["text"].strip()]
    while content and content[-1].get("type") != "text":
        content.pop()
    return [{"role": "assistant", "content": content}] if content else []


def text_of(message: Message) -> str:
    """Text of a model's message, without its thinking."""
    return "".join(block.get("text", "") for block in message.get("content", []) if block.get("type") == "text")


def json_of(text: str) -> Any:
    """An answer as JSON; raises ValueError if it is not JSON."""
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:  # the latter for thousands of nested brackets
        raise ValueError(f"the answer is not one JSON object ({error})") from None


def reason_of(error: ValueError) -> str:
    """Reason of an error, in one line."""
    if isinstance(error, ValidationError):
        first = error.errors()[0]
        return f"{'.'.join(str(part) for part in first['loc']) or 'answer'}: {first['msg']}"
    return str(error)
