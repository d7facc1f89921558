"""Axes by which a shape lies or stands on end, told by its extents alone.

In: a mesh. Out: the axes of the box about it, its thinnest side first looked for, and the axis by which one tells
whether it stands on end, lies, or has no end to stand on.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from dcap.geometry.placement.polygons import smallest_rectangle
from dcap.scene.types.mesh import Mesh

Array = NDArray[np.float64]

LOW = 0.75
"""An extent shorter than this times the next longer one is clearly the shorter [-]."""
BLOCK = 256
"""Directions that are measured at once: a scan's hull has thousands [-]."""


def own_box(mesh: Mesh) -> tuple[Array, Array]:
    """Axes as rows (3, 3), unit, and extents (3,) [m] of the box about a mesh, the longest first.

    Its thinnest side lies on a face of the hull, the others are those of the smallest rectangle about what is seen
    along it. Flat and straight meshes have boxes too.
    """
    points = np.unique(mesh.vertices[np.unique(mesh.faces)], axis=0)
    thin = thinnest(points)
    across = np.cross(thin, np.eye(3)[int(np.argmin(np.abs(thin)))])
    frame = np.stack([across / np.linalg.norm(across), np.cross(thin, across / np.linalg.norm(across))])
    long, size = smallest_rectangle(points @ frame.T)
    first = long @ frame
    axes = np.stack([first, np.cross(thin, first), thin])
    extents = np.array([*size, np.ptp(points @ thin)])
    order = np.argsort(-extents, kind="stable")
    return axes[order], extents[order]


def thinnest(points: Array) -> Array:
    """Normal of the face of the hull across which points (n, 3) are thinnest, unit, shape (3,)."""
    try:
        hull = ConvexHull(points)
    except (QhullError, ValueError):  # flat: the normal of its plane
        return np.asarray(np.linalg.svd(points - points.mean(axis=0))[2][-1])
    normals = np.unique(np.round(hull.equations[:, :3], 9), axis=0)
    outer = points[hull.vertices]
    blocks = np.array_split(normals, len(normals) // BLOCK + 1)
    widths = np.concatenate([np.ptp(block @ outer.T, axis=1) for block in blocks])
    best = normals[int(np.argmin(widths))]
    return np.asarray(best / np.linalg.norm(best))


def end_axis(mesh: Mesh, *, on_edge: bool) -> tuple[Array, float] | None:
    """The axis by which one tells whether it stands on end, and its angle from the vertical when it does [rad]; None
    where the shape has no end.

    Of something long that is the long axis, which is vertical; of something flat the thin one, which is level. Of what
    is both, `on_edge` says whether standing on any edge is enough.
    """
    axes, size = own_box(mesh)
    flat = (axes[2], 0.5 * np.pi) if size[2] < LOW * size[1] else None
    long = (axes[0], 0.0) if size[1] < LOW * size[0] else None
    return flat or long if on_edge else long or flat
