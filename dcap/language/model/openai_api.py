"""OpenAI's chat completions through the official SDK, for any compatible server, including a local vLLM or Ollama.

An extra: `pip install 'dcap[openai]'`. The key only comes from the environment (OPENAI_API_KEY; your own server,
OPENAI_BASE_URL, may need none). A completion is stored as received, together with the form of the Messages API in which
the rest of this package reads replies, so that ledger, stored replies and recordings are the same for both. The SDK
retries after a rate limit, an overload or a lost connection.
"""

import importlib.util
import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from typing import TYPE_CHECKING, Any

from dcap.language.model.anthropic_api import (
    RETRIES,
    address_name,
    failed,
    message_of,
    one_line,
    unanswered,
    unreachable,
)
from dcap.language.model.payload import Payload
from dcap.language.model.reply_folder import Message
from dcap.language.protocol.client import LanguageConfig
from dcap.language.protocol.session import TIMEOUT, Session
from dcap.scene.errors import InputError, LanguageError, RefusedError

if TYPE_CHECKING:
    import openai

USUAL = "api.openai.com-v1"
"""Default address of the SDK, in the form of `endpoint`."""
NO_KEY = "none"
"""Key sent to a server that needs none, because the SDK requires one."""
CUT_OFF, FILTERED = "length", "content_filter"
"""Finish reasons that make a completion unusable."""


def reply_of(config: LanguageConfig, payload: Payload, session: Session) -> Message:
    """The server's reply to one call."""
    with told_in_a_line(config.model, payload.room * session.timeout):
        api = connection().with_options(timeout=payload.room * session.timeout)
        raw = api.chat.completions.with_raw_response.create(**call_of(config, payload, session))
    return as_message(config.model, raw.text)


def endpoint() -> str:
    """Address of the API if it is not the default, usable in a file name; empty for the default."""
    name = address_name(os.environ.get("OPENAI_BASE_URL", ""))
    return "" if name == USUAL else name


def check_installed() -> None:
    """Raise InputError if the SDK is not installed."""
    if importlib.util.find_spec("openai") is None:
        raise InputError(
            "--language openai needs the library openai, which is not installed: `pip install 'dcap[openai]'`"
        )


def connection() -> "openai.OpenAI":
    """The SDK's client for the current environment; raises RefusedError without a key for the default address."""
    check_installed()
    key = os.environ.get("OPENAI_API_KEY", "")
    if not key and not endpoint():
        raise RefusedError(
            "no access to OpenAI: there is no key; set OPENAI_API_KEY, or OPENAI_BASE_URL for a server of your own"
        )
    return _connection(key or NO_KEY, os.environ.get("OPENAI_BASE_URL", ""))


def call_of(config: LanguageConfig, payload: Payload, session: Session) -> dict[str, Any]:
    """The arguments of one call, whose answer is a JSON object of the reply's schema."""
    form = {"name": payload.question, "strict": True, "schema": payload.schema}
    effort = {"reasoning_effort": config.effort} if config.effort else {}
    return {
        "model": config.model,
        "messages": [{"role": "system", "content": payload.system}, *map(turn_of, payload.messages)],
        "response_format": {"type": "json_schema", "json_schema": form},
        # many servers only know the older name, which the default server no longer accepts
        ("max_tokens" if endpoint() else "max_completion_tokens"): payload.tokens(session.max_tokens),
        **effort,
    }


def turn_of(message: Mapping[str, Any]) -> dict[str, Any]:
    """A turn of the conversation; a model's turn only contains its text."""
    if message["role"] == "assistant":
        return {"role": "assistant", "content": "".join(block.get("text", "") for block in message["content"])}
    return {"role": message["role"], "content": [part_of(block) for block in message["content"]]}


def part_of(block: Mapping[str, Any]) -> dict[str, Any]:
    """A text, or a picture as a data URL."""
    if block["type"] == "text":
        return {"type": "text", "text": block["text"]}
    source = block["source"]
    return {"type": "image_url", "image_url": {"url": f"data:{source['media_type']};base64,{source['data']}"}}


def as_message(model: str, text: str) -> Message:
    """A completion in the form of the Messages API, with the completion itself; raises LanguageError for anything
    else."""
    try:
        completion = json.loads(text)
        choice = completion["choices"][0]
        said, refusal = choice["message"].get("content"), choice["message"].get("refusal")
        if not isinstance(said, str | None):
            raise TypeError("content")
        usage = usage_of(completion.get("usage") or {})
    except (RecursionError, ValueError, LookupError, TypeError, AttributeError):
        raise LanguageError(f"{model} sent something that is not a completion: {one_line(text)}") from None
    ended = choice.get("finish_reason")
    stop = "refusal" if refusal or ended == FILTERED else "max_tokens" if ended == CUT_OFF else "end_turn"
    content = [{"type": "text", "text": said}] if said else []
    return {"role": "assistant", "content": content, "stop_reason": stop, "usage": usage, "completion": completion}


def usage_of(told: Mapping[str, Any]) -> dict[str, int]:
    """Token counts under the names of the Messages API, where tokens read from a cache are not part of the input."""
    cached = int((told.get("prompt_tokens_details") or {}).get("cached_tokens") or 0)
    return {
        "input_tokens": int(told.get("prompt_tokens") or 0) - cached,
        "cache_read_input_tokens": cached,
        "output_tokens": int(told.get("completion_tokens") or 0),
    }


@contextmanager
def told_in_a_line(model: str, timeout: float) -> Iterator[None]:
    """Turn failures of the SDK into a one-line LanguageError, without headers and key; RefusedError: nothing was
    done."""
    check_installed()
    import openai

    try:
        yield
    except openai.APIStatusError as error:
        raise failed(model, error.status_code, message_of(error.body, error.message)) from None
    except openai.APITimeoutError:
        raise unanswered(model, timeout) from None
    except openai.APIError as error:
        raise unreachable(model, error, "OPENAI_BASE_URL") from None
    except openai.OpenAIError as error:
        raise RefusedError(f"no access to OpenAI: {one_line(str(error))}") from None


@cache
def _connection(key: str, address: str) -> "openai.OpenAI":
    import openai

    return openai.OpenAI(api_key=key, base_url=address or None, max_retries=RETRIES, timeout=TIMEOUT)
