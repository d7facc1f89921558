"""Requests that servers of chat completions refuse, as a table of rules like that of api_rules.py."""

import re
from typing import Annotated, Any, Literal

from api_rules import Body, Call, Closed, Refusal, Rule, complaint_of, measured, nodes_of
from pydantic import Field

OPENAI_SCHEMAS = "https://platform.openai.com/docs/guides/structured-outputs"
OPENAI_IMAGES = "https://platform.openai.com/docs/guides/images-vision"


# OpenAI: shapes ------------------------------------------------------------------------------------------------------


class TextPart(Closed):
    type: Literal["text"]
    text: str


class ImageUrl(Closed):
    url: str
    detail: Literal["auto", "low", "high", "original"] = "auto"


class ImagePart(Closed):
    type: Literal["image_url"]
    image_url: ImageUrl


class SystemTurn(Closed):
    role: Literal["system", "developer"]
    content: str | list[TextPart]
    name: str | None = None


class UserTurn(Closed):
    role: Literal["user"]
    content: str | list[Annotated[TextPart | ImagePart, Field(discriminator="type")]]
    name: str | None = None


class AssistantTurn(Closed):
    role: Literal["assistant"]
    content: str


class NamedSchema(Closed):
    name: str = Field(pattern=r"^[a-zA-Z0-9_-]+$", max_length=64)
    description: str | None = None
    schema_: dict[str, Any] = Field(alias="schema")
    strict: bool | None = None


class SchemaAnswer(Closed):
    type: Literal["json_schema"]
    json_schema: NamedSchema


class CompletionCall(Closed):
    """POST /v1/chat/completions."""

    model: str = Field(min_length=1)
    messages: list[Annotated[SystemTurn | UserTurn | AssistantTurn, Field(discriminator="role")]] = Field(min_length=1)
    max_tokens: int | None = Field(default=None, ge=1)
    max_completion_tokens: int | None = Field(default=None, ge=1)
    response_format: SchemaAnswer
    reasoning_effort: Literal["none", "minimal", "low", "medium", "high", "xhigh", "max"] | None = None


def openai_shape(call: Call) -> Refusal | None:
    """What is wrong with a body's shape, with the parameter."""

    def made(place: str, said: str) -> Refusal:
        if said == "Extra inputs are not permitted":
            return Refusal(f"Unknown parameter: '{place}'.", param=place, code="unknown_parameter")
        if said == "Field required":
            return Refusal(f"Missing required parameter: '{place}'.", param=place, code="missing_required_parameter")
        return Refusal(f"Invalid value for '{place}': {said}", param=place, code="invalid_value")

    return complaint_of(call.body, CompletionCall, made)


# OpenAI: rules -------------------------------------------------------------------------------------------------------

REASONING = re.compile(r"^(o\d|gpt-5)")
"""Models that think before they answer."""


def bearer(call: Call) -> str:
    """A key."""
    given = call.headers.get("authorization", "")
    return "" if given.startswith("Bearer ") and given != "Bearer " else "You didn't provide an API key."


def one_limit(call: Call) -> str:
    """The newer name for models that think, and never both."""
    if call.body.get("max_tokens") is None:
        return ""
    if call.body.get("max_completion_tokens") is not None:
        return "Setting 'max_tokens' and 'max_completion_tokens' at the same time is not supported."
    if REASONING.match(call.body["model"]):
        return (
            "Unsupported parameter: 'max_tokens' is not supported with this model. Use 'max_completion_tokens' instead."
        )
    return ""


def knows_effort(call: Call) -> str:
    """Models that think know some words for their effort, others none."""
    model, effort = call.body["model"], call.body.get("reasoning_effort")
    if effort is None:
        return ""
    if not REASONING.match(model):
        return "Unrecognized request argument supplied: reasoning_effort"
    known = efforts_of(model)
    return "" if effort in known else f"Unsupported value: 'reasoning_effort'; supported are {', '.join(known)}."


def efforts_of(model: str) -> tuple[str, ...]:
    """The words for its effort that a model knows."""
    if model.startswith("o"):
        return ("low", "medium", "high")
    if re.match(r"gpt-5(-|$)", model):
        return ("minimal", "low", "medium", "high")
    return ("none", "low", "medium", "high", "xhigh")


OUTPUTS = {"gpt-4o": 16_384, "gpt-4.1": 32_768, "gpt-5": 128_000, "o": 100_000}
"""Longest completions by the beginning of a model's name [tokens]."""


def within_completion(call: Call) -> str:
    """No longer answer than the model can give, where that is known."""
    asked = max(call.body.get("max_tokens") or 0, call.body.get("max_completion_tokens") or 0)
    most = next((most for name, most in OUTPUTS.items() if call.body["model"].startswith(name)), asked)
    return (
        f"max_tokens is too large: {asked}. This model supports at most {most} completion tokens, whereas you "
        f"provided {asked}."
        if asked > most
        else ""
    )


def strict_form(call: Call) -> Body | None:
    """The schema of the answer, if it is to be kept strictly."""
    form = (call.body.get("response_format") or {}).get("json_schema") or {}
    return form["schema"] if form.get("strict") else None


UNSUPPORTED = {
    "allOf", "not", "dependentRequired", "dependentSchemas", "if", "then", "else", "oneOf", "patternProperties",
    "unevaluatedProperties", "propertyNames", "minProperties", "maxProperties", "unevaluatedItems", "contains",
    "minContains", "maxContains", "uniqueItems", "default", "prefixItems",
}  # fmt: skip


def strict_schemas(call: Call) -> str:
    """Closed objects of which everything is required, and only words that strict mode knows."""
    schema = strict_form(call)
    if schema is None:
        return ""
    begin = f"Invalid schema for response_format '{call.body['response_format']['json_schema']['name']}': "
    if schema.get("type") != "object" or "anyOf" in schema:
        return f"{begin}schema must be a JSON Schema of 'type: \"object\"', got 'type: \"{schema.get('type')}\"'."
    for path, node in nodes_of(schema):
        place = f"{begin}In context=({path}), "
        if "$ref" in node:
            if len(node) > 1:
                return f"{place}$ref cannot have keywords {sorted(set(node) - {'$ref'})}."
            if not node["$ref"].startswith("#"):
                return f"{place}'$ref' must point into the schema itself."
            continue
        if not node.keys() & {"type", "anyOf", "enum", "const"}:
            return f"{place}schema must have a 'type' key."
        if unknown := sorted(UNSUPPORTED & node.keys()):
            return f"{place}'{unknown[0]}' is not permitted."
        if node.get("type") == "object" or "properties" in node:
            if node.get("additionalProperties") is not False:
                return f"{place}'additionalProperties' is required to be supplied and to be false."
            missing = [one for one in node.get("properties", {}) if one not in node.get("required", ())]
            if missing:
                return (
                    f"{place}'required' is required to be supplied and to be an array including every key in "
                    f"properties. Missing '{missing[0]}'."
                )
        if node.get("type") == "array" and "items" not in node:
            return f"{place}array schema missing items."
    return small_schema(begin, schema)


def small_schema(begin: str, schema: Body) -> str:
    """Its size in properties, levels, choices and letters."""
    nodes = list(nodes_of(schema))
    properties = [name for _, node in nodes for name in node.get("properties", {})]
    choices = [one for _, node in nodes for one in node.get("enum", ())]
    levels = max(path.count(".properties.") for path, _ in nodes)
    letters = sum(len(str(one)) for one in (*properties, *choices, *schema.get("$defs", {})))
    for found, most in ((len(properties), 5000), (levels, 10), (len(choices), 1000), (letters, 120_000)):
        if found > most:
            return f"{begin}{found} properties, levels, choices or letters exceed the limit of {most}."
    return ""


def linked_pictures(call: Call) -> str:
    """Pictures are addresses, or data of a kind that is known."""
    for turn in call.body["messages"]:
        for part in turn["content"] if isinstance(turn.get("content"), list) else ():
            if part["type"] != "image_url":
                continue
            url = part["image_url"]["url"]
            if url.startswith(("http://", "https://")):
                continue
            kind = re.fullmatch(r"data:image/(png|jpeg|jpg|gif|webp);base64,(.*)", url, re.DOTALL)
            if kind is None:
                return "Invalid image data. Expected a base64-encoded data URL with an image MIME type."
            found, _ = measured(kind[2])
            if found is None:
                return (
                    "You uploaded an unsupported image. Please make sure your image has of one the following "
                    "formats: ['png', 'jpeg', 'gif', 'webp']."
                )
    return ""


GUIDES = "https://platform.openai.com/docs/guides/"
OPENAI_RULES: tuple[Rule, ...] = (
    Rule("key", "https://platform.openai.com/docs/api-reference/authentication", bearer, 401, code="invalid_api_key"),
    Rule("limit of tokens", f"{GUIDES}reasoning", one_limit, code="unsupported_parameter"),
    Rule("effort", f"{GUIDES}reasoning", knows_effort, code="unsupported_value"),
    Rule("output tokens", "https://platform.openai.com/docs/models", within_completion, code="invalid_value"),
    Rule("strict schema", OPENAI_SCHEMAS, strict_schemas),
    Rule("pictures", OPENAI_IMAGES, linked_pictures, code="invalid_image_url"),
)
