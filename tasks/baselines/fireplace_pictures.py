"""Pictures of options for batched visual selection: a thing, a surface, a placement; made on demand.

In: the scene and an option. Out: sRGB pictures of shape (size, size, 3) in which the option is painted in a bright
colour; a placement shows the object in its own colours. Walls and ceilings are left out.
"""

import numpy as np
from numpy.typing import NDArray

from dcap.evaluation.baselines.fireplace.planar import InteractionSurface
from dcap.geometry.camera import Camera, looking_at
from dcap.geometry.placement.named_regions import ViewerFrame
from dcap.geometry.rendering.picture import picture
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.segmentation import Segmentation
from tasks.requests.pictures import LOUD, TINT

Array = NDArray[np.float64]
LIFT = 0.004
"""Distance in front of its surface at which a painted outline is drawn [m]."""
CLOSEST = 0.6
"""Least distance of the camera [m]."""
DISTANCE = 1.35
"""Distance of the camera over the diagonal of its target [-]."""
NEARER = 1.1
"""Distance of the camera over the diagonal of a thing alone [-]."""
LARGE = 4.0
"""Largest length of a thing that is shown as a whole [m]."""
STEEP = 1.3
"""Factor of the camera's height for an upward surface, to look into a tub [-]."""
AROUND = 2.2
"""Distance of the camera to a placement over the object's diagonal: the surroundings belong to the picture [-]."""
WAY = (0.85, 0.4, 0.65)
"""Direction from the target to the camera: parts towards the viewer, to his right and up [-]."""


def thing_picture(scene: Segmentation, index: int, frame: ViewerFrame, size: int) -> NDArray[np.uint8]:
    """One instance in a bright colour in its surroundings."""
    box = scene.instances[index].box
    mine = np.flatnonzero(scene.face_instance == index)
    camera = view(box.center, max(2.5, DISTANCE * box.diagonal), frame, size)
    others = open_room(scene, skipped=index)
    return picture([others, loud(scene.mesh.submesh(mine))], camera, samples=1, shadows=False).rgb


def surface_picture(
    scene: Segmentation, index: int, surface: InteractionSurface, frame: ViewerFrame, size: int
) -> NDArray[np.uint8]:  # fmt: skip
    """One surface of an instance: its own faces painted, a side of a box as a sheet before it."""
    whole = scene.instance_mesh(index)
    low, high = whole.bounds
    middle, reach = 0.5 * (low + high), float(np.linalg.norm(high - low))
    # the camera looks at a floor near the surface, at a thing as a whole
    target = surface.center if reach > LARGE else 0.5 * (middle + surface.center)
    camera = view(target, max(CLOSEST, NEARER * min(reach, LARGE)), frame, size, surface.normal)
    painted = outline_mesh(surface)
    if len(surface.faces):
        painted = loud(scene.mesh.submesh(surface.faces))
        rest = scene.face_instance == index
        rest[surface.faces] = False
        whole = scene.mesh.submesh(np.flatnonzero(rest))
    return picture([whole, painted], camera, samples=1, shadows=False).rgb


def placement_picture(
    scene: Segmentation, item: Mesh, frame: ViewerFrame, size: int
) -> NDArray[np.uint8]:  # fmt: skip
    """The object at a placement."""
    middle = item.bounds.mean(axis=0)
    reach = max(CLOSEST, AROUND * float(np.linalg.norm(np.ptp(item.bounds, axis=0))))
    return picture([open_room(scene), item], view(middle, reach, frame, size), samples=1).rgb


def resting_picture(item: Mesh, size: int) -> NDArray[np.uint8]:
    """The object alone, resting on one of its surfaces."""
    reach = DISTANCE * float(np.linalg.norm(np.ptp(item.bounds, axis=0)))
    middle = item.bounds.mean(axis=0)
    camera = looking_at(middle + reach * np.array([0.45, -0.8, 0.4]), middle, size, size)
    return picture([item], camera, samples=1, shadows=False).rgb


def view(target: Array, distance: float, frame: ViewerFrame, size: int, normal: Array | None = None) -> Camera:
    """Camera from the viewer's side and above, or from the side that a surface faces."""
    way = WAY[0] * np.append(frame.front, 0.0) + WAY[1] * np.append(frame.right, 0.0) + (0.0, 0.0, WAY[2])
    if normal is not None and normal[2] > 0.5:
        way += np.array([0.0, 0.0, STEEP])
    elif normal is not None and float(way @ normal) < 0.3:
        way = 0.8 * normal + 0.2 * way + (0.0, 0.0, 0.3 if normal[2] > -0.5 else 0.0)
    return looking_at(target + distance * way / np.linalg.norm(way), target, size, size)


def open_room(scene: Segmentation, skipped: int = -1) -> Mesh:
    """The scene without walls and ceilings, and without one instance."""
    hidden = [one.structure and one.label != "floor" for one in scene.instances]
    gone = np.array([*hidden, False])[scene.face_instance]
    if skipped >= 0:
        gone |= scene.face_instance == skipped
    return scene.mesh.submesh(np.flatnonzero(~gone))


def outline_mesh(surface: InteractionSurface) -> Mesh:
    """The hull of a surface as a thin sheet in a bright colour."""
    ring = surface.outline + LIFT * surface.normal
    fan = np.array([(0, k, k + 1) for k in range(1, len(ring) - 1)], dtype=np.int32).reshape(-1, 3)
    return Mesh.of(ring, fan, LOUD)


def loud(mesh: Mesh) -> Mesh:
    """The mesh in a bright colour blended with its own."""
    return Mesh(mesh.vertices, mesh.faces, np.rint((1.0 - TINT) * mesh.colors + TINT * LOUD).astype(np.uint8))
