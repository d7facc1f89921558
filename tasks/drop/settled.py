"""The solver's result as a type of the pipeline."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from dcap.scene.types.mesh import Mesh
from dcap.scene.types.particles import Particles, SimulationBody
from dcap.scene.types.settled import Settled, SettledBody
from solver.result import RestBody, SettledModel

Array = NDArray[np.float64]


def settled_of(particles: Particles, result: SettledModel) -> Settled:
    """The solver's result in the form that the pipeline stores, not yet compared with the request."""
    bodies = [_body(body, rest) for body, rest in zip(particles.bodies, result.bodies, strict=True)]
    return Settled(
        verdict=result.verdict,
        bodies=tuple(bodies),
        contacts=result.contacts,
        contact_points=result.contact_points[particles.bodies[0].name],
        certificate=result.certificate,
        history=result.history,
        frames=result.frames,
        material=tuple(result.material.get(body.name) for body in particles.bodies) if result.material else (),
        nodes=tuple(result.nodes.get(body.name) for body in particles.bodies) if result.nodes else (),
        steps=result.steps,
        simulated_seconds=result.simulated_seconds,
        warnings=result.warnings + particles.notes,
    )


def quaternion(rotation: Array) -> Array:
    """(w, x, y, z) of a rotation matrix, w >= 0."""
    return np.asarray(Rotation.from_matrix(rotation).as_quat(canonical=True, scalar_first=True))


def _body(body: SimulationBody, rest: RestBody) -> SettledBody:
    surface = Mesh(rest.vertices, body.surface.faces, body.surface.colors)
    moved = rest.vertices - body.surface.vertices
    return SettledBody(body.name, surface, rest.translation, quaternion(rest.rotation), moved)
