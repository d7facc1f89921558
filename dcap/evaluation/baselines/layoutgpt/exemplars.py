"""Chooses the other rooms that the model sees: the K with the most similar floors, as many as fit into the prompt.

As in the source (`load_features`, `get_closest_room`, `form_prompt_for_chatgpt`): floors are compared as pictures of
64 x 64 pixels by the mean of the squared differences, the nearest comes first, and the first that would exceed the
limit ends the list. Pictures have one scale, so that floors are compared by shape and size, each about its own middle.
Ours: the square is as wide as the longest room that is compared (the source's is 6.2 m for bedrooms, whose pictures end
there); tokens are counted by the rule by which GPT-2 divides text before it merges letters (Radford et al., 2019), a
piece of more than `LONG_PIECE` letters as several, because the table of merges itself is not at hand.
"""

import re
from collections import Counter
from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

from dcap.evaluation.baselines.layoutgpt.pixels import grid_of
from dcap.scene.types.floor_plan import FloorPlan

MASK = 64
"""Width and height of a floor's picture [pixels]."""
PIECES = re.compile(r" ?[^\W\d_]+| ?\d+| ?(?:[^\s\w]|_)+|\s+(?!\S)|\s+")
"""Words, numbers, signs and blanks; a blank belongs to the piece after it."""
LONG_PIECE = 6
"""Letters of a word or digits of a number per token [-]."""


def floor_mask(plan: FloorPlan, side: float) -> NDArray[np.uint8]:
    """The floor in the middle of a square of that side [m] as a picture, 255 inside and 0 outside, rows along y, shape
    (64, 64)."""
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
