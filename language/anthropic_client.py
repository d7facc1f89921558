"""The client that asks a model of Anthropic through the official SDK.

In: a request. Out: a reply that passed pydantic and its own `check`. The model must answer with one tool call; an
answer that is invalid goes back with the reason, a bounded number of times. Text of scenes and prompts travels as
JSON inside a data block, so it can neither close the block nor pick what is not listed. The key comes from the
environment only (the SDK reads ANTHROPIC_API_KEY, and ANTHROPIC_BASE_URL where another address is wanted) and is
never logged.
"""

import base64
import io
import json
from dataclasses import fields, is_dataclass
from functools import cache
from typing import Any, TypeAlias, TypeVar

import anthropic
import jinja2
import numpy as np
from anthropic.types import MessageParam, TextBlockParam, ToolParam, ToolUseBlock
from numpy.typing import NDArray
from PIL import Image
from pydantic import BaseModel, ValidationError

from language.replies import AnchorReply, IntentReply, LabelReply, MaterialsReply, PartsReply, RotationReply
from language.requests import (
    AnchorRequest,
    IntentRequest,
    LabelRequest,
    MaterialsRequest,
    PartsRequest,
    PictureMaker,
    RotationRequest,
)
from scene.errors import LanguageError
from scene.settings import PROJECT_ROOT

PROMPTS = "prompts"
TOOL = "answer"
ATTEMPTS = 3
"""Times a question is asked before an invalid answer becomes an error."""
RETRIES = 4
"""Times the SDK tries again after a rate limit, an overload or a lost connection, with growing pauses."""
TIMEOUT = 120.0
"""Longest wait for one answer [s]."""
MAX_TOKENS = 2048
"""Longest answer; the largest reply (materials of 30 parts) takes about 1500."""
SHOWN = 300
"""Characters of a bad reply that an error quotes."""

Request: TypeAlias = IntentRequest | RotationRequest | AnchorRequest | MaterialsRequest | LabelRequest | PartsRequest
Reply = TypeVar("Reply", IntentReply, RotationReply, AnchorReply, MaterialsReply, LabelReply, PartsReply)


class AnthropicClient:
    """Asks one model; holds the connection."""

    def __init__(self, model: str) -> None:
        self.model = model
        try:
            self._connection = anthropic.Anthropic(max_retries=RETRIES, timeout=TIMEOUT)
        except anthropic.AnthropicError as error:
            raise LanguageError(f"no access to Anthropic: {error}; set ANTHROPIC_API_KEY") from None

    def intent(self, request: IntentRequest) -> IntentReply:
        """Which base, how big, how heavy, which orientation and region."""
        return self._ask("intent", request, IntentReply)

    def rotation(self, request: RotationRequest) -> RotationReply:
        """Which rotation, judged from three pictures."""
        return self._ask("rotation", request, RotationReply)

    def anchor(self, request: AnchorRequest) -> AnchorReply:
        """Which part and where on it."""
        return self._ask("anchor", request, AnchorReply)

    def materials(self, request: MaterialsRequest) -> MaterialsReply:
        """Which row of the library for each part."""
        return self._ask("materials", request, MaterialsReply)

    def label(self, request: LabelRequest) -> LabelReply:
        """What a thing is, judged from its measures and two pictures."""
        return self._ask("label", request, LabelReply)

    def parts(self, request: PartsRequest) -> PartsReply:
        """What the parts of a thing are called, judged from their measures and one picture."""
        return self._ask("parts", request, PartsReply)

    def _ask(self, question: str, request: Request, kind: type[Reply]) -> Reply:
        """Ask until the answer is valid, at most ATTEMPTS times."""
        messages: list[MessageParam] = [{"role": "user", "content": content_of(question, request)}]
        problem, shown = "", ""
        for _ in range(ATTEMPTS):
            message = self._send(question, messages, kind)
            call = next((block for block in message.content if isinstance(block, ToolUseBlock)), None)
            if message.stop_reason == "refusal":
                raise LanguageError(f"{self.model} refused to answer the question {question!r}")
            if call is None:
                problem, shown = f"no call of the tool {TOOL!r}", str([b.type for b in message.content])
                messages += [{"role": "user", "content": f"Answer by calling the tool {TOOL}."}]
                continue
            try:
                return checked(kind, call.input, request)
            except ValueError as error:
                problem, shown = reason_of(error), json.dumps(call.input)[:SHOWN]
            messages += [{"role": "assistant", "content": [tool_use(call)]}, rejection(call, problem)]
        raise LanguageError(f"{self.model} gave {ATTEMPTS} invalid answers to {question!r}, last: {problem}; {shown}")

    def _send(self, question: str, messages: list[MessageParam], kind: type[BaseModel]) -> anthropic.types.Message:
        """One call of the API; its failures in one line."""
        system: TextBlockParam = {
            "type": "text",
            "text": template(f"{question}.system.j2").render(),
            "cache_control": {"type": "ephemeral"},
        }
        tool: ToolParam = {
            "name": TOOL,
            "description": f"Give the answer to the question about {question}.",
            "input_schema": kind.model_json_schema(),
        }
        try:
            return self._connection.messages.create(
                model=self.model,
                max_tokens=MAX_TOKENS,
                system=[system],
                messages=messages,
                tools=[tool],
                tool_choice={"type": "tool", "name": TOOL},
            )
        except anthropic.APIStatusError as error:
            raise LanguageError(f"{self.model} answered HTTP {error.status_code}: {message_of(error)}") from None
        except anthropic.APIError as error:
            raise LanguageError(f"{self.model} cannot be reached: {type(error).__name__}: {error}") from None
        except (TypeError, anthropic.AnthropicError) as error:
            reason = str(error).splitlines()[0]
            raise LanguageError(f"no access to Anthropic: {reason}; set ANTHROPIC_API_KEY") from None


def message_of(error: anthropic.APIStatusError) -> str:
    """The server's own words, without headers."""
    body = error.body
    inner = body.get("error") if isinstance(body, dict) else None
    return str(inner.get("message") if isinstance(inner, dict) else error.message)[:SHOWN]


def checked(kind: type[Reply], answer: object, request: Request) -> Reply:
    """The answer as a reply that fits the request; ValueError otherwise."""
    reply = kind.model_validate(answer)
    reply.check(request)  # type: ignore[arg-type]  # the methods pair each reply with its own request
    return reply


def reason_of(error: ValueError) -> str:
    """What is wrong, in one line."""
    if isinstance(error, ValidationError):
        first = error.errors()[0]
        return f"{'.'.join(str(part) for part in first['loc']) or 'answer'}: {first['msg']}"
    return str(error)


def tool_use(call: ToolUseBlock) -> Any:
    """The model's call as it goes back into the conversation."""
    return {"type": "tool_use", "id": call.id, "name": call.name, "input": call.input}


def rejection(call: ToolUseBlock, problem: str) -> MessageParam:
    """Why the answer cannot be used."""
    text = f"Not usable: {problem}. Answer again."
    return {
        "role": "user",
        "content": [{"type": "tool_result", "tool_use_id": call.id, "is_error": True, "content": text}],
    }


def content_of(question: str, request: Request) -> list[Any]:
    """The request as text and pictures."""
    pictures = [picture_block(make) for make in request.pictures]
    data = {name: plain(getattr(request, name)) for name in field_names(request) if name != "pictures"}
    text = template("data.j2").render(question=question, data=data)
    return [*pictures, {"type": "text", "text": text}]


def field_names(value: Any) -> list[str]:
    """Names of a dataclass's fields."""
    return [field.name for field in fields(value)]


def plain(value: object) -> object:
    """A value as JSON types; lengths to a tenth of a millimetre, so that rounding noise does not show."""
    if is_dataclass(value) and not isinstance(value, type):
        return {name: plain(getattr(value, name)) for name in field_names(value)}
    if isinstance(value, tuple | list):
        return [plain(one) for one in value]
    if isinstance(value, float):
        return float(f"{value:.4g}") if abs(value) >= 1e3 else round(value, 4)
    return value


def picture_block(make: PictureMaker) -> dict[str, object]:
    """A picture as the API takes it."""
    data = base64.standard_b64encode(png(make())).decode()
    return {"type": "image", "source": {"type": "base64", "media_type": "image/png", "data": data}}


def png(rgb: NDArray[np.uint8]) -> bytes:
    """An RGB picture as PNG bytes."""
    buffer = io.BytesIO()
    Image.fromarray(rgb).save(buffer, format="PNG")
    return buffer.getvalue()


@cache
def environment() -> jinja2.Environment:
    """Where the templates are; a name that is not given is an error."""
    return jinja2.Environment(
        loader=jinja2.FileSystemLoader(PROJECT_ROOT / PROMPTS),
        undefined=jinja2.StrictUndefined,
        autoescape=False,
        keep_trailing_newline=False,
    )


def template(name: str) -> jinja2.Template:
    """A template of the folder `prompts`."""
    return environment().get_template(name)
