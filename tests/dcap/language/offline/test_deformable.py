"""What counts as a deformable support, by its label."""

import pytest

from dcap.language.offline.kinds import deformable_kind, deformable_supports


@pytest.mark.parametrize(
    ("label", "kind"),
    [
        ("Bed", "bed"), ("functional bed", "bed"), ("Multi person sofa", "sofa"), ("armchair", "soft seat"),
        ("leather chair", "soft seat"), ("upholstered stool", "soft seat"), ("Mattress", "mattress"),
        ("body pillow", "pillow or cushion"), ("quilt", "blanket or towel"), ("teddy bear", "soft toy"),
        ("carpet", "rug"),
    ],
)  # fmt: skip
def test_soft_supports_are_counted(label: str, kind: str) -> None:
    """Any case, synonyms, and seats that a word makes soft."""
    assert deformable_kind(label) == kind


@pytest.mark.parametrize(
    "label",
    ["chair", "dining table", "bedside table", "pillow cabinet", "curtain", "wall", "apple", "book", "headboard",
     "floor lamp", "plant", "", "!!", "teatable", "stool"],
)  # fmt: skip
def test_hard_things_and_soft_things_that_carry_nothing_are_not(label: str) -> None:
    """A bedside table is no bed, fruit and curtains carry nothing."""
    assert deformable_kind(label) == ""


def test_they_are_counted_by_kind() -> None:
    """One for each label."""
    assert deformable_supports(["bed", "Bed", "sofa", "desk"]) == {"bed": 2, "sofa": 1}
