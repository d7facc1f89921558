"""Places an asset on the floor with Holodeck's depth-first search.

The room's things count as placed objects. As in the source (`DFS_Solver_Floor`, without the variant that is off by
default), middles lie on a grid of a 20th of the room, with four turns, and 10 cm is added to each extent. A rectangle
lies in the room and meets no other; its front is at least 30 cm from the wall. `edge`, a hard constraint and the
default, takes the places whose back is within a grid step of the wall and moves them there. Scores are divided by the
number of relations. Without a place at a wall there is none at all, even for `middle`. The first of several objects is
tried at 30 places, each later one at its best place; in a furnished room the requested object is a later one.

Ours: a budget of steps instead of 30 s, so that equal inputs give equal places; the caller's generator breaks ties.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from shapely import affinity

from dcap.arrays import Array
from dcap.evaluation.baselines.floor_plan import CanonicalAsset
from dcap.evaluation.baselines.holodeck.scores import (
    BONUS,
    TURNS,
    WAYS,
    WEIGHTS,
    GridPlace,
    Relation,
    RelationKind,
    distance_scores,
    satisfying,
)
from dcap.scene.types.floor_plan import FloorPlan, PlanBox

DENSITY = 20
"""Grid steps along the room's longer side [-]."""
BUFFER = 10.0
"""Added to the object's length and width [cm]."""
FRONT_ROOM = 30.0
"""Least distance of the middle of its front from the wall [cm]."""
INTO_WALL = 4.5
"""Distance that the back of a place at the wall moves into it [cm]: almost half of the added extent."""
EDGE = "edge"
CENTIMETRES = 100.0
WALKED_ON = 0.05
"""Largest height of a thing that is no obstacle [m]: rugs."""


@dataclass(frozen=True, slots=True)
class FloorObject:
    """An object to place."""

    name: str
    length: float
    """Extent across its viewing direction [cm]."""
    width: float
    """From back to front [cm]."""
    relations: tuple[Relation, ...]


@dataclass(slots=True)
class StepBudget:
    """Number of object searches left."""

    left: int


Placed = Mapping[str, GridPlace]


@dataclass(frozen=True, slots=True)
class FloorRoom:
    """The floor and its grid."""

    outline: shapely.Polygon
    """[cm]."""
    grid: int
    """[cm]."""

    @classmethod
    def of(cls, outline: shapely.Polygon) -> "FloorRoom":
        """A room with the source's grid: a 20th of its longer side, which is counted in whole metres."""
        low_x, low_y, high_x, high_y = outline.bounds
        metres = (int((high_x - low_x) // 100), int((high_y - low_y) // 100))
        return cls(outline, max(1, *(100 * one // DENSITY for one in metres)))


def search(
    room: FloorRoom, objects: Sequence[FloorObject], placed: Placed, rng: np.random.Generator, *, roots: int, steps: int
) -> dict[str, GridPlace]:
    """The placed things, and the objects that found a place, in the solution with the best total score.

    Args:
        room: the floor.
        objects: in their order; relations refer to earlier objects and to placed things.
        placed: things by name.
        rng: breaks ties.
        roots: places that are tried for the first object, if nothing is placed yet.
        steps: maximum number of object searches.
    """
    solutions: list[dict[str, GridPlace]] = []
    descend(room, list(objects), dict(placed), rng, solutions, StepBudget(steps), 1 if placed else roots)
    new = {one.name for one in objects}
    return max(solutions, key=lambda found: sum(place.score for name, place in found.items() if name in new))


def descend(
    room: FloorRoom,
    objects: list[FloorObject],
    placed: dict[str, GridPlace],
    rng: np.random.Generator,
    solutions: list[dict[str, GridPlace]],
    budget: StepBudget,
    branches: int,
) -> None:
    """Try places for the first object, recurse for the rest, and add finished branches to `solutions`."""
    if not objects or budget.left <= 0:
        solutions.append(placed)
        return
    budget.left -= 1
    places = candidates(room, objects[0], placed, rng)
    if branches > 1:
        places = [places[k] for k in rng.permutation(len(places))]
    if not places:
        solutions.append(placed)
    for place in places[:branches]:
        descend(room, objects[1:], {**placed, objects[0].name: place}, rng, solutions, budget, 1)


def candidates(room: FloorRoom, one: FloorObject, placed: Placed, rng: np.random.Generator) -> list[GridPlace]:
    """Possible places of an object, the best first."""
    free = off_others(all_places(room, one, placed), placed)
    free = [place for place in free if wall_distance(room, ahead(place, one.width)) >= FRONT_ROOM]
    at_wall = moved_to_wall(room, free, one.width)
    if not at_wall:
        return []
    told = next((relation.name for relation in one.relations if relation.kind is RelationKind.GLOBAL), EDGE)
    anywhere = free + at_wall if len(one.relations) > 1 else free
    places = off_others(at_wall if told == EDGE else anywhere, placed)
    places = [places[k] for k in rng.permutation(len(places))]
    return sorted(scored(room, one, placed, places), key=lambda place: -place.score)


def scored(room: FloorRoom, one: FloorObject, placed: Placed, places: list[GridPlace]) -> list[GridPlace]:
    """The places with the scores of their relations."""
    if not places:
        return []
    totals = np.array([place.score for place in places])
    for relation in one.relations:
        if not relation.target:
            continue
        target, weight = placed[relation.target], WEIGHTS[relation.kind]
        if relation.kind is RelationKind.DISTANCE:
            totals += weight * np.array(distance_scores(relation.name, target, places))
        else:
            totals += BONUS * weight * np.array(satisfying(relation, target, places, room.grid))
    totals /= max(len(one.relations), 1)
    return [replace(place, score=float(total)) for place, total in zip(places, totals, strict=True)]


def all_places(room: FloorRoom, one: FloorObject, placed: Placed) -> list[GridPlace]:
    """Free grid points with every turn at which the rectangle lies in the room."""
    low_x, low_y, high_x, high_y = room.outline.bounds
    columns, rows = (range(int(a), int(b), room.grid) for a, b in ((low_x, high_x), (low_y, high_y)))
    x, y = np.array([(column, row) for column in columns for row in rows], dtype=np.float64).reshape(-1, 2).T
    free = shapely.contains_xy(room.outline, x, y)
    for thing in (one for one in placed.values() if one.solid):
        free &= ~shapely.contains_xy(thing.rectangle, x, y)
    found = []
    for turn in TURNS:
        across, along = (one.length, one.width) if turn in (0, 180) else (one.width, one.length)
        for a, b in zip(x[free], y[free], strict=True):
            rectangle = shapely.box(a - across / 2, b - along / 2, a + across / 2, b + along / 2)
            if room.outline.contains(rectangle):
                found.append(GridPlace((float(a), float(b)), turn, rectangle))
    return found


def off_others(places: Sequence[GridPlace], placed: Placed) -> list[GridPlace]:
    """Places that intersect nothing placed."""
    others = shapely.union_all([thing.rectangle for thing in placed.values() if thing.solid])
    return [place for place in places if not place.rectangle.intersects(others)]


def moved_to_wall(room: FloorRoom, places: Sequence[GridPlace], width: float) -> list[GridPlace]:
    """Places whose back is at the wall, moved there, with the score for it."""
    found = []
    for place in places:
        away = wall_distance(room, behind(place, width))
        if not away <= room.grid or not away < wall_distance(room, place.center):
            continue
        way = WAYS[place.turn]
        offset = tuple(-one * (away + INTO_WALL) for one in way)
        center = (place.center[0] + offset[0], place.center[1] + offset[1])
        rectangle = affinity.translate(place.rectangle, *offset)
        found.append(GridPlace(center, place.turn, rectangle, place.score + BONUS * WEIGHTS[RelationKind.GLOBAL]))
    return found


def ahead(place: GridPlace, width: float) -> tuple[float, float]:
    """The middle of a place's front [cm]."""
    way = WAYS[place.turn]
    return place.center[0] + 0.5 * width * way[0], place.center[1] + 0.5 * width * way[1]


def behind(place: GridPlace, width: float) -> tuple[float, float]:
    """The middle of a place's back [cm]."""
    return ahead(place, -width)


def wall_distance(room: FloorRoom, point: tuple[float, float]) -> float:
    """How far a point is from the outline [cm]."""
    return float(room.outline.boundary.distance(shapely.Point(point)))


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
        names[box.thing].lower(): as_place(box, solid=box.bottom < high and box.top > plan.floor + WALKED_ON)
        for box in plan.things
        if box.thing in names
    }
    length, width = (CENTIMETRES * float(asset.size[axis]) + BUFFER for axis in (0, 1))
    thing = FloorObject(object_name, length, width, tuple(relations))
    return search(room, [thing], placed, rng, roots=roots, steps=steps).get(object_name)


def as_place(box: PlanBox, *, solid: bool) -> GridPlace:
    """A thing of the room in the search's form: its rectangle, and the quarter turn nearest to its front."""
    turn = max(WAYS, key=lambda one: float(box.front @ WAYS[one]))
    x, y = (float(value) for value in CENTIMETRES * box.center[:2])
    return GridPlace((x, y), turn, shapely.Polygon(CENTIMETRES * box.ring), solid=solid)


def floor_pose(place: GridPlace, plan: FloorPlan, asset: CanonicalAsset) -> Array:
    """World from object of a place: on the floor, its front along the place's direction, shape (4, 4)."""
    center = np.array([*(np.array(place.center) / CENTIMETRES), plan.floor + 0.5 * float(asset.size[2])])
    return asset.pose(center, float(np.radians(180 - place.turn)))
