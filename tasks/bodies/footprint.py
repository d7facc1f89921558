"""Where and how wide the object will probably touch: decides cell sizes before anything is simulated.

In: the object at its pre-drop pose, what lies beneath it, weight and elasticity. Out: the footprint at the expected
indentation. The gap between the object's underside and what lies below it is measured along gravity; the part of it
that closes first touches first.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.raycast import Raycaster
from dcap.geometry.solid.repair import subdivide_near
from dcap.scene.types.mesh import Mesh
from solver.contact.predict import contact_radius

LEAST_DEPTH, MOST_DEPTH = 5e-4, 0.06  # expected indentation [m]: below it is invisible, above it no formula holds
ROUNDS = 8  # indentation and footprint decide each other: a few rounds settle within a few per cent
WIDER = 4.0  # times the expected indentation: what may touch before the object has levelled out
# a footprint that grows by less than this factor when the depth grows by WIDER is flat (a sphere's grows by WIDER)
FLAT = 2.0


@dataclass(frozen=True, eq=False, slots=True)
class Footprint:
    """The predicted contact."""

    low: NDArray[np.float64]
    """Lower corner of its box [m], shape (3,)."""
    high: NDArray[np.float64]
    """Upper corner [m], shape (3,)."""
    wider: NDArray[np.float64]
    """Lower and upper corner of what may touch too, at WIDER times the indentation [m], shape (2, 3): an object that
    lies on a slope comes down at one end first."""
    radius: float
    """Contact radius [m] (of a disc of the same area where it is not round)."""
    depth: float
    """Expected indentation [m]."""
    flat: bool
    """An extended face rather than a rounded underside."""
    gap: float
    """Smallest gap at the start [m]."""
    face_nearest: int
    """Face of the object that touches first."""

    @property
    def small_side(self) -> float:
        """Shorter horizontal side [m]."""
        return float((self.high - self.low)[:2].min())


def predicted_footprint(
    item: Mesh, beneath: Raycaster, weight: float, compliance: float, fallback_height: float
) -> Footprint:
    """The footprint of an object of a given weight [N]; `compliance` = 1 / E* of the pair [1/Pa].

    `fallback_height` [m] stands for what lies below where a ray meets nothing.
    """
    fine, under, gap, area = underside(item, beneath, fallback_height)
    center = fine.triangles[under].mean(axis=1)
    closest = float(gap.min())
    depth, radius = 3e-3, 0.0
    for _ in range(ROUNDS):
        covered = float(area[gap <= closest + depth].sum())
        curvature = covered / (2.0 * np.pi * depth)
        radius = contact_radius(weight, curvature, 1.0 / compliance, 0.0)
        depth = float(np.clip(0.5 * depth + 0.5 * radius**2 / curvature, LEAST_DEPTH, MOST_DEPTH))
    touching = gap <= closest + depth
    radius = min(radius, float(np.sqrt(area[touching].sum() / np.pi)))
    wider = gap <= closest + WIDER * depth
    corner, beyond = (fine.triangles[under[those]].reshape(-1, 3) for those in (touching, wider))
    height = float(np.ptp(item.vertices[:, 2]))
    return Footprint(
        corner.min(axis=0), corner.max(axis=0), np.stack([beyond.min(axis=0), beyond.max(axis=0)]), radius, depth,
        is_flat(gap - closest, area, min(WIDER * depth, 0.5 * height)), closest,
        int(nearest_face(item, center[int(np.argmin(gap))])),
    )  # fmt: skip


def is_flat(gap: NDArray[np.float64], area: NDArray[np.float64], depth: float) -> bool:
    """Whether faces of these gaps [m] and areas in plan [m^2] grow little on the last way to a depth [m], which is at
    most half an object's height: a ball has no more to show beyond that."""
    return float(area[gap <= depth].sum()) < FLAT * float(area[gap <= depth / WIDER].sum())


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
