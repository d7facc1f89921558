"""Places an asset on the floor: the room's things as placed objects, a search, the pose of the place found."""

from collections.abc import Sequence

import numpy as np
import shapely

from dcap.arrays import Array
from dcap.evaluation.baselines.asset import CanonicalAsset
from dcap.evaluation.baselines.holodeck.constraints import Relation
from dcap.evaluation.baselines.holodeck.floor_search import BUFFER, FloorObject, FloorRoom, search
from dcap.evaluation.baselines.holodeck.scores import WAYS, GridPlace
from dcap.scene.types.floor_plan import FloorPlan, PlanBox

CENTIMETRES = 100.0
WALKED_ON = 0.05
"""Largest height of a thing that is no obstacle [m]: rugs."""


def floor_place(
    plan: FloorPlan,
    names: dict[str, str],
    asset: CanonicalAsset,
    object_name: str,
    relations: Sequence[Relation],
    rng: np.random.Generator,
    *,
    roots: int,
    steps: int,
) -> GridPlace | None:
    """The best place, None without one.

    Args:
        plan: the room.
        names: names of its things by instance id.
        asset: the asset to place.
        object_name: its name.
        relations: the relations that its place should meet.
        rng: breaks ties.
        roots, steps: see `search`.
    """
    room = FloorRoom.of(shapely.Polygon(CENTIMETRES * plan.outline))
    high = plan.floor + float(asset.size[2])
    placed = {
        names[box.thing].lower(): as_place(box, solid=stands_in(box, plan.floor, high))
        for box in plan.things
        if box.thing in names
    }
    length, width = (CENTIMETRES * float(asset.size[axis]) + BUFFER for axis in (0, 1))
    thing = FloorObject(object_name, length, width, tuple(relations))
    return search(room, [thing], placed, rng, roots=roots, steps=steps).get(object_name)


def stands_in(box: PlanBox, floor: float, high: float) -> bool:
    """Whether a thing occupies space between the floor and a height [m]."""
    return box.bottom < high and box.top > floor + WALKED_ON


def as_place(box: PlanBox, *, solid: bool) -> GridPlace:
    """A thing of the room in the search's form: its rectangle, and the quarter turn nearest to its front."""
    turn = max(WAYS, key=lambda one: float(box.front @ WAYS[one]))
    x, y = (float(value) for value in CENTIMETRES * box.center[:2])
    return GridPlace((x, y), turn, shapely.Polygon(CENTIMETRES * box.ring), solid=solid)


def floor_pose(place: GridPlace, plan: FloorPlan, asset: CanonicalAsset) -> Array:
    """World from object of a place: on the floor, its front along the place's direction, shape (4, 4)."""
    center = np.array([*(np.array(place.center) / CENTIMETRES), plan.floor + 0.5 * float(asset.size[2])])
    return asset.pose(center, float(np.radians(180 - place.turn)))
