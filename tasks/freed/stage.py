"""Stage freed: start of the next drop in a scene with earlier placed things.

In: the scan with the record of earlier placements, the scene, the object and its anchor. Out: `FreedThings`: the
things in reach, which take part as free bodies, lifted out of their dents; the scene with those dents undone; and the
object's start above them. Things out of reach keep their places and their dents. `freed_scene` and
`freed_anchor` return scene and anchor for the later stages.
"""

from dataclasses import replace

import numpy as np

from dcap.geometry.raycast import Raycaster
from dcap.scene.types.anchor import Anchor
from dcap.scene.types.earlier import FreedThings
from dcap.scene.types.scan import Scan
from dcap.scene.types.segmentation import Segmentation, SegmentedObject, SegmentedScene
from tasks.cache import stage
from tasks.freed.reach import things_in_reach
from tasks.freed.unloaded import bottom_up, faces_around, height_over, lifted, unloaded

DEEPEST = 0.08
"""Height above a dent from which the surface is searched [m]."""


def freed(scan: Scan, scene: SegmentedScene, item: SegmentedObject, anchor: Anchor) -> FreedThings:
    """Free the things in reach."""
    earlier = scan.earlier
    assert earlier is not None
    mesh = item.mesh.transformed(anchor.world_from_object)
    own, others = things_in_reach(scene, mesh, anchor, earlier)
    undone = [one for one in earlier.deformations if set(one.loads) & set(own)]
    depth = max((float(np.linalg.norm(one.shift, axis=1).max(initial=0.0)) for one in undone), default=0.0)
    start, heights = lifted(unloaded(scene, undone), own, depth)
    raised = 0.0
    if own:
        around = faces_around(start.mesh, mesh, np.ones(len(start.mesh.faces), dtype=bool))
        raised = height_over(mesh, around, max(heights.values()) + depth, anchor.clearance)
    things = [earlier.thing(one) for one in bottom_up({one: start.instance_mesh(start.index_of(one)) for one in own})]
    return FreedThings(
        scene=start,
        anchor=above(anchor, start, raised),
        things=tuple(one for one in things if one is not None),
        ground=earlier.ground_of(anchor.base_id),
        materials=earlier.materials,
        notes=tuple(notes(scene, own, others, heights)),
    )


def freed_scene(freed: FreedThings) -> SegmentedScene:
    """The scene at the start of the drop."""
    return SegmentedScene(freed.scene)


def freed_anchor(freed: FreedThings) -> Anchor:
    """The anchor at the start of the drop."""
    return freed.anchor


freed_task = stage(freed)
freed_scene_task = stage(freed_scene)
freed_anchor_task = stage(freed_anchor)


def above(anchor: Anchor, start: Segmentation, raised: float) -> Anchor:
    """The anchor raised [m], with its surface point on the present surface."""
    pose = anchor.world_from_object.copy()
    pose[2, 3] += raised
    base = Raycaster(start.instance_mesh(start.index_of(anchor.base_id)))
    hit = base.cast(anchor.surface_point[None] + [0.0, 0.0, DEEPEST], np.array([[0.0, 0.0, -1.0]]))
    point = hit.position[0] if np.isfinite(hit.distance[0]) else anchor.surface_point
    return replace(anchor, world_from_object=pose, surface_point=point)


def notes(scene: Segmentation, own: list[str], others: list[str], heights: dict[str, float]) -> list[str]:
    """Notes on the things."""
    label = {one.id: one.label for one in scene.instances}
    found = [
        f"{one} ({label[one]}), placed before, is in reach: a free body, which starts {1e3 * heights[one]:.1f} mm "
        "above where it rests"
        for one in own
    ]
    return found + [
        f"{one} ({label[one]}), placed before, is in reach but rests on something else: it stays where it is"
        for one in others
    ]
