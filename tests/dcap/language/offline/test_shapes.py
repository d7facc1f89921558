"""Laws of naming things by shape: what is usual for a label gets it, and doubt is said."""

import math
from dataclasses import replace

import pytest

from dcap.knowledge.shapes import ShapePrior, labels, shape_row, shapes
from dcap.language.offline.label import label_of
from dcap.language.protocol.replies import OTHER, LabelReply
from dcap.language.protocol.requests import LabelRequest
from dcap.scene.errors import InputError

ALIKE = frozenset({"counter", "toy"})
"""Labels whose middling example is as well something else: a short counter is a cabinet, a flat toy a book."""


def usual_thing(shape: ShapePrior) -> LabelRequest:
    """Every measure of the row in the middle of its range, the others as most things have them."""

    def middle(name: str, otherwise: float) -> float:
        usual = shape.traits.get(name)
        return otherwise if usual is None else 0.5 * (usual.low + usual.high)

    length, width, height = (math.exp(middle(name, 0.0)) for name in ("length", "width", "height"))
    on_floor = shape.held_by[0] == "floor"
    bottom, rise = middle("bottom", 0.0 if on_floor else 1.0), middle("rise", 0.0 if on_floor else 0.1)
    light, green = middle("light", 0.5), middle("green", 0.0)
    return LabelRequest(
        id="thing_0", size=(length, width, height), bottom=bottom, top=bottom + height,
        level_height=middle("level", bottom + height - rise), level_area=middle("share", 0.5) * length * width,
        rise=rise, levels=round(middle("levels", 1.0)), closed=middle("closed", 0.8), covered=middle("covered", 0.9),
        waist=middle("waist", 0.8), rough=middle("rough", 0.1), held_by=shape.held_by[0], holder=shape.held_by[0],
        wall_gap=middle("gap", 0.3), carries=0, color=(light, light + green, light), varied=middle("varied", 15.0),
        balance=middle("balance", 0.5), labels=labels(),
    )  # fmt: skip


def test_what_is_usual_for_a_label_gets_it(subtests: pytest.Subtests) -> None:
    """A thing in the middle of all ranges of a row, held by what usually holds it, gets the label of the row."""
    for shape in shapes():
        if shape.label not in ALIKE:
            with subtests.test(str((shape.label, shape.held_by))):
                assert label_of(usual_thing(shape)).label == shape.label


def test_what_holds_a_thing_tells_what_it_is() -> None:
    """The same soft box is a pillow on a bed and a cushion on a sofa."""
    pillow = next(usual_thing(shape) for shape in shapes() if shape.label == "pillow")
    small = replace(pillow, size=(0.48, 0.4, 0.14))
    assert label_of(replace(small, holder="bed")).label == "pillow"
    assert label_of(replace(small, holder="sofa")).label == "cushion"


def test_only_listed_labels_are_given() -> None:
    """What may not be chosen is not, and with nothing to choose from the thing is other."""
    bed = next(usual_thing(shape) for shape in shapes() if shape.label == "bed")
    assert label_of(replace(bed, labels=("sofa", "cup"))).label in ("sofa", "cup", OTHER)
    assert label_of(replace(bed, labels=())) == LabelReply(
        label=OTHER, confidence=1.0, reason=label_of(replace(bed, labels=())).reason
    )
    with pytest.raises(ValueError, match="throne"):
        LabelReply(label="throne", confidence=1.0).check(bed)


@pytest.mark.parametrize("entry", ["height=1 2 3", "height=3 2 1 4", "girth=1 2 3 4"])
def test_a_bad_row_is_named(entry: str) -> None:
    """Too few numbers, falling ones and unknown measures are errors that quote the entry."""
    row = {"label": "bed", "held_by": "floor", "common": "1", "traits": entry, "source": "estimate"}
    with pytest.raises(InputError, match=entry.split("=")[0]):
        shape_row(row)
