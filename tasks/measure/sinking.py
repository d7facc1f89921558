"""Compares the object's depth in a soft support with the depth to which its weight should press it.

In: scene and object, masses and materials, the simulated bodies (for the layers beneath) and the final state. Out:
`Indentation`, without numbers for a rigid support or an object as soft as the support.

The reference is no drop: the contact of elastic layered half-spaces under the true gap of both surfaces, frictionless
and quasi-static (docs/metrics.md states its error). The object is lifted over the undeformed support, so the reference
does not depend on the method's depth.
"""

import numpy as np

from dcap.evaluation.metrics.columns import columns
from dcap.geometry.raycast import Raycaster
from dcap.scene.types.anchor import Anchor
from dcap.scene.types.gravity import GRAVITY
from dcap.scene.types.intent import Intent
from dcap.scene.types.materials import PartMaterials
from dcap.scene.types.measures import Indentation
from dcap.scene.types.particles import Particles
from dcap.scene.types.segmentation import SegmentedObject, SegmentedScene
from dcap.scene.types.settled import Settled
from tasks.bodies.footprint import heights_over
from tasks.bodies.plan_contact import plan_contact
from tasks.cache import stage
from tasks.particles.contact_layers import RIGID, compliance_of, layers_of

LIFTED = 0.01
"""Height to which the object is lifted over the support before it is pressed onto it [m]; results do not depend on
it."""
STIFF = 0.1
"""Largest compliance of an object over the support's for it to sink in undeformed [-]."""


def indentation(
    scene: SegmentedScene,
    item: SegmentedObject,
    intent: Intent,
    anchor: Anchor,
    materials: PartMaterials,
    particles: Particles,
    settled: Settled,
) -> Indentation:
    """Compare depths on the base whose layers are known; the object has its undeformed shape, moved rigidly."""
    index = scene.index_of(anchor.base_id)
    rows = materials.of_parts(anchor.base_id, len(scene.instances[index].parts))
    layers = layers_of(particles.column, rows)
    softest = max(compliance_of(row) for row in materials.of_parts("object", len(item.instances[0].parts)))
    if not layers:
        return Indentation(reason="the support is rigid")
    if softest > STIFF * max(compliance for _, compliance in layers):
        return Indentation(reason="the object gives way as well")
    thing = item.mesh.transformed(settled.bodies[0].world_from_start @ anchor.world_from_object)
    base = scene.mesh.submesh(np.flatnonzero(scene.face_instance == index))
    lines = columns(thing, Raycaster(base))
    if lines.nearest < 0:
        return Indentation(reason="the object is not over its base")
    depth = max(-float(lines.gap.min()), 0.0)
    lift = np.eye(4)
    lift[2, 3] = depth + LIFTED
    over = thing.transformed(lift)
    stacks = ([(float(np.ptp(thing.bounds[:, 2])), softest)], [*layers, RIGID])
    found = plan_contact(heights_over(over, Raycaster(base)), over.bounds[:, :2], intent.mass * GRAVITY, stacks)
    if found is None:
        return Indentation(reason="the object is not over its base")
    return Indentation(depth, found.patch.approach)


indentation_task = stage(indentation)
