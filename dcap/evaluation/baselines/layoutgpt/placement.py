"""Turns a floor plan into the question, and the answer into the pose that it proposes.

Exactly one new line in the layout makes a placement. Its size is replaced by the asset's; its middle is the middle of
the asset's box; its orientation turns the asset about the vertical. Nothing else is changed.
"""

from collections.abc import Sequence

import numpy as np

from dcap.arrays import Array
from dcap.evaluation.baselines.asset import CanonicalAsset
from dcap.evaluation.baselines.layoutgpt.exemplars import (
    condition_of,
    exemplar_of,
    frequencies,
    most_similar,
    token_count,
    within_limit,
)
from dcap.evaluation.baselines.layoutgpt.pixels import category_of, grid_of
from dcap.language.protocol.questions import CssBox, LayoutLine, LayoutRequest, parsed_layout
from dcap.language.protocol.requests import IntentRequest, vector
from dcap.scene.types.floor_plan import FloorPlan, FloorPlans
from dcap.scene.types.outcome import Infeasible, Reason

SHOWN = 120
"""Most characters of a bad answer that a message quotes."""


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
    """The question with as many of the `most` similar rooms as `limit` tokens allow; `asked` is the
    request of our own method's intent stage."""
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
    """World from object by the line, shape (4, 4)."""
    return asset.pose(grid_of(plan).center(box), float(np.radians(box.orientation)))
