"""What is typed inside becomes plain JSON at the edge, always in the same way."""

import json
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
import pytest
from pydantic import BaseModel

from dcap.scene.written_files import to_json


class Colour(StrEnum):
    """A closed set."""

    RED = "red"


@dataclass(frozen=True)
class Cell:
    """A value with every kind of field."""

    width: float
    colour: Colour
    corner: np.ndarray
    neighbours: tuple["Cell", ...]
    asked: float | None
    extra: int | None = None


CELL = Cell(0.5, Colour.RED, np.array([1.0, 2.0]), (), None)


def test_a_dataclass_becomes_an_object_in_the_order_of_its_fields() -> None:
    """Enums become their values, arrays and tuples lists; None is null, but left out where it is the default."""
    outer = Cell(1.0, Colour.RED, np.zeros(0), (CELL,), 2.0, 3)
    assert json.dumps(to_json(outer)) == (
        '{"width": 1.0, "colour": "red", "corner": [], "neighbours": [{"width": 0.5, "colour": "red", '
        '"corner": [1.0, 2.0], "neighbours": [], "asked": null}], "asked": 2.0, "extra": 3}'
    )


class Length(BaseModel, frozen=True):
    """A configuration of one number."""

    metres: float


@pytest.mark.parametrize("number", [float("inf"), np.float64("-inf")])
def test_a_number_that_json_does_not_have_is_null(number: float) -> None:
    """Also inside of an array; so whatever is written can be read by any program."""
    tree = to_json({"a": number, "b": np.array([number, 1.0]), "c": Length(metres=number)})
    assert json.loads(json.dumps(tree, allow_nan=False)) == {"a": None, "b": [None, 1.0], "c": {"metres": None}}


@pytest.mark.parametrize("number", [float("nan"), np.float64("nan"), np.array([1.0, np.nan])])
def test_nan_is_a_mistake(number: object) -> None:
    """Null would hide it; the field is named."""
    with pytest.raises(ValueError, match="height is NaN"):
        to_json({"thing": {"height": number}})
