"""Anthropic's API through the official SDK: one question at once, or many in a batch.

The key comes from the environment only (the SDK reads ANTHROPIC_API_KEY, and ANTHROPIC_BASE_URL where another address
is wanted); it reaches no log, no artifact and no cache key. Rate limits, overload, 5xx and lost connections are tried
again by the SDK with growing pauses.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import anthropic

from language.ledger import Ledger
from language.payload import CACHED, Payload
from language.reply_folder import Message
from language.session import Session
from scene.errors import LanguageError

RETRIES = 5
"""Times the SDK tries again after a rate limit, an overload or a lost connection."""
TIMEOUT = 300.0
"""Longest wait for one answer [s]; a model may think before it answers."""
MAX_TOKENS = 8192
"""Longest answer, thoughts included; the largest reply (materials of 30 parts) takes about 1500."""
SHOWN = 300
"""Characters of a server's message that an error quotes."""


def ask_at_once(model: str, payload: Payload, session: Session) -> Message:
    """The API's reply to one call."""
    ledger = ledger_of(session)
    reservation = ledger.reserve(model, payload, MAX_TOKENS)
    try:
        with told_in_a_line(model):
            message = as_json(connection().messages.create(**call_of(model, payload)))
    except LanguageError:
        ledger.release(reservation)
        raise
    ledger.settle(reservation, model, payload.question, message, how="asked")
    return message


def ledger_of(session: Session, sample: str | None = None) -> Ledger:
    """The session's ledger."""
    path = Path(session.ledger) if session.ledger else None
    return Ledger(path, session.max_cost, session.sample if sample is None else sample)


def connection() -> anthropic.Anthropic:
    """The SDK's client for the present environment."""
    try:
        return _connection(*_access())
    except anthropic.AnthropicError as error:
        raise no_access(error) from None


def call_of(model: str, payload: Payload) -> dict[str, Any]:
    """The arguments of one call: the answer is one JSON object of the reply's form."""
    return {
        "model": model,
        "max_tokens": MAX_TOKENS,
        "system": [{"type": "text", "text": payload.system, **CACHED}],
        "messages": list(payload.messages),
        "output_config": {
            "format": {"type": "json_schema", "schema": anthropic.transform_schema(dict(payload.schema))}
        },
    }


def as_json(message: anthropic.types.Message) -> Message:
    """A reply as JSON, fit to be sent back as a turn."""
    return message.model_dump(mode="json", exclude_unset=True)


@contextmanager
def told_in_a_line(model: str) -> Iterator[None]:
    """Failures of the SDK as LanguageError in one line, without headers and key."""
    try:
        yield
    except anthropic.APIStatusError as error:
        raise LanguageError(f"{model} answered HTTP {error.status_code}: {message_of(error)}") from None
    except anthropic.APITimeoutError:
        raise LanguageError(f"{model} gave no answer within {TIMEOUT:.0f} s, {RETRIES + 1} times") from None
    except anthropic.APIError as error:
        raise LanguageError(f"{model} cannot be reached: {type(error).__name__}: {first_line(error)}") from None
    except (TypeError, anthropic.AnthropicError) as error:
        raise no_access(error) from None


def no_access(error: Exception) -> LanguageError:
    """What is said where the SDK finds no key, or cannot use what it found."""
    why = first_line(error) if any(_access()[:2]) else "there is no key"
    return LanguageError(f"no access to Anthropic: {why}; set ANTHROPIC_API_KEY")


def message_of(error: anthropic.APIStatusError) -> str:
    """The server's own words, without headers."""
    body = error.body
    inner = body.get("error") if isinstance(body, Mapping) else None
    return str(inner.get("message") if isinstance(inner, Mapping) else error.message)[:SHOWN]


def first_line(error: BaseException) -> str:
    """The first line of an error's text."""
    return (str(error).splitlines() or [""])[0]


def _access() -> tuple[str, ...]:
    """What decides the connection: tests and long processes may change it."""
    import os

    return tuple(
        os.environ.get(name, "") for name in ("ANTHROPIC_API_KEY", "ANTHROPIC_AUTH_TOKEN", "ANTHROPIC_BASE_URL")
    )


@cache
def _connection(*_: str) -> anthropic.Anthropic:
    return anthropic.Anthropic(max_retries=RETRIES, timeout=TIMEOUT)
