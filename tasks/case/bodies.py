"""The bodies of a physics case, built as those of a placement are: fine at the contact, graded away from it."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.distance import Distance, sampler
from dcap.scene.errors import InputError
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.particles import (
    BackgroundGrid,
    DistanceGrid,
    MaterialPoints,
    Particles,
    RigidSimulationBody,
    SimulationBody,
    SoftSimulationBody,
)
from tasks.bodies.distance_samples import distance_samples
from tasks.bodies.material_points import MaterialConstants, material_points, with_mass
from tasks.bodies.node_states import grid_of, nodes_at_faces
from tasks.bodies.soft_cells import Planes, planes_of
from tasks.case.file import Case
from tasks.case.solid import CaseSolid

RIGID_CELLS = 25.0  # in the smallest side where nothing is soft: spacing of surface points
FINE_REACH = 1.3  # half width of the fine zone over the predicted contact radius
GROWTH = 2.2  # ratio of neighbouring cells outside of the fine zone
MOST_MARGIN = 0.02  # a signed distance reaches this far beyond the body [m], half its thickness for small ones
MOST_SAMPLES = 250.0  # of a signed distance along its longest side: 16 million in a cube
MOST_CELLS = 200_000  # cells of one soft body; more would not fit the time a user expects
"""What a person can raise with --resolution."""


def case_particles(case: Case, folder: Path, resolution: float | None) -> Particles:
    """The simulation input of a case, with the smallest cell at a contact [m]."""
    solids = [CaseSolid(body, folder, _bonded_to(body.name, case.bonds)) for body in case.bodies]
    gravity = float(np.linalg.norm(case.gravity))
    cells = [resolution or s.predicted_cell(solids, gravity) for s in solids]
    finest = min(
        [c for s, c in zip(solids, cells, strict=True) if not s.rigid]
        or [min(s.smallest for s in solids) / RIGID_CELLS]
    )
    bodies = tuple(case_body(s, c, finest, solids, gravity) for s, c in zip(solids, cells, strict=True))
    pairs = tuple((p.a, p.b, p.static_friction, p.dynamic_friction) for p in case.friction_pairs)
    return Particles(bodies, pairs, finest, ())


def case_body(solid: CaseSolid, cell: float, finest: float, solids: list[CaseSolid], gravity: float) -> SimulationBody:
    """One body, with cells of `cell` [m] at its contacts where it is soft; `finest` is the smallest cell of all."""
    planes = None if solid.rigid else graded(solid, cell, solids, gravity)
    if planes is not None:
        _refuse_more_cells(solid, planes, cell)
    surface = solid.surface(planes, finest if planes is None else cell)
    distance = sampled_distance(solid, surface, finest)
    inertial, friction = solid.inertial(), solid.material.friction
    name, velocity, spin = solid.body.name, np.asarray(solid.body.velocity), np.asarray(solid.body.angular_velocity)
    if planes is None:
        return RigidSimulationBody(
            name=name, instance=name, fixed=solid.fixed, surface=surface, distance=distance, inertial=inertial,
            friction=friction, velocity=velocity, angular_velocity=spin,
        )  # fmt: skip
    loaded = (solid.body.rest_shape or ("loaded" if solid.fixed else "unloaded")) == "loaded"
    return SoftSimulationBody(
        name=name, instance=name, fixed=solid.fixed, surface=surface, distance=distance, inertial=inertial,
        friction=friction, velocity=velocity, angular_velocity=spin,
        points=uniform_points(solid, planes, distance, inertial.mass), grid=clamped_grid(solid, planes), loaded=loaded,
    )  # fmt: skip


def graded(solid: CaseSolid, cell: float, solids: list[CaseSolid], gravity: float) -> Planes:
    """Graded planes: fine where another body stands over or under this one."""
    reach = FINE_REACH * solid.predicted_radius(solids, gravity)
    low, high = solid.high.copy(), solid.low.copy()
    for other in solid.may_touch(solids):
        middle = solid.touch_point(other)
        low, high = np.minimum(low, middle - reach), np.maximum(high, middle + reach)
    fine = solid.box if (low > high).any() else np.stack([low, high])
    return planes_of(solid.box, fine, cell, GROWTH)


def _refuse_more_cells(solid: CaseSolid, planes: Planes, cell: float) -> None:
    count = int(np.prod([len(p) - 1 for p in planes], dtype=np.float64))
    if count > MOST_CELLS:
        raise InputError(
            f"body {solid.body.name!r}: {count:.3g} cells of {1e3 * cell:.2g} mm > {MOST_CELLS}; raise --resolution"
        )


def sampled_distance(solid: CaseSolid, surface: Mesh, finest: float) -> DistanceGrid:
    """Samples of the signed distance as fine as the contact needs, as far out as another body comes."""
    least = min(0.5 * solid.smallest, MOST_MARGIN)
    longest = float(solid.extent.max()) + 2.0 * least
    spacing = max(min(finest / 2.5, solid.smallest / 24.0), longest / MOST_SAMPLES)
    return distance_samples(solid.distance(surface), solid.box, spacing, margin=max(4.0 * spacing, least))


def uniform_points(solid: CaseSolid, planes: Planes, distance: DistanceGrid, mass: float) -> MaterialPoints:
    """Points of one material that weigh `mass` [kg], within the exact distance of a primitive, else the sampled one."""
    m = solid.material
    inside: Distance = sampler(distance) if solid.primitive is None else solid.exact_distance

    def uniform(position: NDArray[np.float64]) -> MaterialConstants:
        one = np.ones(len(position))
        return MaterialConstants(m.density * one, m.youngs_modulus * one, m.poisson_ratio * one)

    empty = f"body {solid.body.name!r}: soft but without particles; its grid cells are larger than the body"
    return with_mass(material_points(planes, inside, uniform, if_empty=empty), mass)


def clamped_grid(solid: CaseSolid, planes: Planes) -> BackgroundGrid:
    """The grid of a soft body, a fixed one's held at its clamped faces."""
    if not solid.fixed:
        return grid_of(planes)
    faces = clamped_faces(solid.body.clamp)
    return grid_of(planes, held=nodes_at_faces(planes, faces, solid.local_box, solid.rotation, solid.position))


def clamped_faces(clamp: str) -> list[str]:
    """Faces named by a clamp."""
    if clamp == "sides_and_bottom":
        return ["x_min", "x_max", "y_min", "y_max", "z_min"]
    return {"bottom": ["z_min"], "none": []}.get(clamp, [clamp])


def _bonded_to(name: str, bonds: list[list[str]]) -> frozenset[str]:
    """Names of the bodies bonded to one."""
    return frozenset(one for bond in bonds if name in bond for one in bond if one != name)
