"""Faces that the rays of a picture may meet: those in the camera's view, and those that may shade them.

In: a mesh, a camera and its key light. Out: faces. It is a bound: a face left out is met by no ray of the picture, one
that is kept may be met by none. So the acceleration structure holds a part of a room only, and is built sooner.
"""

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.camera import Camera
from dcap.scene.types.mesh import Mesh

Array = NDArray[np.float64]

LIGHT_RADIUS = 0.10  # tangent of the key light's angular radius: a window-sized source
# shadows are cast from at most this share of the camera's distance: far walls and ceilings let light in
KEY_REACH, SKY_REACH = 0.9, 0.5
SLACK = 0.01  # over the camera's distance: more than rounding and the starts of rays off a surface


def in_view(mesh: Mesh, camera: Camera, key: Array, reach: float) -> NDArray[np.bool_]:
    """Faces of a mesh that rays of a picture may meet, shape (m,).

    Args:
        mesh: what is looked at.
        camera: where from.
        key: unit vector to the key light, shape (3,).
        reach: the camera's distance from its target [m].
    """
    normal = inward_normals(camera)
    # rays to the lights begin at what the camera sees, and end this far outside of a side of the view at most
    outward = np.maximum(KEY_REACH * (LIGHT_RADIUS - normal @ key), SKY_REACH)
    outside = (mesh.vertices - camera.position) @ normal.T < -(outward + SLACK) * reach
    sides = outside @ (1 << np.arange(len(normal))).astype(np.uint8)
    a, b, c = sides[mesh.faces].T
    return np.asarray((a & b & c) == 0)


def inward_normals(camera: Camera) -> Array:
    """Unit normals of the five planes through the camera that bound its view: left, right, top, bottom, and the one
    behind which nothing is seen; shape (5, 3)."""
    low, high = (
        -camera.principal / camera.focals,
        (np.array([camera.width, camera.height]) - camera.principal) / camera.focals,
    )
    local = np.array(
        [[1.0, 0.0, -low[0]], [-1.0, 0.0, high[0]], [0.0, 1.0, -low[1]], [0.0, -1.0, high[1]], [0.0, 0.0, 1.0]]
    )
    return np.asarray(local / np.linalg.norm(local, axis=1, keepdims=True) @ camera.world_from_camera.T)
