"""Gaussians that move with a deforming surface, split where one flat disc cannot follow it.

In: Gaussians in any frame and unit, and the motion of a surface in the world. Out: the Gaussians that move, in the same
frame; the others are unchanged to the bit. With F the deformation gradient at a centre, a covariance becomes F S F^T
and harmonics turn by the rotation R of F = R U. A disc stays flat, so a disc that is large compared with the dent is
split first.

On the surface the displacement is that of its nearest point. Below, it fades as in an elastic half-space whose surface
is displaced over a disc of radius L: on the axis a harmonic field has the share 1 - d / sqrt(d^2 + L^2) at depth d
(Poisson's integral). L is the radius of the disc with the area of the surface that moved by more than half of the
maximum, and at least twice the maximum: nearer layers are compressed by at most a half and never pass one another.
Above, Gaussians within CLOSE follow completely, since scans have Gaussians off the surface that they show; farther ones
follow less, and beyond FAR not at all.

`split` replaces a Gaussian by smaller pieces with the same appearance, which can follow a shape that a flat disc
cannot. Pieces lie on a grid in the plane of the larger two axes. Optical depths add up, opacities do not. A Gaussian of
opacity a has the depth -ln(1 - a exp(-r^2 / 2)); pieces of opacity b and deviation s on a grid of step h have on
average 2 pi (s / h)^2 Li2(b), where Li2 is the dilogarithm (the integral of -ln(1 - b exp(-r^2 / 2)) over the plane is
2 pi Li2(b)). So b follows from the required depth at a piece's place. Places are narrowed to make up for the pieces'
width.
"""

from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from scipy.special import spence

from dcap.arrays import Array, Float32Array
from dcap.geometry.deform import NEGLIGIBLE, edge_lengths
from dcap.geometry.raycast import tensor
from dcap.scene.types.gaussians import Gaussians, joined_splats, turned_harmonics
from dcap.scene.types.mesh import Mesh

REACH = 2.7
"""Largest distance of pieces from the middle, in deviations [-]; farther out there is less than 3 % of the opacity."""
OVERLAP = 0.8
"""Deviation of a piece over the grid's step [-]: with a smaller one, the sum is uneven."""
STEPS = (5, 7, 10, 14, 20, 28)
"""Allowed numbers of grid steps to either side [-]; with the smallest, pieces are 0.43 times as wide."""
FAINT, SOLID = 1.0 / 255.0, 0.99
"""Least and largest opacity that a renderer accepts from one Gaussian [-]."""

_OPACITY = np.concatenate([[0.0], np.geomspace(1e-6, 0.5, 2000), 1.0 - np.geomspace(0.499, 1e-4, 2000)])
_DILOGARITHM = spence(1.0 - _OPACITY)
if TYPE_CHECKING:
    import open3d


CLOSE, FAR = 0.02, 0.04
"""Distances above the surface up to which Gaussians follow it completely, and from which not at all [m]."""
HIDDEN = 1e-4
"""Displacement below the surface that is too small to matter [m]."""
MOST_STRETCH = 4.0
"""Largest factor by which a Gaussian grows or shrinks along any axis [-]: gradients across a fold are meaningless."""
LEAST_STRAIN = 1e-4
"""Difference of a gradient from a pure translation below which no Gaussian changes visibly [-]."""
TOLERANCE = 5e-4
"""Largest deviation of a Gaussian from its surface at two deviations from its middle [m]; above it, it is split."""
LEAST_SPLIT = 0.05
"""Least opacity of a Gaussian that is split [-]: pieces of haze would be too faint to be drawn."""
MOST_PIECES, COARSER = 1_000_000, 1.2
"""Maximum number of pieces of all Gaussians together [-], and factor by which they are widened until this holds."""
STEP = 0.25
"""Largest share of L for the step of the gradient, which is a mean over a Gaussian's own width [-]."""
CHUNK = 100_000
"""Number of Gaussians processed together [-]."""
CHANGED = 10_000
"""Number of Gaussians rotated together [-]."""


@dataclass(frozen=True, eq=False, slots=True)
class SplatPieces:
    """Pieces of split Gaussians."""

    splats: Gaussians
    """k pieces in the given frame, grouped and ordered by Gaussian."""
    owner: NDArray[np.int64]
    """Index of the original Gaussian of each piece, increasing, shape (k,)."""
    middle: NDArray[np.bool_]
    """Mask of the pieces at the centres of their Gaussians, shape (k,)."""


def split(splats: Gaussians, steps: NDArray[np.int64]) -> SplatPieces:
    """Pieces of n Gaussians; `steps` (n, 2), from STEPS, count to either side along the two largest axes."""
    owners, places, widths, opacities = (
        [np.zeros(0, dtype=np.int64)], [np.zeros((0, 2))], [np.zeros((0, 2))], [np.zeros(0)],
    )  # fmt: skip
    alpha = np.minimum(splats.opacity.astype(np.float64), SOLID)
    for pair in np.unique(steps, axis=0):
        index = np.flatnonzero((steps == pair).all(axis=1))
        place, width, opacity = pieces(alpha[index], pair)
        row, column = np.nonzero((opacity > FAINT) | (place == 0.0).all(axis=1))
        owners.append(index[row])
        places.append(place[column])
        widths.append(np.tile(width, (len(row), 1)))
        opacities.append(np.clip(opacity[row, column], 1e-4, SOLID))
    order = np.argsort(np.concatenate(owners), kind="stable")
    owner, opacity = np.concatenate(owners)[order], np.concatenate(opacities)[order]
    place, width = np.concatenate(places)[order], np.concatenate(widths)[order]
    wide = np.argsort(-splats.log_scale, axis=1, kind="stable")[owner, :2]
    rows = np.arange(len(owner))[:, None]
    part = splats.subset(owner)
    across = np.swapaxes(part.axes, 1, 2)[rows, wide] * part.scale[rows, wide][:, :, None]
    log_scale = part.log_scale.copy()
    log_scale[rows, wide] += np.log(width).astype(np.float32)
    found = replace(
        part,
        position=(part.position + np.einsum("nk,nki->ni", place, across)).astype(np.float32),
        log_scale=log_scale,
        logit=np.log(opacity / (1.0 - opacity)).astype(np.float32),
    )
    return SplatPieces(found, owner, (place == 0.0).all(axis=1))


def pieces(alpha: Array, steps: NDArray[np.int64]) -> tuple[Array, Array, Array]:
    """Places (k, 2) and widths (2,) of pieces in deviations of the whole, and opacities (n, k) for `alpha` (n,)."""
    one, two = (REACH * np.arange(-count, count + 1) / count for count in steps)
    place = np.stack(np.meshgrid(one, two, indexing="ij"), axis=-1).reshape(-1, 2)
    width = OVERLAP * REACH / steps
    rest = 1.0 - width**2  # share of the variance that the places provide
    fall = np.exp(-0.5 * (place**2 / rest).sum(axis=1))
    depth = -np.log1p(-alpha[:, None] * fall) / np.sqrt(rest.prod())
    return place, width, np.interp(depth / (2.0 * np.pi * OVERLAP**2), _DILOGARITHM, _OPACITY)


class SurfaceMotion:
    """The displacement that a moved surface gives to Gaussians on and in it."""

    def __init__(self, start: Mesh, shift: Array, movable: NDArray[np.bool_]) -> None:
        """Take a mesh before the motion, the displacement of its vertices [m] (n, 3), and the mask of its faces (m,)
        that may carry Gaussians; Gaussians nearest to other faces stay."""
        moved = np.linalg.norm(shift, axis=1)[start.faces].max(axis=1)
        self.moves = bool((moved[movable] > NEGLIGIBLE).any())
        if not self.moves:
            return
        self._movable = movable
        near = start.submesh(np.flatnonzero(movable & (moved > NEGLIGIBLE)))
        self._shift, self._start = shift, start
        self._origin = near.bounds.mean(axis=0)
        self._whole = self._scene(start.faces)
        self._own_faces = start.faces[movable]
        self._own = self._scene(self._own_faces)
        area, most = start.face_areas, float(moved[movable].max())
        wide = float(np.sqrt(area[movable & (moved > 0.5 * most)].sum() / np.pi))
        self.length = max(wide, 2.0 * most)
        """L, the length over which the displacement fades below the surface [m]."""
        self.edge = float(np.median(edge_lengths(near)))
        """Median longest edge of the moved faces [m]."""
        reach = max(FAR, self.length * np.sqrt(0.5 * most / HIDDEN))
        self._box = near.bounds + np.array([[-reach], [reach]])

    def _scene(self, faces: NDArray[np.integer]) -> "open3d.t.geometry.RaycastingScene":
        import open3d

        scene = open3d.t.geometry.RaycastingScene()
        # single precision suffices for coordinates relative to the dent
        scene.add_triangles(tensor(self._start.vertices - self._origin, np.float32), tensor(faces, np.uint32))
        return scene

    def reached(self, points: Array) -> NDArray[np.int64]:
        """Indices of the points (n, 3) that are near enough, and nearest to a face that may carry them."""
        near = np.flatnonzero(((points >= self._box[0]) & (points <= self._box[1])).all(axis=1))
        if not len(near):
            return near
        found = self._whole.compute_closest_points(tensor(points[near] - self._origin, np.float32))
        return near[self._movable[found["primitive_ids"].numpy()]]

    def at(self, points: Array) -> Array:
        """Displacement [m] at points (n, 3), of the same shape."""
        found = self._own.compute_closest_points(tensor(points - self._origin, np.float32))
        corner = self._own_faces[found["primitive_ids"].numpy()]
        u, v = found["primitive_uvs"].numpy().astype(np.float64).T
        on_surface = np.einsum("nk,nki->ni", np.stack([1.0 - u - v, u, v], axis=1), self._shift[corner])
        away = points - self._origin - found["points"].numpy()
        distance = np.linalg.norm(away, axis=1)
        below = np.einsum("ni,ni->n", away, found["primitive_normals"].numpy().astype(np.float64)) < 0.0
        within = 1.0 - distance / np.hypot(distance, self.length)
        above = np.clip(1.0 - (distance - CLOSE) / (FAR - CLOSE), 0.0, 1.0)
        return np.asarray(np.where(below, within, above)[:, None] * on_surface)

    def bend(self, points: Array, across: Array) -> Array:
        """Largest deviation of the displacement from its tangent at points (n, 3) [m], along the vectors (n, 2, 3) up
        to twice their length, shape (n, 2)."""
        middle, out = self.at(points), np.zeros(across.shape[:2])
        first, second = across[:, 0], across[:, 1]
        ways = ((first, (0,)), (second, (1,)), (first + second, (0, 1)), (first - second, (0, 1)))
        for way, axes in ways:
            for share in (0.5, 1.0, 1.5, 2.0):
                away = share * way
                off = 0.5 * (self.at(points + away) + self.at(points - away)) - middle
                out[:, axes] = np.maximum(out[:, axes], np.linalg.norm(off, axis=1)[:, None])
        return out

    def gradient(self, points: Array, step: Array) -> Array:
        """F = I + du/dx at points (n, 3), by central differences over steps (n,) [m], shape (n, 3, 3)."""
        out = np.tile(np.eye(3), (len(points), 1, 1))
        for axis in range(3):
            away = step[:, None] * np.eye(3)[axis]
            out[:, :, axis] += (self.at(points + away) - self.at(points - away)) / (2.0 * step[:, None])
        return out


@dataclass(frozen=True, eq=False, slots=True)
class CarriedSplats:
    """The Gaussians carried along by a moved surface."""

    index: NDArray[np.int64]
    """Their indices among the given ones, increasing, shape (k,)."""
    splats: Gaussians
    """Their new state, in the given frame and unit, k of them."""
    more: Gaussians
    """Further pieces of those that were split, in the same frame."""

    def into(self, part: Gaussians, first: int) -> Gaussians:
        """The given Gaussians from index `first` on, with the carried ones in their new state."""
        low, high = np.searchsorted(self.index, [first, first + len(part)])
        if low == high:
            return part
        at = np.zeros(len(part), dtype=bool)
        at[self.index[low:high] - first] = True
        return replaced(part, at, self.splats.subset(np.arange(low, high)))


def replaced(splats: Gaussians, at: NDArray[np.bool_], others: Gaussians) -> Gaussians:
    """Gaussians (n,) with k of them replaced by others (k,)."""

    def patched(name: str) -> Float32Array:
        out: Float32Array = getattr(splats, name).copy()
        out[at] = getattr(others, name)
        return out

    return Gaussians(*(patched(one.name) for one in fields(Gaussians)))


def carried(splats: Gaussians, world_from_file: Array, motion: SurfaceMotion) -> CarriedSplats:
    """Gaussians of a file, whose frame and unit a similarity (4, 4) maps to the world, carried along by the surface."""
    none = splats.subset(np.zeros(0, dtype=np.int64))
    if not motion.moves:
        return CarriedSplats(np.zeros(0, dtype=np.int64), none, none)
    near = [first + motion.reached(in_world(splats.position[first : first + CHUNK], world_from_file))
            for first in range(0, len(splats), CHUNK)]  # fmt: skip
    groups = [some for one in near for some in np.array_split(one, len(one) // CHANGED + 1)]
    steps = steps_within(np.concatenate([share_of(splats.subset(some), world_from_file, motion) for some in groups]))
    indices, parts, more = [np.zeros(0, dtype=np.int64)], [none], [none]
    for index, asked in zip(groups, np.split(steps, np.cumsum([len(some) for some in groups])[:-1]), strict=True):
        here, bent = splats.subset(index), asked[:, 0] > 0
        whole, changed = bodily(here, world_from_file, motion)
        found = split(here.subset(bent), asked[bent])
        fine = [bodily(found.splats.subset(some), world_from_file, motion)[0] for some in at_a_time(len(found.owner))]
        fine_splats = joined_splats([none, *fine])
        indices.append(index[changed | bent])
        parts.append(replaced(whole, bent, fine_splats.subset(found.middle)).subset(changed | bent))
        more.append(fine_splats.subset(~found.middle))
    return CarriedSplats(np.concatenate(indices), joined_splats(parts), joined_splats(more))


def at_a_time(count: int) -> list[NDArray[np.int64]]:
    """Indices up to `count` in groups of CHANGED: gradients and harmonics take much memory."""
    return np.array_split(np.arange(count), count // CHANGED + 1)


def share_of(splats: Gaussians, world_from_file: Array, motion: SurfaceMotion) -> Array:
    """Required width of pieces along their Gaussian's larger two axes, over its own, to keep TOLERANCE, shape (n, 2).

    1: it may stay unchanged. No piece need be finer than the faces that it follows.
    """
    wide = np.argsort(-splats.log_scale, axis=1, kind="stable")[:, :2]
    rows = np.arange(len(splats))[:, None]
    scale = splats.scale[rows, wide].astype(np.float64)
    own = np.swapaxes(splats.axes, 1, 2)[rows, wide] * scale[:, :, None] @ world_from_file[:3, :3].T
    place = in_world(splats.position, world_from_file)
    ends = [place, *(place + sign * REACH * own[:, axis] for axis in range(2) for sign in (-1, 1))]
    some = np.max([np.linalg.norm(motion.at(end), axis=1) for end in ends], axis=0) > TOLERANCE
    bend = np.zeros((len(splats), 2))
    bend[some] = motion.bend(place[some], own[some])
    share = np.sqrt(TOLERANCE / np.maximum(bend, TOLERANCE))  # a bend grows with the square of the width
    share = np.maximum(share, 0.5 * motion.edge / np.maximum(np.linalg.norm(own, axis=2), 1e-12))
    share[splats.opacity < LEAST_SPLIT] = 1.0
    return np.asarray(np.minimum(share, 1.0))


def steps_within(share: Array) -> NDArray[np.int64]:
    """Steps of the grids that split Gaussians this finely (n, 2), 0 for those that stay whole; coarser ones if there
    would be more than MOST_PIECES."""
    while True:
        steps = np.array(STEPS)[np.minimum(np.searchsorted(STEPS, OVERLAP * REACH / share), len(STEPS) - 1)]
        steps[share.min(axis=1) == 1.0] = 0
        if (2 * steps + 1).prod(axis=1).sum() - len(steps) <= MOST_PIECES or (share == 1.0).all():
            return steps
        share = np.minimum(COARSER * share, 1.0)


def bodily(splats: Gaussians, world_from_file: Array, motion: SurfaceMotion) -> tuple[Gaussians, NDArray[np.bool_]]:
    """Each Gaussian moved and deformed as a whole, and the mask of those that this changes, shape (n,)."""
    linear = world_from_file[:3, :3]
    back, unit = np.linalg.inv(linear), float(np.cbrt(np.linalg.det(linear)))
    place = in_world(splats.position, world_from_file)
    width = unit * np.exp(splats.log_scale.astype(np.float64)).max(axis=1, initial=0.0)
    step = np.clip(width, motion.edge, max(motion.edge, STEP * motion.length))
    shift, gradient = motion.at(place), motion.gradient(place, step)
    strain = np.abs(gradient - np.eye(3)).max(axis=(1, 2), initial=0.0)
    changes = (np.linalg.norm(shift, axis=1) > NEGLIGIBLE) | (strain > LEAST_STRAIN)
    return strained(splats, back @ gradient @ linear, shift @ back.T), changes


def in_world(position: NDArray[np.floating], world_from_file: Array) -> Array:
    """Points of a file (n, 3) in the world [m]."""
    return np.asarray(position @ world_from_file[:3, :3].T + world_from_file[:3, 3])


def strained(splats: Gaussians, gradient: Array, shift: Array) -> Gaussians:
    """Each Gaussian moved by its displacement (n, 3) and deformed by its gradient F (n, 3, 3), all in its own frame.

    With the axes A and deviations s of a Gaussian, F A diag(s) = U diag(s') V^T has the covariance U diag(s'^2) U^T:
    the new axes and deviations, without squaring small ones. They keep the order of the given ones.
    """
    left, stretch, right = np.linalg.svd(gradient)
    stretch = np.clip(stretch, 1.0 / MOST_STRETCH, MOST_STRETCH)
    mirrored = np.linalg.det(left @ right) < 0.0
    left[mirrored, :, 2] *= -1.0
    turn = left @ right
    bounded = (left * stretch[:, None, :]) @ right
    deviation = np.exp(splats.log_scale.astype(np.float64))
    own = Rotation.from_quat(splats.rotation, scalar_first=True).as_matrix() if len(splats) else np.zeros((0, 3, 3))
    axes, size, _ = np.linalg.svd(bounded @ own * deviation[:, None, :])
    place = np.argsort(np.argsort(-deviation, axis=1, kind="stable"), axis=1)
    axes = np.take_along_axis(axes, place[:, None, :], axis=2)
    size = np.take_along_axis(size, place, axis=1)
    axes[np.linalg.det(axes) < 0.0, :, 0] *= -1.0
    quaternion = (
        Rotation.from_matrix(axes).as_quat(canonical=True, scalar_first=True) if len(splats) else np.zeros((0, 4))
    )
    return replace(
        splats,
        position=(splats.position + shift).astype(np.float32),
        log_scale=np.log(size).astype(np.float32),
        rotation=quaternion.astype(np.float32),
        rest=turned_harmonics(splats.rest, turn, splats.degree),
    )
