"""The contact patch in pictures: the points of the scene that belong to it."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from dcap.geometry.camera import Camera

Array = NDArray[np.float64]

NEXT_PIXEL = 1.0
"""Distance within which a pixel is next to the contact patch [pixel]."""
LEAST_PATCH = 1.5e-3
"""Least radius of the disc that a contact point represents [m]."""


def patch_radius(contact: Array) -> float:
    """Radius [m] of the disc that one contact point represents, so that neighbouring discs overlap."""
    if len(contact) < 2:
        return 4.0 * LEAST_PATCH
    spacing = np.median(cKDTree(contact).query(contact, k=2)[0][:, 1])
    extent = float(np.linalg.norm(np.ptp(contact, axis=0)))
    return float(np.clip(1.6 * spacing, LEAST_PATCH, max(0.05 * extent, LEAST_PATCH)))


def near_patch(points: Array, contact: Array, camera: Camera) -> NDArray[np.bool_]:
    """Whether points (n, 3) lie in the contact patch, or less than a pixel next to it, shape (n,)."""
    result = np.zeros(len(points), dtype=bool)
    if not len(contact):
        return result
    depth = float(camera.project(contact)[:, 2].min())
    radius = patch_radius(contact) + NEXT_PIXEL * max(depth, 0.0) / camera.focal
    low, high = contact.min(axis=0) - radius, contact.max(axis=0) + radius
    close = np.flatnonzero(((points >= low) & (points <= high)).all(axis=1))
    result[close] = cKDTree(contact).query(points[close], distance_upper_bound=radius, workers=-1)[0] <= radius
    return result
