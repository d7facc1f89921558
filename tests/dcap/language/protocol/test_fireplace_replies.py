"""What the questions of FirePlace* take for an answer, and what they refuse in one line."""

from dataclasses import replace

import pytest
from questions_at_hand import pose

from dcap.language.offline.client import OfflineClient
from dcap.language.protocol.fireplace import (
    CHOICE,
    OUTLINES,
    PRUNING,
    ChoiceOption,
    ChoiceRequest,
    OutlinesRequest,
    PruningRequest,
)
from dcap.language.protocol.requests import InstanceView, ObjectView, PartView

TOP = PartView(0, "top", (0.0, 0.0, 0.7), (1.2, 0.6, 0.03), 0.7)
TABLE = InstanceView(
    "t1", "table", (0.0, 0.0, 0.35), (1.2, 0.6, 0.7), (-0.6, -0.3, 0.0), (0.6, 0.3, 0.7), None, False, (0.5, 0.5, 0.5),
    (TOP,),
)  # fmt: skip
ON_TOP = {"anchors": ["t1"], "anchor_side": "top"}
CONTACT = {"function": "contact", "object_surfaces": ["upright"], **ON_TOP}
REQUEST = OutlinesRequest(
    "put the mug near the left edge of the table", "mug", ObjectView("mug", (0.1, 0.1, 0.1), ()), (TABLE,),
    ((0.0, -1.0, 0.0),), (0.0, 0.0, 0.0), (pose("upright", (0.0, 0.0, 1.0)), pose("flip_y", (0.0, 0.0, -1.0))), 0,
    False, True, 0.0, False,
)  # fmt: skip
OPTIONS = (
    ChoiceOption("A", "placement 0", (("loss", 0.5),)),
    ChoiceOption("B", "placement 1", (("loss", 0.001), ("margin_m", 0.1))),
    ChoiceOption("C", "placement 2", (("loss", 0.001), ("margin_m", 0.3))),
)


def test_a_sentence_becomes_a_contact_and_a_distance_from_a_side() -> None:
    """The left edge is close_to the left side of the part that carries."""
    reply = OfflineClient().ask(OUTLINES, REQUEST)
    assert [one.function for one in reply.constraints] == ["contact", "no_overhang", "close_to"]
    contact, _, edge = reply.constraints
    assert (contact.anchors, contact.anchor_parts, contact.anchor_side) == (("t1",), (0,), "top")
    assert contact.object_surfaces == ("upright",)
    assert (edge.anchor_side, edge.metres) == ("left", 0.05)


@pytest.mark.parametrize(
    ("words", "functions"),
    [
        ("in the middle of the table", ["far_from"] * 4),
        ("at the front right corner of the table", ["close_to"] * 2),
        ("on the left half of the table", ["far_from"]),
        ("on the table", []),
        ("on the table 20 cm from the left edge", ["close_to", "far_from"]),
    ],
)
def test_regions_are_distances(words: str, functions: list[str]) -> None:
    """Beside what every placement has."""
    reply = OfflineClient().ask(OUTLINES, replace(REQUEST, prompt=f"put the mug {words}"))
    assert [one.function for one in reply.constraints][2:] == functions


def test_what_the_scene_lacks_is_said() -> None:
    """And no constraint is made up."""
    reply = OfflineClient().ask(OUTLINES, replace(REQUEST, prompt="put the mug on the piano"))
    assert reply.constraints == ()
    assert "piano" in reply.missing


@pytest.mark.parametrize(
    ("constraints", "said"),
    [
        ([], "hold 0 contacts, expected exactly one"),
        ([CONTACT, CONTACT], "hold 2 contacts"),
        ([{**CONTACT, "anchors": ["nowhere"]}], "anchor 'nowhere' is not one of t1"),
        ([{**CONTACT, "anchors": []}], "names no anchor"),
        ([{**CONTACT, "object_surfaces": ["bottom"]}], "'bottom' of constraint contact is not one of upright, flip_y"),
        ([{**CONTACT, "anchor_parts": [3]}], r"anchor_parts \[3\] are not all parts of t1"),
        ([{**CONTACT, "anchor_side": "whole"}], "anchor_side is 'whole'"),
        ([CONTACT, {"function": "close_to", "object_surfaces": ["bottom"], **ON_TOP}], "close_to has 0 distances"),
        ([{**CONTACT, "metres": 0.1}], "contact has 1 distances"),
        ([CONTACT, {"function": "facing", "object_surfaces": ["face"], **ON_TOP}], "'face' of constraint facing"),
    ],
)
def test_outlines_that_do_not_fit_are_refused_in_one_line(constraints: list[object], said: str) -> None:
    """With what is wrong and what there is."""
    with pytest.raises(ValueError, match=said) as error:
        OUTLINES.parsed({"constraints": constraints}, REQUEST)
    assert "\n" not in str(error.value)


def test_choices_are_among_the_options() -> None:
    """Another letter is refused with those there are."""
    request = ChoiceRequest("put it there", "placement", "the most natural one", OPTIONS)
    with pytest.raises(ValueError, match="chosen 'Z' is not one of A, B, C"):
        CHOICE.parsed({"chosen": "Z"}, request)
    with pytest.raises(ValueError, match="implausible 'Z' is not one of A, B, C"):
        PRUNING.parsed({"implausible": ["A", "Z"]}, PruningRequest("put it there", "mug", OPTIONS))


def test_offline_prunes_what_breaks_constraints_and_takes_what_is_farthest_from_the_rim() -> None:
    """A has a loss far above the best; C keeps farther from the rim than B."""
    assert OfflineClient().ask(PRUNING, PruningRequest("put it there", "mug", OPTIONS)).implausible == ("A",)
    request = ChoiceRequest("put it there", "placement", "the most natural one", OPTIONS)
    assert OfflineClient().ask(CHOICE, request).chosen == "C"
