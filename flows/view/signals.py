"""Signals of the settling over their thresholds, as series of a plot: at rest where all are below one."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from dcap.arrays import Array
from dcap.scene.json_tree import JsonValue
from dcap.scene.types.settled import Settled

FLOOR, CEILING = 1e-3, 1e9
"""Drawn range of a signal over its threshold [-]: a logarithm has no zero."""
NAMES = ("linear_speed", "angular_speed", "particle_speed", "force_residual", "torque_residual")


@dataclass(frozen=True, eq=False, slots=True)
class SignalSeries:
    """Signals over time."""

    time: Array
    """[s], increasing, shape (s,)."""
    share: dict[str, Array]
    """Signals over their thresholds, between FLOOR and CEILING [-], shape (s,) each."""
    threshold: dict[str, float]
    """Thresholds of the signals, in their units."""


def signal_series(settled: Settled, certificate: JsonValue) -> SignalSeries | None:
    """The series of a drop; None where there are less than two steps, or no thresholds."""
    rows = certificate.get("signals") if isinstance(certificate, Mapping) else None
    history = settled.history
    if not isinstance(rows, Mapping) or len(history.time) < 2:
        return None
    share, threshold = {}, {}
    for name in NAMES:
        row = rows.get(name)
        limit = row.get("threshold") if isinstance(row, Mapping) else None
        if not isinstance(limit, (int, float)) or limit <= 0.0:
            continue
        values = np.asarray(getattr(history, name), dtype=np.float64)
        share[name] = np.clip(np.nan_to_num(values / limit, nan=CEILING, posinf=CEILING), FLOOR, CEILING)
        threshold[name] = float(limit)
    return SignalSeries(np.asarray(history.time, dtype=np.float64), share, threshold) if share else None
