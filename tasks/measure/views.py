"""The fixed pictures of a final state for judges.

In: scene and object as segmented, what was asked, the pose before any drop, the final state and the textures of both
sources. Out: `JudgedViews`. Where the cameras stand says `judge_cameras`.
"""

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.rendering.painted import painted
from dcap.geometry.rendering.picture import picture
from dcap.scene.types.anchor import Anchor
from dcap.scene.types.intent import Intent
from dcap.scene.types.judged_views import PLACED, JudgedViews
from dcap.scene.types.paint import SourceSurface
from dcap.scene.types.segmentation import SegmentedObject, SegmentedScene
from dcap.scene.types.settled import Settled
from tasks.cache import stage
from tasks.measure.judge_cameras import NEARBY, TOWARDS, JudgeCameras, ViewsConfig, seen_from
from tasks.render.scene_views import SceneViews
from tasks.render.settled_meshes import is_as_given, painted_item, painted_scene, settled_scene

ROOM = "room"
"""The view of what was placed from where the scene without it is looked at."""


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
    thing = painted_item(item, anchor, settled.bodies[0], object_surface)
    after = SceneViews(around.scene, painted_scene(around, scene_surface), [thing])
    still = is_as_given(around, scene)
    before = after if still else SceneViews(scene, painted(scene.mesh, scene_surface))
    own = float(np.linalg.norm(np.ptp(item.mesh.bounds, axis=0)))
    support = scene.instances[scene.index_of(intent.base_id)].box
    cameras = JudgeCameras(support.center, support.diagonal, scene.mesh.bounds.mean(axis=0), intent.scale * own, config)

    middle = thing.mesh.bounds.mean(axis=0)
    clean = before.exposed(cameras.of("clean", middle))

    def taken(name: str) -> NDArray[np.uint8]:
        if still and name == ROOM:
            return after.with_things(clean).picture(config.samples).rgb
        camera = cameras.of(name, middle)
        return picture(after.seen_by(camera), camera, samples=config.samples).rgb

    alone = seen_from(item.mesh.bounds.mean(axis=0), TOWARDS + 30.0, NEARBY, 0.8 * config.near * own, config)
    return JudgedViews(
        clean=clean.picture(config.samples).rgb,
        asset=picture([painted(item.mesh, object_surface)], alone, samples=config.samples).rgb,
        **{name: taken(name) for name in PLACED},
    )


judged_views_task = stage(judged_views, process=True)
