"""The library of binary constraints: how far a pose is from each, 0 where it holds.

In: surfaces a of the object and b of an anchor as arrays over n poses, in a frame whose third axis is the normal of the
surface that carries. Out: shape (n,), not negative. All formulas are ours; c is a surface's middle, n its unit normal,
P its outline seen along the contact's normal:

    parallel     1 - |n_a . n_b|
    contact      |(c_a - c_b) . n_b| / h
    no_overhang  1 - area(P_a and P_b) / area(P_a)
    close_to     max(dist(P_a, P_b) - d, 0) / d
    far_from     max(d - dist(P_a, P_b), 0) / d
    in_front_of  max(-(c_a - c_b) . n_b, 0) / w + |lateral part of c_a - c_b| / w
    facing       1 - cos of the angle between n_a and the way from c_a to b, both level

A contact's angle, 1 + n_a . n_b, is no term: every candidate pose has the contact surface turned down onto the surface
that carries, so that it is 0 by construction, and no pose could change the remainder due to unevenness. A pose's loss
is the sum of their squares times weights. Hard conditions outside the loss: the object and the scene cut through each
other by at most 2 mm, and the object is inside the room.
"""

import numpy as np

from dcap.arrays import Array

LEAST_DISTANCE = 0.02
"""Least reference for distances [m]: no sentence is more exact."""
LEAST_WIDTH = 0.05
"""Least reference for widths [m]."""
LEAST_HEIGHT = 0.1
"""Least reference for a contact's distance, usually the object's height [m]: thin sheets lie on uneven surfaces."""
COLLISION = 0.002
"""How deep object and scene may cut through each other [m]."""
WEIGHTS = {"contact": 10.0, "no_overhang": 10.0, "parallel": 2.0, "facing": 1.0}
"""Weights of the squares [-], 1 for all others. The support comes first."""


def parallel(a_normal: Array, b_normal: Array) -> Array:
    """Normals (n, 3) and (3,) are parallel or antiparallel."""
    return 1.0 - np.abs(a_normal @ b_normal)


def contact(distance: Array, height: float) -> Array:
    """Surfaces that look at each other touch: distance along n_b (n,) [m], the object's height [m]."""
    return np.abs(distance) / max(height, LEAST_HEIGHT)


def no_overhang(inside_share: Array) -> Array:
    """All of P_a is inside P_b; (n,) is the share inside."""
    return 1.0 - inside_share


def close_to(distance: Array, metres: float) -> Array:
    """P_a is no farther from P_b (distances (n,) [m]) than this [m]."""
    return np.maximum(distance - metres, 0.0) / max(metres, LEAST_DISTANCE)


def far_from(distance: Array, metres: float) -> Array:
    """P_a is no nearer to P_b (distances (n,) [m]) than this [m]."""
    return np.maximum(metres - distance, 0.0) / max(metres, LEAST_DISTANCE)


def in_front_of(a_center: Array, b_center: Array, b_normal: Array, width: float) -> Array:
    """Middles (n, 2) lie before a side with this middle and normal (2,) each, and are centred on it; its width [m]."""
    offset = a_center - b_center
    ahead = offset @ b_normal
    lateral = np.linalg.norm(offset - ahead[:, None] * b_normal, axis=1)
    return np.asarray((np.maximum(-ahead, 0.0) + lateral) / max(width, LEAST_WIDTH))


def facing(a_center: Array, a_normal: Array, target: Array) -> Array:
    """A side with middles and normals (n, 2) each looks at points (n, 2); 1 where its normal has no level part."""
    way = target - a_center
    length = np.linalg.norm(way, axis=1) * np.linalg.norm(a_normal, axis=1)
    return np.asarray(1.0 - np.einsum("ij,ij->i", way, a_normal) / np.maximum(length, 1e-9))


def distance_to_polygon(points: Array, ring: Array) -> Array:
    """Distance of points (..., 2) from a convex polygon (k, 2), 0 inside; a polygon may be a line or a point [m]."""
    start, edge = ring, np.roll(ring, -1, axis=0) - ring
    square = np.maximum(np.einsum("ij,ij->i", edge, edge), 1e-18)
    offset = points[..., None, :] - start
    share = np.clip(np.einsum("...ij,ij->...i", offset, edge) / square, 0.0, 1.0)
    gap = np.linalg.norm(offset - share[..., None] * edge, axis=-1).min(axis=-1)
    turn = offset[..., 1] * edge[:, 0] - offset[..., 0] * edge[:, 1]
    twice_area = float(np.sum(ring[:, 0] * np.roll(ring[:, 1], -1) - ring[:, 1] * np.roll(ring[:, 0], -1)))
    within = (turn * np.sign(twice_area) > 0.0).all(axis=-1) & (abs(twice_area) > 1e-9)
    return np.where(within, 0.0, gap)


def nearest_on_polygon(points: Array, ring: Array) -> Array:
    """The nearest point of a polygon's rim (k, 2) to each of points (n, 2) [m], shape (n, 2)."""
    edge = np.roll(ring, -1, axis=0) - ring
    square = np.maximum(np.einsum("ij,ij->i", edge, edge), 1e-18)
    offset = points[:, None] - ring
    share = np.clip(np.einsum("nij,ij->ni", offset, edge) / square, 0.0, 1.0)
    foot = ring + share[..., None] * edge
    best = np.argmin(np.linalg.norm(points[:, None] - foot, axis=2), axis=1)
    return np.asarray(foot[np.arange(len(points)), best])
