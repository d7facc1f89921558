"""The start over a support: the best spot at which an object hovers with exact clearance and cuts through nothing.

In: an object over a scene, sampled (`PlacementSearch`) and exact (`Clearance`), and the areas to try. Out: the spot
nearest to an area's aim, and the height there. The samples propose; the meshes decide. Where they cut through each
other, what the samples missed is added to them, and they propose again.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dcap.geometry.placement.clearance import Clearance
from dcap.geometry.placement.named_regions import Region
from dcap.geometry.placement.search import SHARES, PlacementSearch, Spot

LEVEL = 0.7
"""Least share with which a level place is searched before an uneven one is taken [-]."""
PASSES = (
    (SHARES[0], True, True),
    *((share, True, False) for share in SHARES if share >= LEVEL),
    *((share, False, False) for share in SHARES),
)
"""Supported share of the underside, whether the support must be level there, and the place steady; best first."""
EXACT = 1e-5
"""How near the gap comes to what is asked [m]."""
ROUNDS = 3
"""A gap is measured, corrected and measured again; the second time it is right unless something is in the way."""
ALIKE = 0.05
"""Distances from the aim that differ by less than this are alike [m]: any of four corners, the viewer's first."""
PATIENCE = 2
"""Failed spots after which the neighbourhood that is left out around the next one grows by one sample [-]."""


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


def set_down(
    search: PlacementSearch, exact: Clearance, areas: Sequence[Region], gap: float, *, anywhere: bool = False
) -> Start | None:
    """The best supported free spot, a steady one if there is one nearby, or `anywhere` in the areas; of equally good
    ones the nearest to its area's aim, earlier areas first."""
    failed, before = 0, None
    for share, level, steady in PASSES:
        while (found := nearest(search, areas, share, level, steady, anywhere)) is not None:
            area, spot = found
            start = hover(search, exact, spot, gap)
            if start is not None:
                return Start(area, spot, *start)
            if steady and anywhere:
                break  # something is in the way at the steadiest place: the next passes look near the aim
            if spot == before:  # with all that is known now it looked free again, and is not
                search.exclude(spot, failed // PATIENCE)
                failed += 1
            before = spot
    return None


def nearest(
    search: PlacementSearch, areas: Sequence[Region], share: float, level: bool, steady: bool, anywhere: bool
) -> tuple[Region, Spot] | None:
    """Of each area's best spot the one nearest to its aim, the earlier area's if they are about as near."""
    best: tuple[int, Region, Spot] | None = None
    for area in areas:
        spot = search.find(area, share, level=level, steady=steady, anywhere=anywhere)
        if spot is not None:
            steps = round(float(np.hypot(*(area.target - (spot.x, spot.y)))) / ALIKE)
            if best is None or steps < best[0]:
                best = steps, area, spot
    return None if best is None else best[1:]


def hover(search: PlacementSearch, exact: Clearance, spot: Spot, gap: float) -> tuple[float, float] | None:
    """Height of the origin with the asked gap and the gap measured there [m]; None where something is in the way."""
    place = np.array([spot.x, spot.y, search.start_height(spot) + gap])
    measured = exact.gap(place)
    for _ in range(ROUNDS):
        if abs(measured - gap) <= EXACT or not np.isfinite(measured):
            break
        place[2] += gap - measured
        measured = exact.gap(place)
    points, faces = exact.cuts(place)
    if len(points) or abs(measured - gap) > EXACT:
        search.add(points, faces)
        return None
    return float(place[2]), measured
