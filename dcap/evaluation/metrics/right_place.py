"""Compares the place of an object in its final state with the intended or requested one, in raw units.

Only stated intentions count: if the truth names no part, region or direction, the measure is None.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation as Turn

from dcap.arrays import Array
from dcap.evaluation.outcome_table import ExpectedOutcome
from dcap.geometry.raycast import Raycaster
from dcap.scene.types.segmentation import Segmentation

TOLERANCE_M = 0.02
"""Tolerance of a region stated in words, about a finger's breadth [m]."""

MOSTLY = 0.5
"""Least share of the contact on the requested part for an object to rest on it [-]."""


def part_missed(scene: Segmentation, base: str, part: str, points: NDArray[np.float64], top: float) -> bool:
    """Whether most of a contact lies outside the base's parts with this name.

    Args:
        scene: the scene without the object, undeformed.
        base: id of the requested instance.
        part: name of its part.
        points: of the contact [m], shape (k, 3).
        top: height of the object's highest point [m]; the surface between it and the contact was dented.
    """
    if not len(points):
        return False
    start = np.c_[points[:, :2], np.full(len(points), top)]
    faces = Raycaster(scene.mesh).cast(start, np.tile([0.0, 0.0, -1.0], (len(start), 1))).face
    owner, number = scene.face_instance[faces], scene.face_part[faces]
    met = (faces >= 0) & (owner >= 0) & (number >= 0)
    own = {k for k, one in enumerate(scene.instances[scene.index_of(base)].parts) if one.name == part}
    on_it = (owner[met] == scene.index_of(base)) & np.isin(number[met], list(own))
    return bool(on_it.sum() < MOSTLY * len(points))


def region_missed(point: NDArray[np.float64], polygon: NDArray[np.float64]) -> bool:
    """Whether a point (2,) lies outside a polygon (k, 2) by more than the tolerance."""
    if len(polygon) < 3:
        return False
    return not inside(point, polygon) and distance_to_edges(point, polygon) > TOLERANCE_M


def inside(point: NDArray[np.float64], polygon: NDArray[np.float64]) -> bool:
    """Even-odd rule: a ray along +x crosses the outline an odd number of times."""
    start, end = polygon, np.roll(polygon, -1, axis=0)
    spans = (start[:, 1] > point[1]) != (end[:, 1] > point[1])
    height = np.where(spans, end[:, 1] - start[:, 1], 1.0)
    crossing = start[:, 0] + (point[1] - start[:, 1]) / height * (end[:, 0] - start[:, 0])
    return bool(np.count_nonzero(spans & (point[0] < crossing)) % 2)


def distance_to_edges(point: NDArray[np.float64], polygon: NDArray[np.float64]) -> float:
    """Distance from a point to the outline [m]."""
    start, edge = polygon, np.roll(polygon, -1, axis=0) - polygon
    length = np.maximum((edge**2).sum(axis=1), np.finfo(float).tiny)
    share = np.clip(((point - start) * edge).sum(axis=1) / length, 0.0, 1.0)
    return float(np.linalg.norm(start + share[:, None] * edge - point, axis=1).min())


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
