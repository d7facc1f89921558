"""Holodeck's relations: their parser, and their scores for places on the floor in centimetres.

As in the source (`DFS_Solver_Floor`): a place is a middle, one of four turns and a rectangle. Turn 0 looks along +y, 90
along +x, 180 along -y, 270 along -x. A satisfied relation counts its weight; distances count 1.8 times the height of a
curve: near falls from 1 at the least distance of all candidates to 0 at 80 cm, or at the greatest distance where that
is less; far rises from 0 at the least to 1 at the greatest.

The parser is equivalent to the source's (`parse_constraints`): lines hold `|`, their letters are made small, a leading
number or dash and a last full stop are dropped; what is before the first `|` is the object; each further piece is a
relation and perhaps a target behind a comma. A relation that is not known is taken for the one with the least edit
distance. A target must be placed before; a piece without one is dropped. `around` means near and facing, `in front of`
also aligned. An object without a line is not placed.
"""

import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
import shapely

LEADING = re.compile(r"^(\d+[.)]\s*|- )")


class RelationKind(StrEnum):
    """Kinds of relations."""

    GLOBAL = "global"
    RELATIVE = "relative"
    DIRECTION = "direction"
    ALIGNMENT = "alignment"
    DISTANCE = "distance"


KINDS: Mapping[str, RelationKind] = {
    "edge": RelationKind.GLOBAL,
    "middle": RelationKind.GLOBAL,
    "in front of": RelationKind.RELATIVE,
    "behind": RelationKind.RELATIVE,
    "left of": RelationKind.RELATIVE,
    "right of": RelationKind.RELATIVE,
    "side of": RelationKind.RELATIVE,
    "around": RelationKind.RELATIVE,
    "face to": RelationKind.DIRECTION,
    "face same as": RelationKind.DIRECTION,
    "aligned": RelationKind.ALIGNMENT,
    "center alignment": RelationKind.ALIGNMENT,
    "center aligned": RelationKind.ALIGNMENT,
    "aligned center": RelationKind.ALIGNMENT,
    "edge alignment": RelationKind.ALIGNMENT,
    "near": RelationKind.DISTANCE,
    "far": RelationKind.DISTANCE,
}
"""The vocabulary, including aliases."""


@dataclass(frozen=True, slots=True)
class Relation:
    """One relation of the object."""

    kind: RelationKind
    name: str
    target: str = ""
    """Empty: it has none."""


def parsed_relations(text: str, object_name: str, placed: Collection[str]) -> list[Relation] | None:
    """The relations of one object, from its last line; None if no line names it.

    Args:
        text: the answer, any number of lines.
        object_name: the object; names are compared in lower case.
        placed: names of possible targets.
    """
    found: list[Relation] | None = None
    for line in (line.lower() for line in text.splitlines() if "|" in line):
        plain = LEADING.sub("", line.strip()).removesuffix(".")
        about, *pieces = plain.split("|")
        if about.replace("*", "").strip() != object_name.lower():
            continue
        found = [one for piece in pieces for one in relations_of(piece.strip(), {name.lower() for name in placed})]
    return found


def relations_of(piece: str, placed: Collection[str]) -> list[Relation]:
    """Relations of one piece between bars."""
    said, comma, behind = piece.partition(",")
    said = said.strip()
    if said in ("", "n/a"):
        return []
    name = said if said in KINDS else min(KINDS, key=lambda one: (edit_distance(one, said), one))
    kind = KINDS[name]
    if kind is RelationKind.GLOBAL:
        return [Relation(kind, name)]
    target = behind.split(",")[0].strip()
    if not comma or target not in placed:
        return []
    if name == "around":
        return [Relation(RelationKind.DISTANCE, "near", target), Relation(RelationKind.DIRECTION, "face to", target)]
    if name == "in front of":
        return [Relation(kind, name, target), Relation(RelationKind.ALIGNMENT, "center aligned", target)]
    return [Relation(kind, name, target)]


def edit_distance(a: str, b: str) -> int:
    """Number of letters to insert, delete or replace (Levenshtein, 1966)."""
    row = list(range(len(b) + 1))
    for i, letter in enumerate(a, 1):
        above, row[0] = row[0], i
        for j, other in enumerate(b, 1):
            above, row[j] = row[j], min(row[j] + 1, row[j - 1] + 1, above + (letter != other))
    return row[-1]


BONUS = 1.0
"""A satisfied relation [-]."""
WEIGHTS: Mapping[RelationKind, float] = {
    RelationKind.GLOBAL: 1.0,
    RelationKind.RELATIVE: 0.5,
    RelationKind.DIRECTION: 0.5,
    RelationKind.ALIGNMENT: 0.5,
    RelationKind.DISTANCE: 1.8,
}
NEAR = 80.0
"""Distance from which on nothing is near [cm]."""
ALIGNED = 5.0
"""Largest difference in one coordinate between aligned middles [cm]."""
FAR_POINT = 1e6
"""Length of the line of sight [cm]."""
TURNS = (0, 90, 180, 270)
WAYS: Mapping[int, tuple[float, float]] = {0: (0.0, 1.0), 90: (1.0, 0.0), 180: (0.0, -1.0), 270: (-1.0, 0.0)}
"""Viewing direction of each turn."""


@dataclass(frozen=True, slots=True)
class GridPlace:
    """A candidate, or a thing that is placed."""

    center: tuple[float, float]
    """[cm]."""
    turn: int
    """Degrees, clockwise from +y seen from above."""
    rectangle: shapely.Polygon
    """[cm]."""
    score: float = 1.0
    solid: bool = True
    """Whether it blocks its place; things that hang or lie on others are only targets."""


def satisfying(relation: Relation, target: GridPlace, places: Sequence[GridPlace], grid: float) -> list[bool]:
    """Whether places satisfy a relation other than a distance; `grid` is the spacing of the candidates [cm]."""
    if relation.kind is RelationKind.RELATIVE:
        return [is_on_side(relation.name, target, place, grid) for place in places]
    if relation.kind is RelationKind.ALIGNMENT:
        return [aligned(target, place) for place in places]
    if relation.name == "face same as":
        return [place.turn == target.turn for place in places]
    return [faces(target, place) for place in places]


def is_on_side(name: str, target: GridPlace, place: GridPlace, grid: float) -> bool:
    """Whether a place is left of, right of, in front of, behind, or at the side of the target's bounds.

    Seen from the target: beyond its bounds on that side, and level with them; in front also less than a grid step from
    its middle line. The side of it is any place that is level with it.
    """
    low_x, low_y, high_x, high_y = target.rectangle.bounds
    middle = (0.5 * (low_x + high_x), 0.5 * (low_y + high_y))
    half = (0.5 * (high_x - low_x), 0.5 * (high_y - low_y))
    way = WAYS[target.turn]
    forward = (place.center[0] - middle[0]) * way[0] + (place.center[1] - middle[1]) * way[1]
    rightward = (place.center[0] - middle[0]) * way[1] - (place.center[1] - middle[1]) * way[0]
    length, width = (half[1], half[0]) if target.turn in (0, 180) else (half[0], half[1])
    holds: dict[str, bool] = {
        "left of": rightward < -width and abs(forward) <= length,
        "right of": rightward > width and abs(forward) <= length,
        "side of": abs(forward) <= length,
        "in front of": forward > length and abs(rightward) < grid,
        "behind": forward < -length and abs(rightward) <= width,
    }
    return holds[name]


def aligned(target: GridPlace, place: GridPlace) -> bool:
    """Whether the middles are level in x or in y."""
    return any(abs(a - b) < ALIGNED for a, b in zip(place.center, target.center, strict=True))


def faces(target: GridPlace, place: GridPlace) -> bool:
    """Whether the line ahead of the place meets the target."""
    x, y = place.center
    way = WAYS[place.turn]
    line = shapely.LineString([(x, y), (x + FAR_POINT * way[0], y + FAR_POINT * way[1])])
    return bool(line.intersects(target.rectangle))


def distance_scores(name: str, target: GridPlace, places: Sequence[GridPlace]) -> list[float]:
    """Score of near or far for each place, by its distance from the target among those of all places."""
    away = [float(target.rectangle.distance(place.rectangle)) for place in places]
    curve = near_curve(min(away), max(away)) if name == "near" else far_curve(min(away), max(away))
    return [curve(one) for one in away]


def near_curve(least: float, most: float) -> Callable[[float], float]:
    """1 at the least distance, 0 from 80 cm or the greatest distance on, whichever is less; nothing is near where the
    least is 80 cm or more. The source divides by zero where all distances are equal; here all count 1."""
    if least >= NEAR:
        return lambda away: 0.0
    end = min(NEAR, most)
    if end <= least:
        return lambda away: 1.0
    return lambda away: float(np.clip((end - away) / (end - least), 0.0, 1.0))


def far_curve(least: float, most: float) -> Callable[[float], float]:
    """0 at the least distance, 1 at the greatest; 0 where they are the same."""
    if most <= least:
        return lambda away: 0.0
    return lambda away: (away - least) / (most - least)
