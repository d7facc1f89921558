"""LayoutGPT's formulas: lines, pixels, pictures of floors, examples, and what counts as one new line."""

import numpy as np
import pytest
from baseline_requests import asked_layout
from box_rooms import ROOM, mug
from hypothesis import given
from hypothesis import strategies as st

from dcap.evaluation.baselines.floor_plan import canonical_asset, floor_plan_of
from dcap.evaluation.baselines.layoutgpt import (
    category_of,
    difference,
    exemplar_of,
    floor_mask,
    grid_of,
    most_similar,
    new_line,
    others_of,
    proposed_pose,
    token_count,
    within_limit,
)
from dcap.language.offline.client import OfflineClient
from dcap.language.protocol.questions import LAYOUTGPT, CssBox, parsed_layout, parsed_line
from dcap.scene.types.floor_plan import FloorPlan, FloorPlans, PlanBox
from dcap.scene.types.outcome import Infeasible

LINE = "bed {length: 120px; width: 110px; height: 60px; left: 90px; top: 80px; depth: 30px; orientation: 90 degrees;}"
BED = CssBox("bed", 120, 110, 60, 90, 80, 30, 90)


def room(*corners: tuple[float, float], boxes: tuple[PlanBox, ...] = ()) -> FloorPlan:
    """A plan of that outline."""
    return FloorPlan("bedroom", np.array(corners), 0.0, boxes)


SQUARE = room((0, 0), (4, 0), (4, 4), (0, 4))
HALF = room((0, 0), (4, 0), (4, 2), (0, 2))
THREE_QUARTERS = room((0, 0), (4, 0), (4, 3), (0, 3))


def test_a_line_is_read_and_written() -> None:
    """The example of the source's form, in any order of its fields; writing it gives it back."""
    assert parsed_line(LINE) == BED
    assert parsed_line("bed2 {orientation: 90; left: 90; top: 80px; depth: 30.0px; height:60px;width:110;length:120px}")
    assert parsed_line("bed2" + LINE[3:]) == BED  # digits are no part of a category
    assert parsed_line(BED.text) == BED


@pytest.mark.parametrize(
    "turn", ["90", "90deg", "90 deg", "90degree", "90 degree", "90degrees", "90px", " 90.0 degrees "]
)
def test_letters_of_units_are_cut_off(turn: str) -> None:
    """The source takes any letters of `degrees`, and any of `px` before them, off the end of a field."""
    assert parsed_line(LINE.replace("90 degrees", turn)) == BED


@given(st.lists(st.integers(-999, 999), min_size=7, max_size=7))
def test_any_box_survives_its_line(numbers: list[int]) -> None:
    """Reading what was written gives the same numbers."""
    box = CssBox("side_table", *numbers)
    assert parsed_line(box.text) == box


@pytest.mark.parametrize(
    "line",
    [
        "", "I would put the ball on the bed.", LINE.replace("depth: 30px; ", ""), LINE.replace("depth", "deep"),
        LINE.replace("30px", "thirty px"), LINE.replace("30px", "30cm"), LINE.replace("30px", "nan"),
        LINE.replace("depth: 30px", "depth: 30px; depth: 31px"), LINE.replace("left:", "left"), "{" + LINE,
        LINE.replace("30px", "1e999px"), LINE.replace("depth: 30px", "left: 30px"),
        LINE.replace("90 degrees", "1.57 rad"), LINE.replace("90 degrees", "90°"), LINE.replace("90 degrees", "90 Deg"),
    ],
)  # fmt: skip
def test_what_is_no_line_is_dropped(line: str) -> None:
    """Seven fields of the right names with finite numbers, or it is none."""
    assert parsed_layout(line) == []


def test_pixels_are_cut_and_come_back() -> None:
    """A pixel is a 256th of the shorter side: in a room of 4 x 2 m, 128 to the metre; a length is cut to whole ones."""
    grid = grid_of(HALF)
    assert grid.per_metre == pytest.approx(128.0)
    assert grid.pixels(1.0) == 128
    assert grid.pixels(0.999) == 127
    box = PlanBox("a", -1, "side table", np.array([1.0, 0.5, 0.25]), np.array([0.5, 1.0, 0.5]), np.pi / 2)
    assert grid.box(box) == CssBox("side_table", 64, 128, 64, 128, 64, 32, 90)
    np.testing.assert_allclose(grid.center(grid.box(box)), box.center, atol=1.0 / 128.0)


def test_a_category_is_one_word() -> None:
    """Blanks, digits and what ends a line are replaced."""
    assert category_of("Side table 2 {new}; ") == "Side_table_new"
    assert category_of("12") == "thing"


def test_floors_are_compared_as_pictures() -> None:
    """Half a square differs from the whole in half its pixels: 255^2 / 2; three quarters in a quarter of them."""
    whole, half, more = (floor_mask(one, 4.0) for one in (SQUARE, HALF, THREE_QUARTERS))
    assert whole.shape == (64, 64)
    assert whole.min() == 255
    assert difference(whole, half) == pytest.approx(255.0**2 / 2)
    assert difference(whole, more) == pytest.approx(255.0**2 / 4)
    assert most_similar(SQUARE, [HALF, THREE_QUARTERS], 2) == [THREE_QUARTERS, HALF]
    assert most_similar(SQUARE, [HALF, THREE_QUARTERS], 1) == [THREE_QUARTERS]


def test_floors_are_compared_by_size_too() -> None:
    """A square of 4 m is nearer to its half than to a square of 8 m, which has the same shape."""
    large = room((0, 0), (8, 0), (8, 8), (0, 8))
    assert most_similar(SQUARE, [large, HALF], 2) == [HALF, large]
    assert difference(floor_mask(large, 8.0), floor_mask(SQUARE, 8.0)) == pytest.approx(0.75 * 255.0**2)


def test_a_room_is_no_example_of_itself() -> None:
    """Of the plans of a run that of the room is left out; without plans there are no examples."""
    own, same = floor_plan_of(ROOM), floor_plan_of(ROOM)
    assert others_of(own, FloorPlans((HALF, same))) == [HALF]
    assert others_of(own, None) == []


def test_examples_end_before_the_limit() -> None:
    """Of three texts of four tokens each, ten tokens with two used hold two; a text that does not fit ends the list."""
    text = "a bed: 1"
    assert token_count(text) == 4
    assert within_limit([text, text, text], 2, 10) == [text, text]
    assert within_limit([text * 100, text], 2, 10) == []


def test_an_example_says_what_a_room_holds() -> None:
    """Condition, then a line for each thing, none for its parts."""
    lines = exemplar_of(floor_plan_of(ROOM)).splitlines()
    assert lines[:4] == ["Condition:", "Room Type: bedroom", "Room Size: max length 256px, max width 256px", "Layout:"]
    assert [line.split()[0] for line in lines[4:]] == ["bed", "table", "table_lamp"]


@pytest.mark.parametrize(
    ("answer", "count"),
    [
        ("", 0), ("Sure, on the bed!", 0), (asked_layout().lines[0].text, 0),
        (f"{LINE}\n{BED.text.replace('90px', '91px')}", 2),
    ],
)  # fmt: skip
def test_more_or_fewer_than_one_new_line_is_no_placement(answer: str, count: int) -> None:
    """None, two, and one that the layout had already: each is said in one line."""
    found = new_line(answer, asked_layout().lines)
    assert isinstance(found, Infeasible)
    assert found.message.startswith(f"the layout gained {count} valid lines, expected exactly one")
    assert "\n" not in found.message


def test_one_new_line_among_old_ones_and_prose_is_taken() -> None:
    """Repeated lines are not new, prose is dropped."""
    had = asked_layout().lines
    answer = "\n".join(["Here it is:", *(line.text for line in had), f"- {LINE}"])
    assert new_line(answer, had) == CssBox("- bed", 120, 110, 60, 90, 80, 30, 90)


def test_the_pose_is_what_the_line_says() -> None:
    """Middle and turn are the line's, the size is the asset's whatever the line says."""
    plan, asset = floor_plan_of(ROOM), canonical_asset(mug(), 1.0, "mug")
    pose = proposed_pose(CssBox("mug", 999, 999, 999, 128, 64, 32, 90), plan, asset)
    placed = mug().transformed(pose)
    # 256 pixels are 6 m
    np.testing.assert_allclose(placed.bounds.mean(axis=0), np.array([128, 64, 32]) * 6.0 / 256.0 - (3, 3, 0), atol=1e-6)
    np.testing.assert_allclose(np.ptp(placed.bounds, axis=0), asset.size[[1, 0, 2]], atol=1e-6)


@pytest.mark.parametrize(
    ("prompt", "xy", "bottom"),
    [
        ("put the mug at the center of the bed", (0.0, 0.0), 0.5),
        ("put the mug on the left half of the bed", (-0.375, 0.0), 0.5),
        ("put the mug on the table", (1.9, 1.0), 0.5),  # beside the foot of the lamp that stands in its middle
        ("put the mug on the floor near the bed", None, 0.0),
    ],
)
def test_offline_the_line_stands_where_the_sentence_says(prompt: str, xy, bottom: float) -> None:
    """The box's lower face is at the support to half a pixel, its middle at the region's, free of other boxes."""
    request = asked_layout(prompt)
    box = parsed_layout(OfflineClient().ask(LAYOUTGPT, request).layout)[0]
    pixel = 1.0 / request.pixels_per_metre
    center = grid_of(floor_plan_of(ROOM)).center(box)
    assert center[2] - 0.5 * request.asset_size[2] == pytest.approx(bottom, abs=0.51 * pixel)
    if xy is not None:
        np.testing.assert_allclose(center[:2], xy, atol=2.0 * pixel)
    inside_bed = abs(center[0]) < 0.75 and abs(center[1]) < 0.95
    assert inside_bed == ("of the bed" in prompt)
