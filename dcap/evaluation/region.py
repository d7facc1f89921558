"""Whether an object rests in the requested region."""

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.raycast import Raycaster
from dcap.scene.types.segmentation import Segmentation

TOLERANCE_M = 0.02
"""Tolerance of a region stated in words, about a finger's breadth [m]."""

MOSTLY = 0.5
"""Least share of the contact on the requested part for an object to rest on it [-]: not next to the arm of a sofa, on
the seat."""


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
