"""Which nodes of a soft body's background grid are free: masks of those held by a clamp, a cut, a support or a core.

Masks are of shape (kx, ky, kz), for node planes along x, y and z of kx, ky and kz nodes.
"""

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.distance import Distance
from dcap.scene.types.box import OrientedBox
from dcap.scene.types.particles import BackgroundGrid, NodeState
from tasks.bodies.soft_cells import Planes, nodes

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

OVERHANG = 0.05  # beyond a part's own box its bottom still holds [m]: scans show soft parts wider than they are


def grid_of(planes: Planes, *, held: Mask | None = None, core: Mask | None = None) -> BackgroundGrid:
    """A grid with the state of its nodes; the core wins over what is held."""
    state = np.full(tuple(len(p) for p in planes), NodeState.FREE, dtype=np.int8)
    for mask, value in ((held, NodeState.HELD), (core, NodeState.CORE)):
        if mask is not None:
            state[mask] = value
    return BackgroundGrid(*planes, state)


def spacing_at(planes: Array) -> Array:
    """Smaller of the two cells beside each node plane [m], shape (k,)."""
    gap = np.diff(planes)
    return np.asarray(np.minimum(np.append(gap, np.inf), np.insert(gap, 0, np.inf)))


def nodes_at_faces(planes: Planes, faces: Sequence[str], box: Array, rotation: Array, position: Array) -> Mask:
    """Nodes within half a cell, measured across the face, of faces (`x_min` ... `z_max`) of a box (2, 3) that stands
    turned by `rotation` at `position`."""
    local = (node_positions(planes) - position) @ rotation
    size = np.stack(np.meshgrid(*(spacing_at(p) for p in planes), indexing="ij"), axis=-1)
    mask = np.zeros(local.shape[:3], dtype=bool)
    for face in faces:
        axis, side = "xyz".index(face[0]), 0 if face.endswith("min") else 1
        across = size @ np.abs(rotation[:, axis])
        mask |= np.abs(local[..., axis] - box[side][axis]) <= 0.5 * across
    return mask


def nodes_at_cuts(planes: Planes, cut: Mask) -> Mask:
    """Nodes of the grid's own sides (2, 2) = (low/high, x/y) that are cuts through the material."""
    mask = np.zeros(tuple(len(p) for p in planes), dtype=bool)
    for axis in range(2):
        for side, end in ((0, 0), (1, -1)):
            if cut[side, axis]:
                np.moveaxis(mask, axis, 0)[end] = True
    return mask


def nodes_at_bottoms(planes: Planes, bottoms: Iterable[tuple[float, Sequence[OrientedBox]]]) -> Mask:
    """Nodes within half a cell of each height [m] and over one of its boxes."""
    point = node_positions(planes)
    tolerance = 0.5 * spacing_at(planes[2])
    mask = np.zeros(point.shape[:3], dtype=bool)
    for height, boxes in bottoms:
        for k in np.flatnonzero(np.abs(planes[2] - height) <= tolerance):
            plan = point[:, :, k].reshape(-1, 3)
            over = np.zeros(len(plan), dtype=bool)
            for box in boxes:
                over |= (np.abs(box.to_local(plan))[:, :2] <= box.half_extents[:2] + OVERHANG).all(axis=1)
            mask[:, :, k] |= over.reshape(mask.shape[:2])
    return mask


def nodes_within(planes: Planes, solid: Distance, distance: float) -> Mask:
    """Nodes in a solid or at most `distance` [m] from it."""
    return np.asarray(solid(nodes(planes)) <= distance).reshape([len(p) for p in planes])


def node_positions(planes: Planes) -> Array:
    """[m], shape (kx, ky, kz, 3)."""
    return nodes(planes).reshape(*(len(p) for p in planes), 3)
