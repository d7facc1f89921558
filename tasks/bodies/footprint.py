"""Where and how wide the object will probably touch: decides cells and contact points before anything is simulated.

In: the object at its pre-drop pose, what lies beneath it, its weight, and the layers that press on each other. The gap
between the object's underside and what lies below it is measured along gravity, once the object has tilted onto it; the
part of it that closes first touches first.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.boundary import is_closed
from dcap.geometry.raycast import Raycaster
from dcap.geometry.solid.repair import subdivide_near
from dcap.scene.errors import GeometryError
from dcap.scene.types.mesh import Mesh
from tasks.bodies.inertial import inertial_of_solid
from tasks.bodies.layered_patch import Stack
from tasks.bodies.levelling import levelling
from tasks.bodies.plan_contact import Heights, PlanContact, plan_contact

Array = NDArray[np.float64]

LEAST_DEPTH, MOST_DEPTH = 5e-4, 0.06  # expected indentation [m]: below it is invisible, above it no formula holds
WIDER = 4.0  # times the expected indentation: what may touch before the object has levelled out
UP = (0.0, 0.0, 1.0)
BELOW = 0.01  # a ray that looks for an underside starts this far below it [m]


@dataclass(frozen=True, eq=False, slots=True)
class Footprint:
    """The predicted contact."""

    low: Array
    """Lower corner of its box [m], shape (3,)."""
    high: Array
    """Upper corner [m], shape (3,)."""
    wider: Array
    """Lower and upper corner of what may touch too, at WIDER times the indentation [m], shape (2, 3)."""
    on_base: Array
    """The same two boxes of what is below once the object lies [m], shape (2, 2, 3)."""
    half_width: float
    """Half the width of the contact where it is narrower [m]."""
    depth: float
    """Expected indentation [m]."""
    contacts: tuple[PlanContact, ...]
    """The patch, and that where it was found at rest before; none where nothing there is soft."""

    @property
    def small_side(self) -> float:
        """Shorter horizontal side once the object lies [m]."""
        return float(np.ptp(self.on_base[0], axis=0)[:2].min())


def joined(one: Footprint, other: Footprint) -> Footprint:
    """Two places where the object may touch."""
    return Footprint(
        np.minimum(one.low, other.low), np.maximum(one.high, other.high), around(one.wider, other.wider),
        np.stack([around(a, b) for a, b in zip(one.on_base, other.on_base, strict=True)]),
        min(one.half_width, other.half_width), max(one.depth, other.depth), one.contacts + other.contacts,
    )  # fmt: skip


def around(one: Array, other: Array) -> Array:
    """The box of two boxes, all of shape (2, 3)."""
    return np.stack([np.minimum(one[0], other[0]), np.maximum(one[1], other[1])])


@dataclass(frozen=True, eq=False, slots=True)
class Descent:
    """The object over what it comes down on, before its contact is known."""

    beneath: Raycaster
    fallback_height: float
    """Stands for what lies below where a ray meets nothing [m]."""
    lying: Mesh
    """The object once it has tilted onto what is below."""
    under: Array
    """Its faces that look down, at its pre-drop pose [m], shape (k, 3, 3)."""
    laid: Array
    """The same once the object lies [m], shape (k, 3, 3)."""
    gap: float
    """Smallest gap at the start [m]."""
    way: Array
    """The way down of each face once the object lies [m], shape (k,)."""
    face_nearest: int
    """Face of the object that touches first."""
    first: Array
    """Where it touches what is below; of several places the one nearest to its middle [m], shape (3,)."""

    @classmethod
    def of(cls, item: Mesh, beneath: Raycaster, fallback_height: float, *, tilts: bool) -> "Descent":
        """Of an object at its pre-drop pose; `tilts` where it may lie down on what it meets."""
        center = center_of(item)
        turn = levelling(item, center, lambda turned: heights_over(turned, beneath)) if tilts else np.eye(4)
        fine, under, gap, _ = underside(item, beneath, fallback_height)
        nearest = nearest_face(item, fine.triangles[under[int(np.argmin(gap))]].mean(axis=0))
        laid = fine.transformed(turn).triangles[under]
        middle = laid.mean(axis=1)
        way = gaps(middle, beneath, fallback_height)
        at_once = np.flatnonzero(way <= way.min() + LEAST_DEPTH)
        first = at_once[int(np.argmin(np.linalg.norm((middle[at_once] - center)[:, :2], axis=1)))]
        place = middle[first] - [0.0, 0.0, way[first]]
        return cls(
            beneath, fallback_height, item.transformed(turn), fine.triangles[under], laid, float(gap.min()), way,
            nearest, place,
        )  # fmt: skip

    def footprint(self, weight: float, stacks: tuple[Stack, Stack]) -> Footprint:
        """The contact under a weight [N] of the layers of the object with those of what is below it."""
        contact = None
        if any(compliance > 0.0 for stack in stacks for _, compliance in stack):
            box = self.lying.bounds[:, :2]
            contact = plan_contact(heights_over(self.lying, self.beneath), box, weight, stacks)
            if contact is None:  # all of it is over a hole of what is seen
                level = heights_over(self.lying, self.beneath, self.fallback_height)
                contact = plan_contact(level, box, weight, stacks)
        depth = LEAST_DEPTH if contact is None else float(np.clip(contact.patch.approach, LEAST_DEPTH, MOST_DEPTH))
        boxes, below = [], []
        for times in (1.0, WIDER):
            touching = self.way <= self.way.min() + times * depth
            boxes.append(box_of(self.under[touching]))
            below.append(box_of(self.laid[touching] - self.way[touching, None, None] * np.array(UP)))
        (low, high), wider = boxes
        half = 0.5 * float(np.ptp(below[0], axis=0)[:2].min()) if contact is None else contact.half_width
        contacts = () if contact is None else (contact,)
        return Footprint(low, high, wider, np.stack(below), half, depth, contacts)


def box_of(corner: Array) -> Array:
    """Around triangles (n, 3, 3) [m], shape (2, 3)."""
    return np.stack([corner.min(axis=(0, 1)), corner.max(axis=(0, 1))])


def heights_over(item: Mesh, beneath: Raycaster, fallback_height: float = np.nan) -> Heights:
    """Tells where vertical lines enter the object from below, and what lies below that; `fallback_height` [m] where
    nothing is seen."""
    own, start = Raycaster(item), float(item.bounds[0, 2]) - BELOW

    def heights(plan: Array) -> tuple[Array, Array]:
        origin = np.column_stack([plan, np.full(len(plan), start)])
        under = start + own.cast(origin, np.tile(UP, (len(plan), 1))).distance
        there = np.isfinite(under)
        top = np.full(len(plan), np.nan)
        top[there] = under[there] - gaps(np.column_stack([plan, under])[there], beneath, fallback_height)
        return np.where(there, under, np.nan), top

    return heights


def center_of(item: Mesh) -> Array:
    """Centre of the solid, else of the surface [m], shape (3,)."""
    if is_closed(item):
        try:
            return inertial_of_solid(item, 1.0).center_of_mass
        except GeometryError:
            pass
    return np.average(item.triangles.mean(axis=1), axis=0, weights=np.maximum(item.face_areas, 1e-12))


def underside(
    item: Mesh, beneath: Raycaster, fallback_height: float
) -> tuple[Mesh, NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """The object with small faces, which of them look down (k,), their free way down [m] and area in plan [m^2]."""
    size = float(np.ptp(item.vertices, axis=0).max())
    fine = subdivide_near(item, item.bounds, max(size / 40.0, 1e-3)) if len(item.faces) < 4000 else item
    normal = fine.face_normals
    under = np.flatnonzero(normal[:, 2] < 0.0)
    if len(under) == 0:  # wound inside out, or a sheet seen from above
        under = np.flatnonzero(np.abs(normal[:, 2]) > 0.0)
    center = fine.triangles[under].mean(axis=1)
    return fine, under, gaps(center, beneath, fallback_height), 0.5 * np.abs(normal[under, 2])


def first_curvature(item: Mesh, beneath: Raycaster, fallback_height: float) -> float:
    """Radius [m] of the sphere whose cap of LEAST_DEPTH has the area that the object has within that depth of first
    contact: A = 2 pi R d. Of a flat underside a radius much larger than its width, yet one that sinks deeper."""
    _, _, gap, area = underside(item, beneath, fallback_height)
    return float(area[gap <= gap.min() + LEAST_DEPTH].sum()) / (2.0 * np.pi * LEAST_DEPTH)


def gaps(points: NDArray[np.float64], beneath: Raycaster, fallback_height: float) -> NDArray[np.float64]:
    """Free way of points (n, 3) along gravity [m], shape (n,)."""
    hits = beneath.cast(points, np.broadcast_to(np.array([0.0, 0.0, -1.0]), points.shape))
    return np.where(np.isfinite(hits.distance), hits.distance, points[:, 2] - fallback_height)


def nearest_face(mesh: Mesh, point: NDArray[np.float64]) -> int:
    """The face whose middle is nearest to a point."""
    return int(np.argmin(np.linalg.norm(mesh.triangles.mean(axis=1) - point, axis=1)))
