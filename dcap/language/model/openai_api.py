"""OpenAI's chat completions through the official SDK, for any server that speaks them: a local vLLM or Ollama too.

An extra: `pip install 'dcap[openai]'`. The key comes from the environment only (OPENAI_API_KEY; a server of one's own,
OPENAI_BASE_URL, may need none). A completion is kept as it came, along with the form of the Messages API in which the
rest of this package reads replies, so that ledger, kept replies and recordings are the same for both. A rate limit, an
overload or a lost connection is tried again by the SDK.
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
"""Where the SDK asks unless told otherwise, as `endpoint` would name it."""
NO_KEY = "none"
"""Sent where a server of one's own wants no key; the SDK insists on one."""
CUT_OFF, FILTERED = "length", "content_filter"
"""Reasons for which a completion has ended that make it unusable."""


def reply_of(config: LanguageConfig, payload: Payload, session: Session) -> Message:
    """The server's reply to one call."""
    with told_in_a_line(config.model, payload.room * session.timeout):
        api = connection().with_options(timeout=payload.room * session.timeout)
        raw = api.chat.completions.with_raw_response.create(**call_of(config, payload, session))
    return as_message(config.model, raw.text)


def endpoint() -> str:
    """Address that is asked where it is not the usual one, fit for a file name; empty for the usual one."""
    name = address_name(os.environ.get("OPENAI_BASE_URL", ""))
    return "" if name == USUAL else name


def check_installed() -> None:
    """InputError if the SDK is not there."""
    if importlib.util.find_spec("openai") is None:
        raise InputError(
            "--language openai needs the library openai, which is not installed: `pip install 'dcap[openai]'`"
        )


def connection() -> "openai.OpenAI":
    """The SDK's client for the present environment; RefusedError without a key for the usual address."""
    check_installed()
    key = os.environ.get("OPENAI_API_KEY", "")
    if not key and not endpoint():
        raise RefusedError(
            "no access to OpenAI: there is no key; set OPENAI_API_KEY, or OPENAI_BASE_URL for a server of your own"
        )
    return _connection(key or NO_KEY, os.environ.get("OPENAI_BASE_URL", ""))


def call_of(config: LanguageConfig, payload: Payload, session: Session) -> dict[str, Any]:
    """The arguments of one call: the answer is one JSON object of the reply's form."""
    form = {"name": payload.question, "strict": True, "schema": payload.schema}
    effort = {"reasoning_effort": config.effort} if config.effort else {}
    return {
        "model": config.model,
        "messages": [{"role": "system", "content": payload.system}, *map(turn_of, payload.messages)],
        "response_format": {"type": "json_schema", "json_schema": form},
        # the older name is all that many servers know, and what the usual one no longer takes
        ("max_tokens" if endpoint() else "max_completion_tokens"): payload.tokens(session.max_tokens),
        **effort,
    }


def turn_of(message: Mapping[str, Any]) -> dict[str, Any]:
    """A turn of the conversation: what a model said as its text alone."""
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
    """A completion in the form of the Messages API, with the completion itself; LanguageError if it is none."""
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
    """Tokens under the Messages API's names: there, what came from a cache is no part of the input."""
    cached = int((told.get("prompt_tokens_details") or {}).get("cached_tokens") or 0)
    return {
        "input_tokens": int(told.get("prompt_tokens") or 0) - cached,
        "cache_read_input_tokens": cached,
        "output_tokens": int(told.get("completion_tokens") or 0),
    }


@contextmanager
def told_in_a_line(model: str, timeout: float) -> Iterator[None]:
    """Failures of the SDK as LanguageError in one line, without headers and key; RefusedError: nothing was done."""
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
