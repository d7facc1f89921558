"""What the servers of both APIs refuse of requests like ours, with the sources of the limits.

Anthropic: https://platform.claude.com/docs/en/build-with-claude/structured-outputs, .../vision, .../prompt-caching.
OpenAI: https://platform.openai.com/docs/guides/structured-outputs, .../reasoning, .../images-vision.
"""

import base64
import io
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any

from PIL import Image

Body = dict[str, Any]
MOST_OPTIONAL, MOST_UNIONS, MOST_MARKS = 24, 16, 4
ANTHROPIC_PARAMETERS = {"model", "max_tokens", "messages", "system", "output_config"}
OPENAI_PARAMETERS = {"model", "messages", "response_format", "max_tokens", "max_completion_tokens", "reasoning_effort"}
ANTHROPIC_KEYWORDS = {
    "type", "properties", "required", "additionalProperties", "items", "enum", "const", "anyOf", "allOf", "$ref",
    "$defs", "description", "title", "default", "format", "minItems", "pattern",
}  # fmt: skip
OPENAI_UNSUPPORTED = {
    "allOf", "not", "if", "then", "else", "oneOf", "patternProperties", "propertyNames", "minProperties",
    "maxProperties", "contains", "uniqueItems", "default", "prefixItems",
}  # fmt: skip
WITHOUT_EFFORT = re.compile(r"claude-3|haiku-4-5|sonnet-4-5|opus-4-1|-4-20")
REASONING = re.compile(r"^(o\d|gpt-5)")
"""Models of OpenAI that think before they answer."""
OPENAI_OUTPUTS = {"gpt-4o": 16_384, "gpt-4.1": 32_768, "gpt-5": 128_000, "o": 100_000}
"""Longest completions by the beginning of a model's name [tokens]."""


@dataclass(frozen=True, slots=True)
class Call:
    """One request."""

    body: Body
    path: str = "/v1/messages"
    headers: Mapping[str, str] = field(default_factory=dict)
    """Names in small letters."""
    size: int = 0
    """Bytes."""


def anthropic_refusal(call: Call) -> str:
    """What the Messages API says of a call; empty if it takes it."""
    if "anthropic-version" not in call.headers or not call.headers.keys() & {"x-api-key", "authorization"}:
        return "the header anthropic-version and a key are required"
    if call.size > 32 * 2**20:
        return "Request exceeds the maximum size"
    if call.path.endswith("/batches"):
        names = [one["custom_id"] for one in call.body["requests"]]
        return "custom_id must be unique" if len(set(names)) < len(names) else ""
    return next(anthropic_complaints(call.body), "")


def anthropic_complaints(body: Body) -> Iterator[str]:
    """Everything that is wrong with the body of a message call."""
    yield from (f"{name}: Extra inputs are not permitted" for name in body.keys() - ANTHROPIC_PARAMETERS)
    if body["max_tokens"] > most_output(body["model"]):
        yield f"max_tokens: {body['max_tokens']} > {most_output(body['model'])}, the maximum of {body['model']}"
    if body["messages"][-1]["role"] == "assistant":
        yield "This model does not support assistant message prefill."
    if body["output_config"].get("effort") and WITHOUT_EFFORT.search(body["model"]):
        yield "This model does not support the effort parameter."
    blocks = [*body["system"], *(block for turn in body["messages"] for block in turn["content"])]
    if any(block["type"] == "text" and not block["text"].strip() for block in blocks):
        yield "messages: text content blocks must be non-empty"
    if sum("cache_control" in block for block in blocks) > MOST_MARKS:
        yield f"A maximum of {MOST_MARKS} blocks with cache_control may be provided."
    pictures = [block["source"] for block in blocks if block["type"] == "image"]
    for source in pictures:
        kind, size = measured(source["data"])
        if f"image/{kind}" != source["media_type"] or max(size) > (2000 if len(pictures) > 20 else 8000):
            yield f"messages: Could not process image of {source['media_type']}, {size} pixels"
    if form := body["output_config"].get("format"):
        yield from anthropic_schema_complaints(form["schema"])


def most_output(model: str) -> int:
    """Longest answer of a model [tokens]."""
    if "claude-3" in model:
        return 8_192
    if re.search(r"opus-4-(0|1|20)", model):
        return 32_000
    return 64_000 if re.search(r"-4-5|-4-20|-4-0|haiku", model) else 128_000


def anthropic_schema_complaints(schema: Body) -> Iterator[str]:
    """What no grammar is made of."""
    definitions = schema.get("$defs", {})
    for path, node in nodes_of(schema):
        yield from (f"schema: '{word}' is not supported at {path}" for word in node.keys() - ANTHROPIC_KEYWORDS)
        if node.get("type") == "object" and node.get("additionalProperties") is not False:
            yield "schema: 'additionalProperties' must be explicitly set to false"
        if node.get("minItems", 0) > 1:
            yield "schema: 'minItems' values other than 0 or 1 are not supported"
        if "$ref" in node and node["$ref"].rpartition("/")[2] not in definitions:
            yield f"schema: unknown reference {node['$ref']}"
    if (found := optional_parameters(schema)) > MOST_OPTIONAL:
        yield f"Schemas contains too many optional parameters ({found})"
    if (found := union_parameters(schema)) > MOST_UNIONS:
        yield f"Schemas contains too many parameters with union types ({found})"


def optional_parameters(schema: Body) -> int:
    """Number of properties that need not be given, in all objects of a schema."""
    return sum(len(set(node.get("properties", ())) - set(node.get("required", ()))) for _, node in nodes_of(schema))


def union_parameters(schema: Body) -> int:
    """Number of schemas of more than one type."""
    return sum("anyOf" in node or isinstance(node.get("type"), list) for _, node in nodes_of(schema))


def nodes_of(tree: Any, path: str = "") -> Iterator[tuple[str, Body]]:
    """All schemas in a schema with their paths, itself first; names of properties are no keywords."""
    if not isinstance(tree, dict):
        return
    yield path, tree
    for word in ("properties", "$defs"):
        for name, one in tree.get(word, {}).items():
            yield from nodes_of(one, f"{path}.{word}.{name}")
    for word in ("anyOf", "oneOf", "allOf"):
        for index, one in enumerate(tree.get(word, ())):
            yield from nodes_of(one, f"{path}.{word}.{index}")
    yield from nodes_of(tree.get("items"), f"{path}.items")


@cache
def measured(data: str) -> tuple[str | None, tuple[int, int]]:
    """Format and size of a picture in base64; None where it is none."""
    try:
        with Image.open(io.BytesIO(base64.b64decode(data, validate=True))) as picture:
            return str(picture.format).lower(), picture.size
    except (ValueError, OSError):
        return None, (0, 0)


def openai_refusal(call: Call) -> str:
    """What a server of chat completions says of a call; empty if it takes it."""
    if not call.headers.get("authorization", "").startswith("Bearer "):
        return "You didn't provide an API key."
    return next(openai_complaints(call.body), "")


def openai_complaints(body: Body) -> Iterator[str]:
    """Everything that is wrong with the body of a completion call."""
    model, thinks = body["model"], REASONING.match(body["model"])
    yield from (f"Unknown parameter: '{name}'." for name in body.keys() - OPENAI_PARAMETERS)
    if thinks and "max_tokens" in body:
        yield "Unsupported parameter: 'max_tokens' is not supported with this model."
    if "reasoning_effort" in body and not thinks:
        yield "Unrecognized request argument supplied: reasoning_effort"
    tokens = max(body.get("max_tokens", 0), body.get("max_completion_tokens", 0))
    if tokens > next((most for name, most in OPENAI_OUTPUTS.items() if model.startswith(name)), tokens):
        yield f"max_tokens is too large: {tokens}."
    form = body["response_format"]["json_schema"]
    for path, node in nodes_of(form["schema"] if form.get("strict") else None):
        if "$ref" in node:
            if len(node) > 1:
                yield f"In context=({path}), $ref cannot have other keywords."
            continue
        yield from (f"In context=({path}), '{word}' is not permitted." for word in node.keys() & OPENAI_UNSUPPORTED)
        if node.get("type") == "object" and (
            node.get("additionalProperties") is not False or set(node["properties"]) - set(node.get("required", ()))
        ):
            yield f"In context=({path}), objects must be closed and all of their properties required."
    for turn in body["messages"]:
        for part in turn["content"] if isinstance(turn["content"], list) else ():
            if part["type"] == "image_url":
                kind, _, data = part["image_url"]["url"].partition(";base64,")
                if kind != f"data:image/{measured(data)[0]}":
                    yield "Invalid image data."
