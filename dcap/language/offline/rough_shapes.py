"""Labels that rough shapes speak for: all labels against all unions of a fused scan at once.

In: measures of many things, some unknown. Out: for each the label that fits best and by how much better than a thing of
which nothing is known. The rule and the table are those of `shapes`.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.language.offline.shapes import (
    EVEN,
    EVIDENCE,
    FARTHEST,
    HELD,
    NOT_HELD,
    NOTHING_KNOWN,
    ROOM,
    ShapePrior,
    shapes,
)

Array = NDArray[np.float64]

OUT_OF_PLACE = 0.02
"""How much rarer a thing of wet rooms is in a dry one, and the other way round [-]."""


@dataclass(frozen=True, eq=False, slots=True)
class Evidence:
    """Evidence for the best label of each of n things."""

    label: tuple[str, ...]
    nats: Array
    """Logarithm of how much better it fits than a thing of which nothing is known, shape (n,)."""


def evidence(
    measures: Sequence[Mapping[str, float]], holders: Sequence[str], room: str, excluded: Collection[str] = ()
) -> Evidence:
    """The best label of each thing in a wet or dry room.

    Args:
        measures: as `measures_of` names them; what is missing is unknown.
        holders: floor, wall, ceiling, nothing, or empty for any thing.
        room: wet or dry.
        excluded: labels that are not meant.
    """
    if not measures:
        return Evidence((), np.zeros(0))
    rows = [one for one in shapes() if one.label not in excluded]
    names = list(EVEN)
    value = np.array([[one.get(name, np.nan) for name in names] for one in measures]).reshape(len(measures), len(names))
    held = np.array([[_holds(row, holder) for row in rows] for holder in sorted(set(holders))])
    rank = np.searchsorted(sorted(set(holders)), list(holders))
    score = np.array([math.log(row.common) + _context(row, room) for row in rows])
    total = score + EVIDENCE * np.stack([_fit(row, names, value) for row in rows], axis=1) + held[rank]
    best = np.argmax(total, axis=1)
    unknown = math.log(NOTHING_KNOWN * NOT_HELD)
    return Evidence(tuple(rows[i].label for i in best), total[np.arange(len(best)), best] - unknown)


def _context(row: ShapePrior, room: str) -> float:
    return math.log(OUT_OF_PLACE) if row.room not in ("", room) else 0.0


def _holds(row: ShapePrior, holder: str) -> float:
    """Logarithm of the probability that what carries it is what it is; any thing will do where a thing is usual."""
    usual = holder in row.held_by if holder else any(one not in ROOM for one in row.held_by)
    return math.log(HELD / len(row.held_by) ** EVIDENCE if usual else NOT_HELD)


def _fit(row: ShapePrior, names: Sequence[str], value: Array) -> Array:
    """Sum of the logarithms of density over even density, shape (n,)."""
    total = np.zeros(len(value))
    for name, usual in row.traits.items():
        x = value[:, names.index(name)]
        away = np.maximum(np.maximum((usual.low - x) / usual.below, (x - usual.high) / usual.above), 0.0)
        whole = usual.high - usual.low + math.sqrt(0.5 * math.pi) * (usual.below + usual.above)
        one = -0.5 * np.minimum(away, FARTHEST) ** 2 - math.log(whole) + math.log(EVEN[name])
        total += np.where(np.isnan(x), 0.0, one)
    return total
