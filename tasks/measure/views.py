"""The fixed pictures of a final state for judges, from cameras that no method has a say in.

In: scene and object as segmented, what was asked, the pose before any drop, the final state and the textures of both
sources. Out: `JudgedViews`. The scene before, the room and the view from above are taken from one camera for all
methods: it looks at the support that was asked for, as it stands in the intent that all share. The others look at the
object, from four sides and from low down, at a distance that depends on its size alone.
"""

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, PositiveFloat, PositiveInt

from dcap.geometry.camera import Camera, looking_at
from dcap.geometry.rendering.painted import painted
from dcap.geometry.rendering.picture import picture
from dcap.scene.types.anchor import Anchor
from dcap.scene.types.intent import Intent
from dcap.scene.types.judged_views import JudgedViews
from dcap.scene.types.paint import SourceSurface
from dcap.scene.types.segmentation import SegmentedObject, SegmentedScene
from dcap.scene.types.settled import Settled
from tasks.render.scene_views import SceneViews
from tasks.render.settled_meshes import painted_item, painted_scene, settled_scene
from tasks.runner.stage import stage

Array = NDArray[np.float64]

SIDES = {"front": 0.0, "right": 90.0, "back": 180.0, "left": -90.0}
"""Azimuths off the way from the support to the middle of the scene, counterclockwise from above [degrees]."""
TOWARDS = -90.0
"""That way in the world, off +x, where the support is in the middle [degrees]."""
NEARBY, ABOVE, LEVEL, CORNER = 25.0, 70.0, 6.0, 30.0
"""Elevations of the side views, of the view from above, of the low one and of that of the room [degrees]."""


class ViewsConfig(BaseModel, frozen=True, extra="forbid"):
    """How large the pictures are and what they cover."""

    size: PositiveInt = 384
    """Width and height [pixel]."""
    fov_deg: PositiveFloat = 40.0
    """Field of view [degrees]."""
    near: PositiveFloat = 3.2
    """Distance of the cameras near the object over its diagonal [-]."""
    far: PositiveFloat = 2.4
    """Least distance of the cameras that look at the support [m], or six times the object's diagonal."""
    margin: PositiveFloat = 1.25
    """Angle that their pictures cover over that of the support [-]."""
    samples: PositiveInt = 2
    """Rays along each side of a pixel at edges [-]."""


def judged_views(
    scene: SegmentedScene,
    item: SegmentedObject,
    intent: Intent,
    anchor: Anchor,
    settled: Settled,
    scene_surface: SourceSurface,
    object_surface: SourceSurface,
    config: ViewsConfig,
) -> JudgedViews:
    """Take the pictures."""
    around = settled_scene(scene, settled, anchor.base_id)
    look, thing = painted_scene(around, scene_surface), painted_item(item, anchor, settled.bodies[0], object_surface)
    middle = thing.mesh.bounds.mean(axis=0)
    size = intent.scale * float(np.linalg.norm(np.ptp(item.mesh.bounds, axis=0)))  # as given: the same for all methods
    away = config.near * size
    after = SceneViews(around.scene, look, [thing])
    before = SceneViews(scene, painted(scene.mesh, scene_surface))

    def taken(camera: Camera) -> NDArray[np.uint8]:
        return picture(after.seen_by(camera), camera, samples=config.samples).rgb

    support = scene.instances[scene.index_of(intent.base_id)].box
    reach = 0.5 * support.diagonal / np.sin(0.5 * np.radians(config.fov_deg) / config.margin)
    distance = max(config.far, 6.0 * size, float(reach))
    inwards = scene.mesh.bounds.mean(axis=0) - support.center
    off_middle = np.linalg.norm(inwards[:2]) > 0.1
    ahead = float(np.degrees(np.arctan2(inwards[1], inwards[0]))) if off_middle else TOWARDS
    whole = seen_from(support.center, ahead, CORNER, distance, config)
    over = seen_from(support.center, ahead, ABOVE, distance, config)
    asset, apart = painted(item.mesh, object_surface), 0.8 * away / intent.scale
    alone = seen_from(item.mesh.bounds.mean(axis=0), TOWARDS + 30.0, NEARBY, apart, config)
    sides = {name: taken(seen_from(middle, ahead + side, NEARBY, away, config)) for name, side in SIDES.items()}
    return JudgedViews(
        clean=picture(before.seen_by(whole), whole, samples=config.samples).rgb,
        asset=picture([asset], alone, samples=config.samples).rgb,
        room=taken(whole),
        top=taken(over),
        low=taken(seen_from(middle, ahead, LEVEL, away, config)),
        **sides,
    )


def seen_from(middle: Array, azimuth_deg: float, elevation_deg: float, distance: float, config: ViewsConfig) -> Camera:
    """A camera that looks at a point."""
    a, e = np.radians(azimuth_deg), np.radians(elevation_deg)
    way = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    return looking_at(middle + distance * way, middle, config.size, config.size, fov_deg=config.fov_deg)


judged_views_task = stage(judged_views)
