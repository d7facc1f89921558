"""Pictures of a final state for judges and raters, taken when a judge runs or a study is served.

In: scene and object as segmented, the request, the pose before any drop, the final state and the textures of both
sources. Out: `Sights`, from which dcap/evaluation/judging/cameras.py chooses the cameras of a sample; from these
cameras, `JudgedViews` of each placement and `SceneBefore` of the sample.
"""

import numpy as np
from numpy.typing import NDArray

from dcap.evaluation.judging.cameras import SAMPLES, PlacedThing, asset_view, camera_of, sights_of
from dcap.geometry.rendering.painted import painted
from dcap.geometry.rendering.picture import picture
from dcap.scene.types.choices import Anchor, Intent
from dcap.scene.types.mesh import SourceSurface
from dcap.scene.types.pictures import JudgedViews, SceneBefore, Sights, Viewpoint
from dcap.scene.types.segmentation import SegmentedObject, SegmentedScene
from dcap.scene.types.settled import Settled
from tasks.cache import stage
from tasks.render.settled_meshes import painted_item, painted_scene, settled_item, settled_scene, structure_faces
from tasks.render.views import SceneViews


def sights(scene: SegmentedScene, item: SegmentedObject, intent: Intent, anchor: Anchor, settled: Settled) -> Sights:
    """Measure the visibility of the final state from every possible direction of its cameras."""
    around = settled_scene(scene, settled, anchor.base_id).scene
    thing = settled_item(item, anchor, settled.bodies[0])
    support = scene.instances[scene.index_of(intent.base_id)].box
    placed = PlacedThing.of(around.mesh, structure_faces(around), thing)
    return sights_of(placed, support.corners, scene.mesh.bounds.mean(axis=0))


def judged_views(
    scene: SegmentedScene,
    item: SegmentedObject,
    anchor: Anchor,
    settled: Settled,
    scene_surface: SourceSurface,
    object_surface: SourceSurface,
    overview: Viewpoint,
    closeup: Viewpoint,
) -> JudgedViews:
    """Take the pictures of one placement."""
    around = settled_scene(scene, settled, anchor.base_id)
    thing = painted_item(item, anchor, settled.bodies[0], object_surface)
    views = SceneViews(around.scene, painted_scene(around, scene_surface), [thing])
    return JudgedViews(overview=camera_view(views, overview), closeup=camera_view(views, closeup))


def scene_before(
    scene: SegmentedScene,
    item: SegmentedObject,
    scene_surface: SourceSurface,
    object_surface: SourceSurface,
    overview: Viewpoint,
) -> SceneBefore:
    """Take the pictures shared by all methods of a sample."""
    alone = camera_of(asset_view(item.mesh))
    return SceneBefore(
        clean=camera_view(SceneViews(scene, painted(scene.mesh, scene_surface)), overview),
        asset=picture([painted(item.mesh, object_surface)], alone, samples=SAMPLES).rgb,
    )


def camera_view(views: SceneViews, view: Viewpoint) -> NDArray[np.uint8]:
    """Camera view, sRGB."""
    camera = camera_of(view)
    return picture(views.seen_by(camera), camera, samples=SAMPLES).rgb


sights_task = stage(sights, process=True)
judged_views_task = stage(judged_views, process=True)
scene_before_task = stage(scene_before, process=True)
