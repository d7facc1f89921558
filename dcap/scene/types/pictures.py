"""Pictures of a placement and their cameras: for people, for judges, conditioning maps, COLMAP models.

A COLMAP model: pinhole cameras, the pictures taken with them, and points in space.

Camera axes: x to the right, y down, z forward. Poses are world to camera, as COLMAP stores them.
"""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from dcap.arrays import Array, ByteArray, Float32Array
from dcap.scene.errors import GeometryError
from dcap.scene.types.arrays import check_array

Picture = NDArray[np.uint8]
Numbers = NDArray[np.uint16]

SEEN_CONTACT, HIDDEN_CONTACT = 255, 128
"""Values of the contact map: visible patch, and patch hidden by the object."""


@dataclass(frozen=True, eq=False, slots=True)
class Visibility:
    """Visibility of the object at rest."""

    views: NDArray[np.float64]
    """For each view around the object: azimuth off the base's front and elevation [degrees], visible share of the
    silhouette and of its outline [-], shape (n, 4)."""
    from_the_room: float
    """Mean visible share of the surface that faces people standing around the object [-]."""


@dataclass(frozen=True, eq=False, slots=True)
class Renders:
    """RGB images of a placement, with visibility and camera."""

    clean: NDArray[np.uint8]
    """The scene before, (h, w, 3)."""
    settled: NDArray[np.uint8]
    """The scene with the object at rest, same camera, (h, w, 3)."""
    closeup: NDArray[np.uint8]
    """The object at rest from nearby, (h, w, 3)."""
    visible_fraction: float
    """Share of the object's pixels not hidden by the scene in the settled view, 0..1."""
    camera_position: NDArray[np.float64]
    camera_target: NDArray[np.float64]
    before_after: NDArray[np.uint8]
    """The place in close-up without the object, and next to it with the object at rest, (h, w, 3)."""
    contact: NDArray[np.uint8]
    """The dent and the contact patch with the object lifted away, and a legend, (h, w, 3)."""
    profile: NDArray[np.uint8]
    """A vertical cut through the contact, before and after, (h, w, 3)."""
    visibility: Visibility


@dataclass(frozen=True, eq=False, slots=True)
class Overview:
    """Pictures of an infeasible placement: the scene, and the object at its intended place if it is known."""

    clean: NDArray[np.uint8]
    """The scene, (h, w, 3)."""
    asked: NDArray[np.uint8] | None
    """The scene with the object at its pre-drop pose, same camera, (h, w, 3); None if no stage got that far."""
    candidates: NDArray[np.uint8] | None = None
    """All possible supports of the object, numbered and listed, (h, w, 3); None if a support was found."""
    hole: NDArray[np.uint8] | None = None
    """The object with the rims of its holes in red if its surface cannot be closed, (h, w, 3); else None."""


@dataclass(frozen=True, eq=False, slots=True)
class JudgedViews:
    """Square RGB images of one placement, each (h, w, 3)."""

    overview: Picture
    """The requested support and the object, from one camera for all methods of a sample."""
    closeup: Picture
    """The contact at a grazing angle, from the same direction and distance for all methods."""


@dataclass(frozen=True, eq=False, slots=True)
class SceneBefore:
    """Square RGB images shared by all methods of a sample, each (h, w, 3)."""

    clean: Picture
    """The scene before, as in `overview`."""
    asset: Picture
    """The object alone, in its input state."""


BEFORE = tuple(one.name for one in fields(SceneBefore))
"""Names of the pictures of the scene before and of the object alone."""
PLACED = tuple(one.name for one in fields(JudgedViews))
"""Names of the pictures of a placement, in the order in which judges and people see them."""


@dataclass(frozen=True, eq=False, slots=True)
class Sights:
    """Visibility of one placement from each possible direction of the cameras."""

    overview: Array
    """Share of the object's surface that the scene does not hide, by direction of the overview [-], shape (n,)."""
    closeup: Array
    """Share of the object's lower edge that is not hidden, by direction of the close-up [-], shape (m,)."""
    contact: Array
    """Contact point, or the point nearest to the surface below, as seen from each direction [m], shape (m, 3)."""
    bounds: Array
    """Bounds of the object [m], shape (2, 3)."""
    support: Array
    """Corners of the box of the requested support [m], shape (8, 3)."""
    ahead_deg: float
    """Azimuth from the requested support to the middle of the scene [degrees]."""


@dataclass(frozen=True, slots=True)
class Viewpoint:
    """A camera of a square picture, in plain numbers."""

    position: tuple[float, float, float]
    """Position [m]."""
    target: tuple[float, float, float]
    """Point in the middle of the picture [m]."""
    fov_deg: float
    """Field of view across the picture [degrees]."""


@dataclass(frozen=True, eq=False, slots=True)
class ConditioningMaps:
    """All passes of one view, with the same rays for each pixel; h rows, w columns."""

    rgb: ByteArray
    """sRGB with the object at rest, shape (h, w, 3)."""
    object_rgb: ByteArray
    """sRGB of the object's own share of each pixel, black elsewhere, shape (h, w, 3)."""
    depth: Float32Array
    """Depth along the optical axis [m], inf where nothing is, shape (h, w)."""
    normal_world: Float32Array
    """Unit shading normals towards the viewer, z up; zeros where nothing is, shape (h, w, 3)."""
    normal_camera: Float32Array
    """The same with x to the right, y down, z forward, shape (h, w, 3)."""
    object_mask: ByteArray
    """Share of each pixel that the object covers, 0..255, shape (h, w)."""
    hidden_mask: ByteArray
    """Share of each pixel in which something hides the object, 0..255, shape (h, w)."""
    contact: ByteArray
    """SEEN_CONTACT for surface in or next to the contact patch, HIDDEN_CONTACT where the object hides the patch, 0
    elsewhere, shape (h, w)."""
    shadow: Float32Array
    """Light on the scene with the object over light without it, luminance 0..1; on the object the value of the nearest
    pixel outside it, shape (h, w)."""
    ambient_occlusion: Float32Array
    """Share of the sky that reaches the surface, 0..1; 1 where nothing is, shape (h, w)."""
    dent: Float32Array
    """Displacement of the support along its outward normal, negative inwards; 0 elsewhere [m], shape (h, w)."""
    instance: Numbers
    """Instance ids, 0 where nothing is, shape (h, w)."""
    part: Numbers
    material: Numbers
    names: dict[str, dict[str, str]]
    """Names of the ids: `instance`, `part` and `material`, each a mapping from id to name."""


@dataclass(frozen=True, slots=True)
class Pinhole:
    """A camera without distortion (PINHOLE; SIMPLE_PINHOLE has the same focal length along both axes)."""

    id: int
    width: int
    """Width of the picture [pixel]."""
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
    """Name of the picture's file, with suffix."""
    camera_id: int
    quaternion: Array
    """Unit quaternion (w, x, y, z) that turns world directions into the camera's, shape (4,)."""
    translation: Array
    """Origin of the world in the camera's frame [m], shape (3,)."""

    def __post_init__(self) -> None:
        check_array(f"quaternion of image {self.id}", self.quaternion, 4)
        check_array(f"translation of image {self.id}", self.translation, 3)
        length = float(np.linalg.norm(self.quaternion))
        if abs(length - 1.0) > 1e-3:
            raise GeometryError(f"quaternion of image {self.id} has length {length:.4g}, expected 1")

    @property
    def camera_from_world(self) -> Array:
        """Rotation matrix, shape (3, 3)."""
        return np.asarray(Rotation.from_quat(self.quaternion, scalar_first=True).as_matrix())

    @property
    def position(self) -> Array:
        """Centre of projection in the world [m], shape (3,)."""
        return np.asarray(-self.camera_from_world.T @ self.translation)


@dataclass(frozen=True, eq=False, slots=True)
class ColmapModel:
    """Cameras, pictures and points, without observations and tracks."""

    cameras: tuple[Pinhole, ...]
    images: tuple[PosedImage, ...]
    points: Array
    """Positions of the points [m], shape (n, 3)."""
    colors: NDArray[np.uint8]
    """sRGB colours of the points, shape (n, 3)."""

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
        """The camera of a picture."""
        return next(camera for camera in self.cameras if camera.id == image.camera_id)


def posed(id_: int, name: str, camera_id: int, world_from_camera: Array, position: Array) -> PosedImage:
    """A picture, given the camera's axes in the world (columns, shape (3, 3)) and its centre of projection (3,)."""
    camera_from_world = world_from_camera.T
    quaternion = Rotation.from_matrix(camera_from_world).as_quat(canonical=True, scalar_first=True)
    return PosedImage(id_, name, camera_id, quaternion, -camera_from_world @ position)
