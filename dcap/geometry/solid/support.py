"""The solid of a support whose surface was seen from above only.

A scan shows a mattress from above and from the sides, never from below. Its solid is what lies under the visible
surface, down to the bottom of its part's box; a part that is closed keeps its own shape. In: faces with a bottom
height each. Out: a signed distance whose sign is that of the solid and whose zero is the visible surface, its walls
and its bottom.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.distance import MeshDistance
from dcap.geometry.pieces import components
from dcap.geometry.raycast import Raycaster
from dcap.geometry.solid.closed import RepairLimits, enclosed, tidied, used_as_given, with_faces_kept
from dcap.geometry.solid.repair import outer_faces, small_holes_capped, solid_under, subdivide_near, without_empty_faces
from dcap.geometry.solid.repair_log import RepairLog
from dcap.scene.types.boxes import OrientedBox
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.scan import RepairReport

COVERED = 0.5  # share of a part's plan that must lie over another part for it to be the one that carries it
PIECE = 0.05  # longest edge [m] of walls and shadows: each piece is kept or dropped as a whole where solids overlap
CARRIES = 0.1  # vertical component of the unit normal of a face that carries what lies on it
LOOKS_BELOW = (0.25, 0.5, 0.75, 1.0)  # of a depth: where the solid under a face is looked for
NEAR_CORNER = 0.9  # of the way from a face's middle to its corners: it is looked for there too
TOUCHING = 0.06  # gap [m] up to which boxes of parts count as lying on each other: boxes of noisy parts are loose


def support_solid(
    mesh: Mesh, bottom: NDArray[np.float64], region: NDArray[np.float64], hole_perimeter: float
) -> MeshDistance:
    """Signed distance to the solid under the faces, each down to its own `bottom` [m], shape (m,).

    It is accurate within `region` [m], shape (2, 3), horizontally. Holes of at most `hole_perimeter` [m] are closed
    first, so that a crack in a scan is no shaft.
    """
    return ready_support(mesh, bottom, region, hole_perimeter)[0]


def ready_support(
    mesh: Mesh, bottom: NDArray[np.float64], region: NDArray[np.float64], hole_perimeter: float
) -> tuple[MeshDistance, RepairReport]:
    """`support_solid` and what it took; only what can be seen within `region` counts, also in height.

    The distance is that to the faces with their walls and shadows while those hide nothing that can be seen. Else it is
    that to one clean closed surface, or to the faces with their holes capped, whichever is better; but where capping
    would fill an opening that is seen from above and longer around than `hole_perimeter`, the first is kept, and its
    report tells what is off.
    """
    field = under_faces(mesh, bottom, region, hole_perimeter)
    log = RepairLog()
    given = tidied(mesh, bottom, log, region)
    as_given = used_as_given(field, given, RepairLimits(), log.copy())
    if field.closed and not as_given.problem:
        return field, as_given
    allowed = RepairLimits(opening=hole_perimeter)
    filled = enclosed(given, allowed)
    if given.filled(filled, allowed):
        return field, as_given
    found = with_faces_kept(given, filled, allowed, log)
    if found is not None and not found[1].problem:
        return MeshDistance(found[0]), found[1]
    # with holes capped instead of continued downwards more of it may be there
    capped = used_as_given(filled, given, allowed, log)
    better = capped.agreement >= as_given.agreement and capped.hausdorff < as_given.hausdorff
    return (filled, capped) if better else (field, as_given)


def under_faces(
    mesh: Mesh, bottom: NDArray[np.float64], region: NDArray[np.float64], hole_perimeter: float
) -> MeshDistance:
    """Distance to everything under the faces, told by winding number."""
    groups = [
        without_empty_faces(small_holes_capped(mesh.submesh(np.flatnonzero(bottom == b)), hole_perimeter))
        for b in np.unique(bottom)
    ]
    heights = np.repeat(np.unique(bottom), [len(g.faces) for g in groups])
    closed = upright(solid_under(Mesh.concatenate(groups), heights))
    column = region.copy()
    column[:, 2] = -np.inf, np.inf
    closed = subdivide_near(closed, column, PIECE)
    hull = outer_faces(closed)
    return MeshDistance(closed.submesh(hull) if len(hull) else mesh, sides=closed)


def upright(mesh: Mesh) -> Mesh:
    """The mesh, turned inside out if its faces were wound the wrong way round."""
    center = mesh.bounds.mean(axis=0)
    a, b, c = (mesh.triangles - center).transpose(1, 0, 2)
    enclosed = float(np.einsum("ij,ij->", a, np.cross(b, c)))
    return mesh if enclosed >= 0.0 else Mesh(mesh.vertices, mesh.faces[:, ::-1].copy(), mesh.colors)


def shell_bottoms(mesh: Mesh, part_bottom: NDArray[np.float64], depth: float) -> NDArray[np.float64]:
    """Bottom of the solid under each face of rigid parts [m], shape (m,).

    Down to the bottom of the face's part, but at most `depth` [m] below its connected piece, and a sheet without
    thickness is `depth` thick: a shelf's board seen from above is a board, neither a block nor nothing. Closed pieces
    are not changed by it.
    """
    piece = components(mesh)
    lowest, highest = mesh.triangles[:, :, 2].min(axis=1), mesh.triangles[:, :, 2].max(axis=1)
    piece_low = np.full(int(piece.max(initial=0)) + 1, np.inf)
    np.minimum.at(piece_low, piece, lowest)
    bottom = np.maximum(part_bottom, piece_low[piece] - depth)
    _, group = np.unique(np.stack([piece, part_bottom]), axis=1, return_inverse=True)
    group = group.reshape(-1)
    low, high = np.full(group.max(initial=0) + 1, np.inf), np.full(group.max(initial=0) + 1, -np.inf)
    np.minimum.at(low, group, lowest)
    np.maximum.at(high, group, highest)
    return np.where(high[group] - bottom < depth, low[group] - depth, bottom)


def under_thin_faces(solid: MeshDistance, item: Mesh, region: NDArray[np.float64], depth: float) -> MeshDistance | None:
    """Solid to add so that `solid` is `depth` [m] deep under what looks up in a region (2, 3) [m]; None where it is.

    Samples that are farther apart than the two sides of a board see neither. An `item` comes to rest from above, so a
    board that is too thin for them is taken as deep as they need: its upper side stays where it is. What the item
    already lies under stays as thin as it is.
    """
    fine = subdivide_near(solid.mesh, region, PIECE)
    corner, normal = fine.triangles, fine.face_normals
    near = ((corner.max(axis=1) >= region[0]) & (corner.min(axis=1) <= region[1])).all(axis=1)
    up = np.flatnonzero(near & (normal[:, 2] > CARRIES * np.linalg.norm(normal, axis=1)))
    middle = corner[up].mean(axis=1, keepdims=True)
    looks = np.concatenate([middle, middle + NEAR_CORNER * (corner[up] - middle)], axis=1)
    deeper = looks[:, :, None] - depth * np.array(LOOKS_BELOW)[:, None] * np.array([0.0, 0.0, 1.0])
    thick = solid.inside(deeper.reshape(-1, 3)).reshape(len(up), math.prod(deeper.shape[1:3])).all(axis=1)
    if thick.all():
        return None
    thin = fine.submesh(up[~thick])
    piece = components(thin)
    lowest = np.full(int(piece.max()) + 1, np.inf)
    np.minimum.at(lowest, piece, thin.triangles[:, :, 2].min(axis=1))
    bottom = lowest[piece] - depth
    below = subdivide_near(item, item.bounds, 0.5 * PIECE).vertices  # some under every piece that is over the item
    over = Raycaster(thin).cast(below, np.broadcast_to([0.0, 0.0, 1.0], below.shape)).face
    covers = over[(over >= 0) & (below[:, 2] > bottom[over])]
    free = np.setdiff1d(np.arange(len(thin.faces)), covers)
    return under_faces(thin.submesh(free), bottom[free], region, 0.0) if len(free) else None


def carried_bottoms(boxes: Sequence[OrientedBox]) -> NDArray[np.float64]:
    """Bottom of the material under each part [m]: its own, or that of the part that carries it, shape (n,).

    What lies under a pillow on a mattress is mattress, although no face says so.
    """
    own = np.array([b.bottom for b in boxes])
    bottom = own.copy()
    for _ in boxes:  # a chain of parts on parts is at most as long as their number
        previous = bottom.copy()
        for upper, box in enumerate(boxes):
            plan = plan_samples(box)
            for lower, other in enumerate(boxes):
                below = own[lower] < own[upper] and other.top > own[upper] - TOUCHING
                if upper != lower and below and over(plan, other) > COVERED:
                    bottom[upper] = min(bottom[upper], previous[lower])
    return bottom


def plan_samples(box: OrientedBox) -> NDArray[np.float64]:
    """A grid of points over a box's plan [m], shape (49, 3)."""
    side = np.linspace(-0.9, 0.9, 7)
    grid = np.stack(np.meshgrid(side, side, [0.0], indexing="ij"), axis=-1).reshape(-1, 3)
    return box.to_world(grid * box.half_extents)


def over(points: NDArray[np.float64], box: OrientedBox) -> float:
    """Share of points that lie over or in a box as seen from above."""
    local = np.abs(box.to_local(points))[:, :2]
    return float((local <= box.half_extents[:2]).all(axis=1).mean())
