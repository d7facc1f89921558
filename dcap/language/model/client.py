"""The client behind which a model answers, now or when it was recorded: asks, checks, and asks again with the reason.

In: a question. Out: a reply that passed pydantic and its check against the request. An answer that is invalid goes
back with the reason, a bounded number of times; then the replies are put aside for a person to read, and the stage
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
"""Times a question is asked before an invalid answer becomes an error."""
AT_A_TIME = 4
"""Questions of one stage that are under way together."""
MOST_IN_A_BATCH = 256
"""The same where they wait for a batch: threads that sleep."""
CUT_OFF = "max_tokens"
"""Why a reply ended that was cut off."""
SHOWN = 300
"""Characters of a bad answer that an error quotes."""

Send = Callable[[Payload, Idle], Message]
"""One call: the reply to a question; `Idle` is entered while it waits for a batch."""


@dataclass(frozen=True, slots=True)
class ModelClient:
    """Asks one model through `send`."""

    model: str
    send: Send
    reject: Callable[[Sequence[str]], Path | None]
    """Puts the replies to these questions aside for a person; their folder, None if nothing was kept."""
    batched: bool = False
    """Whether questions wait for a batch."""
    max_tokens: int = MAX_TOKENS
    """Longest answer before one was cut off."""
    idle: Idle = nullcontext
    """Entered while a question waits for a batch."""

    def ask(self, question: Question[RequestT, ReplyT], request: RequestT) -> ReplyT:
        """The answer, asked for at most ATTEMPTS times."""
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
                    raise LanguageError(
                        f"{self.model}: {problem}, and longer ones are not asked for{self._aside(sent)}"
                    )
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
        """Several at a time, in a batch all of them; the first that fails ends it."""
        if len(requests) < 2:
            return [self.ask(question, request) for request in requests]
        at_once = min(len(requests), MOST_IN_A_BATCH if self.batched else AT_A_TIME)
        # in a batch all wait together: the slot is lent once, here, and not again by each thread
        waiting = replace(self, idle=nullcontext)
        with self.idle() if self.batched else nullcontext(), ThreadPoolExecutor(at_once) as pool:
            tasks = [pool.submit(waiting.ask, question, one) for one in requests]
            try:
                return [task.result() for task in tasks]
            except BaseException:
                pool.shutdown(wait=False, cancel_futures=True)  # what has not begun is not asked
                raise

    def _aside(self, digests: Sequence[str]) -> str:
        path = self.reject(digests)
        return "" if path is None else f"; the reply is kept in {path}"


def model_client(config: LanguageConfig, session: Session, idle: Idle = nullcontext) -> ModelClient:
    """The client for a model in this session: the API behind what is kept, or a recording."""
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
    """Answers from a recording only."""
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
    """Answers from what is kept, else from the API; every reply that is used goes into the recording."""
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
    """A line for a reply that cost nothing this time."""
    ledger = Ledger(Path(session.ledger) if session.ledger else None, sample=session.sample)
    ledger.settle("", model, payload.question, message, how="kept", digest=payload.digest)


def written(message: Message) -> int:
    """Tokens that a model wrote, thoughts included."""
    return Usage.of(message).output_tokens


def turn_of(message: Message) -> list[dict[str, Any]]:
    """A reply as a turn of the conversation, up to its last text: the API takes no turn that ends in a thought, and no
    turn or text that is empty."""
    content = [one for one in message.get("content", []) if one.get("type") != "text" or one["text"].strip()]
    while content and content[-1].get("type") != "text":
        content.pop()
    return [{"role": "assistant", "content": content}] if content else []


def text_of(message: Message) -> str:
    """Text of a model's message, without its thinking."""
    return "".join(block.get("text", "") for block in message.get("content", []) if block.get("type") == "text")


def json_of(text: str) -> Any:
    """An answer as JSON; ValueError if it is none."""
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:  # the latter where brackets are nested by the thousand
        raise ValueError(f"the answer is not one JSON object ({error})") from None


def reason_of(error: ValueError) -> str:
    """Reason of an error, in one line."""
    if isinstance(error, ValidationError):
        first = error.errors()[0]
        return f"{'.'.join(str(part) for part in first['loc']) or 'answer'}: {first['msg']}"
    return str(error)
