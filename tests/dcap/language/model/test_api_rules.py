"""The form of every question, and requests of the stages, pass the rules of both APIs; broken requests do not."""

import base64
import io
import json
import sys
from collections.abc import Callable
from copy import deepcopy
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from api_rules import (
    ANTHROPIC_RULES,
    MOST_OPTIONAL,
    MOST_UNIONS,
    Body,
    Call,
    anthropic_shape,
    optional_parameters,
    refusal,
    union_parameters,
)
from fake_api import QUESTIONS
from judged import GOOD
from openai_rules import OPENAI_RULES, openai_shape
from PIL import Image
from pydantic import BaseModel
from questions_at_hand import AT_HAND

from dcap.evaluation.judging.cameras import SIZE
from dcap.evaluation.judging.judge import JudgedPlacement, pair_request, score_request
from dcap.evaluation.judging.questions import JUDGE_PAIR, JUDGE_SCORE
from dcap.language.model import anthropic_api, openai_api
from dcap.language.model.ledger import prices
from dcap.language.model.payload import Payload, payload_of, schema_of, template
from dcap.language.protocol.client import ClientName, LanguageConfig
from dcap.language.protocol.questions import INTENT, Question
from dcap.language.protocol.requests import Picture
from dcap.language.protocol.session import Session
from dcap.scene.types.pictures import BEFORE, PLACED

EVERY: tuple[Question[Any, Any], ...] = (*QUESTIONS.values(), JUDGE_SCORE, JUDGE_PAIR)
ANTHROPIC = {"x-api-key": "k", "anthropic-version": "2023-06-01"}
OPENAI = {"authorization": "Bearer k"}
OTHERS = ("gpt-4o", "gpt-4.1", "gpt-5", "gpt-5.2", "o3", "local/some-vlm")


def anthropic_refuses(body: Body, path: str = "/v1/messages", headers: dict[str, str] | None = None) -> str:
    """What the stand-in says of a call, empty where it takes it."""
    wrong = refusal(Call(body, path, ANTHROPIC if headers is None else headers), ANTHROPIC_RULES, anthropic_shape)
    return "" if wrong is None else wrong.message


def openai_refuses(body: Body) -> str:
    """The same of the other one."""
    wrong = refusal(Call(body, "/v1/chat/completions", OPENAI), OPENAI_RULES, openai_shape)
    return "" if wrong is None else wrong.message


def form_of(question: Question[Any, Any]) -> Body:
    """The schema of an answer."""
    reply: type[BaseModel] = question.reply
    return dict(schema_of(reply))


def payloads(ask: Callable[..., Any]) -> list[Payload]:
    """Each question with a request of its own, or at least with its own text and form of answer."""
    at_hand: tuple[tuple[Question[Any, Any], Callable[[], Any]], ...] = AT_HAND
    made: list[Payload] = [payload_of(question, make()) for question, make in at_hand]
    made.append(payload_of(INTENT, ask("put the mug upside down on the desk", "mug")))
    said = {one.question for one in made}
    content = [{"type": "text", "text": "<data>\n{}\n</data>"}]
    for one in EVERY:
        if one.name not in said:
            system = template(f"{one.name}.system.j2").render()
            made.append(Payload(one.name, system, ({"role": "user", "content": content},), form_of(one)))
    return made


@pytest.mark.parametrize("model", sorted(prices()))
def test_anthropic_takes_every_question(ask, model: str) -> None:
    """Of every stage, baseline and judge; after an answer that was cut off, too."""
    config = LanguageConfig(client=ClientName.ANTHROPIC, model=model)
    made = payloads(ask)
    assert {one.question for one in made} == {one.name for one in EVERY}
    for payload in (*made, *(one.with_more_room().with_more_room() for one in made)):
        assert anthropic_refuses(anthropic_api.call_of(config, payload, Session())) == "", payload.question


@pytest.mark.parametrize("model", OTHERS)
def test_openai_takes_every_question(ask, model: str) -> None:
    """Of every stage, baseline and judge; with more room, where the model has it."""
    config = LanguageConfig(client=ClientName.OPENAI, model=model)
    made = payloads(ask)
    for payload in (*made, *(one.with_more_room() for one in made if model != "gpt-4o")):
        assert openai_refuses(openai_api.call_of(config, payload, Session())) == "", payload.question


@pytest.mark.parametrize("question", EVERY, ids=lambda one: one.name)
def test_forms_of_answers_leave_room(question: Question[Any, Any], record_property) -> None:
    """Nothing is optional, few parts have two types, and what a model thinks comes first."""
    schema = form_of(question)
    optional, unions = optional_parameters(schema), union_parameters(schema)
    record_property("optional", optional)
    record_property("unions", unions)
    sys.stdout.write(f"{question.name}: {optional} optional of {MOST_OPTIONAL}, {unions} unions of {MOST_UNIONS}\n")
    assert optional == 0
    assert unions <= (0 if question is INTENT else 2)
    properties = list(schema["properties"])
    if "reason" in properties:
        assert properties[0] == "reason"
    if question is INTENT:
        assert properties.index("candidates") < properties.index("base_id")


@pytest.mark.slow
@pytest.mark.parametrize("question", [JUDGE_SCORE, JUDGE_PAIR], ids=lambda one: one.name)
def test_pictures_of_judges_reach_a_model_as_they_are(question: Question[Any, Any], record_property) -> None:
    """Of the size that judges see, with all examples: both APIs take them and make none smaller. Anthropic does so from
    1568 pixels along a side or 1.15 megapixels [VISION], OpenAI where the shorter side has more than 768 [IMAGES]."""
    noise = np.random.default_rng(0).integers(0, 255, (SIZE, SIZE, 3), dtype=np.uint8)  # what PNG cannot make smaller
    views = tuple(Picture(name, lambda: noise) for name in PLACED)
    before = tuple(Picture(name, lambda: noise) for name in BEFORE)
    one = JudgedPlacement("s", "a", "put it there", "ball", GOOD, before, views)
    request = score_request(one) if question is JUDGE_SCORE else pair_request(one, replace(one, method="b"))
    payload = payload_of(question, request)
    body = anthropic_api.call_of(
        LanguageConfig(client=ClientName.ANTHROPIC, model="claude-sonnet-4-5"), payload, Session()
    )
    size = len(json.dumps(body))
    record_property("bytes", size)
    assert refusal(Call(body, headers=ANTHROPIC, size=size), ANTHROPIC_RULES, anthropic_shape) is None
    assert (
        openai_refuses(openai_api.call_of(LanguageConfig(client=ClientName.OPENAI, model="gpt-5"), payload, Session()))
        == ""
    )
    for block in payload.messages[0]["content"]:
        if block["type"] == "image":
            width, height = Image.open(io.BytesIO(base64.b64decode(block["source"]["data"]))).size
            assert max(width, height) <= 1568
            assert width * height <= 1.15e6
            assert min(width, height) <= 768


# what is broken ------------------------------------------------------------------------------------------------------

PNG = "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNk+M9QDwADhgGAWjR9awAAAABJRU5ErkJggg=="


def picture(width: int = 0, kind: str = "image/png") -> Body:
    """A block with a picture of so many pixels."""
    data = PNG
    if width:
        buffer = io.BytesIO()
        Image.new("L", (width, 1)).save(buffer, format="PNG")
        data = base64.b64encode(buffer.getvalue()).decode()
    return {"type": "image", "source": {"type": "base64", "media_type": kind, "data": data}}


def good() -> Body:
    """A call that the Messages API takes."""
    schema = {
        "type": "object", "properties": {"a": {"type": "string"}}, "required": ["a"], "additionalProperties": False,
    }  # fmt: skip
    return {
        "model": "claude-sonnet-5-5", "max_tokens": 1000, "system": [{"type": "text", "text": "You help."}],
        "messages": [{"role": "user", "content": [{"type": "text", "text": "Hello"}, picture()]}],
        "output_config": {"format": {"type": "json_schema", "schema": schema}},
    }  # fmt: skip


def said(*blocks: Body) -> list[Body]:
    """A conversation in which the model has answered with these blocks."""
    return [
        {"role": "user", "content": "Hello"}, {"role": "assistant", "content": list(blocks)},
        {"role": "user", "content": "Again"},
    ]  # fmt: skip


THOUGHT = {"type": "thinking", "thinking": "well", "signature": "c2ln"}
MARK = {"cache_control": {"type": "ephemeral"}}


def with_properties(**more: Body) -> Callable[[Body], Any]:
    """A form of answer with other properties, none of which is required."""

    def change(body: Body) -> None:
        schema = body["output_config"]["format"]["schema"]
        schema["properties"] = more
        schema["required"] = []

    return change


def setting(**more: Any) -> Callable[[Body], Any]:
    """Other parameters."""
    return lambda body: body.update(more)


BROKEN: dict[str, tuple[Callable[[Body], Any], str]] = {
    "no model": (lambda body: body.pop("model"), "Field required"),
    "no limit": (lambda body: body.pop("max_tokens"), "Field required"),
    "no messages": (setting(messages=[]), "at least 1"),
    "an unknown parameter": (setting(seed=3), "Extra inputs are not permitted"),
    "an unknown parameter of a block": (
        lambda body: body["messages"][0]["content"][0].update(name="x"), "Extra inputs are not permitted",
    ),
    "an unknown role": (setting(messages=[{"role": "system", "content": "x"}]), "'user' or 'assistant'"),
    "a model that begins": (setting(messages=[{"role": "assistant", "content": "x"}]), '"user" role'),
    "a model that ends": (setting(messages=said({"type": "text", "text": "{"})[:2]), "prefill"),
    "an empty turn": (setting(messages=said()), "non-empty content"),
    "an empty text": (setting(messages=said({"type": "text", "text": ""}, THOUGHT)), "non-empty"),
    "a blank text": (setting(messages=said({"type": "text", "text": " \n"})), "non-whitespace"),
    "a thought at the end": (setting(messages=said(THOUGHT)), "cannot be `thinking`"),
    "a thought without its signature": (
        setting(messages=said({"type": "thinking", "thinking": "x"}, {"type": "text", "text": "y"})), "Field required",
    ),
    "more than the model can write": (setting(max_tokens=200_000), "maximum allowed number"),
    "nothing to write": (setting(max_tokens=0), "greater than or equal to 1"),
    "a budget for thoughts": (
        setting(thinking={"type": "enabled", "budget_tokens": 500}), "greater than or equal to 1024",
    ),
    "thoughts longer than the answer": (
        setting(model="claude-haiku-4-5", thinking={"type": "enabled", "budget_tokens": 2000}), "must be greater than",
    ),
    "sampling while thinking": (
        setting(model="claude-haiku-4-5", max_tokens=9000, temperature=0.5,
                thinking={"type": "enabled", "budget_tokens": 2000}), "only be set to 1",
    ),
    "sampling": (setting(temperature=0.5), "deprecated"),
    "an unknown effort": (lambda body: body["output_config"].update(effort="hard"), "'low', 'medium'"),
    "effort of a model without": (
        lambda body: (body.update(model="claude-haiku-4-5"), body["output_config"].update(effort="low")), "effort",
    ),
    "a picture of another kind": (
        lambda body: body["messages"][0]["content"].append(picture(kind="image/jpeg")), "appears to be",
    ),
    "no picture": (
        lambda body: body["messages"][0]["content"][1]["source"].update(data="eA=="), "Could not process image",
    ),
    "an unknown kind of picture": (
        lambda body: body["messages"][0]["content"].append(picture(kind="image/bmp")), "image/jpeg",
    ),
    "a wide picture": (lambda body: body["messages"][0]["content"].append(picture(8001)), "8000"),
    "a wide picture of many": (
        lambda body: body["messages"][0]["content"].extend([picture()] * 20 + [picture(2001)]), "2000",
    ),
    "too many pictures": (
        lambda body: (body.update(model="claude-opus-4-5"), body["messages"][0]["content"].extend([picture()] * 100)),
        "101 + 0 > 100",
    ),
    "five marks": (
        lambda body: body["messages"][0]["content"].extend([{"type": "text", "text": "x", **MARK}] * 5), "maximum of 4",
    ),
    "an open object": (
        lambda body: body["output_config"]["format"]["schema"].pop("additionalProperties"), "explicitly set to false",
    ),
    "a bound": (with_properties(a={"type": "number", "minimum": 0}), "'minimum' is not supported"),
    "a length": (with_properties(a={"type": "string", "maxLength": 3}), "'maxLength' is not supported"),
    "three entries": (
        with_properties(a={"type": "array", "items": {"type": "string"}, "minItems": 3}), "other than 0 or 1",
    ),
    "a circle": (
        lambda body: body["output_config"]["format"]["schema"].update(
            properties={"a": {"$ref": "#/$defs/one"}},
            **{"$defs": {"one": {"type": "array", "items": {"$ref": "#/$defs/one"}}}},
        ), "Circular",
    ),
    "a reference outside": (with_properties(a={"$ref": "https://example.com/a.json"}), "External"),
    "a pattern that looks ahead": (with_properties(a={"type": "string", "pattern": "(?=x)"}), "look-around"),
    "25 optional": (with_properties(**{f"p{k}": {"type": "string"} for k in range(25)}), "optional parameters (25)"),
    "17 unions": (
        lambda body: (
            with_properties(**{f"p{k}": {"type": ["string", "null"]} for k in range(17)})(body),
            body["output_config"]["format"]["schema"].update(required=[f"p{k}" for k in range(17)]),
        ), "union types (17",
    ),
    "too complex": (
        with_properties(**{f"p{k}": {"type": "string", "enum": ["x" * 3000]} for k in range(24)}), "too complex",
    ),
    "no kind": (lambda body: body["output_config"]["format"].update(schema={"properties": {}}), "must have a 'type'"),
    "a blank stop": (setting(stop_sequences=["\n"]), "non-whitespace"),
}  # fmt: skip
"""What is done to a good call, and words of the refusal."""


def test_a_good_call_is_taken() -> None:
    """With and without thoughts in the conversation."""
    assert anthropic_refuses(good()) == ""
    assert anthropic_refuses(good() | {"messages": said(THOUGHT, {"type": "text", "text": "{}"})}) == ""


@pytest.mark.parametrize("what", BROKEN)
def test_a_broken_call_is_refused(what: str) -> None:
    """Each in one way, with the real server's words."""
    change, words = BROKEN[what]
    body = deepcopy(good())
    change(body)
    assert words in anthropic_refuses(body)


def test_headers_batches_and_sizes() -> None:
    """A call without version or key, a batch with one id twice or a name that is none, a call of 40 MB."""
    assert "anthropic-version" in anthropic_refuses(good(), headers={"x-api-key": "k"})
    assert "x-api-key" in anthropic_refuses(good(), headers={"anthropic-version": "2023-06-01"})
    batch = "/v1/messages/batches"
    for names, words in ((["a", "a"], "unique"), (["a b"], "pattern"), ([], "at least 1")):
        assert words in anthropic_refuses({"requests": [{"custom_id": n, "params": good()} for n in names]}, batch)
    large = refusal(Call(good(), headers=ANTHROPIC, size=40_000_000), ANTHROPIC_RULES, anthropic_shape)
    assert large is not None
    assert (large.status, large.kind) == (413, "request_too_large")


OPEN = {"type": "object", "properties": {"a": {"type": "string"}}, "required": ["a"], "additionalProperties": False}


def completion(model: str = "gpt-4o", schema: Body | None = None, **more: Any) -> Body:
    """A call that chat completions take."""
    form = {"type": "json_schema", "json_schema": {"name": "x", "strict": True, "schema": schema or OPEN}}
    return {"model": model, "messages": [{"role": "user", "content": "Hello"}], "response_format": form, **more}


@pytest.mark.parametrize(
    ("body", "words"),
    [
        (completion(thinking={}), "Unknown parameter"),
        (completion("gpt-5", max_tokens=9), "max_completion_tokens"),
        (completion("gpt-5", temperature=0.2), "does not support 0.2"),
        (completion("gpt-5", reasoning_effort="none"), "Supported values"),
        (completion(reasoning_effort="low"), "Unrecognized"),
        (completion(max_completion_tokens=20_000), "at most 16384"),
        (completion(schema=OPEN | {"required": []}), "including every key"),
        (completion(schema={k: v for k, v in OPEN.items() if k != "additionalProperties"}), "additionalProperties"),
        (completion(schema=OPEN | {"properties": {"a": {"enum": ["x"], "default": "x"}}}), "'default' is not"),
        (completion(schema=OPEN | {"properties": {"a": {"description": "x"}}}), "must have a 'type' key"),
        (completion(schema={"anyOf": [OPEN]}), "type: \"object\""),
        (completion(messages=[{"role": "user", "content": [
            {"type": "image_url", "image_url": {"url": "data:image/bmp;base64,eA=="}}]}]), "Invalid image data"),
    ],
)  # fmt: skip
def test_a_broken_completion_is_refused(body: Body, words: str) -> None:
    """Parameters that a model does not know, forms that strict mode does not take."""
    assert openai_refuses(completion()) == ""
    assert words in openai_refuses(body)
