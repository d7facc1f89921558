"""One object on one surface: the constraints, and the loss of poses, many at once.

Everything lies in the frame of the surface that carries: origin at its middle, third axis along its normal. A pose is
(x, y, yaw) of the object with its contact surface turned down, the middle of that surface over (x, y). The height is
not free: the object touches what is under it where that is within the surface's flatness, lies in the plane where it
finds less, and is lifted, which the contact's loss counts, where something else is in the way. Ours; the source names
no numbers.

The library of binary constraints: how far a pose is from each, 0 where it holds.

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

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import binary_closing, binary_fill_holes, distance_transform_edt, label

from dcap.arrays import Array
from dcap.geometry.placement.search import PlacementSearch

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
RASTER = 160
"""Cells along the longer side of a surface [-]."""
FINEST = 0.004
"""Smallest cell of a surface [m]."""
CLOSED = 2
"""Width of gaps in a surface that are bridged [cells]."""
HOLE = 0.01
"""Largest hole that is filled as an artefact of growth [m^2]; larger ones are real, such as a tub within its rim."""
BLOCKED = 10.0
"""Height that stands for an obstacle without a top [m]."""


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


@dataclass(frozen=True, eq=False, slots=True)
class SupportArea:
    """A surface in its own frame, as distances from its rim on a grid."""

    origin: Array
    """Middle of the first cell [m], shape (2,)."""
    cell: float
    """[m]."""
    depth: Array
    """Distance from the rim, negative outside [m], shape (columns, rows)."""

    @classmethod
    def of(cls, points: Array, cell: float, closed: int = CLOSED, hole: float = HOLE) -> "SupportArea":
        """The surface of points (k, 2) that lie less than a cell [m] apart; gaps of `closed` cells are bridged, holes
        up to `hole` [m^2] filled."""
        low, high = points.min(axis=0), points.max(axis=0)
        origin = low - (closed + 2) * cell
        count = np.ceil((high + (closed + 2) * cell - origin) / cell).astype(int) + 1
        full = np.zeros(count, dtype=bool)
        full[tuple(np.rint((points - origin) / cell).astype(int).T)] = True
        full = binary_closing(full, iterations=closed)
        holes, _ = label(binary_fill_holes(full) & ~full)
        full |= (holes > 0) & (np.bincount(holes.ravel())[holes] * cell**2 <= hole)
        # cells are squares: the rim runs half a cell outside of the outermost middles
        depth = np.where(full, distance_transform_edt(full) - 0.5, 0.5 - distance_transform_edt(~full))
        return cls(origin, cell, cell * depth)

    def depth_at(self, points: Array) -> Array:
        """Distance of points (..., 2) from the rim, negative outside [m]."""
        index = np.rint((points - self.origin) / self.cell).astype(int)
        inside = np.clip(index, 0, np.array(self.depth.shape) - 1)
        beyond = self.cell * np.linalg.norm(index - inside, axis=-1)
        return np.asarray(self.depth[inside[..., 0], inside[..., 1]] - beyond)

    def share_inside(self, points: Array) -> Array:
        """Share of points (n, k, 2) inside, smooth over the width of a cell, shape (n,)."""
        return np.asarray(np.clip(0.5 + self.depth_at(points) / self.cell, 0.0, 1.0).mean(axis=-1))

    @property
    def middle(self) -> Array:
        """Middle of the area [m], shape (2,)."""
        return np.asarray(self.middles().mean(axis=0))

    def middles(self) -> Array:
        """Middles of the cells inside [m], shape (k, 2)."""
        return np.asarray(self.origin + self.cell * np.argwhere(self.depth > 0.0))


@dataclass(frozen=True, eq=False, slots=True)
class ResolvedConstraint:
    """A binary constraint whose two surfaces are known, the anchor's in the frame of the surface that carries."""

    function: str
    side: str
    """Of the object."""
    ring: Array
    """The anchor's outline seen along the contact's normal [m], shape (k, 2)."""
    center: Array
    """[m], shape (3,)."""
    normal: Array
    """Unit vector, shape (3,)."""
    width: float
    """Of a side, along the surface that carries [m]."""
    metres: float = 0.0
    """Of close_to and far_from."""
    nearest: bool = False
    """Whether facing it means facing its nearest point, not its middle."""
    words: str = ""


@dataclass(frozen=True, eq=False, slots=True)
class Evaluation:
    """Losses of n poses."""

    loss: Array
    """Weighted sum of squares [-], shape (n,)."""
    height: Array
    """Height of the contact surface over the plane [m], shape (n,)."""
    overhang: Array
    """Share of the contact surface beyond the rim [-], shape (n,)."""
    terms: tuple[tuple[str, Array], ...]
    """Each constraint's value, shape (n,)."""


@dataclass(frozen=True, eq=False, slots=True)
class PlacementProblem:
    """The object, the surface that carries it and the other constraints."""

    area: SupportArea
    search: PlacementSearch
    """The scene's heights over the plane, and the object's underside, both sampled."""
    flatness: float
    """Allowed unevenness of the surface [m]."""
    item_height: float
    """[m]."""
    contact_points: Array
    """Of the object's contact surface, from its middle [m], shape (k, 2)."""
    footprint: Array
    """Points along the object's outline, from the contact surface's middle [m], shape (f, 2)."""
    sides: Mapping[str, tuple[Array, Array]]
    """Middle, from the contact surface's [m], and unit normal of the object's sides at yaw 0, shape (3,) each."""
    constraints: tuple[ResolvedConstraint, ...]
    upright: tuple[Array, Array] | None = None
    """On a surface that is no floor: the object's up at yaw 0 and the world's, shape (3,) each."""
    columns: int = 160
    """Number of samples of the underside that are evaluated [-]."""

    def evaluate(self, poses: Array) -> Evaluation:
        """Loss of poses (n, 3): x, y [m], yaw [rad]."""
        xy, turn = poses[:, :2], rotations(poses[:, 2])
        touching = self.touching_heights(xy, turn)
        overhang = no_overhang(self.area.share_inside(xy[:, None] + self.contact_points @ turn))
        terms = [
            ("contact", contact(self.beyond_flat(touching), self.item_height)),
            ("no_overhang", overhang),
        ]
        ring = xy[:, None] + self.footprint @ turn
        terms += [(one.function, self.value(one, xy, turn, ring)) for one in self.constraints]
        if self.upright is not None:
            own, up = self.upright
            terms.append(("parallel", 1.0 - spun(own, turn) @ up))
        loss = sum(WEIGHTS.get(name, 1.0) * value**2 for name, value in terms)
        return Evaluation(np.asarray(loss), self.resting_height(touching), overhang, tuple(terms))

    def touching_heights(self, xy: Array, turn: Array) -> Array:
        """Height over the plane at which the object touches something [m], shape (n,)."""
        step = max(1, len(self.search.offset) // self.columns)
        offset = self.search.cell * self.search.offset[::step]
        points = xy[:, None] + offset @ turn
        index = np.rint((points - self.search.origin) / self.search.cell).astype(int)
        index = np.clip(index, 0, self.search.count - 1)
        surface = np.clip(self.search.surface.height[index[..., 0], index[..., 1]], -BLOCKED, BLOCKED)
        return np.asarray((surface - self.search.under[::step]).max(axis=1))

    def resting_height(self, touching: Array) -> Array:
        """Resting height for a touching height: in the plane if the touched surface is far below it."""
        return np.where(touching > -self.flatness, touching, 0.0)

    def beyond_flat(self, touching: Array) -> Array:
        """Distance of the touched surface from the plane, less the surface's own unevenness [m], shape (n,)."""
        return np.maximum(np.abs(touching) - self.flatness, 0.0)

    def value(self, one: ResolvedConstraint, xy: Array, turn: Array, ring: Array) -> Array:
        """A constraint's value at poses, shape (n,)."""
        if one.function in ("close_to", "far_from"):
            distance = distance_to_polygon(ring, one.ring).min(axis=1)
            call = close_to if one.function == "close_to" else far_from
            return np.asarray(call(distance, one.metres))
        if one.function == "no_overhang":
            return no_overhang((distance_to_polygon(ring, one.ring) <= 0.0).mean(axis=1))
        if one.function == "in_front_of":
            return in_front_of(xy, one.center[:2], level(one.normal), one.width)
        center, normal = self.sides[one.side]
        if one.function == "parallel":
            return parallel(spun(normal, turn), one.normal)
        middle = xy + spun(center, turn)[:, :2]
        target = nearest_on_polygon(middle, one.ring) if one.nearest else np.tile(one.center[:2], (len(xy), 1))
        return facing(middle, spun(normal, turn)[:, :2], target)


def rotations(yaw: Array) -> Array:
    """Rotation matrices for row vectors, by angles (n,) [rad], shape (n, 2, 2)."""
    c, s = np.cos(yaw), np.sin(yaw)
    return np.stack([np.stack([c, s], axis=1), np.stack([-s, c], axis=1)], axis=1)


def spun(vector: Array, turn: Array) -> Array:
    """A vector (3,) turned about the third axis, shape (n, 3)."""
    level_part = np.einsum("i,nij->nj", vector[:2], turn)
    return np.asarray(np.c_[level_part, np.full(len(turn), vector[2])])


def level(normal: Array) -> Array:
    """A unit vector (2,) along the level part of a normal; zero where it has none."""
    length = float(np.linalg.norm(normal[:2]))
    return np.asarray(normal[:2] / length if length > 1e-6 else np.zeros(2))
