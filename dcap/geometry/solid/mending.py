"""A scanned thing made fit to carry: wound outwards, without scraps that float, its holes closed as seen from above.

In: the faces of one thing. Out: the same faces, less the scraps, turned where a scan has them inside out, and more
where what is seen from above was torn; what was done in numbers. Where nothing is wrong nothing changes.
"""

from dataclasses import dataclass, replace

import igl
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from dcap.arrays import Array, IntArray
from dcap.geometry.pieces import components, welded
from dcap.geometry.raycast import Raycaster
from dcap.geometry.solid.cleaning import cyclic_sense
from dcap.geometry.solid.height_map import MARGIN, HeightMap, TornHole, holes_closed, seen_from_above, spacing_within
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.segmentation import Segmentation

FINEST = 0.004  # distance of the looks from above, at least [m]
MOST_LOOKS = 250_000  # of them: over large things they are farther apart
MOST_SCRAP = 0.03  # m^2: a piece of more area is a thing of its own, be it torn off
SCRAP_SHARE = 0.05  # ... and so is one of more than this share of all area
APART = 0.015  # a scrap is at least this far from all else [m]: less is the gap of a seam, or scan noise
CELLS_APART = 2  # cells of half of that that points may be apart and still be near, between their middles
NEIGHBOURS = np.indices((2 * CELLS_APART + 1,) * 3).reshape(3, -1).T - CELLS_APART
NEIGHBOURS = NEIGHBOURS[(NEIGHBOURS**2).sum(axis=1) <= CELLS_APART**2]
STANDING = 0.02  # a piece that reaches down to the lowest of a thing but for this [m] is a foot
LEVEL = 0.8  # vertical component of the unit normal of what something can lie on
COMPARABLE = 0.1  # share of the largest area that looks up, or of all, that is as good as that
LONG = 0.25  # what is longer than this share of a thing is a piece of it
UPWARD = 0.3  # least share of its area by which a piece looks up or down: all of a sheet, a third of a square bar
WRONG_SIDE = 0.002  # share of the looks from above that meet the back of a face beyond which windings are not trusted
BACK = -0.1  # vertical component of a unit normal that looks down
ASKED = 12  # points of each patch from which both sides are looked out of
BROAD, AGREED = 0.05, 0.8  # share of a patch's area seen from above, and of the looks there that agree
UNSURE = 0.1  # share of the looks by which one side must win
LIFT = 1e-3  # where such a look begins, off the face [m]
WAYS = np.random.default_rng(5).standard_normal((24, 3))  # generic directions
WAYS /= np.linalg.norm(WAYS, axis=1, keepdims=True)


@dataclass(frozen=True, eq=False, slots=True)
class MendedSurface:
    """The faces of a thing, mended."""

    mesh: Mesh
    source: IntArray
    """The given face that each was, or the one nearest to where it was added, shape (m,)."""
    scraps: int
    """Pieces that floated and were left out."""
    scrap_area: float
    """Of them [m^2]."""
    turned: int
    """Faces that were wound inwards."""
    holes: tuple[TornHole, ...]
    """Holes that were closed."""

    @property
    def changed(self) -> bool:
        """Whether anything was done."""
        return bool(self.scraps or self.turned or self.holes)


def mended(mesh: Mesh, region: Array | None = None, *, turn: bool = True) -> MendedSurface:
    """The surface of a thing that may have been scanned badly, as it can carry something; one without area as it is.
    Holes are looked for within `region` (2, 2), a rectangle in plan [m], and as finely as its size allows; windings are
    left alone unless they shall `turn`: who only looks for a place has to know what is there, not its inside."""
    if not mesh.face_areas.sum() > 0.0:
        return MendedSurface(mesh, np.arange(len(mesh.faces)), 0, 0.0, 0, ())
    kept, scraps, area = without_floating(mesh)
    whole = mesh if scraps == 0 else mesh.submesh(kept)
    caster = Raycaster(whole)
    bounds = bounds_within(whole, region)
    seen = seen_from_above(caster, bounds, look_spacing(bounds))
    faces, turned = whole.faces, 0
    if turn and looks_at_backs(whole, seen):
        faces, turned = wound_outwards(whole, caster, seen)
    whole = Mesh(whole.vertices, faces, whole.colors)
    closed, holes = holes_closed(seen, caster, whole)
    made, near = patches(closed, holes, seen, whole)
    new = Mesh.concatenate([whole, made])
    return MendedSurface(new, np.concatenate([kept, kept[near]]), scraps, area, turned, tuple(holes))


def with_mended(
    scene: Segmentation, index: int, region: Array | None = None, *, turn: bool = True
) -> tuple[Segmentation, MendedSurface]:
    """A scene with one of its things mended, within `region` and with a `turn` as by `mended`, and what that took; the
    scene itself where that was nothing. What is mended comes last among the faces."""
    own = np.flatnonzero(scene.face_instance == index)
    surface = mended(scene.mesh.submesh(own), region, turn=turn)
    if not surface.changed:
        return scene, surface
    others = np.flatnonzero(scene.face_instance != index)
    source = np.concatenate([others, own[surface.source]])
    mesh = Mesh.concatenate([scene.mesh.submesh(others), surface.mesh])
    return replace(
        scene, mesh=mesh, face_instance=scene.face_instance[source], face_part=scene.face_part[source]
    ), surface  # fmt: skip


def bounds_within(mesh: Mesh, region: Array | None) -> Array:
    """The bounds of a mesh [m], shape (2, 3), in plan as far as they are in a region that they meet."""
    bounds = mesh.bounds.copy()
    if region is not None:
        low, high = np.maximum(bounds[0, :2], region[0]), np.minimum(bounds[1, :2], region[1])
        if (low < high).all():
            bounds[:, :2] = low, high
    return bounds


def look_spacing(bounds: Array) -> float:
    """Distance of the looks from above within bounds (2, 3) [m]."""
    return spacing_within(np.ptp(bounds[:, :2], axis=0), FINEST, MOST_LOOKS, MARGIN)


# scraps -------------------------------------------------------------------------------------------------------------


def without_floating(mesh: Mesh) -> tuple[IntArray, int, float]:
    """Faces that are no floating scraps, shape (k,), the number of scraps, and their area [m^2].

    A scrap is a small piece that hangs in the air, or lies inside of a thing, with nothing near: what lies on the thing
    touches it. What something could lie on is none: a slat, a shelf whose posts the scan lacks.
    """
    everything = np.arange(len(mesh.faces))
    piece = np.unique(components(mesh), return_inverse=True)[1].reshape(-1)
    count = int(piece.max(initial=0)) + 1
    if count == 1:
        return everything, 0, 0.0
    piece = near_as_one(mesh, piece, count)
    area = np.bincount(piece, weights=mesh.face_areas)
    total = float(area.sum())
    small = (area < MOST_SCRAP) & (area < SCRAP_SHARE * total)
    if not small.any() or small.all():
        return everything, 0, 0.0
    lowest = np.full(len(area), np.inf)
    np.minimum.at(lowest, piece, mesh.triangles[:, :, 2].min(axis=1))
    small &= (area > 0.0) & (lowest > mesh.bounds[0, 2] + STANDING)
    small &= ~could_carry(mesh, piece, small)
    gone = small[piece]
    return everything[~gone], int(small.sum()), float(area[small].sum())


def could_carry(mesh: Mesh, piece: IntArray, small: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Which pieces, given by the number of each face (m,) and whether a piece is `small` (n,), look up and have much of
    the largest area that does, reach along much of the thing, or lie level with much of what else does, shape (n,)."""
    count, area = len(small), mesh.face_areas
    normal = mesh.face_normals[:, 2] / np.maximum(np.linalg.norm(mesh.face_normals, axis=1), np.finfo(float).tiny)
    flat = np.abs(normal) > LEVEL  # windings are not known yet
    upper = np.where(flat, area, 0.0)
    own = np.bincount(piece, weights=upper, minlength=count)
    height = mesh.triangles[:, :, 2].mean(axis=1)
    level = np.bincount(piece, weights=upper * height, minlength=count) / np.maximum(own, np.finfo(float).tiny)
    low, high = np.full((count, 2), np.inf), np.full((count, 2), -np.inf)
    np.minimum.at(low, piece, mesh.triangles[:, :, :2].min(axis=1))
    np.maximum.at(high, piece, mesh.triangles[:, :, :2].max(axis=1))
    along = (high - low).max(axis=1) > LONG * float(np.ptp(mesh.bounds[:, :2], axis=0).max())
    carries = along | (own > COMPARABLE * own.max(initial=0.0))
    rest = upper * ~small[piece]
    order = np.argsort(height)
    heights, sums = height[order], np.concatenate([[0.0], np.cumsum(rest[order])])
    beside = sums[np.searchsorted(heights, level + STANDING)] - sums[np.searchsorted(heights, level - STANDING)]
    carries |= beside > COMPARABLE * max(float(rest.sum()), np.finfo(float).tiny)
    return np.asarray(carries & (own > UPWARD * np.bincount(piece, weights=area, minlength=count)))


def near_as_one(mesh: Mesh, piece: IntArray, count: int) -> IntArray:
    """Number of the group of each face (m,), pieces nearer to each other than APART in one group, shape (m,)."""
    corner = mesh.triangles
    points = np.concatenate([corner.reshape(-1, 3), corner.mean(axis=1)])
    owner = np.concatenate([np.repeat(piece, 3), piece])
    large = int(np.argmax(np.bincount(piece, weights=mesh.face_areas, minlength=count)))
    other = np.flatnonzero(owner != large)  # points of the largest piece are one group already
    # what touches the largest piece anywhere belongs to it, also where that has large faces
    body = Raycaster(mesh, np.flatnonzero(piece == large))
    near_body = other[body.distance_to(points[other]) < APART]
    # else pieces are near whose points fall into the same cells or into neighbouring ones
    place = np.floor(points / (0.5 * APART)).astype(np.int64)
    place -= place.min(axis=0) - CELLS_APART  # no way to a neighbour leads around an end of the numbering
    step = np.cumprod([1, *(place.max(axis=0) + 1 + CELLS_APART)[:2]])
    cells, cell = np.unique(place @ step, return_inverse=True)
    asked = np.unique(cell[other])
    wanted = cells[asked][:, None] + NEIGHBOURS @ step
    found = np.minimum(np.searchsorted(cells, wanted), len(cells) - 1)
    there, which = np.nonzero(cells[found] == wanted)
    rows = np.concatenate([owner, owner[near_body], asked[there] + count])
    columns = np.concatenate([cell + count, np.full(len(near_body), large), found[there, which] + count])
    size = count + len(cells)
    link = coo_matrix((np.ones(len(rows), dtype=np.int8), (rows, columns)), shape=(size, size))
    return np.asarray(connected_components(link, directed=False)[1][piece], dtype=np.int64)


# windings -----------------------------------------------------------------------------------------------------------


def looks_at_backs(mesh: Mesh, seen: HeightMap) -> bool:
    """Whether looks from above meet backs of faces: nothing is seen from its inside from there."""
    face = seen.face[seen.face >= 0]
    normal = mesh.face_normals[face]
    length = np.maximum(np.linalg.norm(normal, axis=1), np.finfo(float).tiny)
    return len(face) > 0 and float((normal[:, 2] < BACK * length).mean()) > WRONG_SIDE


def wound_outwards(mesh: Mesh, caster: Raycaster, seen: HeightMap | None) -> tuple[NDArray[np.int32], int]:
    """The faces with each patch wound so that more ways lead out of its front than out of its back, and how many were
    turned. What is `seen` from above looks up, as far as that is a good part of a patch and agrees; what is told
    neither way stays as most of it was."""
    if len(mesh.faces) == 0:
        return mesh.faces, 0
    place = welded(mesh.vertices)[mesh.faces]
    oriented, patch = igl.bfs_orient(np.ascontiguousarray(place, dtype=np.int64))
    patch = np.asarray(patch, dtype=np.int64).reshape(-1)
    relative = np.where(cyclic_sense(np.asarray(oriented)) == cyclic_sense(place), 1, -1)
    order = np.lexsort((np.random.default_rng(0).random(len(patch)), patch))
    rank = np.arange(len(order)) - np.searchsorted(patch[order], patch[order])
    asked = order[rank < ASKED]
    corner = mesh.corners(asked).mean(axis=1)
    normal = mesh.face_normals[asked]
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), np.finfo(float).tiny)
    outward = np.zeros(len(asked))
    for way in WAYS:
        ahead = np.sign(normal @ way)[:, None] * way
        outward += ~caster.occluded(corner + LIFT * normal, ahead)
        outward -= ~caster.occluded(corner - LIFT * normal, -ahead)
    count = int(patch.max()) + 1
    vote = np.bincount(patch[asked], weights=relative[asked] * outward, minlength=count)
    looks = np.bincount(patch[asked], minlength=count) * len(WAYS)
    own = np.bincount(patch, weights=relative * mesh.face_areas, minlength=count)
    sense = np.sign(np.where(np.abs(vote) > UNSURE * looks, vote, own))
    if seen is not None:
        face = seen.face[seen.face >= 0]
        up = np.bincount(patch[face], weights=relative[face] * np.sign(mesh.face_normals[face, 2]), minlength=count)
        met = np.bincount(patch[face], minlength=count)
        broad = met * seen.cell**2 > BROAD * np.bincount(patch, weights=mesh.face_areas, minlength=count)
        told = broad & (np.abs(up) >= AGREED * met) & (met > 0)
        sense[told] = np.sign(up[told])
    sense[sense == 0.0] = 1.0
    turn = relative != sense[patch]
    faces = mesh.faces.copy()
    faces[turn] = faces[turn][:, ::-1]
    return faces, int(turn.sum())


# holes --------------------------------------------------------------------------------------------------------------


def patches(closed: HeightMap, holes: list[TornHole], seen: HeightMap, mesh: Mesh) -> tuple[Mesh, IntArray]:
    """The faces that close holes, one sample over their rims, and the given face nearest to each: whose part it is."""
    mask = np.zeros(closed.height.shape, dtype=bool)
    for hole in holes:
        mask[hole.place] |= hole.mask
    around = binary_dilation(mask, np.ones((3, 3))) & np.isfinite(closed.height)
    corners = np.stack([around[:-1, :-1], around[1:, :-1], around[1:, 1:], around[:-1, 1:]])
    inside = np.stack([mask[:-1, :-1], mask[1:, :-1], mask[1:, 1:], mask[:-1, 1:]])
    square = np.argwhere(corners.all(axis=0) & inside.any(axis=0))
    number = np.full(closed.height.shape, -1)
    index = np.argwhere(around)
    number[tuple(index.T)] = np.arange(len(index))
    a, b, c, d = (number[tuple((square + step).T)] for step in ((0, 0), (1, 0), (1, 1), (0, 1)))
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    rim = np.argwhere(around & ~mask & (seen.face >= 0))
    if len(rim) == 0 or len(faces) == 0:
        return Mesh.of(np.zeros((0, 3)), np.zeros((0, 3))), np.zeros(0, dtype=np.int64)
    face = seen.face[tuple(rim.T)][cKDTree(rim).query(index)[1]]
    vertices = np.c_[closed.world(index), closed.height[tuple(index.T)]]
    made = Mesh(vertices, faces.astype(np.int32), mesh.colors[mesh.faces[face, 0]])
    return made, np.asarray(face[faces[:, 0]], dtype=np.int64)
