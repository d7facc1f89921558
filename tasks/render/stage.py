"""Stage 9, render: the scene before, the object at rest in it, and a close-up of its contact.

In: scene, object, anchor, the settled state and the textures of both sources. Out: pictures, and the visible share of
the object; or `buried` if the scene hides it. The camera looks at the contact from the front of the base and above, at
1.5 times the diagonal of the base part's box (the paper's section 4.3), from the place with the best view of the
object; walls and ceiling in its way are cut away.
"""

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.camera import Camera
from dcap.geometry.raycast import Raycaster
from dcap.geometry.rendering.painted import painted
from dcap.geometry.rendering.picture import exposed
from dcap.scene.types.choices import Anchor
from dcap.scene.types.mesh import Mesh, SourceSurface
from dcap.scene.types.outcome import HiddenObject, Infeasible, Reason
from dcap.scene.types.pictures import Renders
from dcap.scene.types.segmentation import SegmentedObject, SegmentedScene
from dcap.scene.types.settled import Settled
from tasks.cache import stage
from tasks.render.config import RenderConfig
from tasks.render.contact_picture import contact_picture, profile_picture
from tasks.render.settled_meshes import painted_item, painted_scene, settled_scene, structure_faces
from tasks.render.views import (
    SceneViews,
    best_view,
    canonical_views,
    contact_middle,
    front,
    view_distance,
    visible_fraction,
)


def render(
    scene: SegmentedScene,
    item: SegmentedObject,
    anchor: Anchor,
    settled: Settled,
    scene_surface: SourceSurface,
    object_surface: SourceSurface,
    config: RenderConfig,
    before: SegmentedScene | None = None,
    before_surface: SourceSurface | None = None,
) -> Renders | Infeasible:
    """Take the pictures; `before` is the input scene, with its textures, if the drop started from another state."""
    thing = painted_item(item, anchor, settled.bodies[0], object_surface)
    around = settled_scene(scene, settled, anchor.base_id)
    end = around.scene.mesh
    unmoved = np.array_equal(end.faces, scene.mesh.faces) and np.array_equal(end.vertices, scene.mesh.vertices)
    still = before is None and unmoved
    first, after = around.scene if still else before or scene, painted_scene(around, scene_surface)
    things = Raycaster(around.scene.mesh, np.flatnonzero(~structure_faces(around.scene)))
    target, toward = contact_middle(settled, anchor), front(scene, anchor)
    distance = view_distance(scene, anchor, thing.mesh, config)
    view = best_view(things, thing.mesh, target, distance, toward, config)
    views = SceneViews(around.scene, after, [thing])
    given = views if still else SceneViews(first, painted(first.mesh, before_surface or scene_surface))
    clean = given.exposed(view.camera)
    seen = views.with_things(clean) if still else exposed(views.seen_by(view.camera), view.camera)
    rest = seen.picture(config.samples)
    fraction = visible_fraction(rest.mesh_index == len(seen.scene.prepared.things) - 1, thing, view.camera)
    if fraction < config.least_visible:
        return Infeasible(
            Reason.BURIED,
            f"only {fraction:.1%} of the object is visible (RenderConfig.least_visible {config.least_visible})",
            HiddenObject(visible_fraction=fraction, camera_position=view.camera.position),
        )
    near = nearby(things, thing.mesh, view.camera, config)
    bare = views.exposed(near, low_light=True)
    closeup = views.with_things(bare).picture(config.samples)
    empty = (bare if still else given.exposed(near, low_light=True)).picture(config.samples)
    gap = np.full((len(empty.rgb), max(2, empty.rgb.shape[1] // 128), 3), 255, dtype=np.uint8)
    labels = {one.id: one.label for one in scene.instances}
    contact = contact_picture(
        bare, around.shift, thing, settled.contact_points, settled.contacts, settled.bodies[0].name, labels
    )
    return Renders(
        clean=clean.picture(config.samples).rgb,
        settled=rest.rgb,
        closeup=closeup.rgb,
        visible_fraction=fraction,
        camera_position=view.camera.position,
        camera_target=target,
        before_after=np.concatenate([empty.rgb, gap, closeup.rgb], axis=1),
        contact=contact,
        profile=profile_picture(
            first.mesh, around.scene.mesh, thing.mesh, touched(settled, target), near.world_from_camera[:, 0]
        ),
        visibility=canonical_views(around.scene.mesh, thing.mesh, target, toward, config),
    )


def touched(settled: Settled, middle: NDArray[np.float64]) -> NDArray[np.float64]:
    """The contact point nearest to a contact's middle [m], shape (3,): a cut between legs would show no contact."""
    points = settled.contact_points
    return points[int(np.argmin(np.linalg.norm(points - middle, axis=1)))] if len(points) else middle


def nearby(things: Raycaster, thing: Mesh, first: Camera, config: RenderConfig) -> Camera:
    """The camera of the close-up: on the side of the first camera, with the contact slightly below the middle."""
    size = np.ptp(thing.vertices, axis=0)
    target = first.target + np.array([0.0, 0.0, 0.22 * size[2]])
    way = first.position - first.target
    flat = np.array([way[0], way[1], 0.0])
    flat /= np.linalg.norm(flat)
    distance = config.closeup_factor * float(np.linalg.norm(size))
    return best_view(things, thing, target, distance, flat, config).camera


render_task = stage(render, process=True)
