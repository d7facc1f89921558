"""Rooms that a scan has fused: which unions of pieces are things, by how much they look like things that homes have.

A union of pieces is worth what its rough shape tells more for some label than for nothing known, less what it costs to
suppose one thing more (else every piece would be a thing) and to cut it out of the surface around it. Labels are only
supposed here; a client gives them later. A room is wet or dry, whichever explains more: a seat of 40 cm is a stool in a
living room.
"""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.segmentation.rooms.composites import ONLY_PARTS
from dcap.geometry.segmentation.rooms.unions import RoughShape, worth_most
from dcap.language.offline.rough_shapes import Evidence, evidence
from dcap.language.offline.shapes import colour_measures, labels, shapes

PER_THING = 8.5
"""Evidence that one more thing needs [nats]: position and size, each to a few per cent of what a room allows."""
BURIED = 4.0
"""Evidence against a thing if another one grows out of all of its top [nats]: a board is no stool."""
CUT = 0.4
"""Evidence that a metre of surface needs to go on as another thing [nats/m]: things touch along short edges."""
COMMON = {"dry": 1.0, "wet": 1.0 / 8.0}
"""How many bathrooms there are for every other room that is scanned [-]: an estimate."""

MOST_LEVELS = 4
"""More levels tell no more [-]: on the boards of a shelf lies something that looks up, too."""

Union = frozenset[int]


def likely_things(unions: Sequence[Union], rough: Sequence[RoughShape]) -> list[Union]:
    """The unions without overlap that explain most."""
    number = {union: i for i, union in enumerate(unions)}
    best: tuple[float, list[Union]] = (-math.inf, [])
    for room in COMMON:
        found = _evidence(rough, room)
        against = [BURIED * one.buried + CUT * one.cut + PER_THING for one in rough]
        worth: NDArray[np.float64] = found.nats - np.array(against)
        chosen = worth_most(unions, worth.tolist())
        total = explained(room, [(found.label[i], float(worth[i])) for i in (number[union] for union in chosen)])
        best = max(best, (total, chosen), key=lambda one: one[0])
    return best[1]


def room_labels(measures: Sequence[Mapping[str, float]], holders: Sequence[str]) -> tuple[str, ...]:
    """Possible names of things with these measures and supports, in such a room."""
    room = max(COMMON, key=lambda room: explained(room, _worthy(evidence(measures, holders, room, ONLY_PARTS))))
    odd = {shape.label for shape in shapes() if shape.room not in ("", room)}
    return tuple(label for label in labels() if label not in odd)


def _worthy(found: Evidence) -> list[tuple[str, float]]:
    return [(label, nats - PER_THING) for label, nats in zip(found.label, found.nats.tolist(), strict=True)
            if nats > PER_THING]  # fmt: skip


def _evidence(rough: Sequence[RoughShape], room: str) -> Evidence:
    measures, holders = [rough_measures(one) for one in rough], [one.held_by for one in rough]
    return evidence(measures, holders, room, ONLY_PARTS)


def explained(room: str, things: Sequence[tuple[str, float]]) -> float:
    """The worth of such a room with things by label, of each that stands in wet rooms only once: two toilets are none
    [nats]."""
    wet = {shape.label for shape in shapes() if shape.room == "wet"}
    total, seen = math.log(COMMON[room]), set[str]()
    for label, worth in sorted(things, key=lambda one: -one[1]):
        total += 0.0 if label in wet & seen else worth
        seen.add(label)
    return total


def rough_measures(shape: RoughShape) -> dict[str, float]:
    """The measures that a rough shape knows, under the names of the table of shapes."""
    bottom = shape.bottom or 0.0
    length, width, height = (max(size, 1e-3) for size in (shape.length, shape.width, shape.top - bottom))
    found = {"length": math.log(length), "width": math.log(width), "height": math.log(height)}
    if shape.bottom is not None:
        found["bottom"] = shape.bottom
    if shape.wall_gap is not None:
        found["gap"] = shape.wall_gap
    if shape.color is not None:
        found |= colour_measures(shape.color)
    if not shape.top_seen:
        found["levels"] = float(min(shape.levels, MOST_LEVELS))
    elif shape.level_height is not None:
        found |= {
            "level": shape.level_height,
            "rise": shape.top - shape.level_height,
            "share": min(shape.level_area / (length * width), 1.0),
        }
    return found
