"""Finds points of a rigid surface that a finely sampled soft partner makes superfluous.

Where a rigid body is flat over more than a cell of its soft partner, the partner's own surface points already prevent
penetration. Points of the rigid body there would also hold the partner's surface, up to the rim of a flat punch, and
drag nodes along that lie a cell beyond it: the punch would act as if it were wider by that much, and a coarse contact
would be too stiff. Edges and corners that press with their ridge, and features smaller than a cell, keep their points.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.spatial import cKDTree

from solver.arrays import Array
from solver.model.bodies import Body

ALIKE = np.cos(np.radians(15.0))  # faces whose normals differ by less belong to one flat region
PRESSED = np.cos(np.radians(25.0))  # a region whose normal is closer to the partner's presses flat on it
STILL_PRESSED = np.cos(np.radians(45.0))  # a pressing region continues until its normal is farther off,
WIDER = 1.0 + 1e-6  # of a cell: a region of exactly one cell does not count as wider
STILL_WIDE = 0.5  # or until it is narrower than this share of a cell [-]
COVERED = 0.7  # least area of a region within a radius r of a point, over r^2 [-]: 1.57 at a rim, 0.79 at a corner
WIDE = 0.03  # least variance of its positions, over r^2 [-]: 0.049 at a corner, (w / r)^2 / 12 in a strip of width w
HALF_CELL_DIAGONAL = 0.75  # longest edge of a face with corners half a cell apart, over the cell [-]: 0.71
PLANES = 3  # number of regions for each point: those at a box's corner
LEVELS = 3  # number of radii, each twice the previous one
GRAIN = 0.125  # of a radius: smaller faces are merged, else a fine surface has thousands around a point
PARALLEL = 0.06  # components of merged normals agree within this [-]: 6 degrees at most
LEAST_THICKNESS = 4e-3  # of a body behind a region [m]: surface points sink in by up to a millimetre
LEAST_SAMPLES = 6  # of its distance across: with fewer, directions are inaccurate near the middle
OTHER_SIDE = -0.5  # cosine between the way out and a normal, beyond which the way leads to the other side
CHUNK = 4000  # points processed together: each has hundreds of faces around it


@dataclass(frozen=True, eq=False, slots=True)
class Sampling:
    """Density of the points of a soft surface."""

    vertices: cKDTree
    """Search tree of the vertices in the start pose."""
    spacing: Array
    """Longest edge at each vertex [m], shape (m,)."""

    @classmethod
    def of(cls, body: Body) -> "Sampling":
        """Sampling of a body's surface."""
        corner = body.vertices[body.faces]
        edge = np.linalg.norm(corner - np.roll(corner, 1, axis=1), axis=2).max(axis=1)
        spacing = np.zeros(len(body.vertices))
        np.maximum.at(spacing, body.faces, edge[:, None])
        return cls(cKDTree(body.vertices), spacing)

    def fine(self, material: Array, cell: Array) -> NDArray[np.bool_]:
        """Mask of the places (k, 3) of the start pose [m] where points are at least twice as dense as nodes in cells of
        given sizes [m] (k,)."""
        return np.asarray(self.spacing[self.vertices.query(material)[1]] <= HALF_CELL_DIAGONAL * cell)


@dataclass(frozen=True, eq=False, slots=True)
class FlatRegions:
    """Flat regions around the points of a rigid surface, and the soft surface that they press on."""

    partner: Sampling
    normal: Array
    """Outward normals in the start pose, shape (n, PLANES, 3); zero if there are fewer regions."""
    radius: Array
    """Radius to which each region extends, at most the largest radius tested [m], shape (n, PLANES)."""

    def superfluous(
        self,
        point: NDArray[np.integer],
        rotation: Array,
        material: Array,
        normal: Array,
        cell: Array,
        before: NDArray[np.bool_],
    ) -> NDArray[np.bool_]:
        """Mask of the points (k,) that press with a flat region on places of the partner with enough points of their
        own: material points (k, 3) of its start pose [m], with world outward normals (k, 3) and cells [m] (k,) narrower
        than the region; `rotation` (3, 3) is that of the rigid body since the start. Points that were superfluous
        `before` (k,) remain so until they clearly are not: otherwise a body would rock between both states."""
        facing = np.einsum("kpi,ji,kj->kp", self.normal[point], rotation, -normal)
        begins = (facing > PRESSED) & (
            self.radius[point] > WIDER * cell[:, None]
        )  # radii are cells times powers of two
        goes_on = (facing > STILL_PRESSED) & (self.radius[point] >= STILL_WIDE * cell[:, None])
        return np.asarray((begins.any(axis=1) | (before & goes_on.any(axis=1))) & self.partner.fine(material, cell))


def flat_regions(body: Body, partner: Body, smallest: float) -> FlatRegions:
    """The regions around every vertex of a rigid body, tested within radii from `smallest` [m] upwards."""
    corner = body.vertices[body.faces]
    cross = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    length = np.linalg.norm(cross, axis=1)
    face_normal, area = cross / np.maximum(length, 1e-300)[:, None], 0.5 * length
    normal = adjacent_normals(body, face_normal, area)
    center, radius = corner.mean(axis=1), np.zeros(normal.shape[:2])
    going = np.asarray(np.abs(normal).sum(axis=2) > 0.0) & thick_behind(body, normal)
    for level in range(LEVELS):
        reach = smallest * 2.0**level
        center, face_normal, area = joined_faces(center, face_normal, area, GRAIN * reach)
        tree = cKDTree(center)
        rows = np.flatnonzero(going.any(axis=1))
        for some in np.array_split(rows, max(1, -(-len(rows) // CHUNK))):
            found = tree.query_ball_point(body.vertices[some], reach)
            count = np.array([len(one) for one in found], dtype=np.int64)
            face = np.fromiter((one for several in found for one in several), dtype=np.int64, count=int(count.sum()))
            owner = np.repeat(np.arange(len(some)), count)
            alike = np.einsum("fpi,fi->fp", normal[some][owner], face_normal[face]) > ALIKE
            for plane in range(normal.shape[1]):
                near = sparse.csr_matrix((1.0 * alike[:, plane], (owner, face)), shape=(len(some), len(area)))
                covered, variance = spread(near, area, center)
                going[some, plane] &= (covered >= COVERED * reach**2) & (variance >= WIDE * reach**2)
        radius[going] = reach
    return FlatRegions(Sampling.of(partner), normal, radius)


def spread(near: sparse.csr_matrix, area: Array, center: Array) -> tuple[Array, Array]:
    """Total area [m^2] of the faces near each of k points, and the variance of their places along the shorter direction
    of the region [m^2], both of shape (k,): `near` (k, f) is 1 for the faces near a point; areas (f,) [m^2] and centres
    (f, 3) [m].

    Within a face the variance is taken as that of a square, area / 12.
    """
    place = center - center.mean(axis=0)
    products = (place[:, :, None] * place[:, None, :]).reshape(-1, 9)
    total, own, first, second = (near @ (area * one.T).T for one in (np.ones(len(area)), area / 12.0, place, products))
    some = np.maximum(total, 1e-300)
    mean = first / some[:, None]
    covariance = (second / some[:, None]).reshape(-1, 3, 3) - mean[:, :, None] * mean[:, None, :]
    return total, np.linalg.eigvalsh(covariance)[:, 1] + own / some  # the smallest eigenvalue is across the flat region


def thick_behind(body: Body, normal: Array) -> NDArray[np.bool_]:
    """Mask of the regions behind which a rigid body is thick, along normals (n, PLANES, 3) at its vertices, shape (n,
    PLANES): at half of LEAST_THICKNESS the way out does not lead to the other side. A point of the partner that has
    sunk into a thinner body would be pushed out there."""
    half = 0.5 * max(LEAST_SAMPLES * body.distance.spacing, LEAST_THICKNESS)
    behind = (body.vertices[:, None] - half * normal).reshape(-1, 3)
    along = np.einsum("ni,ni->n", body.distance.outward(behind), normal.reshape(-1, 3))
    return np.asarray(along.reshape(normal.shape[:2]) > OTHER_SIDE)


def joined_faces(center: Array, normal: Array, area: Array, grain: float) -> tuple[Array, Array, Array]:
    """Centres (f, 3) [m], unit normals (f, 3) and areas (f,) [m^2] of faces, where faces with nearly parallel normals
    in the same cube of side `grain` [m] are merged."""
    key = np.concatenate([np.floor(center / grain), np.round(normal / PARALLEL)], axis=1).astype(np.int64)
    group = np.unique(key, axis=0, return_inverse=True)[1].reshape(-1)
    total = np.asarray(np.bincount(group, area), np.float64)
    weight = area / np.maximum(total, 1e-300)[group]
    middle, mean = (
        np.stack([np.bincount(group, weight * values[:, i]) for i in range(3)], axis=1).astype(np.float64)
        for values in (center, normal)
    )
    return middle, mean / np.maximum(np.linalg.norm(mean, axis=1), 1e-300)[:, None], total


def adjacent_normals(body: Body, face_normal: Array, area: Array) -> Array:
    """Up to PLANES normals of the faces at each vertex, those of larger faces first, at least 15 degrees apart, shape
    (n, PLANES, 3)."""
    corner = body.faces.ravel()
    face = np.repeat(np.arange(len(body.faces)), 3)
    order = np.lexsort((-area[face], corner))
    corner, face = corner[order], face[order]
    out, used = np.zeros((len(body.vertices), PLANES, 3)), np.zeros(len(body.vertices), dtype=np.int64)
    starts = np.flatnonzero(np.diff(corner, prepend=-1))
    place = np.arange(len(corner)) - np.repeat(starts, np.diff(np.append(starts, len(corner))))
    for turn in range(int(place.max(initial=-1)) + 1):  # the largest face of every vertex, then the next of each
        at = place == turn
        vertex, normal = corner[at], face_normal[face[at]]
        alike = (np.einsum("vpi,vi->vp", out[vertex], normal) > ALIKE).any(axis=1)
        new = ~alike & (used[vertex] < PLANES)
        out[vertex[new], used[vertex[new]]] = normal[new]
        used[vertex[new]] += 1
    return out
