"""Simulation bodies as the solver's model, and the free nodes of their background grids.

Masks of the nodes held by a clamp, a cut, a support or a core are of shape (kx, ky, kz), for node planes along x, y and
z of kx, ky and kz nodes.
"""

from collections.abc import Iterable, Sequence

import numpy as np

from dcap.arrays import Array, Mask
from dcap.geometry.distance import Distance
from dcap.scene.types.boxes import OrientedBox
from dcap.scene.types.particles import (
    BackgroundGrid,
    LayeredPoints,
    NodeState,
    Particles,
    RigidSimulationBody,
    SimulationBody,
    SoftSimulationBody,
)
from solver.model.bodies import Body, Interior, Model, RigidBody, SignedDistance, SoftBody
from solver.model.layers import Layers
from tasks.bodies.soft_cells import Planes, nodes

OVERHANG = 0.05  # beyond a part's own box its bottom still holds [m]: scans show soft parts wider than they are


def solver_model(particles: Particles, gravity: Sequence[float], bonds: Sequence[tuple[str, str]] = ()) -> Model:
    """The solver's model of all bodies under gravity [m/s^2]; raises ModelError for bodies that it cannot simulate."""
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
    """The layers of material points in the solver's form."""
    if layers is None:
        return None
    return Layers(layers.youngs_modulus, layers.poisson_ratio, layers.shear_modulus, layers.normal)


def grid_of(planes: Planes, *, held: Mask | None = None, core: Mask | None = None) -> BackgroundGrid:
    """A grid with the state of its nodes; a node that is both held and in the core counts as core."""
    state = np.full(tuple(len(p) for p in planes), NodeState.FREE, dtype=np.int8)
    for mask, value in ((held, NodeState.HELD), (core, NodeState.CORE)):
        if mask is not None:
            state[mask] = value
    return BackgroundGrid(*planes, state)


def spacing_at(planes: Array) -> Array:
    """Smaller of the two cells next to each node plane [m], shape (k,)."""
    gap = np.diff(planes)
    return np.asarray(np.minimum(np.append(gap, np.inf), np.insert(gap, 0, np.inf)))


def nodes_at_faces(planes: Planes, faces: Sequence[str], box: Array, rotation: Array, position: Array) -> Mask:
    """Nodes within half a cell, measured across the face, of faces (`x_min` ... `z_max`) of a box (2, 3) that stands
    turned by `rotation` at `position`."""
    local = (node_positions(planes) - position) @ rotation
    size = np.stack(np.meshgrid(*(spacing_at(p) for p in planes), indexing="ij"), axis=-1)
    mask = np.zeros(local.shape[:3], dtype=bool)
    for face in faces:
        axis, side = "xyz".index(face[0]), 0 if face.endswith("min") else 1
        across = size @ np.abs(rotation[:, axis])
        mask |= np.abs(local[..., axis] - box[side][axis]) <= 0.5 * across
    return mask


def nodes_at_cuts(planes: Planes, cut: Mask) -> Mask:
    """Nodes on those sides of the grid, (2, 2) = (low/high, x/y), that are cuts through the material."""
    mask = np.zeros(tuple(len(p) for p in planes), dtype=bool)
    for axis in range(2):
        for side, end in ((0, 0), (1, -1)):
            if cut[side, axis]:
                np.moveaxis(mask, axis, 0)[end] = True
    return mask


def nodes_at_bottoms(planes: Planes, bottoms: Iterable[tuple[float, Sequence[OrientedBox]]]) -> Mask:
    """Nodes within half a cell of each height [m] and over one of its boxes."""
    point = node_positions(planes)
    tolerance = 0.5 * spacing_at(planes[2])
    mask = np.zeros(point.shape[:3], dtype=bool)
    for height, boxes in bottoms:
        for k in np.flatnonzero(np.abs(planes[2] - height) <= tolerance):
            plan = point[:, :, k].reshape(-1, 3)
            over = np.zeros(len(plan), dtype=bool)
            for box in boxes:
                over |= (np.abs(box.to_local(plan))[:, :2] <= box.half_extents[:2] + OVERHANG).all(axis=1)
            mask[:, :, k] |= over.reshape(mask.shape[:2])
    return mask


def nodes_within(planes: Planes, solid: Distance, distance: float) -> Mask:
    """Nodes in a solid or at most `distance` [m] from it."""
    return np.asarray(solid(nodes(planes)) <= distance).reshape([len(p) for p in planes])


def node_positions(planes: Planes) -> Array:
    """Positions of the nodes [m], shape (kx, ky, kz, 3)."""
    return nodes(planes).reshape(*(len(p) for p in planes), 3)
