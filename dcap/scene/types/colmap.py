"""A COLMAP model: pinhole cameras, the pictures taken with them, and points in space.

Camera axes: x to the right, y down, z forward. Poses are world to camera, as COLMAP stores them.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from dcap.scene.errors import GeometryError
from dcap.scene.types.arrays import check_array

F64 = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Pinhole:
    """A camera without distortion (PINHOLE; SIMPLE_PINHOLE has the same focal length along both axes)."""

    id: int
    width: int
    """[pixel]."""
    height: int
    focal: tuple[float, float]
    """Focal lengths along x and y [pixel]."""
    center: tuple[float, float]
    """Principal point [pixel]; (0, 0) is the upper left corner of the picture."""

    def __post_init__(self) -> None:
        if self.width < 1 or self.height < 1:
            raise GeometryError(f"camera {self.id} has {self.width} x {self.height} pixels")
        if not np.isfinite([*self.focal, *self.center]).all() or min(self.focal) <= 0.0:
            raise GeometryError(f"camera {self.id} has focal lengths {self.focal} and principal point {self.center}")


@dataclass(frozen=True, eq=False, slots=True)
class PosedImage:
    """A picture with the pose of its camera."""

    id: int
    name: str
    """Name of its file, with suffix."""
    camera_id: int
    quaternion: F64
    """(w, x, y, z) of unit length that turns world directions into the camera's, shape (4,)."""
    translation: F64
    """The world's origin in the camera's frame [m], shape (3,)."""

    def __post_init__(self) -> None:
        check_array(f"quaternion of image {self.id}", self.quaternion, 4)
        check_array(f"translation of image {self.id}", self.translation, 3)
        length = float(np.linalg.norm(self.quaternion))
        if abs(length - 1.0) > 1e-3:
            raise GeometryError(f"quaternion of image {self.id} has length {length:.4g}, expected 1")

    @property
    def camera_from_world(self) -> F64:
        """Rotation matrix, shape (3, 3)."""
        return np.asarray(Rotation.from_quat(self.quaternion, scalar_first=True).as_matrix())

    @property
    def position(self) -> F64:
        """Centre of projection in the world [m], shape (3,)."""
        return np.asarray(-self.camera_from_world.T @ self.translation)


@dataclass(frozen=True, eq=False, slots=True)
class ColmapModel:
    """Cameras, pictures and points, without observations and tracks."""

    cameras: tuple[Pinhole, ...]
    images: tuple[PosedImage, ...]
    points: F64
    """[m], shape (n, 3)."""
    colors: NDArray[np.uint8]
    """sRGB, shape (n, 3)."""

    def __post_init__(self) -> None:
        check_array("points of a COLMAP model", self.points, None, 3)
        check_array("colours of a COLMAP model", self.colors, len(self.points), 3)
        known = {camera.id for camera in self.cameras}
        if len(known) < len(self.cameras):
            raise GeometryError("two cameras of a COLMAP model have the same id")
        for image in self.images:
            if image.camera_id not in known:
                raise GeometryError(f"image {image.id} names camera {image.camera_id}, which is not there")

    def camera_of(self, image: PosedImage) -> Pinhole:
        """The camera that a picture was taken with."""
        return next(camera for camera in self.cameras if camera.id == image.camera_id)


def posed(id_: int, name: str, camera_id: int, world_from_camera: F64, position: F64) -> PosedImage:
    """A picture by the camera's axes in the world (columns, shape (3, 3)) and its centre of projection (3,)."""
    camera_from_world = world_from_camera.T
    quaternion = Rotation.from_matrix(camera_from_world).as_quat(canonical=True, scalar_first=True)
    return PosedImage(id_, name, camera_id, quaternion, -camera_from_world @ position)
