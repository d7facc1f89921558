"""A question in the form of the Messages API: system text, data, pictures and the schema of the answer.

In: a question and its request. Out: a `Payload` whose digest covers everything that a model sees, and nothing else:
neither the model nor the key. Text of scenes and prompts is sent as JSON inside data blocks with `<` and `>` escaped,
so it can neither close its block nor pass for our own text.
"""

import base64
import hashlib
import io
import json
from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cache
from typing import Any

import jinja2
import numpy as np
from jinja2.sandbox import SandboxedEnvironment
from numpy.typing import NDArray
from PIL import Image
from pydantic import BaseModel

from dcap.language.protocol.questions import Question, ReplyT, RequestT
from dcap.language.protocol.requests import Picture
from dcap.language.protocol.session import MOST_TOKENS
from dcap.scene.settings import resource

PROMPTS = "prompts"
EXAMPLES, PICTURES = "examples", "pictures"
"""Fields of requests with pictures: the shared ones, and those of the request."""
CACHED = {"cache_control": {"type": "ephemeral"}}
"""Marks the end of a part of the prompt that the API should cache for the next question."""
CACHED_FROM = 16_000
"""Length of the beginning of a prompt from which it is worth caching [characters]: 4,096 tokens, the largest minimum of
any model."""
LIMITS = {
    "minimum": "at least {:g}",
    "exclusiveMinimum": "more than {:g}",
    "maximum": "at most {:g}",
    "minLength": "not empty",
    "maxLength": "at most {} characters",
    "minItems": "at least {} entries",
    "maxItems": "at most {} entries",
}
"""Keywords of JSON schema that grammars do not support, and their wording in a description."""

Block = Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Payload:
    """One call of the API, for any model."""

    question: str
    system: str
    messages: tuple[Mapping[str, Any], ...]
    schema: Mapping[str, Any]
    """JSON schema of the answer."""
    room: int = 1
    """Factor on the allowed length of the answer: 2 after an answer that was cut off."""

    @property
    def digest(self) -> str:
        """SHA-256 of everything that a model sees, with pictures by their pixels: 64 hex digits."""
        return hashlib.sha256(json.dumps(self.readable(), sort_keys=True).encode()).hexdigest()

    @property
    def bytes(self) -> int:
        """Length of the text, an upper bound of its tokens: a token has at least one byte."""
        return len(json.dumps(self.readable(), ensure_ascii=False).encode())

    @property
    def pictures(self) -> int:
        """Number of pictures."""
        return sum(block.get("type") == "image" for message in self.messages for block in message["content"])

    def readable(self) -> dict[str, Any]:
        """The payload for a person, with pictures given by the digest of their pixels, which does not depend on the PNG
        writer."""
        tree: dict[str, Any] = {"system": self.system, "messages": list(self.messages), "schema": self.schema}
        if self.room > 1:  # a different question, so that the reply that was cut off is not its answer
            tree["room"] = self.room
        found: dict[str, Any] = json.loads(json.dumps(tree))
        for message in found["messages"]:
            for block in message["content"]:
                if isinstance(block, dict) and block.get("type") == "image":
                    block["source"] = {"pixels_sha256": pixel_digest(block["source"]["data"])}
        return found

    def followed_by(self, *messages: Mapping[str, Any]) -> "Payload":
        """The conversation with more turns."""
        return replace(self, messages=(*self.messages, *messages))

    def with_more_room(self) -> "Payload":
        """The same conversation, for an answer of up to twice the length."""
        return replace(self, room=2 * self.room)

    def tokens(self, max_tokens: int) -> int:
        """Maximum length of the answer if `max_tokens` is the normal one [tokens]."""
        return max(max_tokens, min(self.room * max_tokens, MOST_TOKENS))


def payload_of(question: Question[RequestT, ReplyT], request: RequestT) -> Payload:
    """The first call for a request; makes its pictures."""
    own: dict[str, object] = {}
    shared: dict[str, object] = {}
    for name in field_names(request):
        if name not in (EXAMPLES, PICTURES, *question.unseen):
            (shared if name in question.shared else own)[name] = plain(getattr(request, name))
    system = template(f"{question.name}.system.j2").render()
    content: list[Block] = []
    if shared:
        text = data_text(question.name, shared)
        kept = CACHED if len(system) + len(text) >= CACHED_FROM else {}
        content.append({"type": "text", "text": text, **kept})
    examples = getattr(request, EXAMPLES, ())
    for number, one in enumerate((*examples, *getattr(request, PICTURES, ())), 1):
        kept = CACHED if number == len(examples) else {}
        content += [{"type": "text", "text": f"Picture {number}: {one.name}"}, {**picture_block(one), **kept}]
    content.append({"type": "text", "text": data_text(question.name, own)})
    return Payload(question.name, system, ({"role": "user", "content": content},), schema_of(question.reply))


def data_text(question: str, data: Mapping[str, object]) -> str:
    """Data in a data block."""
    return template("data.j2").render(question=question, data=data)


def rejection(reason: str) -> dict[str, Any]:
    """The turn that explains why an answer cannot be used; the reason is data, since it quotes names."""
    text = template("rejected.j2").render(reason=reason)
    return {"role": "user", "content": [{"type": "text", "text": text}]}


@cache
def schema_of(reply: type[BaseModel]) -> Mapping[str, Any]:
    """JSON schema of a reply, restricted to features that all APIs support. Every property is required, in the order of
    the class, so that earlier properties can determine later ones: an API refuses too many optional properties, and
    would write them last. Limits that grammars do not support are stated in descriptions."""
    schema = reply.model_json_schema()
    return strict_schema(schema, schema.get("$defs", {}))


def strict_schema(tree: Mapping[str, Any], definitions: Mapping[str, Any]) -> dict[str, Any]:
    """A part of a schema without references, defaults, titles and keywords of limits."""
    if "$ref" in tree:
        siblings = {name: value for name, value in tree.items() if name != "$ref"}
        return strict_schema({**definitions[tree["$ref"].rpartition("/")[2]], **siblings}, definitions)
    found = {name: tree[name] for name in ("type", "enum", "const") if name in tree}
    if "anyOf" in tree:
        found["anyOf"] = [strict_schema(one, definitions) for one in tree["anyOf"]]
    if tree.get("type") == "array":
        found["items"] = strict_schema(items_of(tree), definitions)
    if tree.get("type") == "object":
        properties = {name: strict_schema(one, definitions) for name, one in tree.get("properties", {}).items()}
        found |= {"properties": properties, "required": list(properties), "additionalProperties": False}
    limits = ", ".join(words.format(tree[name]) for name, words in LIMITS.items() if name in tree)
    said = "; ".join(filter(None, (tree.get("description", ""), limits)))
    return found | ({"description": said} if said else {})


def items_of(array: Mapping[str, Any]) -> Mapping[str, Any]:
    """Schema of the entries of an array; those of a fixed tuple must all be the same."""
    prefix = array.get("prefixItems")
    if prefix is None:
        items: Mapping[str, Any] = array["items"]
        return items
    if any(one != prefix[0] for one in prefix):
        raise TypeError(f"a tuple of different types cannot be asked for: {prefix}")
    first: Mapping[str, Any] = prefix[0]
    return first


def field_names(value: Any) -> list[str]:
    """Names of a dataclass's fields."""
    return [field.name for field in fields(value)]


def plain(value: object) -> object:
    """A value as JSON types; lengths are rounded to a tenth of a millimetre, so that rounding noise does not show."""
    if is_dataclass(value) and not isinstance(value, type):
        return {name: plain(getattr(value, name)) for name in field_names(value)}
    if isinstance(value, tuple | list):
        return [plain(one) for one in value]
    if isinstance(value, float):
        return float(f"{value:.4g}") if abs(value) >= 1e3 else round(value, 4)
    return value


def picture_block(one: Picture) -> dict[str, object]:
    """A picture in the form of the API."""
    data = base64.standard_b64encode(png(one.make())).decode()
    return {"type": "image", "source": {"type": "base64", "media_type": "image/png", "data": data}}


def pixel_digest(data: str) -> str:
    """SHA-256 of a picture's size and pixels, from its PNG in base64."""
    picture = np.asarray(Image.open(io.BytesIO(base64.standard_b64decode(data))))
    return hashlib.sha256(str(picture.shape).encode() + picture.tobytes()).hexdigest()


def png(rgb: NDArray[np.uint8]) -> bytes:
    """An RGB picture as PNG bytes."""
    buffer = io.BytesIO()
    Image.fromarray(rgb).save(buffer, format="PNG")
    return buffer.getvalue()


@cache
def environment() -> jinja2.Environment:  # noqa: TID251 -- the type of a sandboxed one
    """Environment of the templates, in which an undefined name is an error. User text is a value in them and never part
    of a template; sandboxed, no template can reach an attribute from which Python code could be run."""
    return SandboxedEnvironment(
        loader=jinja2.FileSystemLoader(resource(PROMPTS)),
        undefined=jinja2.StrictUndefined,
        autoescape=False,
        keep_trailing_newline=False,
    )


def template(name: str) -> jinja2.Template:  # noqa: TID251 -- the type
    """A template of the folder `prompts`."""
    return environment().get_template(name)
