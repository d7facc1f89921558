"""The one translation of simulation bodies into the solver's model, for cases and placements alike."""

from collections.abc import Sequence

import numpy as np

from dcap.scene.types.particles import (
    LayeredPoints,
    Particles,
    RigidSimulationBody,
    SimulationBody,
    SoftSimulationBody,
)
from solver.model.bodies import Body, Interior, Model, RigidBody, SignedDistance, SoftBody
from solver.model.layers import Layers


def solver_model(particles: Particles, gravity: Sequence[float], bonds: Sequence[tuple[str, str]] = ()) -> Model:
    """The solver's model of all bodies under gravity [m/s^2]; raises ModelError for what it cannot simulate."""
    bodies = tuple(solver_body(body) for body in particles.bodies)
    return Model(bodies, np.array(gravity, dtype=np.float64), particles.friction_pairs, tuple(bonds))


def solver_body(body: SimulationBody) -> Body:
    """One body as the solver's arrays."""
    friction, inertial = body.friction, body.inertial
    common = (
        body.name, body.fixed, body.surface.vertices, body.surface.faces,
        SignedDistance(body.distance.origin, body.distance.spacing, body.distance.values),
        inertial.mass, inertial.center_of_mass, friction.static, friction.dynamic, friction.rolling_resistance,
    )  # fmt: skip
    match body:
        case RigidSimulationBody():
            return RigidBody(
                *common, inertial.inertia, velocity=body.velocity, angular_velocity=body.angular_velocity,
                vertical=body.vertical, face_friction=body.face_friction,
            )  # fmt: skip
        case SoftSimulationBody(points=points, grid=grid):
            interior = Interior(
                points.position, points.volume, points.density, points.youngs_modulus, points.poisson_ratio,
                grid.planes, grid.node_state, body.loaded, solver_layers(points.layers),
            )  # fmt: skip
            return SoftBody(
                *common, interior, velocity=body.velocity, angular_velocity=body.angular_velocity,
                face_friction=body.face_friction,
            )  # fmt: skip


def solver_layers(layers: LayeredPoints | None) -> Layers | None:
    """The layers of material points as the solver has them."""
    if layers is None:
        return None
    return Layers(layers.youngs_modulus, layers.poisson_ratio, layers.shear_modulus, layers.normal)
