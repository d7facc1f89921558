"""The independent referee's verdict on a final state of any method, by MuJoCo and Open3D on the final meshes.

In: scene and object as segmented, the pose before any drop, materials, the simulated bodies (only for mass and
friction) and the final state. Out: `RefereeMeasures`.
"""

import numpy as np
from numpy.typing import NDArray

from dcap.evaluation.referee.rest import Surroundings, judge_rest
from dcap.scene.errors import GeometryError, InputError
from dcap.scene.types.choices import Anchor
from dcap.scene.types.materials import ContactFriction, PartMaterials
from dcap.scene.types.measures import Measures, RefereeMeasures
from dcap.scene.types.particles import InertialProperties, Particles
from dcap.scene.types.segmentation import Segmentation, SegmentedObject, SegmentedScene
from dcap.scene.types.settled import Settled
from tasks.cache import stage
from tasks.render.settled_meshes import settled_item, settled_scene

STILL = 0.1
"""Least share of the weight that the intended support must carry [-]: it carries nothing of an object that fell off,
but some of an object that also leans on other things."""


def referee(
    scene: SegmentedScene,
    item: SegmentedObject,
    anchor: Anchor,
    materials: PartMaterials,
    particles: Particles,
    settled: Settled,
    measures: Measures,
) -> RefereeMeasures:
    """Judge a final state with all bodies rigid."""
    after = settled_scene(scene, settled, anchor.base_id).scene
    owner = np.where(after.face_instance < 0, len(after.instances), after.face_instance).astype(np.int64)
    friction = frictions(after, materials, particles)
    start, pose = particles.bodies[0].inertial, settled.bodies[0].world_from_start
    turn = pose[:3, :3]
    inertia = turn @ start.inertia @ turn.T
    center = turn @ start.center_of_mass + pose[:3, 3]
    try:
        found = judge_rest(
            settled_item(item, anchor, settled.bodies[0]),
            Surroundings(after.mesh, owner, friction),
            inertial=InertialProperties(start.mass, center, 0.5 * (inertia + inertia.T)),
        )
    except (GeometryError, InputError) as error:
        return RefereeMeasures(reason=" ".join(str(error).split()))
    ids = [*(one.id for one in after.instances), ""]
    own = found.carried[ids.index(measures.support_id)] if measures.support_id else 0.0
    return RefereeMeasures(
        drift_m=found.drift_m,
        drift_deg=found.drift_deg,
        supported=found.supported and bool(own >= STILL),
        carrier_id=ids[found.carrier] if found.supported else "",
        penetration_m=found.penetration_m,
        seconds=found.seconds,
        deviation_m=found.deviation_m,
    )


def frictions(scene: Segmentation, materials: PartMaterials, particles: Particles) -> NDArray[np.float64]:
    """Static friction [-] and rolling resistance [m] of the object on each thing, and on faces of no thing, shape (k +
    1, 2): as in the drop. Things left out of the drop have the values of their materials, else of the base."""
    own = particles.bodies[0]
    others = {body.instance: body for body in reversed(particles.bodies[1:])}
    given = {frozenset(row[:2]): row[2] for row in particles.friction_pairs}
    chosen = {row.body: row.material.friction for row in reversed(materials.rows)}
    first = particles.bodies[1].friction if len(particles.bodies) > 1 else own.friction

    def of_pair(friction: ContactFriction) -> tuple[float, float]:
        return (
            float(np.sqrt(own.friction.static * friction.static)),
            float(np.sqrt(own.friction.rolling_resistance * friction.rolling_resistance)),
        )

    rows = []
    for one in scene.instances:
        body = others.get(one.id)
        sliding, rolling = of_pair(body.friction if body else chosen.get(one.id, first))
        rows.append((given.get(frozenset((own.name, body.name)), sliding) if body else sliding, rolling))
    return np.array([*rows, of_pair(first)])


referee_task = stage(referee, process=True)
