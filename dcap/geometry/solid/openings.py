"""Openings of a support that a repair has filled: a tub is no block.

An opening is a border that the open sky is seen from and other faces of the thing are seen through: something may be
put in there. A hole with nothing under it (a floor under a cupboard, the upper end of a leg) is none: nobody knows how
deep it would be.
"""

from collections.abc import Iterable

import numpy as np

from dcap.arrays import Array
from dcap.geometry.distance import MeshDistance
from dcap.geometry.pieces import hole_loops
from dcap.geometry.raycast import Raycaster
from dcap.geometry.solid.closing import cap, perimeter
from dcap.geometry.solid.soundness import LIFT, spread
from dcap.scene.types.mesh import Mesh

PLACES = 1000  # asked in each opening
UP = np.array([0.0, 0.0, 1.0])


def filled_opening(
    pieces: Iterable[Mesh],
    given: Mesh,
    solid: MeshDistance,
    *,
    longest: float,
    shallow: float,
    within: Array | None,
) -> float:
    """How long the longest border [m] of pieces is whose opening a solid fills; 0 if it fills none.

    Openings count whose border is longer than `longest` [m], which are filled more than `shallow` [m] above the first
    of the `given` faces below, over more plan than a circle of that border has. `within` [m], shape (2, 3), is the box
    whose places count; None: everywhere.
    """
    borders = [piece.vertices[loop] for piece in pieces for loop in hole_loops(piece)]
    long = sorted((b for b in borders if perimeter(b) > longest), key=perimeter, reverse=True)
    if not long:
        return 0.0
    caster = Raycaster(given)
    for border in long:
        plan = filled_plan(Mesh.of(border, cap(border)), caster, solid, shallow, within)
        if plan > longest**2 / (4.0 * np.pi):
            return perimeter(border)
    return 0.0


def filled_plan(lid: Mesh, caster: Raycaster, solid: MeshDistance, shallow: float, within: Array | None) -> float:
    """Area in plan of what lies under an opening's lid, is seen from above and is inside a solid [m^2]."""
    if not lid.face_areas.sum() > 0.0:
        return 0.0
    points, face = spread(lid, PLACES)
    plan = 0.5 * np.abs(np.cross(*np.diff(lid.triangles[face], axis=1).transpose(1, 0, 2))[:, 2])
    share = plan / lid.face_areas[face] * float(lid.face_areas.sum()) / PLACES
    up = np.broadcast_to(UP, points.shape)
    depth = caster.cast(points + LIFT * UP, -up).distance - LIFT
    opened = np.isfinite(depth) & (depth > shallow) & ~caster.occluded(points + LIFT * UP, up)
    if within is not None:
        bottom = points[:, 2] - np.where(opened, depth, 0.0)
        opened &= ((points >= within[0]) & (points <= within[1]))[:, :2].all(axis=1)
        opened &= (points[:, 2] >= within[0, 2]) & (bottom <= within[1, 2])
    asked = np.flatnonzero(opened)
    full = solid.inside(points[asked] - 0.5 * depth[asked, None] * UP)
    return float(share[asked[full]].sum())
