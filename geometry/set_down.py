"""The start over a support: the best spot at which an object hovers with exact clearance and cuts through nothing.

In: an object over a scene, sampled (`Landing`) and exact (`Clearance`), and the areas to try. Out: the spot nearest to
the first area's aim, and the height there. The samples propose; the meshes decide. Where they cut through each other
what the samples missed is added to them, and they propose again.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from geometry.clearance import Clearance
from geometry.landing import SHARES, Landing, Spot
from geometry.regions import Region

PASSES = (*((share, True) for share in SHARES if share >= 0.7), *((share, False) for share in SHARES))
"""Supported share of the underside, and whether the support must be level there, best first."""
EXACT = 1e-5
"""How near the gap comes to what is asked [m]."""
ROUNDS = 3
"""A gap is measured, corrected and measured again; the second time it is right unless something is in the way."""
PATIENCE = 2
"""After so many spots that fail, the spots around the next one are left out one sample further [-]."""


@dataclass(frozen=True, slots=True)
class Start:
    """Where the object starts."""

    region: Region
    """The area it is in."""
    spot: Spot
    height: float
    """Of the object's origin [m]."""
    gap: float
    """Smallest vertical distance to what lies below, measured there [m]."""


def set_down(landing: Landing, exact: Clearance, areas: Sequence[Region], gap: float) -> Start | None:
    """The best supported free spot; of equally good ones the nearest to the aim of the first area."""
    failed, before = 0, None
    for share, level in PASSES:
        for area in areas:
            while (spot := landing.find(area, share, level=level)) is not None:
                start = hover(landing, exact, spot, gap)
                if start is not None:
                    return Start(area, spot, *start)
                if spot == before:  # with all that is known now it looked free again, and is not
                    landing.refuse(spot, failed // PATIENCE)
                    failed += 1
                before = spot
    return None


def hover(landing: Landing, exact: Clearance, spot: Spot, gap: float) -> tuple[float, float] | None:
    """Height of the origin with the asked gap and the gap measured there [m]; None where something is in the way."""
    place = np.array([spot.x, spot.y, landing.start_height(spot) + gap])
    measured = exact.gap(place)
    for _ in range(ROUNDS):
        if abs(measured - gap) <= EXACT or not np.isfinite(measured):
            break
        place[2] += gap - measured
        measured = exact.gap(place)
    points, faces = exact.cuts(place)
    if len(points) or abs(measured - gap) > EXACT:
        landing.add(points, faces)
        return None
    return float(place[2]), measured
