"""A point that the user gave, as the anchor's part, area and carrying faces.

In: scene, base and the point on its surface. Out: what the search for a free spot needs; it stays near the point.
"""

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.placement.named_regions import Region
from dcap.geometry.raycast import Raycaster
from dcap.language.protocol.replies import AnchorReply
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.segmentation import Instance, Segmentation

Array = NDArray[np.float64]

ABOVE = 0.02
"""The surface at the point is looked for from this high above it [m]."""
BAND = (0.12, 0.1)
"""How far below and above the point a surface still carries [m]: dents and cushions, not the board above."""
NEAR = 0.05
"""The object may go this far beside the point where that is not free, or half its breadth if that is more [m]."""
UP = np.array([0.0, 0.0, 1.0])
BESIDE = 0.02
"""Farther from the point than this is told [m]."""


def reply_at(scene: Segmentation, base: Instance, at: Array, caster: Raycaster) -> AnchorReply:
    """The part at the point; no client is asked."""
    hit = caster.cast((at + ABOVE * UP)[None], -UP[None])
    face = int(hit.face[0])
    own = face >= 0 and int(scene.face_instance[face]) == scene.index_of(base.id)
    index = max(int(scene.face_part[face]), 0) if own else 0
    return AnchorReply(part_index=index, reason="the point that was given")


def area_at(at: Array, mesh: Mesh) -> Region:
    """A square about the point, aimed at its middle; `mesh` is the object as it will lie."""
    half = max(NEAR, 0.25 * float(np.ptp(mesh.bounds[:, :2], axis=0).sum()))
    ring = np.array([[-half, -half], [half, -half], [half, half], [-half, half]])
    return Region(at[:2] + ring, at[:2].copy(), "at the point")


def carrying_at(scene: Segmentation, base: Instance, at: Array) -> NDArray[np.bool_]:
    """The faces of the base about as high as the point, shape (faces,)."""
    height = scene.mesh.triangles[:, :, 2]
    level = (height.max(axis=1) > at[2] - BAND[0]) & (height.min(axis=1) < at[2] + BAND[1])
    return np.asarray(level & (scene.face_instance == scene.index_of(base.id)))


def beside_the_point(at: Array | None, spot: Array) -> str:
    """How far from the point the object goes, where that is worth a word."""
    away = 0.0 if at is None else float(np.linalg.norm(spot - at[:2]))
    return f"; {away:.2f} m beside the point, which is not free" if away > BESIDE else ""
