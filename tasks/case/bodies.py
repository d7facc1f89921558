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
    LayeredPoints,
    MaterialPoints,
    Particles,
    RigidSimulationBody,
    SimulationBody,
    SoftSimulationBody,
)
from solver.model.grid import sized_planes
from tasks.bodies.distance_samples import distance_samples
from tasks.bodies.material_points import MaterialConstants, material_points, with_mass
from tasks.bodies.node_states import grid_of, nodes_at_faces
from tasks.bodies.soft_cells import Cells, Planes
from tasks.case.contacts import PredictedContact, predicted_contacts
from tasks.case.file import Case
from tasks.case.solid import CaseSolid

Array = NDArray[np.float64]

RIGID_CELLS = 25.0  # in the smallest side where nothing is soft: spacing of surface points
CELLS_ACROSS = 5.0  # cells in half the width of a predicted contact
CELLS_AT_ENDS = 2.0  # and in the shorter half width where a long contact ends: pressure falls over about as much
CELLS_THROUGH = 4.0  # least cells through a body along each axis
# and across layers: cells of constant slip see the parabola of n slices as one of (1 - 1 / n^2) of its second moment,
# so a body that gives by slip alone is 1.5 % too stiff with eight and 6 % with four
CELLS_ACROSS_LAYERS = 8.0
BESIDE = 0.3  # of its half width: cells stay fine this far beside a contact
GROWTH = 1.6  # ratio of neighbouring cells away from a contact
BUDGET = 30_000  # cells of one soft body, unless a resolution was asked for
COARSER = 1.06  # factor of the cells in a round until they keep to it
MOST_MARGIN = 0.02  # a signed distance reaches this far beyond the body [m], half its thickness for small ones
MOST_SAMPLES = 250.0  # of a signed distance along its longest side: 16 million in a cube
MOST_CELLS = 200_000  # cells of one soft body; more would not fit the time a user expects
"""What a person can raise with --resolution."""


def case_particles(case: Case, folder: Path, resolution: float | None) -> Particles:
    """The simulation input of a case, with the smallest cell at a contact [m]."""
    solids = [CaseSolid(body, folder, _bonded_to(body.name, case.bonds)) for body in case.bodies]
    contacts = predicted_contacts(solids, float(np.linalg.norm(case.gravity)))
    grids = [None if s.rigid else soft_grid(s, solids, contacts, resolution) for s in solids]
    finest = min([g.size for g in grids if g is not None] or [min(s.smallest for s in solids) / RIGID_CELLS])
    bodies = tuple(case_body(s, g, finest) for s, g in zip(solids, grids, strict=True))
    pairs = tuple((p.a, p.b, p.static_friction, p.dynamic_friction) for p in case.friction_pairs)
    return Particles(bodies, pairs, finest, ())


def case_body(solid: CaseSolid, grid: Cells | None, finest: float) -> SimulationBody:
    """One body, soft with a grid of cells; `finest` is the smallest cell of all [m]."""
    planes = None if grid is None else grid.planes
    surface = solid.surface(planes, finest if grid is None else grid.size)
    distance = sampled_distance(solid, surface, finest)
    inertial, friction = solid.inertial(), solid.material.friction
    name, velocity, spin = solid.body.name, np.asarray(solid.body.velocity), np.asarray(solid.body.angular_velocity)
    if planes is None:
        return RigidSimulationBody(
            name=name, instance=name, fixed=solid.fixed, surface=surface, distance=distance, inertial=inertial,
            friction=friction, velocity=velocity, angular_velocity=spin, vertical=solid.body.motion == "vertical",
        )  # fmt: skip
    loaded = (solid.body.rest_shape or ("loaded" if solid.fixed else "unloaded")) == "loaded"
    return SoftSimulationBody(
        name=name, instance=name, fixed=solid.fixed, surface=surface, distance=distance, inertial=inertial,
        friction=friction, velocity=velocity, angular_velocity=spin,
        points=uniform_points(solid, planes, distance, inertial.mass), grid=clamped_grid(solid, planes), loaded=loaded,
    )  # fmt: skip


def soft_grid(
    solid: CaseSolid, solids: list[CaseSolid], contacts: list[PredictedContact], resolution: float | None
) -> Cells:
    """The cells of a soft body: fine where a contact is predicted, or of `resolution` [m] there; coarser where that
    takes more cells than the budget, unless they were asked for."""
    joined = bonded_group(solid, solids)
    felt = [c for c in contacts if c.upper in joined or c.lower in joined]
    scale = 1.0
    while True:
        sizes = [axis_sizes(solid, axis, felt, resolution, scale) for axis in range(3)]
        planes = tuple(sized_planes(float(solid.low[a]), float(solid.high[a]), *sizes[a], GROWTH) for a in range(3))
        cell = min(float(np.diff(p).min()) for p in planes)
        count = int(np.prod([len(p) - 1 for p in planes], dtype=np.float64))
        if count <= (MOST_CELLS if resolution else BUDGET):
            return Cells((planes[0], planes[1], planes[2]), cell, count)
        if resolution:
            raise InputError(
                f"body {solid.body.name!r}: {count:.3g} cells of {1e3 * cell:.2g} mm > {MOST_CELLS}; raise --resolution"
            )
        scale *= COARSER


def axis_sizes(
    solid: CaseSolid, axis: int, felt: list[PredictedContact], resolution: float | None, scale: float
) -> tuple[Array, Array, Array]:
    """Where intervals along an axis begin and end [m], and the cell sizes [m] wanted there, each of shape (k,)."""
    low, high = float(solid.low[axis]), float(solid.high[axis])
    least = cells_through(solid)
    through = (high - low) / least[axis] if felt else resolution or scale * min(solid.extent / least)
    begin, end, size = [np.array([low])], [np.array([high])], [np.array([through])]
    for contact in felt:
        height = contact.height_on(solid)
        away = max(float(solid.low[2]) - height, height - float(solid.high[2]), 0.0)
        if axis < 2:
            place, half = contact.across(axis)
            step = 0.5 * contact.patch.spacing[axis]
            apart = np.diff(place) > 3.0 * step
            ends = np.concatenate([place[:1], place[:-1][apart], place[1:][apart], place[-1:]])
            beside = BESIDE * contact.half_width
            begin += [np.append(place[0] - BESIDE * half[0], place[1:] - step), ends - beside]
            end += [np.append(place[:-1] + step, place[-1] + BESIDE * half[-1]), ends + beside]
            wanted = np.append(half / CELLS_ACROSS, np.full(len(ends), contact.half_width / CELLS_AT_ENDS))
        else:
            half = np.array([contact.half_width])
            middle = np.clip([height], low, high)
            begin.append(middle - half)
            end.append(middle + half)
            wanted = half / CELLS_ACROSS
        asked = np.full(len(wanted), resolution) if resolution else scale * wanted
        size.append(asked + np.log(GROWTH) * away)
    return np.concatenate(begin), np.concatenate(end), np.concatenate(size)


def cells_through(solid: CaseSolid) -> Array:
    """Least cells through a body along x, y and z, shape (3,)."""
    if solid.material.layers is None:
        return np.full(3, CELLS_THROUGH)
    return CELLS_THROUGH + (CELLS_ACROSS_LAYERS - CELLS_THROUGH) * solid.layer_normal**2


def bonded_group(solid: CaseSolid, solids: list[CaseSolid]) -> list[CaseSolid]:
    """A body and those bonded to it, directly or through others."""
    group = [solid]
    for one in group:
        group += [s for s in solids if s.body.name in one.bonded and s not in group]
    return group


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
        layers = None
        if m.layers is not None:
            also, normal = m.layers, np.tile(solid.layer_normal, (len(position), 1))
            layers = LayeredPoints(
                also.youngs_modulus * one, also.poisson_ratio * one, also.shear_modulus * one, normal
            )
        return MaterialConstants(m.density * one, m.youngs_modulus * one, m.poisson_ratio * one, layers)

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
