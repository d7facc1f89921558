"""Contact of the object with its surroundings, both deformed and undeformed.

In: scene and object as segmented, the pose before any drop and the final state. Out: `Measures`.
"""

import numpy as np

from dcap.evaluation.metrics.touching import Touching, touching
from dcap.geometry.placement.poses import front_of
from dcap.scene.types.choices import Anchor
from dcap.scene.types.measures import Measures
from dcap.scene.types.segmentation import Segmentation, SegmentedObject, SegmentedScene
from dcap.scene.types.settled import Settled
from tasks.cache import stage
from tasks.render.settled_meshes import settled_item, settled_scene

NEAR = 2e-3
"""Extra distance from the support, beyond the shortest line's, within which lines determine the carrying part [m]."""


def measure(scene: SegmentedScene, item: SegmentedObject, anchor: Anchor, settled: Settled) -> Measures:
    """Measure a final state."""
    thing = settled_item(item, anchor, settled.bodies[0])
    after = settled_scene(scene, settled, anchor.base_id).scene
    found = touching(thing, after.mesh)
    given = found if after.mesh is scene.mesh else touching(thing, scene.mesh)
    support, label, part = carrier(after, found)
    turned = anchor.world_from_object[:3, :3]
    low, high = thing.bounds
    lowest = np.array([0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1]), low[2]])
    turned = turned / np.cbrt(np.linalg.det(turned))  # without its scale
    return Measures(
        support_id=support,
        support_label=label,
        support_part=part,
        middle=lowest if found.middle is None else found.middle,
        front=settled.bodies[0].world_from_start[:3, :3] @ turned @ front_of(item.mesh)[0],
        penetration_m=found.penetration,
        penetration_given_m=given.penetration,
        gap_m=found.gap,
        contact_area_m2=found.contact_area,
        com_margin_m=found.margin,
    )


def carrier(scene: Segmentation, found: Touching) -> tuple[str, str, str]:
    """Id and label of the nearest instance beneath, and its part that most of the short lines hit."""
    lines = found.columns
    if lines.nearest < 0:
        return "", "", ""
    near = np.flatnonzero((lines.gap <= lines.gap.min() + NEAR) & (lines.face >= 0))
    owner = scene.face_instance[lines.face[near]]
    counts = np.bincount(owner[owner >= 0], minlength=len(scene.instances))
    if not counts.sum():
        return "", "", ""
    index = int(counts.argmax())
    instance = scene.instances[index]
    parts = scene.face_part[lines.face[near[owner == index]]]
    parts = parts[parts >= 0]
    part = instance.parts[int(np.bincount(parts).argmax())].name if len(parts) else ""
    return instance.id, instance.label, part


measure_task = stage(measure, process=True)
