"""Pictures of an infeasible placement: the scene, and the object at its intended place.

In: scene and object, and the results of the stages before the failed stage. Out: one or two pictures from one camera;
without a support, the numbered things of the scene.
"""

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw
from pydantic import BaseModel, PositiveFloat, PositiveInt

from dcap.arrays import Array
from dcap.geometry.camera import Camera, looking_at
from dcap.geometry.rendering.picture import picture
from dcap.geometry.rendering.view_volume import cut_faces
from dcap.scene.types.choices import Anchor, Intent
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.pictures import Overview
from dcap.scene.types.segmentation import Segmentation, SegmentedObject, SegmentedScene
from tasks.bodies.object_shape import OpenShape, object_shape
from tasks.cache import stage
from tasks.requests.marks import candidates_picture

RED = (214, 40, 40)
HOLE_DISTANCE = 1.0  # distance of the camera to a hole, over the object's diagonal [-]
ASKEW = np.array([0.25, -0.35, 0.3])  # angle off a hole's axis, so that its depth shows


class OverviewConfig(BaseModel, frozen=True, extra="forbid"):
    """Settings of the pictures."""

    size: PositiveInt = 1024
    """Side of each picture [pixels]."""
    fov_deg: PositiveFloat = 55.0
    """Field of view [degrees]."""
    elevation_deg: PositiveFloat = 35.0
    """Elevation of the camera [degrees]."""
    distance_factor: PositiveFloat = 1.5
    """Camera distance over the diagonal of its target [-]."""
    scene_factor: PositiveFloat = 0.8
    """Camera distance for the whole scene over its diagonal [-]."""


def overview(
    scene: SegmentedScene,
    item: SegmentedObject,
    intent: Intent | None,
    anchor: Anchor | None,
    config: OverviewConfig,
    filled: bool = False,
) -> Overview:
    """Look at the base if it was found, else at the whole scene; an object filled with particles has no holes."""
    camera = camera_for(scene, intent, anchor, config)
    structure = np.array([one.structure for one in scene.instances] + [True])[scene.face_instance]
    cut = cut_faces(scene.mesh, structure, camera.position, camera.target)
    shown = scene.mesh.submesh(np.flatnonzero(~cut))
    asked = None if anchor is None else photograph([shown, item.mesh.transformed(anchor.world_from_object)], camera)
    candidates = candidates_picture(scene) if intent is None and scene.instances else None
    hole = None if filled else hole_picture(item, intent, anchor, config)
    return Overview(photograph([shown], camera), asked, candidates, hole)


def hole_picture(
    item: Segmentation, intent: Intent | None, anchor: Anchor | None, config: OverviewConfig
) -> NDArray[np.uint8] | None:
    """The object before the drop, seen through its largest hole, with all rims in red; None if its surface can be
    closed or no stage has tried."""
    shape = None if intent is None or anchor is None else object_shape(item, intent, anchor)
    if anchor is None or not isinstance(shape, OpenShape):
        return None
    mesh = item.mesh.transformed(anchor.world_from_object)
    middle, diagonal = mesh.bounds.mean(axis=0), float(np.linalg.norm(np.ptp(mesh.bounds, axis=0)))
    way = shape.rims[0].middle - middle if shape.rims else np.array([0.0, -1.0, 0.0])
    way = way / max(float(np.linalg.norm(way)), 1e-9 * diagonal) + ASKEW
    seen_from = middle + HOLE_DISTANCE * diagonal * way / float(np.linalg.norm(way))
    camera = looking_at(seen_from, middle, config.size, config.size, fov_deg=config.fov_deg)
    image = Image.fromarray(photograph([mesh], camera))
    draw = ImageDraw.Draw(image)
    for one in shape.rims:
        line = [(float(x), float(y)) for x, y in camera.project(np.append(one.rim, one.rim[:1], axis=0))[:, :2]]
        draw.line(line, fill=RED, width=max(2, config.size // 250))
    return np.asarray(image, dtype=np.uint8).copy()


def photograph(meshes: list[Mesh], camera: Camera) -> NDArray[np.uint8]:
    """An sRGB picture."""
    return picture([mesh for mesh in meshes if len(mesh.faces)], camera).rgb


def camera_for(scene: Segmentation, intent: Intent | None, anchor: Anchor | None, config: OverviewConfig) -> Camera:
    """A camera in front of and above its target."""
    low, high = scene.mesh.bounds
    middle, diagonal, factor, front = 0.5 * (low + high), float(np.linalg.norm(high - low)), config.scene_factor, None
    if intent is not None:
        base = scene.instances[scene.index_of(intent.base_id)]
        middle, diagonal, factor, front = base.box.center, base.box.diagonal, config.distance_factor, base.front
    if anchor is not None:
        middle = anchor.surface_point
    toward = horizontal(0.5 * (low + high) - middle) if front is None else front
    lift = np.radians(config.elevation_deg)
    way = np.cos(lift) * toward + np.array([0.0, 0.0, np.sin(lift)])
    return looking_at(middle + factor * diagonal * way, middle, config.size, config.size, fov_deg=config.fov_deg)


def horizontal(direction: Array) -> Array:
    """Horizontal unit vector along a direction; the viewer's side (-y) if it has no horizontal part."""
    length = float(np.linalg.norm(direction[:2]))
    if length < 1e-6:
        return np.array([0.0, -1.0, 0.0])
    return np.array([direction[0], direction[1], 0.0]) / length


overview_task = stage(overview)
