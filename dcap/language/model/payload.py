"""A question as the Messages API takes it: system text, data, pictures and the form of the answer.

In: a question and its request. Out: a `Payload` whose digest names everything that a model gets to see, and nothing
else: not the model, not the key. Text of scenes and prompts travels as JSON inside data blocks in which `<` and `>`
are escaped, so it can neither close its block nor pass for ours.
"""

import base64
import hashlib
import io
import json
from collections.abc import Mapping, Sequence
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
from dcap.language.protocol.requests import PictureMaker
from dcap.scene.settings import resource

PROMPTS = "prompts"
PICTURES = "pictures"
CACHED = {"cache_control": {"type": "ephemeral"}}
"""Ends a part of the prompt that the API shall keep for the next question."""

Block = Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Payload:
    """One call of the API, whichever model gets it."""

    question: str
    system: str
    messages: tuple[Mapping[str, Any], ...]
    schema: Mapping[str, Any]
    """JSON schema of the answer, as pydantic writes it."""

    @property
    def digest(self) -> str:
        """SHA-256 of all that a model sees, pictures by their pixels: 64 hex digits."""
        return hashlib.sha256(json.dumps(self.readable(), sort_keys=True).encode()).hexdigest()

    @property
    def bytes(self) -> int:
        """Length of its text, and so more than the tokens of its text: a token has at least one byte."""
        return len(json.dumps(self.readable(), ensure_ascii=False).encode())

    @property
    def pictures(self) -> int:
        """Number of pictures."""
        return sum(block.get("type") == "image" for message in self.messages for block in message["content"])

    def readable(self) -> dict[str, Any]:
        """The payload for a person: pictures by the digest of their pixels, which no PNG writer changes."""
        tree = {"system": self.system, "messages": list(self.messages), "schema": self.schema}
        found: dict[str, Any] = json.loads(json.dumps(tree))
        for message in found["messages"]:
            for block in message["content"]:
                if isinstance(block, dict) and block.get("type") == "image":
                    block["source"] = {"pixels_sha256": pixel_digest(block["source"]["data"])}
        return found

    def followed_by(self, *messages: Mapping[str, Any]) -> "Payload":
        """The conversation with more turns."""
        return replace(self, messages=(*self.messages, *messages))


def payload_of(question: Question[RequestT, ReplyT], request: RequestT) -> Payload:
    """The first call for a request; makes its pictures."""
    own: dict[str, object] = {}
    shared: dict[str, object] = {}
    for name in field_names(request):
        if name not in (PICTURES, *question.unseen):
            (shared if name in question.shared else own)[name] = plain(getattr(request, name))
    content: list[Block] = []
    if shared:
        content.append({"type": "text", "text": data_text(question.name, shared), **CACHED})
    content += [picture_block(make) for make in getattr(request, PICTURES, ())]
    content.append({"type": "text", "text": data_text(question.name, own)})
    system = template(f"{question.name}.system.j2").render()
    return Payload(question.name, system, ({"role": "user", "content": content},), schema_of(question.reply))


def data_text(question: str, data: Mapping[str, object]) -> str:
    """Data in its block."""
    return template("data.j2").render(question=question, data=data)


def rejection(reason: str) -> dict[str, Any]:
    """The turn that says why an answer cannot be used; the reason is data, for it quotes names."""
    text = template("rejected.j2").render(reason=reason)
    return {"role": "user", "content": [{"type": "text", "text": text}]}


@cache
def schema_of(reply: type[BaseModel]) -> Mapping[str, Any]:
    """JSON schema of a reply; fixed tuples as arrays of their one type, which is all that the API's grammar knows."""
    schema: dict[str, Any] = uniform_arrays(reply.model_json_schema())
    return schema


def uniform_arrays(tree: Any) -> Any:
    """The schema with `items` instead of equal `prefixItems`."""
    if isinstance(tree, Sequence) and not isinstance(tree, str):
        return [uniform_arrays(one) for one in tree]
    if not isinstance(tree, Mapping):
        return tree
    found = {name: uniform_arrays(value) for name, value in tree.items() if name != "prefixItems"}
    if prefix := tree.get("prefixItems"):
        if any(one != prefix[0] for one in prefix):
            raise TypeError(f"a tuple of different types cannot be asked for: {prefix}")
        found["items"] = uniform_arrays(prefix[0])
    return found


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
def environment() -> jinja2.Environment:
    """Where the templates are; a name that is not given is an error. What people say is a value in them and never a
    part of one; sandboxed, no template reaches an attribute from which Python code could be run."""
    return SandboxedEnvironment(
        loader=jinja2.FileSystemLoader(resource(PROMPTS)),
        undefined=jinja2.StrictUndefined,
        autoescape=False,
        keep_trailing_newline=False,
    )


def template(name: str) -> jinja2.Template:
    """A template of the folder `prompts`."""
    return environment().get_template(name)
