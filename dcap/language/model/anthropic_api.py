"""Anthropic's API through the official SDK: one question at a time; dcap/language/model/batch.py sends many.

The key only comes from the environment (the SDK reads ANTHROPIC_API_KEY, and ANTHROPIC_BASE_URL for another address);
it reaches no log, no artifact and no cache key. The SDK retries after rate limits, overload, 5xx and lost connections,
with growing pauses. It is imported on first use, as that takes a second.
"""

import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from dcap.language.model.payload import Payload
from dcap.language.model.reply_folder import Message
from dcap.language.protocol.client import LanguageConfig
from dcap.language.protocol.session import TIMEOUT, Session
from dcap.scene.errors import LanguageError, RefusedError
from dcap.scene.secrets import redacted_url

if TYPE_CHECKING:
    import anthropic

USUAL = "api.anthropic.com"
"""Default address of the SDK."""
RETRIES = 5
"""Number of retries of the SDK after a rate limit, an overload or a lost connection."""
PICTURE_TOKENS = 5000
"""Upper bound of the tokens of a picture: the API documents width x height / 750, and ours have at most 960 x 720
pixels."""
PASSING = (408, 409, 429)
"""Client errors that may be temporary; it is not documented whether such a call is charged."""
SHOWN = 300
"""Maximum length of a server's message in an error [characters]."""


def reply_of(config: LanguageConfig, payload: Payload, session: Session) -> Message:
    """The API's reply to one call."""
    with told_in_a_line(config.model, payload.room * session.timeout):
        api = connection().with_options(timeout=payload.room * session.timeout)
        raw = api.messages.with_raw_response.create(**call_of(config, payload, session))
    return as_message(config.model, raw.http_response.text)


def size_of(payload: Payload) -> int:
    """Upper bound of the tokens of a call: the bytes of its text, and the maximum for each picture."""
    return payload.bytes + PICTURE_TOKENS * payload.pictures


def endpoint() -> str:
    """Address of the API if it is not the default, usable in a file name; empty for the default."""
    name = address_name(os.environ.get("ANTHROPIC_BASE_URL", ""))
    return "" if name == USUAL.replace(":", "-") else name


def address_name(url: str) -> str:
    """Host, port and path of an address, without a password, usable in a file name."""
    parts = urlsplit(url)
    address = parts.netloc.rpartition("@")[2] + parts.path.rstrip("/")
    return address.replace(":", "-").replace("/", "-")


def connection() -> "anthropic.Anthropic":
    """The SDK's client for the current environment."""
    import anthropic

    try:
        return _connection(*_access())
    except anthropic.AnthropicError as error:
        raise no_access(error) from None


def call_of(config: LanguageConfig, payload: Payload, session: Session) -> dict[str, Any]:
    """The arguments of one call, whose answer is a JSON object of the reply's schema."""
    effort = {"effort": config.effort} if config.effort else {}
    return {
        "model": config.model,
        "max_tokens": payload.tokens(session.max_tokens),
        "system": [{"type": "text", "text": payload.system}],
        "messages": list(payload.messages),
        "output_config": {"format": {"type": "json_schema", "schema": payload.schema}, **effort},
    }


def as_message(model: str, text: str) -> Message:
    """A reply as received; raises LanguageError if it is not a message."""
    try:
        message = json.loads(text)
    except (ValueError, RecursionError):
        message = None
    if not well_formed(message):
        raise LanguageError(f"{model} sent something that is not a message: {one_line(text)}")
    return dict(message)


def well_formed(message: object) -> bool:
    """Return whether an object is a message with a list of blocks, and with text in its text blocks."""
    if not isinstance(message, Mapping) or not isinstance(message.get("content"), list):
        return False
    blocks = message["content"]
    return all(
        isinstance(block, Mapping) and (block.get("type") != "text" or isinstance(block.get("text"), str))
        for block in blocks
    )


@contextmanager
def told_in_a_line(model: str, timeout: float | None = None) -> Iterator[None]:
    """Turn failures of the SDK into a one-line LanguageError, without headers and key; RefusedError: nothing was
    done."""
    import anthropic

    try:
        yield
    except anthropic.APIStatusError as error:
        raise failed(model, error.status_code, message_of(error.body, error.message)) from None
    except anthropic.APITimeoutError:
        raise unanswered(model, timeout) from None
    except anthropic.APIError as error:
        raise unreachable(model, error, "ANTHROPIC_BASE_URL") from None
    except anthropic.AnthropicError as error:
        raise no_access(error) from None
    except TypeError as error:
        if "authentication" not in str(error):
            raise
        raise no_access(error) from None


def no_access(error: Exception) -> RefusedError:
    """Error if the SDK finds no key, or cannot use the key that it found."""
    why = one_line(str(error)) if any(_access()[:2]) else "there is no key"
    return RefusedError(f"no access to Anthropic: {why}; set ANTHROPIC_API_KEY")


def failed(model: str, status: int, said: str) -> LanguageError:
    """Error of a call by its HTTP status; RefusedError: nothing was done."""
    refused = 400 <= status < 500 and status not in PASSING
    return (RefusedError if refused else LanguageError)(f"{model} answered HTTP {status}: {said}")


def unanswered(model: str, timeout: float | None) -> LanguageError:
    """Error of a call whose attempts all timed out; None: the limit was not set by the user."""
    waited = f"{TIMEOUT:g} s" if timeout is None else f"{timeout:g} s (--reply-timeout)"
    return LanguageError(f"{model} gave no answer within {waited}, {RETRIES + 1} times")


def unreachable(model: str, error: Exception, variable: str) -> LanguageError:
    """Error of a call that never reached the server, whose address may come from an environment variable."""
    given = os.environ.get(variable, "")
    address = f"{redacted_url(given)} ({variable})" if given else f"the usual address ({variable} names another)"
    return LanguageError(f"{model} cannot be reached at {address}: {one_line(str(error))}")


def message_of(body: object, otherwise: str) -> str:
    """The message of the server, without headers; an SDK may already have extracted it from `error`."""
    inner = body.get("error", body) if isinstance(body, Mapping) else None
    said = inner.get("message") if isinstance(inner, Mapping) else inner
    return one_line(str(said or otherwise))


def one_line(text: str) -> str:
    """The beginning of a text, in one line."""
    return " ".join(text.split())[:SHOWN]


def _access() -> tuple[str, ...]:
    """Environment values that determine the connection: tests and long processes may change them."""
    names = ("ANTHROPIC_API_KEY", "ANTHROPIC_AUTH_TOKEN", "ANTHROPIC_BASE_URL")
    return tuple(os.environ.get(name, "") for name in names)


@cache
def _connection(*_: str) -> "anthropic.Anthropic":
    import anthropic

    return anthropic.Anthropic(max_retries=RETRIES, timeout=TIMEOUT)
