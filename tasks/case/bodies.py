"""Builds the bodies of a physics case like those of a placement: fine at the contact, graded away from it."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dcap.arrays import Array
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
from tasks.bodies.discretization import MaterialConstants, distance_samples, material_points, with_mass
from tasks.bodies.plan_contact import within_any
from tasks.bodies.soft_cells import (
    Cells,
    Planes,
    WantedCells,
    cells_within,
    wanted_at_edges,
    wanted_in_height,
    wanted_in_plan,
)
from tasks.bodies.solver_model import grid_of, nodes_at_faces
from tasks.case.contacts import PredictedContact, predicted_contacts
from tasks.case.file import Case
from tasks.case.solid import CaseSolid

RIGID_CELLS = 25.0  # cells along the smallest side if nothing is soft: spacing of surface points
CELLS_THROUGH = 4.0  # least cells through a body along each axis
# and across layers: n cells of constant slip have (1 - 1 / n^2) of the parabola's second moment, so a body that deforms
# by slip alone is 1.5 % too stiff with eight cells and 6 % with four
CELLS_ACROSS_LAYERS = 8.0
BUDGET = 30_000  # most cells of one soft body, unless a resolution was requested
MOST_MARGIN = 0.02  # a signed distance reaches this far beyond the body [m], half its thickness for small ones
MOST_SAMPLES = 250.0  # most samples of a signed distance along its longest side: 16 million in a cube
SHARP_SAMPLES = 8_000_000  # most samples of a signed distance if sharp edges need more: 32 MB
ROUNDED = 1e-4  # edges that samples round off by more than this are sharp [m]
MOST_CELLS = 200_000  # most cells of one soft body; more would take longer than a user expects
"""Limit behind the advice to raise --resolution."""


def case_particles(case: Case, folder: Path, resolution: float | None, ended: Case | None = None) -> Particles:
    """The simulation input of a case, with the smallest cell at a contact [m]; cells of fixed bodies are also fine at
    the places where other bodies came to rest in `ended`."""
    solids, contacts = foreseen(case, folder)
    later = [] if ended is None else foreseen(ended, folder)[1]
    grids = [
        None if s.rigid else soft_grid(s, solids, contacts + later if s.fixed else contacts, resolution) for s in solids
    ]
    finest = min([g.size for g in grids if g is not None] or [min(s.smallest for s in solids) / RIGID_CELLS])
    bodies = tuple(case_body(s, g, finest, contacts + later) for s, g in zip(solids, grids, strict=True))
    pairs = tuple((p.a, p.b, p.static_friction, p.dynamic_friction) for p in case.friction_pairs)
    return Particles(bodies, pairs, finest, tuple(repair for solid in solids for repair in solid.repairs))


def foreseen(case: Case, folder: Path) -> tuple[list[CaseSolid], list[PredictedContact]]:
    """The bodies at their start, and the predicted contacts between them."""
    solids = [CaseSolid(body, folder, _bonded_to(body.name, case.bonds)) for body in case.bodies]
    return solids, predicted_contacts(solids, float(np.linalg.norm(case.gravity)))


def case_body(solid: CaseSolid, grid: Cells | None, finest: float, contacts: list[PredictedContact]) -> SimulationBody:
    """One body, soft with a grid of cells; `finest` is the smallest cell of all [m]."""
    planes = None if grid is None else grid.planes
    surface = solid.surface(planes, finest if grid is None else grid.size)
    distance = sampled_distance(solid, surface, finest, contacts)
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
    """The cells of a soft body: fine at predicted contacts, or of `resolution` [m] there; coarser if that
    exceeds the budget of cells, unless a resolution was requested. The remaining budget goes to cells at edges."""
    joined = {one.body.name for one in bonded_group(solid, solids)}
    felt = [c for c in contacts if joined & c.names]

    def wanted(scale: float) -> list[WantedCells]:
        return [wanted_along(solid, axis, felt, resolution, scale) for axis in range(3)]

    def with_edges(edge_scale: float) -> list[WantedCells]:
        return [wanted_along(solid, axis, felt, None, 1.0, edge_scale) for axis in range(3)]

    box = np.stack([solid.low, solid.high])
    cells, scale = cells_within(box, wanted, all_cells, None if resolution else BUDGET)
    if not resolution:
        return cells if scale > 1.0 else cells_within(box, with_edges, all_cells, BUDGET)[0]
    if cells.count > MOST_CELLS:
        raise InputError(
            f"body {solid.body.name!r}: {cells.count:.3g} cells of {1e3 * cells.size:.2g} mm > {MOST_CELLS}; "
            "raise --resolution"
        )
    return cells


def all_cells(planes: Planes) -> int:
    """Number of cells between planes."""
    return int(np.prod([len(p) - 1 for p in planes], dtype=np.float64))


def wanted_along(
    solid: CaseSolid,
    axis: int,
    felt: list[PredictedContact],
    resolution: float | None,
    scale: float,
    edge_scale: float = np.inf,
) -> WantedCells:
    """Return the largest cells along an axis: through the body, where contacts are felt, and where these end at an
    edge. `scale` and, at edges, `edge_scale` multiply the sizes; inf: no cells for edges."""
    low, high = float(solid.low[axis]), float(solid.high[axis])
    least = cells_through(solid)
    through = (high - low) / least[axis] if felt else scale * (resolution or min(solid.extent / least))
    found = [WantedCells(np.array([low]), np.array([high]), np.array([through]))]
    for contact in felt:
        height = contact.height_on(solid)
        away = max(float(solid.low[2]) - height, height - float(solid.high[2]), 0.0)
        if axis < 2:
            wanted = wanted_in_plan(contact.plan, axis)
        else:
            middle = float(np.clip(height, low, high))
            wanted = wanted_in_height(contact.plan, middle, middle)
        found.append(wanted.resized(size=resolution, scale=scale, away=away))
        if axis < 2 and np.isfinite(edge_scale):
            found.append(wanted_at_edges(contact.plan, axis).resized(scale=edge_scale, away=away))
    return WantedCells.joined(found)


def cells_through(solid: CaseSolid) -> Array:
    """Least number of cells through a body along x, y and z, shape (3,)."""
    if solid.material.layers is None:
        return np.full(3, CELLS_THROUGH)
    return CELLS_THROUGH + (CELLS_ACROSS_LAYERS - CELLS_THROUGH) * solid.layer_normal**2


def bonded_group(solid: CaseSolid, solids: list[CaseSolid]) -> list[CaseSolid]:
    """A body and the bodies bonded to it, directly or through others."""
    group = [solid]
    for one in group:
        group += [s for s in solids if s.body.name in one.bonded and s not in group]
    return group


def sampled_distance(solid: CaseSolid, surface: Mesh, finest: float, contacts: list[PredictedContact]) -> DistanceGrid:
    """Return samples of the signed distance as fine as the contact needs, out to the reach of other bodies.
    Interpolation between samples rounds off sharp edges, so a body whose edges may be pressed on has finer samples."""
    distance, least = solid.distance(surface), min(0.5 * solid.smallest, MOST_MARGIN)
    longest = float(solid.extent.max()) + 2.0 * least
    spacing = max(min(finest / 2.5, solid.smallest / 24.0), longest / MOST_SAMPLES)
    grid = distance_samples(distance, solid.box, spacing, margin=max(4.0 * spacing, least))
    if np.abs(sampler(grid)(touched_vertices(solid, surface, contacts))).max(initial=0.0) <= ROUNDED:
        return grid
    finer = spacing * (grid.values.size / SHARP_SAMPLES) ** (1.0 / 3.0)
    return grid if finer > spacing else distance_samples(distance, solid.box, finer, margin=max(4.0 * finer, least))


def touched_vertices(solid: CaseSolid, surface: Mesh, contacts: list[PredictedContact]) -> Array:
    """Return the vertices on which other bodies may press [m], shape (n, 3): all of a moving body, else those at
    predicted contacts."""
    if not solid.fixed:
        return surface.vertices
    boxes = [one.plan.boxes for one in contacts if solid.body.name in one.names]
    return surface.vertices[within_any(surface.vertices, np.concatenate([np.zeros((0, 2, 2)), *boxes]))]


def uniform_points(solid: CaseSolid, planes: Planes, distance: DistanceGrid, mass: float) -> MaterialPoints:
    """Points of one material that weigh `mass` [kg], inside the exact distance of a primitive, or the sampled distance
    of a mesh."""
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
    """The grid of a soft body; a fixed body is held at its clamped faces."""
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
    """Names of the bodies bonded to a body."""
    return frozenset(one for bond in bonds if name in bond for one in bond if one != name)
