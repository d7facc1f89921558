"""The example that ends each question is an answer to it: in its form, of what it lists, and of no embedded sample."""

import json
import re
import sys
from typing import Any

import jsonschema
import pytest
from fake_api import QUESTIONS
from pydantic import BaseModel

from dcap.evaluation.judging.questions import JUDGE_PAIR, JUDGE_SCORE
from dcap.language.model.payload import schema_of, template
from dcap.language.protocol.questions import LAYOUTGPT, Question
from dcap.synthetic.recipes import object_recipes

EVERY: tuple[Question[Any, Any], ...] = (*QUESTIONS.values(), JUDGE_SCORE, JUDGE_PAIR)
OWN_EXAMPLES = {LAYOUTGPT.name}
"""Shows rooms of the data set, as its source does."""
EXAMPLED = [one for one in EVERY if one.name not in OWN_EXAMPLES]
EXAMPLE, ANSWER = "\nExample: ", "\nAnswer:\n"
TOKEN = 4
"""Characters of a token of English, roughly."""


def situation_and_answer(question: Question[Any, Any]) -> tuple[str, Any]:
    """Both halves of the example."""
    text = template(f"{question.name}.system.j2").render()
    assert text.count(ANSWER) == text.count(EXAMPLE) == 1
    situation, answer = text[text.index(EXAMPLE) + len(EXAMPLE) :].split(ANSWER)
    return situation, json.loads(answer)


def assert_complete(answer: Any, schema: Any) -> None:
    """Every property, in the order in which a model has to write them."""
    if isinstance(answer, dict):
        assert list(answer) == list(schema["properties"])
        for name, value in answer.items():
            assert_complete(value, schema["properties"][name])
    if isinstance(answer, list):
        for value in answer:
            assert_complete(value, schema.get("items", {}))


@pytest.mark.parametrize("question", EXAMPLED, ids=lambda one: one.name)
def test_an_example_is_a_whole_answer(question: Question[Any, Any]):
    """It passes the schema that a model is held to, says all of it in its order, and is read as a reply."""
    _, answer = situation_and_answer(question)
    reply: type[BaseModel] = question.reply
    schema = schema_of(reply)
    jsonschema.validate(answer, schema)
    assert_complete(answer, schema)
    reply.model_validate(answer)


@pytest.mark.parametrize("question", EVERY, ids=lambda one: one.name)
def test_examples_are_of_no_embedded_thing(question: Question[Any, Any]):
    """No object of the embedded benchmark is placed in one: an answer must not be read off."""
    text = template(f"{question.name}.system.j2").render()
    begin = text.find(EXAMPLE)
    sys.stdout.write(f"{question.name}: about {len(text) // TOKEN} tokens\n")
    quoted = " ".join((text[begin:] if begin >= 0 else "", *re.findall(r'^- "put.*$', text, re.MULTILINE))).lower()
    for name in object_recipes():
        assert not re.search(rf"\b{name.replace('_', ' ')}s?\b", quoted), name
