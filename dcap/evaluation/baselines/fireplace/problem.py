"""One object on one surface: the loss of poses, many at once.

Everything lies in the frame of the surface that carries: origin at its middle, third axis along its normal. A pose is
(x, y, yaw) of the object with its contact surface turned down, the middle of that surface over (x, y). The height is
not free: the object touches what is under it where that is within the surface's flatness, lies in the plane where it
finds less, and is lifted, which the contact's loss counts, where something else is in the way. Ours; the source names
no numbers.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import binary_closing, binary_fill_holes, distance_transform_edt, label

from dcap.arrays import Array
from dcap.evaluation.baselines.fireplace import constraints as formulas
from dcap.geometry.placement.search import PlacementSearch

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
        overhang = formulas.no_overhang(self.area.share_inside(xy[:, None] + self.contact_points @ turn))
        terms = [
            ("contact", formulas.contact(self.beyond_flat(touching), self.item_height)),
            ("no_overhang", overhang),
        ]
        ring = xy[:, None] + self.footprint @ turn
        terms += [(one.function, self.value(one, xy, turn, ring)) for one in self.constraints]
        if self.upright is not None:
            own, up = self.upright
            terms.append(("parallel", 1.0 - spun(own, turn) @ up))
        loss = sum(formulas.WEIGHTS.get(name, 1.0) * value**2 for name, value in terms)
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
            distance = formulas.distance_to_polygon(ring, one.ring).min(axis=1)
            call = formulas.close_to if one.function == "close_to" else formulas.far_from
            return np.asarray(call(distance, one.metres))
        if one.function == "no_overhang":
            return formulas.no_overhang((formulas.distance_to_polygon(ring, one.ring) <= 0.0).mean(axis=1))
        if one.function == "in_front_of":
            return formulas.in_front_of(xy, one.center[:2], level(one.normal), one.width)
        center, normal = self.sides[one.side]
        if one.function == "parallel":
            return formulas.parallel(spun(normal, turn), one.normal)
        middle = xy + spun(center, turn)[:, :2]
        target = formulas.nearest_on_polygon(middle, one.ring) if one.nearest else np.tile(one.center[:2], (len(xy), 1))
        return formulas.facing(middle, spun(normal, turn)[:, :2], target)


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
