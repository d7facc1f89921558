"""What placement.json says of where the object came to rest."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from box_rooms import ROOM

from flows.placement_json import off_its_part

ON_THE_MATTRESS = (0.0, -0.5, 0.48)
ON_A_PILLOW = (-0.35, 0.7, 0.6)


@pytest.mark.parametrize(
    ("asked", "rests", "lean", "off"),
    [
        ("mattress", ON_THE_MATTRESS, None, False),
        ("mattress", ON_A_PILLOW, None, True),
        ("", ON_A_PILLOW, None, False),  # no part was asked for
        ("mattress", ON_A_PILLOW, "against the headboard", False),  # what leans touches other parts, too
    ],
)
def test_rest_beside_the_part_that_was_asked(
    asked: str, rests: tuple[float, float, float], lean: str | None, off: bool
) -> None:
    """The part that the sentence names counts, and where the contact is at rest."""
    bounds = np.array([np.subtract(rests, 0.03), np.add(rests, 0.1)])
    body = SimpleNamespace(name="object", surface=SimpleNamespace(bounds=bounds))
    values: Any = SimpleNamespace(
        scene=ROOM, intent=SimpleNamespace(region=SimpleNamespace(part=asked)),
        anchor=SimpleNamespace(base_id="bed", part="mattress", lean=lean),
        settled=SimpleNamespace(bodies=(body,), contact_points=np.array([rests])),
    )  # fmt: skip
    assert off_its_part(values) is off
