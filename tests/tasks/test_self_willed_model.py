"""Stages with a model that reads otherwise than the offline reader: they do what it chooses, if it was listed."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from box_rooms import CUBE, HALL, ROOM, block, thing, toy
from fake_api import FakeApi, offline_model, question_of, reason_of, self_willed
from stage_chain import Stages

from dcap.language.protocol.client import ClientName
from dcap.scene.errors import LanguageError
from dcap.scene.types.choices import Intent

ON_THE_BED = "put the cube on the bed"


@pytest.fixture
def model(api: FakeApi, tmp_path: Path) -> Stages:
    """The stages with the stand-in, which answers as each test has it."""
    return Stages(ClientName.ANTHROPIC, api, tmp_path)


def meant(model: Stages, prompt: str = ON_THE_BED, item=CUBE) -> Intent:
    found = model.meant(prompt, item)
    assert isinstance(found, Intent)
    return found


# what may be chosen -------------------------------------------------------------------------------------------------


def test_another_base_carries_it(api: FakeApi, model: Stages):
    """The model takes the table although the sentence says bed."""
    taken = {"base_id": "table", "candidates": [], "part": "leg", "regions": []}
    api.answers = [self_willed(intent=taken, anchor={"part_index": 0})]
    intent, _, found = model.placed(ON_THE_BED, CUBE)
    assert (intent.base_id, intent.region.part, found.base_id, found.part) == ("table", "leg", "table", "top")


@pytest.mark.parametrize(("index", "low", "high"), [(3, -0.65, -0.05), (4, 0.05, 0.65)])
def test_another_part_of_the_same_name_carries_it(api: FakeApi, model: Stages, index, low, high):
    """The left or the right pillow, where the sentence says neither."""
    api.answers = [self_willed(anchor={"part_index": index})]
    found = model.placed(ON_THE_BED, CUBE)[2]
    assert (found.part, found.part_index) == ("pillow", index)
    assert low < found.surface_point[0] < high
    assert found.surface_point[2] == pytest.approx(0.62)


@pytest.mark.parametrize(
    ("room", "base", "part", "point", "place"),
    [
        # who looks at the bed's front stands at -y: right is +x, front is -y
        (ROOM, "bed", 1, (0.5, 0.5), (0.375, -0.475)),
        # who looks at the bench stands at +y: right is -x, front is +y
        (HALL, "bench", 0, (0.5, -0.5), (-0.25, -1.8)),
    ],
)
def test_a_point_is_a_place_on_the_part(api: FakeApi, model: Stages, room, base, part, point, place):
    """Right and front of the part's middle, -1..1, for who looks at the front of the base."""
    api.answers = [self_willed(anchor={"part_index": part, "regions": [], "point": point})]
    found = model.placed(f"put the cube on the {base}", CUBE, room)[2]
    assert (found.base_id, found.part_index) == (base, part)
    assert found.surface_point[:2] == pytest.approx(place, abs=2e-3)  # spots are a millimetre apart
    assert found.local == pytest.approx(point, abs=0.01)


def test_another_region_is_where_it_goes(api: FakeApi, model: Stages):
    """The foot, where the sentence names no place; then a thing that the model refers to by itself."""
    api.answers = [self_willed(anchor={"regions": ["foot"]})]
    found = model.placed(ON_THE_BED, CUBE)[2]
    assert found.region == "foot"
    assert found.surface_point[1] < -0.95 / 3
    api.answers = [
        self_willed(
            intent={"base_id": "bed", "regions": ["near"], "references": ["part:headboard"]},
            anchor={"part_index": 1, "regions": ["near"], "references": ["part:headboard"]},
        )
    ]
    near = model.placed("put the cube on the bed, please", CUBE)[2]
    assert near.region == "near"
    assert near.surface_point[1] > 0.2


@pytest.mark.parametrize(
    ("edge", "told", "others", "scale"),
    [(0.06, 0.12, (), 2.0), (0.06, 0.6, (0.06,), 1.0), (6.0, 0.06, (), 0.01)],
    ids=["twice as large", "its other state", "in centimetres"],
)
def test_the_scale_follows_the_sizes_of_the_reply(api: FakeApi, model: Stages, edge, told, others, scale):
    """A cube of that edge, told to be of another size or to have another state [m]."""
    sizes = {"size": (told,) * 3, "alternative_sizes": [(other,) * 3 for other in others], "spread": 1.1}
    api.answers = [self_willed(intent=sizes)]
    found = meant(model, item=thing("cube", block((0.0, 0.0, 0.0), (edge, edge, edge))))
    assert found.scale == pytest.approx(scale, rel=1e-3)
    assert found.size == pytest.approx([edge * scale] * 3)


@pytest.mark.parametrize(
    "changes",
    [{"intent": {"facing": "table"}}, {"rotation": {"facing_id": "table", "turn_deg": 0.0}}],
    ids=["heard in the sentence", "seen in the pictures"],
)
def test_the_front_looks_at_the_thing_that_the_reply_names(api: FakeApi, model: Stages, changes):
    """The toy's front, -y in its file, points from the bed to the table at (2, 1) within 15 degrees."""
    api.answers = [self_willed(**changes)]
    matrix = model.oriented("put the teddy on the bed", thing("teddy", toy())).matrix
    ahead = (matrix @ (0.0, -1.0, 0.0))[:2]
    assert ahead @ (2.0, 1.0) / np.sqrt(5.0) > np.cos(np.radians(15))


def test_the_rows_are_those_of_the_reply(api: FakeApi, model: Stages):
    """Every part gets the row that the model picks, with its reason, not the one that a reader would."""
    picks = {("object", 0): "steel", ("bed", 1): "granite"}

    def other(reply):
        for choice in reply["choices"]:
            choice["material"] = picks.get((choice["body"], choice["part_index"]), "glass")
            choice["reason"] = "because"
        return reply

    api.answers = [self_willed(materials=other)]
    rows = model.made_of(ON_THE_BED, CUBE).rows
    assert len(rows) > 5
    for row in rows:
        assert row.material.id == picks.get((row.body, row.part_index), "glass")
        assert row.reason.startswith("because")


# what may not -------------------------------------------------------------------------------------------------------


def unobtainable(reply):
    reply["choices"][0]["material"] = "unobtainium"
    return reply


def unanswered(reply):
    return reply | {"choices": reply["choices"][1:]}


@pytest.mark.parametrize(
    ("question", "change", "word"),
    [
        ("intent", {"base_id": "throne"}, "'throne'"),
        ("intent", {"part": "lid"}, "'lid'"),
        ("intent", {"references": ["ghost"]}, "'ghost'"),
        ("intent", {"facing": "ghost"}, "'ghost'"),
        ("intent", {"base_id": "", "missing": ""}, "missing"),
        ("rotation", {"pose_id": "somersault"}, "'somersault'"),
        ("rotation", {"facing_id": "ghost"}, "'ghost'"),
        ("rotation", {"quaternion": (1.0, 1.0, 0.0, 0.0)}, "length 1.414"),
        ("anchor", {"part_index": 99}, "part_index 99"),
        ("anchor", {"references": ["table"]}, "'table'"),
        ("anchor", {"point": (0.5, -1.5)}, "outside"),
        ("materials", unobtainable, "'unobtainium'"),
        ("materials", unanswered, "choices answer"),
    ],
)
def test_what_is_not_listed_is_asked_again_and_fails_in_a_line(api: FakeApi, model: Stages, question, change, word):
    """Twice again with the reason; then the stage fails in one line that says what was chosen."""
    api.answers = [self_willed(**{question: change})]
    with pytest.raises(LanguageError, match=f"3 invalid answers to '{question}'") as error:
        model.made_of(ON_THE_BED, CUBE)
    assert "\n" not in str(error.value)
    asked = [body for body in api.asked if question_of(body) == question]
    assert [len(body["messages"]) for body in asked] == [1, 3, 5]
    for body in asked[1:]:
        assert word in reason_of(body)
    assert question_of(api.asked[-1]) == question  # no later stage was reached


def test_whoever_mends_the_choice_is_heard(api: FakeApi, model: Stages):
    """A model whose first answer to each question is not listed places the cube as if it had been right at once."""
    bad: dict[str, Any] = {
        "intent": {"base_id": "throne"}, "rotation": {"pose_id": "somersault"}, "anchor": {"part_index": 99},
        "materials": unobtainable,
    }  # fmt: skip
    stubborn = self_willed(**bad)
    api.answers = [lambda body: (offline_model if len(body["messages"]) > 1 else stubborn)(body)]
    mended = model.made_of(ON_THE_BED, CUBE)
    assert [question_of(body) for body in api.asked] == [name for name in bad for _ in range(2)]
    plain = Stages().made_of(ON_THE_BED, CUBE)
    assert [(row.body, row.material.id) for row in mended.rows] == [(row.body, row.material.id) for row in plain.rows]
