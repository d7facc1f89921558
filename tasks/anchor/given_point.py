"""Turns the user's point into the anchor's part, area and carrying faces.

In: scene, base and the point on its surface. Out: input of the search for a free spot, which stays near the point.
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
"""Height above the point from which its surface is searched [m]."""
BAND = (0.12, 0.1)
"""Distance below and above the point within which a surface carries [m]: dents and cushions, not the board above."""
NEAR = 0.05
"""Largest offset from the point if that is not free, or half the object's breadth if that is larger [m]."""
UP = np.array([0.0, 0.0, 1.0])
REPORTED_OFFSET = 0.02
"""Offset from the point above which it is reported [m]."""


def reply_at(scene: Segmentation, base: Instance, at: Array, caster: Raycaster) -> AnchorReply:
    """The part at the point; no client is asked."""
    hit = caster.cast((at + ABOVE * UP)[None], -UP[None])
    face = int(hit.face[0])
    own = face >= 0 and int(scene.face_instance[face]) == scene.index_of(base.id)
    index = max(int(scene.face_part[face]), 0) if own else 0
    return AnchorReply(part_index=index, reason="the given point")


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


def offset_note(at: Array | None, spot: Array) -> str:
    """Note on the object's offset from the point; empty if it is small."""
    away = 0.0 if at is None else float(np.linalg.norm(spot - at[:2]))
    return f"; {away:.2f} m from the point, which is not free" if away > REPORTED_OFFSET else ""
