"""Requests that the Messages API refuses, as a table of rules: shapes, and limits that shapes cannot say.

The shapes know what our calls are made of and nothing else; what else the API takes is refused here, too.

A rule names its source and says what is wrong with a call, in the words of the real server as far as they are known.
Add one by a line in ANTHROPIC_RULES (of the other API: openai_rules.py). A stand-in checks each request against all.
"""

import base64
import io
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Annotated, Any, Literal

from PIL import Image
from pydantic import BaseModel, Field, TypeAdapter, ValidationError

Body = dict[str, Any]
PLATFORM = "https://platform.claude.com/docs/en/build-with-claude/"
STRUCTURED = f"{PLATFORM}structured-outputs"
VISION = f"{PLATFORM}vision"
MESSAGES = "https://platform.claude.com/docs/en/api/messages"
OVERVIEW = "https://platform.claude.com/docs/en/api/overview"
BATCHES = f"{PLATFORM}batch-processing"


@dataclass(frozen=True, slots=True)
class Call:
    """One request."""

    body: Body
    path: str = "/v1/messages"
    headers: Mapping[str, str] = field(default_factory=dict)
    """Names in small letters."""
    size: int = 0
    """Bytes."""


@dataclass(frozen=True, slots=True)
class Refusal:
    """Why a server does not take a call."""

    message: str
    status: int = 400
    kind: str = "invalid_request_error"
    param: str | None = None
    """Of OpenAI: the parameter that is wrong."""
    code: str | None = None
    """Of OpenAI: the error's own name."""


@dataclass(frozen=True, slots=True)
class Rule:
    """Something that a server does not take."""

    name: str
    source: str
    broken: Callable[[Call], str]
    """What is wrong with a call, empty if it keeps the rule."""
    status: int = 400
    kind: str = "invalid_request_error"
    code: str | None = None


def refusal(call: Call, rules: tuple[Rule, ...], shape: Callable[[Call], Refusal | None]) -> Refusal | None:
    """The first rule that a call breaks; those about headers and size come before its shape."""
    for rule in rules:
        if rule.status != 400 and (said := rule.broken(call)):
            return Refusal(said, rule.status, rule.kind, code=rule.code)
    if (wrong := shape(call)) is not None:
        return wrong
    for rule in rules:
        if rule.status == 400 and (said := rule.broken(call)):
            return Refusal(said, rule.status, rule.kind, code=rule.code)
    return None


# Anthropic: shapes ---------------------------------------------------------------------------------------------------


class Closed(BaseModel, extra="forbid"):
    """The API refuses every parameter that it does not know: "Extra inputs are not permitted"."""


class CacheControl(Closed):
    type: Literal["ephemeral"]
    ttl: Literal["5m", "1h"] = "5m"


class Cached(Closed):
    cache_control: CacheControl | None = None


class Text(Cached):
    type: Literal["text"]
    text: str


class Base64Source(Closed):
    type: Literal["base64"]
    media_type: Literal["image/jpeg", "image/png", "image/gif", "image/webp"]
    data: str


class Picture(Cached):
    type: Literal["image"]
    source: Base64Source


class Thought(Closed):
    type: Literal["thinking"]
    thinking: str
    signature: str


Block = Annotated[Text | Picture | Thought, Field(discriminator="type")]


class Turn(Closed):
    role: Literal["user", "assistant"]
    content: str | list[Block]


class JsonSchemaFormat(Closed):
    type: Literal["json_schema"]
    schema_: dict[str, Any] = Field(alias="schema")


class OutputConfig(Closed):
    format: JsonSchemaFormat | None = None
    effort: Literal["low", "medium", "high", "xhigh", "max"] | None = None


class MessageCall(Closed):
    """POST /v1/messages."""

    model: str = Field(min_length=1)
    max_tokens: int = Field(ge=1)
    messages: list[Turn] = Field(min_length=1)
    system: list[Text]
    output_config: OutputConfig


class BatchItem(Closed):
    custom_id: str = Field(pattern=r"^[a-zA-Z0-9_-]{1,64}$")
    params: dict[str, Any]
    """What is in it is looked at when the batch is worked on."""


class BatchCall(Closed):
    """POST /v1/messages/batches."""

    requests: list[BatchItem] = Field(min_length=1, max_length=100_000)


def anthropic_shape(call: Call) -> Refusal | None:
    """What is wrong with a body's shape."""
    kind = BatchCall if call.path == "/v1/messages/batches" else MessageCall
    return complaint_of(call.body, kind, lambda place, said: Refusal(f"{place}: {said}"))


def complaint_of(body: Body, kind: type[BaseModel], make: Callable[[str, str], Refusal]) -> Refusal | None:
    """The first complaint of a shape, with its place."""
    try:
        TypeAdapter(kind).validate_python(body)
    except ValidationError as error:
        first = max(error.errors(), key=lambda one: len(one["loc"]))  # of a union the branch that fits best
        place = ".".join(str(one) for one in first["loc"] if one not in ("str", "list[tagged-union]"))
        return make(place, first["msg"])
    return None


# Anthropic: rules ----------------------------------------------------------------------------------------------------


def turns_of(call: Call) -> list[tuple[str, list[Body]]]:
    """Roles and blocks of a conversation."""
    return [(one["role"], blocks_of(one["content"])) for one in call.body.get("messages", [])]


def blocks_of(content: Any) -> list[Body]:
    """Content as blocks."""
    return [{"type": "text", "text": content}] if isinstance(content, str) else list(content or [])


def all_blocks(call: Call) -> Iterator[Body]:
    """Blocks of the system text, then of all turns."""
    yield from blocks_of(call.body.get("system"))
    for _, blocks in turns_of(call):
        yield from blocks


def versioned(call: Call) -> str:
    """The version is not defaulted."""
    return "" if "anthropic-version" in call.headers else "anthropic-version: header is required"


def with_key(call: Call) -> str:
    """A key or a token."""
    return "" if call.headers.keys() & {"x-api-key", "authorization"} else "x-api-key header is required"


def small(call: Call) -> str:
    """32 MB, 256 MB for a batch."""
    most = 256e6 if call.path.endswith("/batches") else 32 * 2**20
    return "Request exceeds the maximum size" if call.size > most else ""


def says_something(call: Call) -> str:
    """No empty turns but the last of the assistant, no empty texts."""
    turns = turns_of(call)
    for index, (role, blocks) in enumerate(turns):
        last = index == len(turns) - 1 and role == "assistant"
        texts = [one["text"] for one in blocks if one["type"] == "text"]
        if (not blocks or texts == [""] == [one.get("text") for one in blocks]) and not last:
            return (
                f"messages.{index}: all messages must have non-empty content except for the optional final "
                "assistant message"
            )
        if "" in texts and not last:
            return "messages: text content blocks must be non-empty"
        if any(text and not text.strip() for text in texts):
            return "messages: text content blocks must contain non-whitespace text"
    return ""


def ends_with_user(call: Call) -> str:
    """The beginning of an answer cannot be given together with a schema."""
    turns = turns_of(call)
    prefilled = bool(turns) and turns[-1][0] == "assistant"
    return "This model does not support assistant message prefill." if prefilled else ""


def ends_in_no_thought(call: Call) -> str:
    """A turn of the assistant may think first, not last."""
    for index, (role, blocks) in enumerate(turns_of(call)):
        if role == "assistant" and blocks and blocks[-1]["type"] == "thinking":
            return f"messages.{index}: The final block in an assistant message cannot be `thinking`."
    return ""


WITHOUT_EFFORT = re.compile(r"claude-3|haiku-4-5|sonnet-4-5|opus-4-1|-4-20")


def model_knows(call: Call) -> str:
    """Some models do not take an effort."""
    effort = (call.body.get("output_config") or {}).get("effort")
    known = not WITHOUT_EFFORT.search(call.body["model"])
    return "This model does not support the effort parameter." if effort and not known else ""


def most_output(model: str) -> int:
    """Longest answer of a model [tokens]."""
    if "claude-3" in model:
        return 8_192
    if re.search(r"opus-4-(0|1|20)", model):
        return 32_000
    return 64_000 if re.search(r"-4-5|-4-20|-4-0|haiku", model) else 128_000


def within_output(call: Call) -> str:
    """No longer answer than the model can give."""
    asked, most = call.body["max_tokens"], most_output(call.body["model"])
    return (
        f"max_tokens: {asked} > {most}, which is the maximum allowed number of output tokens for {call.body['model']}"
        if asked > most
        else ""
    )


def pictures_of(call: Call) -> list[Body]:
    """The pictures of a call."""
    return [one for one in all_blocks(call) if one["type"] == "image"]


def few_pictures(call: Call) -> str:
    """100 with a context of 200,000 tokens."""
    count = len(pictures_of(call))
    most = 100 if re.search(r"-4-5|claude-3|haiku", call.body["model"]) else 600
    return f"messages: too many images and documents: {count} + 0 > {most}" if count > most else ""


def readable_pictures(call: Call) -> str:
    """Of the kind that they say they are, not too large; in a long row no side above 2000 pixels."""
    found = pictures_of(call)
    longest = 2000 if len(found) > 20 else 8000
    for one in found:
        source = one["source"]
        if len(source["data"]) > 10 * 2**20:
            return f"image exceeds 10 MB maximum: {len(source['data'])} bytes > {10 * 2**20} bytes"
        kind, size = measured(source["data"])
        if kind is None:
            return "messages: Could not process image"
        if f"image/{kind}" != source["media_type"]:
            return (
                f"The image was specified using the {source['media_type']} media type, but the image appears to "
                f"be a image/{kind} image"
            )
        if max(size) > longest:
            many = " for many-image requests" if longest == 2000 else ""
            return f"At least one of the image dimensions exceed max allowed size{many}: {longest} pixels"
    return ""


@cache
def measured(data: str) -> tuple[str | None, tuple[int, int]]:
    """Format and size of a picture in base64; None where it is none."""
    try:
        with Image.open(io.BytesIO(base64.b64decode(data, validate=True))) as picture:
            return str(picture.format).lower(), picture.size
    except (ValueError, OSError):
        return None, (0, 0)


def marks_of(call: Call) -> int:
    """Places at which the prompt shall be cached."""
    return sum(one.get("cache_control") is not None for one in all_blocks(call))


def few_marks(call: Call) -> str:
    """Four at most."""
    count = marks_of(call)
    said = f"A maximum of 4 blocks with cache_control may be provided. Found {count}."
    return said if count > 4 else ""


def schemas_of(call: Call) -> list[Body]:
    """The schema whose grammar is made."""
    form = (call.body.get("output_config") or {}).get("format")
    return [form["schema"]] if form else []


def nodes_of(tree: Any, path: str = "") -> Iterator[tuple[str, Body]]:
    """All schemas in a schema with their paths, itself first; names of properties are no keywords."""
    if not isinstance(tree, dict):
        return
    yield path, tree
    for word in ("properties", "$defs", "definitions", "patternProperties"):
        for name, one in (tree.get(word) or {}).items():
            yield from nodes_of(one, f"{path}.{word}.{name}")
    for word in ("anyOf", "oneOf", "allOf", "prefixItems"):
        for index, one in enumerate(tree.get(word) or []):
            yield from nodes_of(one, f"{path}.{word}.{index}")
    for word in ("items", "additionalProperties", "not", "if", "then", "else"):
        yield from nodes_of(tree.get(word), f"{path}.{word}")


SUPPORTED = {
    "type", "properties", "required", "additionalProperties", "items", "enum", "const", "anyOf", "allOf", "$ref",
    "$defs", "definitions", "description", "title", "default", "format", "minItems", "pattern", "$schema", "$id",
    "examples", "nullable",
}  # fmt: skip
FORMATS = {"date-time", "time", "date", "duration", "email", "hostname", "uri", "ipv4", "ipv6", "uuid"}


def known_keywords(call: Call) -> str:
    """The subset of JSON schema that a grammar is made of."""
    for schema in schemas_of(call):
        for path, node in nodes_of(schema):
            kind = node.get("type")
            if unknown := [word for word in node if word not in SUPPORTED]:
                return f"output_config.format.schema: For '{kind}' type, property '{unknown[0]}' is not supported{path}"
            if kind == "object" and node.get("additionalProperties") is not False:
                return (
                    "output_config.format.schema: For 'object' type, 'additionalProperties' must be explicitly set "
                    "to false"
                )
            if node.get("minItems", 0) not in (0, 1):
                return (
                    f"output_config.format.schema: For 'array' type, 'minItems' values other than 0 or 1 are not "
                    f"supported (got: {node['minItems']})"
                )
            if "format" in node and node["format"] not in FORMATS:
                return f"output_config.format.schema: For 'string' type, format '{node['format']}' is not supported"
            if "pattern" in node and re.search(r"\(\?[=!<]|\\[1-9]|\\[bB]", node["pattern"]):
                return (
                    "output_config.format.schema: regex look-around, back-references and word boundaries are not "
                    "supported"
                )
            if any(isinstance(one, dict | list) for one in node.get("enum", ())):
                return "output_config.format.schema: enum values must be primitives"
            if "allOf" in node and any("$ref" in one for one in node["allOf"]):
                return "output_config.format.schema: allOf with $ref is not supported"
    return ""


def finite_schemas(call: Call) -> str:
    """References go to the schema's own definitions, each of which comes before those that use it."""
    for schema in schemas_of(call):
        definitions = schema.get("$defs") or {}
        known: set[str] = set()
        while ready := {name for name in definitions.keys() - known if targets(definitions[name]) <= known}:
            known |= ready
        if not targets(schema) <= known:
            return f"output_config.format.schema: Circular or unknown reference: {sorted(targets(schema) - known)}"
    return ""


def targets(schema: Body) -> set[str]:
    """Definitions that a schema refers to."""
    return {node["$ref"].rpartition("/")[2] for _, node in nodes_of(schema) if "$ref" in node}


MOST_OPTIONAL, MOST_UNIONS, LARGEST_GRAMMAR = 24, 16, 60_000


def optional_parameters(schema: Body) -> int:
    """Properties that need not be given, in all objects of a schema."""
    return sum(len(set(node.get("properties") or {}) - set(node.get("required") or ())) for _, node in nodes_of(schema))


def union_parameters(schema: Body) -> int:
    """Schemas of more than one type."""
    return sum("anyOf" in node or isinstance(node.get("type"), list) for _, node in nodes_of(schema))


def few_options(call: Call) -> str:
    """The grammar grows with every property that may be left out."""
    found = sum(map(optional_parameters, schemas_of(call)))
    return (
        f"Schemas contains too many optional parameters ({found}), which would make grammar compilation inefficient. "
        f"Reduce the number of optional parameters in your tool schemas (limit: {MOST_OPTIONAL})."
        if found > MOST_OPTIONAL
        else ""
    )


def few_unions(call: Call) -> str:
    """So it does with every union."""
    found = sum(map(union_parameters, schemas_of(call)))
    return (
        f"Schemas contains too many parameters with union types ({found} parameters with type arrays or anyOf). This "
        "would cause exponential compilation cost. Reduce the number of nullable or union-typed parameters (limit: "
        f"{MOST_UNIONS})."
        if found > MOST_UNIONS
        else ""
    )


def simple_enough(call: Call) -> str:
    """Where it ends is not published, so the bound here is a cautious one."""
    for schema in schemas_of(call):
        deepest = max((path.count(".properties.") + path.count(".items") for path, _ in nodes_of(schema)), default=0)
        if deepest > 12 or len(str(schema)) > LARGEST_GRAMMAR:
            return "Schema is too complex for compilation. Simplify your tool schemas or use fewer strict tools."
    return ""


def own_ids(call: Call) -> str:
    """No id twice in a batch."""
    names = [one["custom_id"] for one in call.body.get("requests", [])]
    twice = next((one for one in names if names.count(one) > 1), "")
    return f"requests: custom_id must be unique; found duplicate '{twice}'" if twice else ""


def of_messages(broken: Callable[[Call], str]) -> Callable[[Call], str]:
    """A rule that says nothing of batches."""
    return lambda call: "" if call.path.endswith("/batches") else broken(call)


ANTHROPIC_RULES: tuple[Rule, ...] = (
    Rule("key", OVERVIEW, with_key, 401, "authentication_error"),
    Rule("size", f"{OVERVIEW}#request-size-limits", small, 413, "request_too_large"),
    Rule("version", "https://platform.claude.com/docs/en/api/versioning", versioned),
    Rule("unique ids", BATCHES, own_ids),
    *(
        Rule(name, source, of_messages(broken))
        for name, source, broken in (
            ("empty content", MESSAGES, says_something),
            ("thought last", "tailcallhq/forgecode 2107, 3071", ends_in_no_thought),
            ("prefill", f"{PLATFORM}prefill-claudes-response", ends_with_user),
            ("model's parameters", f"{PLATFORM}effort", model_knows),
            ("output tokens", "https://platform.claude.com/docs/en/about-claude/models/overview", within_output),
            ("pictures", VISION, few_pictures),
            ("picture", VISION, readable_pictures),
            ("cache marks", f"{PLATFORM}prompt-caching", few_marks),
            ("schema's words", STRUCTURED, known_keywords),
            ("references", STRUCTURED, finite_schemas),
            ("optional", "elie222/inbox-zero 2323", few_options),
            ("unions", "elizaOS/eliza 16499", few_unions),
            ("grammar", "mozilla/bugbug 6129, ENTERPILOT/GoModel 963", simple_enough),
        )
    ),
)
