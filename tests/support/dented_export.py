"""The ball in the dented bed of `dented_bed.py` with its simulated bodies, as it is exported."""

from functools import cache

import numpy as np
from dented_bed import RADIUS, anchor, ball, scene_of, settled

from dcap.geometry.distance import MeshDistance, sampled
from dcap.scene.types.export_scene import ExportScene
from dcap.scene.types.materials import ContactFriction
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.particles import InertialProperties, Particles, RigidSimulationBody
from tasks.export.settled_export import export_scene

MASS = 1.0
"""Of the ball [kg]."""
BALL, BED = ContactFriction(0.9, 0.4, 0.001), ContactFriction(0.4, 0.1, 0.004)
PAIR = ContactFriction(0.6, 0.2, 0.002)
"""Their geometric mean."""


def body(name: str, surface: Mesh, friction: ContactFriction, center: np.ndarray, faces: object = None) -> (
    RigidSimulationBody
):  # fmt: skip
    """A body before the drop; its ball of matter is solid."""
    low, high = surface.bounds
    return RigidSimulationBody(
        name=name, instance=name, fixed=name != "object", surface=surface,
        distance=sampled(MeshDistance(surface), low - 0.01, high + 0.01, 0.02),
        inertial=InertialProperties(MASS, center, 0.4 * MASS * RADIUS**2 * np.eye(3)), friction=friction,
        face_friction=None if faces is None else np.asarray(faces, dtype=np.float64),
    )  # fmt: skip


@cache
def particles(other_half: ContactFriction | None = None) -> Particles:
    """The ball, perhaps with another friction where x > 0 at the start, and the bed."""
    own, bed = settled().bodies
    start, plane = (Mesh(b.surface.vertices - b.displacement, b.surface.faces, b.surface.colors) for b in (own, bed))
    faces = None
    if other_half is not None:
        right = start.triangles.mean(axis=1)[:, 0] > 0.0
        two = np.array([[f.static, f.dynamic, f.rolling_resistance] for f in (BALL, other_half)])
        faces = two[right.astype(int)]
    bodies = (
        body("object", start, BALL, anchor().world_from_object[:3, 3], faces),
        body("bed", plane, BED, np.zeros(3)),
    )
    return Particles(bodies, (), 0.01, ())


@cache
def exported() -> ExportScene:
    """What is exported."""
    return export_scene(scene_of(), ball(), anchor(), None, particles(), settled())
