"""Signed distance to meshes, negative inside, whether they are closed or not.

In: a mesh and points, or a box to sample. Out: the exact distance to the nearest triangle with the sign of the
generalised winding number [J13], evaluated fast [B18]: a mesh with holes is closed as its surface suggests, a hollow
mug stays hollow. Grids are exact in a band around the surface and interpolated from a coarser grid beyond it.

[J13] Jacobson, Kavan, Sorkine-Hornung: Robust inside-outside segmentation using generalized winding numbers. ACM TOG
32(4), 2013. [B18] Barill, Dickson, Schmidt, Levin, Jacobson: Fast winding numbers for soups and clouds. ACM TOG
37(4), 2018.
"""

from collections.abc import Callable
from typing import TypeAlias, TypeVar

import igl
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label, map_coordinates

from dcap.geometry.pieces import INSIDE, is_closed, outward, signed_volume
from dcap.geometry.raycast import tensor
from dcap.scene.errors import GeometryError
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.particles import DistanceGrid

Distance: TypeAlias = Callable[[NDArray[np.float64]], NDArray[np.float64]]
"""Signed distance [m] at points (n, 3), shape (n,)."""

ScalarT = TypeVar("ScalarT", bound=np.generic)

# samples on each side of the surface that are exact: trilinear interpolation and its gradient reach one sample far
BAND = 3
CORNERS = tuple(np.ndindex(2, 2, 2))
COARSE = 4  # spacing of the coarse grid over that of the fine one
DISAGREEMENT = 0.002  # share of a region's samples on the other side that is attributed to rounding at the surface
CLEAR = 0.6  # above one half: in single precision, distances at sliver triangles are wrong by up to about 0.01 mm
MOST_SAMPLES = 40_000_000  # 160 MB; far more than any body here needs


class MeshDistance:
    """Signed distance to a mesh, prepared for many points.

    Each closed piece is taken as wound outwards, except for hollows (`outward`). `sides` decides inside and outside if
    it differs from the surface to which distances are measured (a surface without its closing faces, for example); its
    pieces are used as they are, and all reversed together if they enclose a negative volume.
    """

    def __init__(self, mesh: Mesh, sides: Mesh | None = None) -> None:
        import open3d

        if len(mesh.faces) == 0:
            raise GeometryError("signed distance to a mesh without faces; give a part that has a surface")
        inner = outward(mesh) if sides is None else sides
        self.mesh = mesh
        # single precision counts from the middle of the mesh, not from the corner of the room
        self.shift = mesh.bounds.mean(axis=0)
        self._scene = open3d.t.geometry.RaycastingScene()
        self._scene.add_triangles(tensor(mesh.vertices - self.shift, np.float32), tensor(mesh.faces, np.uint32))
        self._vertices = np.ascontiguousarray(inner.vertices - self.shift)
        self._faces = np.ascontiguousarray(inner.faces, dtype=np.int64)
        volume = signed_volume(self._vertices, self._faces)
        self.volume = abs(volume)  # [m^3], if it is closed and nothing overlaps
        self._turned = volume < 0.0
        self.closed = is_closed(inner)

    def __call__(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Signed distance [m] at points (n, 3), shape (n,)."""
        distance = self.unsigned(points)
        return np.where(self.inside(points), -distance, distance)

    def unsigned(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Distance to the surface [m], shape (n,)."""
        if len(points) == 0:
            return np.zeros(0)
        found = self._scene.compute_distance(tensor(points - self.shift, np.float32))
        return np.asarray(found.numpy(), dtype=np.float64)

    def nearest_face(self, points: NDArray[np.float64]) -> NDArray[np.int64]:
        """Index of the face nearest to each point (n, 3), shape (n,)."""
        if len(points) == 0:
            return np.zeros(0, dtype=np.int64)
        found = self._scene.compute_closest_points(tensor(points - self.shift, np.float32))
        return np.asarray(found["primitive_ids"].numpy(), dtype=np.int64)

    def winding(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Generalised winding number, about 1 inside and 0 outside, shape (n,)."""
        if len(points) == 0:
            return np.zeros(0)
        local = np.ascontiguousarray(points - self.shift)
        number = np.asarray(igl.fast_winding_number(self._vertices, self._faces, local)).reshape(-1)
        return -number if self._turned else number

    def inside(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Mask of the points (n, 3) that are inside, shape (n,)."""
        return np.asarray(self.winding(points) > INSIDE)


def sampled(distance: Distance, low: NDArray[np.float64], high: NDArray[np.float64], spacing: float) -> DistanceGrid:
    """Samples of a signed distance over a box: exact within BAND samples of the surface, interpolated farther away."""
    low, high = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
    if not (spacing > 0.0 and (high > low).all()):
        raise GeometryError(f"a distance grid needs high > low and spacing > 0; got {low}, {high}, {spacing}")
    # a multiple of the coarse grid, at least three samples a side
    blocks = np.maximum(np.ceil((high - low) / (COARSE * spacing) - 1e-9).astype(int), 1)
    shape = COARSE * blocks + 1
    if np.prod(shape.astype(float)) > MOST_SAMPLES:
        raise GeometryError(
            f"a distance grid of {shape.tolist()} samples > {MOST_SAMPLES}; raise its spacing ({spacing} m)"
        )
    coarse = distance(lattice(low, COARSE * spacing, blocks + 1)).reshape(blocks + 1)
    values = upsampled(coarse)
    # all values that interpolation within the band reads are computed; farther away the side is still right, because
    # interpolated values are wrong by at most half a coarse diagonal, less than twice the band
    reach = (BAND + np.sqrt(3.0)) * spacing
    near = np.argwhere(np.minimum(np.abs(values), least_distances(coarse, spacing)) < reach)
    points = low + spacing * near
    if isinstance(distance, MeshDistance):
        values[tuple(near.T)] = distance.unsigned(points)
        inside = regional_sides(distance, values, coarse, near, points, spacing)
        values[tuple(near.T)] = np.where(inside, -1.0, 1.0) * values[tuple(near.T)]
    else:
        values[tuple(near.T)] = distance(points)
    return DistanceGrid(low, float(spacing), values.astype(np.float32))


def regional_sides(
    distance: "MeshDistance",
    values: NDArray[np.float64],
    coarse: NDArray[np.float64],
    near: NDArray[np.int64],
    points: NDArray[np.float64],
    spacing: float,
) -> NDArray[np.bool_]:
    """Mask of the near samples that are inside, shape (n,), from one decision per region instead of one per sample.

    Two neighbouring samples that are both farther than half a spacing from the surface lie on the same side of it:
    connected regions of such samples are decided by their coarse samples. If a region's coarse samples disagree, the
    surface has a hole there, and every sample is decided individually.
    """
    clear = np.abs(values) > CLEAR * spacing
    region, count = label(clear)
    seed = region[::COARSE, ::COARSE, ::COARSE]
    votes = np.bincount(seed.ravel(), minlength=count + 1)
    negative = np.bincount(seed.ravel(), weights=(coarse < 0.0).ravel(), minlength=count + 1)
    share = np.divide(negative, votes, out=np.full(count + 1, 0.5), where=votes > 0)
    decided = (share < DISAGREEMENT) | (share > 1.0 - DISAGREEMENT)
    decided[0] = False
    own = region[tuple(near.T)]
    inside = share[own] > 0.5
    open_ = np.flatnonzero(~decided[own])
    inside[open_] = distance.inside(points[open_])
    return np.asarray(inside)


def lattice(low: NDArray[np.float64], spacing: float, shape: NDArray[np.integer]) -> NDArray[np.float64]:
    """Points of a regular grid in C order, shape (n, 3)."""
    return np.asarray(low + spacing * np.indices(tuple(shape)).reshape(3, -1).T)


def upsampled(coarse: NDArray[np.float64]) -> NDArray[np.float64]:
    """Linear interpolation to COARSE intervals per interval along every axis."""
    values = coarse
    for axis in range(3):
        one, two = np.moveaxis(values, axis, 0)[:-1], np.moveaxis(values, axis, 0)[1:]
        share = (np.arange(COARSE) / COARSE)[None, :, None, None]
        mixed = one[:, None] * (1.0 - share) + two[:, None] * share
        mixed = np.concatenate([mixed.reshape(-1, *mixed.shape[2:]), two[-1:]])
        values = np.moveaxis(mixed, 0, axis)
    return np.ascontiguousarray(values)


def least_distances(coarse: NDArray[np.float64], spacing: float) -> NDArray[np.float64]:
    """Lower bound of the distance of the samples between coarse ones from the surface [m]: a distance changes by no
    more than the distance between two points, so each corner of a coarse cell gives a bound. Zero in cells whose
    corners are not all on one side. Shape as from `upsampled`."""
    cells = np.array(coarse.shape)
    corner = np.pad(np.abs(coarse), (0, 1), constant_values=-np.inf)  # samples on the last planes have fewer corners
    crossed = np.logical_not(one_sided(coarse))
    least = np.empty(tuple(COARSE * cells))
    for offset in np.ndindex(COARSE, COARSE, COARSE):
        bound = np.full(tuple(cells), -np.inf)
        for far in CORNERS:
            way = spacing * float(np.linalg.norm(COARSE * np.array(far) - offset))
            np.maximum(bound, at_corner(corner, far) - way, out=bound)
        bound[crossed] = 0.0
        least[offset[0] :: COARSE, offset[1] :: COARSE, offset[2] :: COARSE] = bound
    return least[tuple(slice(COARSE * (n - 1) + 1) for n in cells)]


def one_sided(coarse: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Mask of the cells, one above each sample, whose corners are all on the same side of the surface."""
    inside = np.pad(coarse < 0.0, (0, 1), mode="edge")
    corners = [at_corner(inside, far) for far in CORNERS]
    return np.asarray(np.logical_and.reduce(corners) | ~np.logical_or.reduce(corners))


def at_corner(values: NDArray[ScalarT], corner: tuple[int, ...]) -> NDArray[ScalarT]:
    """Values at one corner of every cell, from samples (one more than cells along each axis)."""
    i, j, k = (slice(far, far + count - 1) for far, count in zip(corner, values.shape, strict=True))
    return values[i, j, k]


def sampler(grid: DistanceGrid) -> Distance:
    """The signed distance given by a grid: trilinear inside, outside the nearest sample plus the distance to it."""

    def distance(points: NDArray[np.float64]) -> NDArray[np.float64]:
        last = np.array(grid.values.shape) - 1.0
        local = (points - grid.origin) / grid.spacing
        within = np.clip(local, 0.0, last)
        value = map_coordinates(grid.values, within.T, order=1, output=np.float64)
        outside = np.flatnonzero((local != within).any(axis=1))  # usually none
        value[outside] += grid.spacing * np.linalg.norm(local[outside] - within[outside], axis=1)
        return np.asarray(value)

    return distance
