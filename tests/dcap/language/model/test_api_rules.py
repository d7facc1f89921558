"""The form of every question, and requests of the stages, pass the rules of both APIs; broken requests do not."""

import base64
import io
import json
from collections.abc import Callable
from copy import deepcopy
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from api_rules import Body, Call, anthropic_refusal, openai_refusal, optional_parameters, union_parameters
from fake_api import QUESTIONS
from judged import GOOD
from PIL import Image
from pydantic import BaseModel
from questions_at_hand import AT_HAND

from dcap.evaluation.judging.cameras import SIZE
from dcap.evaluation.judging.judge import JudgedPlacement, pair_request
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


def anthropic_refuses(body: Body) -> str:
    """What the stand-in says of a call, empty where it takes it."""
    return anthropic_refusal(Call(body, headers=ANTHROPIC, size=len(json.dumps(body))))


def openai_refuses(body: Body) -> str:
    """The same of the other one."""
    return openai_refusal(Call(body, "/v1/chat/completions", OPENAI))


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
def test_forms_of_answers_leave_room(question: Question[Any, Any]) -> None:
    """Nothing is optional, few parts have two types, and what a model thinks comes first."""
    schema = form_of(question)
    assert optional_parameters(schema) == 0
    assert union_parameters(schema) <= (0 if question is INTENT else 2)
    properties = list(schema["properties"])
    if "reason" in properties:
        assert properties[0] == "reason"
    if question is INTENT:
        assert properties.index("candidates") < properties.index("base_id")


@pytest.mark.slow
def test_pictures_of_judges_reach_a_model_as_they_are() -> None:
    """Of the size that judges see, of two placements at once: both APIs take them and make none smaller. Anthropic does
    so from 1568 pixels along a side or 1.15 megapixels, OpenAI where the shorter side has more than 768."""
    noise = np.random.default_rng(0).integers(0, 255, (SIZE, SIZE, 3), dtype=np.uint8)  # what PNG cannot make smaller
    views = tuple(Picture(name, lambda: noise) for name in PLACED)
    before = tuple(Picture(name, lambda: noise) for name in BEFORE)
    one = JudgedPlacement("s", "a", "put it there", "ball", GOOD, before, views)
    payload = payload_of(JUDGE_PAIR, pair_request(one, replace(one, method="b")))
    body = anthropic_api.call_of(
        LanguageConfig(client=ClientName.ANTHROPIC, model="claude-sonnet-4-5"), payload, Session()
    )
    assert anthropic_refuses(body) == ""
    openai = LanguageConfig(client=ClientName.OPENAI, model="gpt-5")
    assert openai_refuses(openai_api.call_of(openai, payload, Session())) == ""
    for block in payload.messages[0]["content"]:
        if block["type"] == "image":
            width, height = Image.open(io.BytesIO(base64.b64decode(block["source"]["data"]))).size
            assert max(width, height) <= 1568
            assert width * height <= 1.15e6
            assert min(width, height) <= 768


MARK = {"cache_control": {"type": "ephemeral"}}
BROKEN: tuple[tuple[Callable[[Body], Any], str], ...] = (
    (lambda body: body.update(seed=3), "Extra inputs are not permitted"),
    (lambda body: body.update(max_tokens=200_000), "max_tokens: 200000"),
    (lambda body: body["messages"].append({"role": "assistant", "content": "{"}), "prefill"),
    (lambda body: body["output_config"].update(effort="low"), "effort"),
    (lambda body: body["messages"][0]["content"].extend([{"type": "text", "text": "x", **MARK}] * 5), "maximum of 4"),
    (lambda body: schema_in(body).pop("additionalProperties"), "explicitly set to false"),
    (lambda body: schema_in(body)["properties"].update(a={"type": "number", "minimum": 0}), "'minimum' is not"),
    (lambda body: schema_in(body)["properties"].update(a={"$ref": "#/$defs/gone"}), "unknown reference"),
    (lambda body: schema_in(body)["properties"].update({f"p{k}": {"type": "string"} for k in range(25)}), "(25)"),
)
"""What is done to a call, and words of the refusal."""


def schema_in(body: Body) -> Body:
    """The form of the answer that is asked for."""
    schema: Body = body["output_config"]["format"]["schema"]
    return schema


def test_the_stand_in_refuses_what_the_api_refuses(ask) -> None:
    """Or the tests above would show nothing."""
    payload = payload_of(INTENT, ask("put the mug upside down on the desk", "mug"))
    config = LanguageConfig(client=ClientName.ANTHROPIC, model="claude-haiku-4-5")
    good = json.loads(json.dumps(anthropic_api.call_of(config, payload, Session())))
    for change, words in BROKEN:
        body = deepcopy(good)
        change(body)
        assert words in anthropic_refuses(body)
