"""LayoutGPT (Feng et al., 2023): a model writes a room's layout as CSS lines, following examples of similar rooms.

The sources are the paper and its published program for rooms in three dimensions (run_layoutgpt_3d.py,
parse_llm_output.py). We take from them: the form of a line; its numbers (the middle of the box from the plan's least
corner, in pixels of a 256th of the room's shorter side, truncated to integers); the K = 8 exemplars with the smallest
mean squared difference between 64 x 64 pictures of the floor, the nearest first; the limit of their length; and the
parser, which drops invalid lines. Nothing is repaired or simulated. Our changes place one asset in a given room: the
prompt lists the room's own things and their parts, so that a seat can be told from a backrest; a sentence states the
request, and the model adds exactly one line; the asset's own size replaces the line's; orientation 0 looks along -y;
`top` grows along +y; heights are counted from the floor.

As in the source, the first room that would exceed the limit ends the list. All pictures have one scale and are centred
on their floors, so that shape and size are compared. Our square is as wide as the longest compared room (the source's
is 6.2 m for bedrooms and crops larger ones). GPT-2's table of merges is not at hand, so we count tokens by its rule for
dividing text (Radford et al., 2019); a piece of more than `LONG_PIECE` letters counts as several.
"""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from dcap.arrays import Array
from dcap.evaluation.baselines.floor_plan import CanonicalAsset
from dcap.language.protocol.questions import CssBox, LayoutLine, LayoutRequest, parsed_layout
from dcap.language.protocol.requests import IntentRequest, vector
from dcap.scene.types.floor_plan import FloorPlan, FloorPlans, PlanBox
from dcap.scene.types.outcome import Infeasible, Reason

PIXELS = 256
"""Pixels along the room's shorter side."""
LEAST_SIDE = 1e-3
"""Least width that a room is assumed to have [m]."""
MASK = 64
"""Width and height of a floor's picture [pixels]."""
PIECES = re.compile(r" ?[^\W\d_]+| ?\d+| ?(?:[^\s\w]|_)+|\s+(?!\S)|\s+")
"""Words, numbers, signs and blanks; a blank belongs to the piece after it."""
LONG_PIECE = 6
"""Letters of a word or digits of a number per token [-]."""
SHOWN = 120
"""Most characters of a bad answer that a message quotes."""


@dataclass(frozen=True, eq=False, slots=True)
class PixelGrid:
    """The pixels of one room."""

    origin: Array
    """World point of left 0, top 0, depth 0 [m], shape (3,)."""
    per_metre: float

    def pixels(self, metres: float) -> int:
        """A length [m] in pixels, truncated as in the source."""
        return int(metres * self.per_metre)

    def box(self, one: PlanBox) -> CssBox:
        """The line of a box."""
        left, top, depth = (self.pixels(float(value)) for value in one.center - self.origin)
        length, width, height = (self.pixels(float(value)) for value in one.size)
        angle = round(float(np.degrees(one.yaw)))
        return CssBox(category_of(one.label), length, width, height, left, top, depth, angle)

    def center(self, box: CssBox) -> Array:
        """The middle of a line's box in the world [m], shape (3,)."""
        return np.asarray(self.origin + np.array([box.left, box.top, box.depth]) / self.per_metre)


def grid_of(plan: FloorPlan) -> PixelGrid:
    """The pixels of a plan."""
    return PixelGrid(plan.low, PIXELS / max(float(plan.extents.min()), LEAST_SIDE))


def category_of(label: str) -> str:
    """A label as the category that begins a line: one word, without characters that end or divide a line."""
    return "_".join("".join(c if c.isalpha() else " " for c in label).split()) or "thing"


def floor_mask(plan: FloorPlan, side: float) -> NDArray[np.uint8]:
    """Picture of the floor, centred in a square with this side [m]: 255 inside, 0 outside, rows along y, shape (64,
    64)."""
    middle = plan.outline.min(axis=0) + 0.5 * plan.extents
    steps = ((np.arange(MASK) + 0.5) / MASK - 0.5) * side
    x, y = np.meshgrid(middle[0] + steps, middle[1] + steps)
    shape = shapely.Polygon(plan.outline)
    shapely.prepare(shape)
    return np.where(shapely.contains_xy(shape, x, y), 255, 0).astype(np.uint8)


def difference(a: NDArray[np.uint8], b: NDArray[np.uint8]) -> float:
    """Mean of the squared differences of two pictures [-]."""
    return float(((a.astype(np.float64) - b) ** 2).mean())


def most_similar(plan: FloorPlan, others: Sequence[FloorPlan], count: int) -> list[FloorPlan]:
    """The plans whose floors look most like this one's, the nearest first."""
    side = max(float(one.extents.max()) for one in (plan, *others))
    own = floor_mask(plan, side)
    away = [difference(floor_mask(other, side), own) for other in others]
    return [others[k] for k in sorted(range(len(others)), key=lambda k: (away[k], k))[:count]]


def within_limit(texts: Sequence[str], used: int, limit: int) -> list[str]:
    """The first texts that, with the tokens already used, stay within a number of tokens."""
    kept: list[str] = []
    for text in texts:
        used += token_count(text)
        if used > limit:
            break
        kept.append(text)
    return kept


def token_count(text: str) -> int:
    """Approximate number of GPT-2 tokens in a text."""
    return sum(-(-len(piece.strip()) // LONG_PIECE) or 1 for piece in PIECES.findall(text))


def condition_of(plan: FloorPlan) -> str:
    """Head of a layout: the kind and size of the room."""
    length, width = (grid_of(plan).pixels(float(value)) for value in plan.extents)
    return f"Condition:\nRoom Type: {plan.kind}\nRoom Size: max length {length}px, max width {width}px"


def exemplar_of(plan: FloorPlan) -> str:
    """A room as an example: its condition and the lines of its things."""
    grid = grid_of(plan)
    return "\n".join([condition_of(plan), "Layout:", *(grid.box(box).text for box in plan.things)])


def frequencies(plans: Sequence[FloorPlan]) -> str:
    """Categories in the rooms with their share of all things, the most frequent first."""
    counts = Counter(box.label for plan in plans for box in plan.things)
    total = max(counts.total(), 1)
    ordered = sorted(counts.items(), key=lambda item: (-item[1], item[0]))
    return "; ".join(f"{label}: {number / total:.4f}" for label, number in ordered)


def layout_request(
    asked: IntentRequest,
    plan: FloorPlan,
    exemplars: FloorPlans | None,
    asset: CanonicalAsset,
    name: str,
    *,
    most: int,
    limit: int,
) -> LayoutRequest:
    """The question with at most `most` similar rooms, as far as `limit` tokens allow; `asked` is the request of our own
    method's intent stage."""
    grid, others = grid_of(plan), others_of(plan, exemplars)
    lines = tuple(LayoutLine(box.thing, box.part, grid.box(box).text) for box in plan.boxes)
    categories, condition = frequencies([plan, *others]), condition_of(plan)
    used = token_count("\n".join([asked.prompt, categories, condition, *(line.text for line in lines)]))
    shown = within_limit([exemplar_of(one) for one in most_similar(plan, others, most)], used, limit)
    length, width, height = (grid.pixels(float(value)) for value in asset.size)
    return LayoutRequest(
        prompt=asked.prompt,
        item=asked.item,
        instances=asked.instances,
        room_center=asked.room_center,
        categories=categories,
        exemplars=tuple(shown),
        condition=condition,
        lines=lines,
        category=category_of(name),
        asset=(length, width, height),
        asset_size=vector(asset.size),
        has_front=asset.has_front,
        origin=vector(grid.origin),
        pixels_per_metre=grid.per_metre,
    )


def others_of(plan: FloorPlan, exemplars: FloorPlans | None) -> list[FloorPlan]:
    """Possible examples: all rooms but this one."""
    found = [] if exemplars is None else exemplars.plans
    return [one for one in found if not same_room(one, plan)]


def same_room(a: FloorPlan, b: FloorPlan) -> bool:
    """Whether two plans show the same room: outline and things are equal."""
    if not np.array_equal(a.outline, b.outline) or len(a.boxes) != len(b.boxes):
        return False
    pairs = zip(a.boxes, b.boxes, strict=True)
    return all(p.thing == q.thing and np.array_equal(p.center, q.center) for p, q in pairs)


def new_line(answer: str, lines: Sequence[LayoutLine]) -> CssBox | Infeasible:
    """The one new line of an answer; lines of the given layout do not count, invalid lines are dropped."""
    had = {box for line in lines for box in parsed_layout(line.text)}
    new = [box for box in parsed_layout(answer) if box not in had]
    if len(new) == 1:
        return new[0]
    said = " ".join(answer.split())[:SHOWN]
    return Infeasible(
        Reason.NO_SUPPORT_HIT,
        f"the layout gained {len(new)} valid lines, expected exactly one: {said!r}",
        None,
    )


def proposed_pose(box: CssBox, plan: FloorPlan, asset: CanonicalAsset) -> Array:
    """World-from-object pose of a line's box, shape (4, 4)."""
    return asset.pose(grid_of(plan).center(box), float(np.radians(box.orientation)))
