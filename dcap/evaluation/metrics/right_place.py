"""Right place: measurements of a final state against the intended outcome, in raw units.

Only stated intentions count: if the truth names no part, region or direction, the measure is None.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation as Turn

from dcap.arrays import Array
from dcap.evaluation.outcome_table import ExpectedOutcome
from dcap.evaluation.region import distance_to_edges, inside


@dataclass(frozen=True, slots=True)
class PlaceMeasures:
    """Measures of the place; None if the truth states nothing."""

    support_hit: bool | None = None
    """Whether the object is over the intended support."""
    part_hit: bool | None = None
    """Whether it is over the intended part of it."""
    region_distance_m: float | None = None
    """Distance in plan from the middle of the contact to the requested region; 0 inside."""
    orientation_error_deg: float | None = None
    """Angle between actual and intended direction of top or front; the larger one of those stated."""


def place_measures(
    support: tuple[str, str, str],
    middle: Array,
    quaternion: Array,
    truth: ExpectedOutcome,
    regions: tuple[Array, ...] = (),
) -> PlaceMeasures:
    """Compare a final state with the intended outcome.

    Args:
        support: id, label and part of the thing below the object; empty without one.
        middle: of the contact [m], shape (3,).
        quaternion: (w, x, y, z) of the object's own frame as read, shape (4,).
        truth: the intended outcome.
        regions: intended areas, world xy [m], (k, 2) each; the nearest counts; none: not stated.
    """
    owner, label, part = support
    hit = None
    if truth.base or truth.base_id:
        hit = truth.base_id in ("", owner) and truth.base in ("", label)
    return PlaceMeasures(
        support_hit=hit,
        part_hit=None if not truth.part else bool(hit is not False and part == truth.part),
        region_distance_m=min((distance_to(middle[:2], one) for one in regions), default=None),
        orientation_error_deg=orientation_error(quaternion, truth),
    )


def distance_to(point: Array, polygon: Array) -> float:
    """Distance of a point (2,) from an area with this outline (k, 2) [m]; 0 inside."""
    return 0.0 if inside(point, polygon) else distance_to_edges(point, polygon)


def orientation_error(quaternion: Array, truth: ExpectedOutcome) -> float | None:
    """Error of top and front [degrees], None if neither is stated."""
    axes = Turn.from_quat(quaternion, scalar_first=True).as_matrix()
    found = []
    height = float(np.degrees(np.arcsin(np.clip(axes[2, 2], -1.0, 1.0))))
    if truth.top:
        found.append(abs(height - {"up": 90.0, "down": -90.0, "sideways": 0.0}[truth.top]))
    if truth.front is not None:
        ahead = np.array([*truth.front, 0.0]) / np.linalg.norm(truth.front)
        flat = np.array([*axes[:2, 1], 0.0])
        length = float(np.linalg.norm(flat))
        found.append(float(np.degrees(np.arccos(np.clip(flat @ ahead / length, -1.0, 1.0)))) if length > 1e-6 else 90.0)
    return max(found, default=None)
