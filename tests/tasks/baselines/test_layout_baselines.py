"""The stages of LayoutGPT and Holodeck on small rooms: where they must succeed, and what comes of bad replies."""

from dataclasses import replace

import numpy as np
import pytest
from box_rooms import CUBE, HALL, ROOM, block, mug, thing
from fake_api import FakeApi, says
from stage_chain import MODEL, Stages

from dcap.language.connect import Client, connect
from dcap.language.protocol.client import ClientName, LanguageConfig
from dcap.language.protocol.session import Session
from dcap.scene.errors import LanguageError
from dcap.scene.types.choices import Anchor, Intent
from dcap.scene.types.floor_plan import FloorPlans
from dcap.scene.types.outcome import Infeasible
from dcap.scene.types.segmentation import Segmentation, SegmentedObject, SegmentedScene
from tasks.baselines.planners import HolodeckConfig, LayoutGptConfig, floor_plan, holodeck, layoutgpt

MUG = thing("mug", mug())
SEAT = thing("stool", block((-0.15, -0.15, 0.0), (0.15, 0.15, 0.4)))
LINE = "mug {{length: 4px; width: 3px; height: 4px; left: 128px; top: 128px; depth: {}px; orientation: 0 degrees;}}"
PLANS = FloorPlans(tuple(floor_plan(SegmentedScene(one)) for one in (ROOM, HALL)))


def layout_of(prompt: str, client: Client, item: Segmentation = MUG, room: Segmentation = ROOM) -> Anchor | Infeasible:
    """LayoutGPT, shown the other room."""
    meant = Stages().meant(prompt, item, room)
    assert isinstance(meant, Intent)
    return layoutgpt(SegmentedScene(room), SegmentedObject(item), meant, prompt, LayoutGptConfig(), client, PLANS)


def deck_of(
    prompt: str, client: Client, item: Segmentation = MUG, room: Segmentation = ROOM, seed: int = 0
) -> Anchor | Infeasible:
    """Holodeck."""
    meant = Stages().meant(prompt, item, room)
    assert isinstance(meant, Intent)
    return holodeck(SegmentedScene(room), SegmentedObject(item), meant, prompt, HolodeckConfig(seed=seed), client)


def asking(api: FakeApi, *answers: object) -> Client:
    """The model's stand-in that says these."""
    api.answers = [says(answer) for answer in answers]
    return connect(LanguageConfig(client=ClientName.ANTHROPIC, model=MODEL), Session())


OFFLINE = connect(LanguageConfig(), Session())


@pytest.mark.parametrize(
    ("prompt", "base", "part", "xy"),
    [
        ("put the mug at the center of the bed", "bed", "mattress", (0.0, 0.0)),
        ("put the mug on the left pillow", "bed", "pillow", (-0.35, 0.7)),
        ("put the mug on the right side of the bed", "bed", "mattress", (0.375, 0.0)),
        ("put the mug on the floor", "floor", "floor", None),
    ],
)
def test_layoutgpt_succeeds_where_it_must(stages: Stages, prompt: str, base: str, part: str, xy) -> None:
    """Whoever answers, the box stands on the support to half a pixel (12 mm in a room of 6 m), at the asked place."""
    found = stages.answered(lambda client: layout_of(prompt, client))
    assert isinstance(found, Anchor), found
    assert (found.base_id, found.part) == (base, part)
    assert abs(found.clearance) <= 0.5 * 6.0 / 256.0 + 1e-6
    if xy is not None:
        middle = mug().transformed(found.world_from_object).bounds.mean(axis=0)
        np.testing.assert_allclose(middle[:2], xy, atol=2.0 * 6.0 / 256.0)
    assert "LayoutGPT with 1 exemplars wrote: mug {" in found.reason


def test_layoutgpt_keeps_the_size_and_takes_nothing_else_of_the_intent() -> None:
    """The scale is the intent's; another base and region of the intent change nothing."""
    prompt = "put the mug at the center of the bed"
    meant = Stages().meant(prompt, MUG)
    assert isinstance(meant, Intent)
    other = replace(meant, base_id="floor", base_label="floor", region=replace(meant.region, names=("left",)))
    one, two = (
        layoutgpt(SegmentedScene(ROOM), SegmentedObject(MUG), i, prompt, LayoutGptConfig(), OFFLINE)
        for i in (meant, other)
    )
    assert isinstance(one, Anchor)
    assert isinstance(two, Anchor)
    np.testing.assert_array_equal(one.world_from_object, two.world_from_object)
    assert np.linalg.det(one.world_from_object[:3, :3]) == pytest.approx(meant.scale**3)


@pytest.mark.parametrize(
    ("answer", "count"),
    [
        ("I am sorry, I cannot see the bed.", 0),
        (LINE.format("twenty"), 0),
        (LINE.format(20).replace("orientation: 0 degrees;", ""), 0),
        (LINE.format(20) + "\n" + LINE.format(30), 2),
    ],
)
def test_layoutgpt_has_no_place_without_exactly_one_line(api: FakeApi, answer: str, count: int) -> None:
    """Prose, a word for a number, a missing field, two lines: infeasible, in one line that says how many, and nothing
    is asked again."""
    found = layout_of("put the mug on the bed", asking(api, {"layout": answer}))
    assert isinstance(found, Infeasible)
    assert f"gained {count} valid lines" in found.message
    assert "\n" not in found.message
    assert len(api.asked) == 1


@pytest.mark.parametrize(("prompt", "base"), [("put the mug on the bed", "bed"), ("put the mug on the table", "table")])
def test_holodeck_succeeds_on_a_receptacle(stages: Stages, prompt: str, base: str) -> None:
    """Whoever answers, the mug stands on the named thing, in nothing's way."""
    found = stages.answered(lambda client: deck_of(prompt, client))
    assert isinstance(found, Anchor), found
    assert found.base_id == base
    assert found.clearance == pytest.approx(0.0, abs=1e-6)
    assert f"on top of the {base}" in found.reason


def test_holodeck_finds_a_place_on_the_floor_by_relations() -> None:
    """A stool near the stove stands on the floor within 80 cm of it, off all other things."""
    found = deck_of("put the stool on the floor next to the stove", OFFLINE, SEAT, HALL)
    assert isinstance(found, Anchor), found
    assert found.base_id in ("floor", "rug")
    low, high = SEAT.mesh.transformed(found.world_from_object).bounds
    assert low[2] == pytest.approx(0.0, abs=1e-6)
    # the stove covers -0.3 to 0.3 in x and 1.6 to 2 in y
    gap = np.maximum(np.maximum((-0.3, 1.6) - high[:2], low[:2] - (0.3, 2.0)), 0.0)
    assert 0.0 < np.linalg.norm(gap) < 0.8
    assert "near, stove-0" in found.reason


def test_holodeck_has_no_place_where_the_room_is_full() -> None:
    """A cube 3.9 m wide stands nowhere on a floor of 4 m."""
    found = deck_of("put the cube on the floor", OFFLINE, thing("cube", block((0, 0, 0), (3.9, 3.9, 3.9))), HALL)
    assert isinstance(found, Infeasible)
    assert "the floor has no place" in found.message


@pytest.mark.parametrize(
    ("line", "said"),
    [("mug-0 |", "edge by default"), ("mug-0 | egde | near, piano-0 | blah", "edge | "), ("mug-0 | middle", "middle;")],
)
def test_holodeck_reads_bad_lines_as_its_source_does(api: FakeApi, line: str, said: str) -> None:
    """No relation: an edge; misspelled words are the nearest ones; targets that are not there are dropped."""
    found = deck_of("put the mug on the floor", asking(api, {"on_top_of": "", "constraints": line}))
    assert isinstance(found, Anchor), found
    assert said.rstrip(" |") in found.reason


@pytest.mark.parametrize("line", ["", "I would put it at the wall.", "stool-0 | edge"])
def test_holodeck_does_not_place_an_object_without_a_line(api: FakeApi, line: str) -> None:
    """As in the source; nothing is asked again."""
    found = deck_of("put the mug on the floor", asking(api, {"on_top_of": "", "constraints": line}))
    assert isinstance(found, Infeasible)
    assert found.message == f"the answer has no line for mug-0: {line!r}"
    assert len(api.asked) == 1


def test_holodeck_is_told_once_more_that_a_receptacle_is_not_listed(api: FakeApi) -> None:
    """A name that is not listed is refused with the reason; three of them end in one line."""
    wrong, right = {"on_top_of": "piano-0", "constraints": ""}, {"on_top_of": "bed-0", "constraints": ""}
    assert isinstance(deck_of("put the mug on the bed", asking(api, wrong, right)), Anchor)
    with pytest.raises(LanguageError, match=r"'piano-0' is not one of bed-0, table-0") as told:
        deck_of("put the cube on the bed", asking(api, wrong), CUBE)
    assert "\n" not in str(told.value)
