"""A line of a layout as LayoutGPT writes them: `bed {length: 120px; width: 110px; height: 60px; ... depth: 30px;}`.

The source is the published program of LayoutGPT (Feng et al., 2023; `parse_3D_layout`): what stands before the bracket
is the category without its digits, between the brackets are exactly seven fields `name: number`, letters of units are
cut off, and whatever is not of this form is no line. A line whose seven fields have other names is none either; the
source keeps it as a box of zeros.
"""

import math
import re
from dataclasses import dataclass

FIELDS = ("length", "width", "height", "left", "top", "depth", "orientation")
"""Seven numbers: extents, then the middle of the box from the plan's least corner, then the turn about the vertical."""
ANGLE = "orientation"
NUMBER = re.compile(r"^\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)(?:\s*[px]+)?(?:\s*[degrs]+)?\s*$")
"""The source cuts any letters of `degrees` off the end, then any of `px`: `90`, `90deg` and `90 degree` are valid."""


@dataclass(frozen=True, slots=True)
class CssBox:
    """A box of a layout, in pixels and degrees."""

    category: str
    length: float
    """To its right at orientation 0, along x."""
    width: float
    """To its front at orientation 0, along y."""
    height: float
    left: float
    """Middle along x from the plan's least x."""
    top: float
    """Middle along y from the plan's least y."""
    depth: float
    """Middle above the floor."""
    orientation: float
    """Turn about the vertical, counterclockwise seen from above [degrees]."""

    @property
    def text(self) -> str:
        """The line."""
        fields = (
            f"{name}: {getattr(self, name):g} degrees" if name == ANGLE else f"{name}: {getattr(self, name):g}px"
            for name in FIELDS
        )
        return f"{self.category} {{{'; '.join(fields)};}}"


def parsed_line(text: str) -> CssBox | None:
    """The box of a line; None of what is no line."""
    before, bracket, rest = text.partition("{")
    if not bracket or "{" in rest:
        return None
    fields = rest.strip().strip("}").strip().strip(";").split(";")
    numbers = {}
    for field in fields:
        name, colon, value = field.partition(":")
        found = NUMBER.match(value)
        if not colon or found is None or not math.isfinite(float(found[1])):
            return None
        numbers[name.strip()] = float(found[1])
    if len(fields) != len(FIELDS) or sorted(numbers) != sorted(FIELDS):
        return None
    return CssBox(re.sub(r"\d", "", before).strip(), **numbers)


def parsed_layout(text: str) -> list[CssBox]:
    """The boxes of a text, line by line; other lines are dropped."""
    found = (parsed_line(line) for line in text.splitlines())
    return [box for box in found if box is not None]
