"""Where labels are unsure a model is shown numbered pictures; it may choose only what is listed."""

import base64
import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from box_rooms import bedroom, block, thing
from fake_api import FakeApi, data_of, offline_model, reason_of, self_willed
from PIL import Image

from dcap.language.connect import connect
from dcap.language.protocol.client import ClientName, LanguageConfig
from dcap.language.protocol.session import Session
from dcap.scene.errors import LanguageError
from dcap.scene.types.choices import Intent
from dcap.scene.types.segmentation import Pointed, Segmentation, SegmentedObject, SegmentedScene
from tasks.intent.request import VIEWS, intent_request
from tasks.intent.stage import IntentConfig, intent
from tasks.requests.marks import marked, numbers_of, plan_picture

MODEL = LanguageConfig(client=ClientName.ANTHROPIC, model="claude-sonnet-5-5")
CUBE = thing("block", block((-0.05, -0.05, -0.05), (0.05, 0.05, 0.05)))
SURE = bedroom()
GUESSED = replace(SURE, instances=tuple(replace(one, confidence=0.6) for one in SURE.instances))


def asked(
    folder: Path, api: FakeApi, room: Segmentation, prompt: str, pointed: Pointed | None = None
) -> Intent:  # fmt: skip
    client = connect(MODEL, Session(kept=str(folder / "kept")))
    found = intent(SegmentedScene(room), SegmentedObject(CUBE), prompt, None, IntentConfig(), client, pointed)
    assert isinstance(found, Intent), found
    return found


def test_the_model_sees_numbered_pictures_of_an_unsure_scene(tmp_path: Path, api: FakeApi) -> None:
    """A plan and views, with the numbers that the list of instances has."""
    assert asked(tmp_path, api, GUESSED, "put the block on the table").base_id == "table"
    (body,) = api.asked
    images = [one for one in body["messages"][0]["content"] if one["type"] == "image"]
    assert len(images) == 1 + VIEWS
    plan = np.asarray(Image.open(io.BytesIO(base64.b64decode(images[0]["source"]["data"]))))
    assert np.array_equal(plan, plan_picture(marked(GUESSED)))
    told = {one["id"]: (one["number"], one["confidence"]) for one in data_of(body)["instances"]}
    assert told == {
        one.id: (numbers_of(GUESSED).get(i, 0), 0.6) for i, one in enumerate(GUESSED.instances)
    }  # fmt: skip


def test_a_scene_whose_labels_are_sure_is_told_alone() -> None:
    """Pictures cost; without them no thing has a number."""
    request = intent_request(SURE, CUBE, "put the block on the table", "")
    assert request.pictures == ()
    assert {one.number for one in request.instances} == {0}


def test_a_choice_that_is_not_listed_is_refused(tmp_path: Path, api: FakeApi) -> None:
    """The model is told which there are; one that insists ends the stage in a line."""
    api.answers = [self_willed(intent={"base_id": "7"}), offline_model]
    assert asked(tmp_path, api, GUESSED, "put the block on the bed").base_id == "bed"
    assert "base_id '7' is not one of bed, table, lamp, floor, wall" in reason_of(api.asked[1])
    api.answers = [self_willed(intent={"base_id": "7"})]
    with pytest.raises(LanguageError, match="'7' is not one of"):
        asked(tmp_path, api, GUESSED, "put the block on the floor")


def test_what_a_person_pointed_at_is_not_for_the_model_to_choose(tmp_path: Path, api: FakeApi) -> None:
    """Another listed instance is refused too."""
    pointed = Pointed("table", "table", "", np.array([1.7, 0.7, 0.5]), np.zeros((0, 2), np.int64), False, ())
    api.answers = [self_willed(intent={"base_id": "bed"}), offline_model]
    found = asked(tmp_path, api, SURE, "put the block there", pointed)
    assert found.base_id == "table"
    assert found.at is not None
    assert "which the person has pointed at" in reason_of(api.asked[1])
