"""Faces that a picture needs: without walls in front, in the camera's view, or shading faces in it.

In: a mesh, a camera and its key light. Out: faces. It is a bound: no ray of the picture meets a face that is left out,
but faces that are kept may not be met either. The acceleration structure then contains only a part of a room, and is
built faster.

Walls and ceilings between a camera and its target: the faces to leave out of the picture.

A face of the structure is cut if its plane separates the camera from the target, and a ceiling always. Scans are noisy,
so planes are first snapped to the room's own axes: a wall is cut or kept as a whole.
"""

import numpy as np
from numpy.typing import NDArray

from dcap.arrays import Array
from dcap.geometry.camera import Camera
from dcap.scene.types.mesh import Mesh

LIGHT_RADIUS = 0.10  # tangent of the key light's angular radius: a window-sized source
# shadows are cast by surfaces within this share of the camera's distance: far walls and ceilings let light in
KEY_REACH, SKY_REACH = 0.9, 0.5
RAY_SLACK = 0.01  # over the camera's distance: more than rounding and the offset of rays from a surface
LEVEL_COS = 0.7  # a face whose normal is within 45 degrees of the vertical is floor or ceiling
OVERHEAD = 0.8  # level structure higher than this [m] above the target is ceiling: always open to let light in
PLANE_SLACK = 0.02  # a plane nearer than this [m] to the target does not hide it


def in_view(mesh: Mesh, camera: Camera, key: Array, reach: float) -> NDArray[np.bool_]:
    """Mask of the faces of a mesh that rays of a picture may meet, shape (m,).

    Args:
        mesh: what is looked at.
        camera: where from.
        key: unit vector to the key light, shape (3,).
        reach: the camera's distance from its target [m].
    """
    normal = inward_normals(camera)
    # rays to the lights begin at visible surfaces, and end at most this far outside a side of the view
    outward = np.maximum(KEY_REACH * (LIGHT_RADIUS - normal @ key), SKY_REACH)
    outside = (mesh.vertices - camera.position) @ normal.T < -(outward + RAY_SLACK) * reach
    sides = outside @ (1 << np.arange(len(normal))).astype(np.uint8)
    a, b, c = sides[mesh.faces].T
    return np.asarray((a & b & c) == 0)


def inward_normals(camera: Camera) -> Array:
    """Unit normals of the five planes through the camera that bound its view: left, right, top, bottom, and the plane
    behind which nothing is visible; shape (5, 3)."""
    low, high = (
        -camera.principal / camera.focals,
        (np.array([camera.width, camera.height]) - camera.principal) / camera.focals,
    )
    local = np.array(
        [[1.0, 0.0, -low[0]], [-1.0, 0.0, high[0]], [0.0, 1.0, -low[1]], [0.0, -1.0, high[1]], [0.0, 0.0, 1.0]]
    )
    return np.asarray(local / np.linalg.norm(local, axis=1, keepdims=True) @ camera.world_from_camera.T)


def cut_faces(
    mesh: Mesh, structure: NDArray[np.bool_], camera: NDArray[np.float64], target: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Mask of the structure's faces (given as a mask) whose plane separates the camera from the target, shape (m,)."""
    return StructurePlanes(mesh, structure).between(camera, target)


class StructurePlanes:
    """The planes of walls, floor and ceiling, for any number of cameras."""

    def __init__(self, mesh: Mesh, structure: NDArray[np.bool_]) -> None:
        """Prepare the planes of those faces of a mesh that are structure, a mask (m,)."""
        self._structure = structure
        a, b, c = mesh.corners(np.flatnonzero(structure)).transpose(1, 0, 2)
        self._normal = snapped(np.cross(b - a, c - a))
        self._center = (a + b + c) / 3.0
        self._offset = np.einsum("ij,ij->i", self._normal, self._center)

    def between(self, camera: NDArray[np.float64], target: NDArray[np.float64]) -> NDArray[np.bool_]:
        """The same as `cut_faces`."""
        side = self._normal @ target - self._offset
        other = self._normal @ camera - self._offset
        ceiling = (np.abs(self._normal[:, 2]) > LEVEL_COS) & (self._center[:, 2] > target[2] + OVERHEAD)
        cut = np.zeros(len(self._structure), dtype=bool)
        cut[self._structure] = ((np.abs(side) > PLANE_SLACK) & (side * other < 0.0)) | ceiling
        return cut


def snapped(normal: NDArray[np.float64]) -> NDArray[np.float64]:
    """Area normals (n, 3) as unit vectors along the nearest of the room's axes, shape (n, 3)."""
    area = np.linalg.norm(normal, axis=1)
    unit = normal / np.maximum(area, 1e-30)[:, None]
    upright = np.abs(unit[:, 2]) < LEVEL_COS
    axis = room_axis(unit[upright], area[upright])
    frame = np.stack([axis, np.array([-axis[1], axis[0], 0.0]), np.array([0.0, 0.0, 1.0])])
    share = unit @ frame.T
    share[~upright, :2] = 0.0
    share[upright, 2] = 0.0
    return np.asarray(frame[np.argmax(np.abs(share), axis=1)])


def room_axis(unit: NDArray[np.float64], area: NDArray[np.float64]) -> NDArray[np.float64]:
    """The horizontal direction that most wall area faces, modulo quarter turns, unit vector (3,)."""
    if len(unit) == 0:
        return np.array([1.0, 0.0, 0.0])
    angle = np.arctan2(unit[:, 1], unit[:, 0])
    # quarter turns coincide in the fourfold angle
    mean = np.angle(np.sum(area * np.exp(4j * angle))) / 4.0
    return np.array([np.cos(mean), np.sin(mean), 0.0])
