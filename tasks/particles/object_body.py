"""The object of the drop as a simulated body: rigid, soft, or soft with a rigid core.

The part of the object at each point.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.arrays import Array
from dcap.geometry.distance import Distance, MeshDistance, sampler
from dcap.geometry.pieces import is_closed
from dcap.geometry.solid.fill import fill
from dcap.geometry.solid.repair import simplified
from dcap.geometry.solid.repair import volume as mesh_volume
from dcap.scene.errors import GeometryError
from dcap.scene.types.materials import BodyModel, Material, PartMaterial
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.particles import (
    DistanceGrid,
    InertialProperties,
    RigidSimulationBody,
    SimulationBody,
    SoftSimulationBody,
)
from tasks.bodies.discretization import (
    distance_samples,
    inertial_of_material,
    inertial_of_points,
    inertial_of_solid,
    layer_normals,
    material_points,
    with_mass,
)
from tasks.bodies.footprint import Footprint, rigid_object_surface, soft_object_surface
from tasks.bodies.object_shape import ObjectShape
from tasks.bodies.soft_cells import Cells, Planes, nodes, thickness, uniform_cells
from tasks.bodies.solver_model import grid_of
from tasks.particles.drop_setup import OBJECT, RIGID_CONTRAST, DropSetup, constants_of_parts, friction_of_surface

SAMPLES = 220.0  # of the distance along the object's diagonal, if ParticlesConfig.object_distance_samples allow
SAMPLES_PER_CELL = 3.0  # least samples of the distance in a cell under the contact
MARGIN = 0.01  # the distance reaches this far beyond the object [m]
FILL_CELLS = 36  # cells along each side that fill a rigid object of several materials, for its mass
TOLD = 0.05  # relative deviation of a mass from the usual mass above which it is noted [-]
POINTS_ACROSS = 10.0  # edges across the footprint of a rigid object on a rigid base


def nearest_part(mesh: Mesh, part_of_face: NDArray[np.int32], points: Array) -> NDArray[np.int64]:
    """Part with the nearest surface for each point (n, 3), shape (n,)."""
    return part_of_face[MeshDistance(mesh).nearest_face(points)].astype(np.int64)


def part_at(mesh: Mesh, part_of_face: NDArray[np.int32], points: Array) -> NDArray[np.int64]:
    """Part of an object that each point belongs to, shape (n,): the smallest closed part around it, else the nearest
    part."""
    owner = nearest_part(mesh, part_of_face, points)
    parts = [(one, mesh.submesh(np.flatnonzero(part_of_face == one))) for one in np.unique(part_of_face).tolist()]
    closed = [(mesh_volume(piece), one, MeshDistance(piece)) for one, piece in parts if is_closed(piece)]
    if len(parts) > 1:
        for _, one, piece_field in sorted(closed, key=lambda c: -c[0]):
            owner[piece_field.inside(points)] = one
    return owner


@dataclass(frozen=True, eq=False, slots=True)
class ObjectBody:
    """The object to place."""

    body: SimulationBody
    cell: float
    """Its cell size [m]; for a rigid object the size that its contact points resolve."""


def object_body(setup: DropSetup, shape: ObjectShape, foot: Footprint, base_cell: float | None) -> ObjectBody:
    """The object to place, of the given `shape`, with contact points for its predicted contact and for cells of
    `base_cell` [m] in the base; None if the base is rigid."""
    instance = setup.item.instances[0]
    rows = setup.materials.of_parts(setup.body, len(instance.parts))
    part_of_face = np.clip(setup.item.face_part, 0, None)
    used = sorted(set(part_of_face.tolist()))
    setup.note_geometry(setup.body, [instance.parts[p].name for p in used], shape.report)
    size = float(np.linalg.norm(np.ptp(setup.mesh.vertices, axis=0)))
    edge = foot.small_side / POINTS_ACROSS if base_cell is None else base_cell
    spacing = min(edge / SAMPLES_PER_CELL, size / SAMPLES)
    most = setup.config.object_distance_samples
    grid = distance_samples(shape.solid, setup.mesh.bounds, spacing, margin=MARGIN, most=most)
    touching = rows[int(part_of_face[setup.descent.face_nearest])]
    if any(rows[p].model is BodyModel.MPM for p in used):
        return soft_object(setup, foot, rows, part_of_face, grid, touching.material)
    inertial = rigid_inertial(setup, rows, part_of_face, grid)
    surface = rigid_object_surface(simplified_item(setup), foot, edge, setup.config.object_faces)
    body = RigidSimulationBody(
        name=setup.body, instance=setup.body, fixed=False, distance=grid, inertial=inertial, surface=surface,
        friction=touching.material.friction,
        face_friction=friction_of_surface(rows, surface, setup.mesh, part_of_face),
    )  # fmt: skip
    return ObjectBody(body, edge)


def simplified_item(setup: DropSetup) -> Mesh:
    """The object's surface with no more vertices than contact needs."""
    mesh = simplified(setup.mesh, setup.config.contact_vertices)
    if mesh is not setup.mesh:
        setup.notes.append(
            f"{setup.body}: contact surface simplified from {len(setup.mesh.vertices)} to {len(mesh.vertices)} vertices"
        )
    return mesh


def rigid_inertial(
    setup: DropSetup, rows: list[PartMaterial], part_of_face: NDArray[np.int32], grid: DistanceGrid
) -> InertialProperties:
    """Mass, centre of mass and inertia of a rigid object."""
    densities = {rows[p].material.density for p in set(part_of_face.tolist())}
    if len(densities) == 1 and is_closed(setup.mesh):
        natural = inertial_of_solid(setup.mesh, densities.pop())
    else:
        position, volume = filled(grid)
        density = np.array([r.material.density for r in rows])[part_at(setup.mesh, part_of_face, position)]
        natural = inertial_of_points(position, volume * density)
    return natural.scaled_to(object_mass(setup, natural.mass))


def filled(grid: DistanceGrid) -> tuple[Array, Array]:
    """Points and volumes [m^3] that fill the solid of a distance grid."""
    count = np.minimum(np.array(grid.values.shape) - 1, FILL_CELLS)
    end = grid.origin + grid.spacing * (np.array(grid.values.shape) - 1)
    x, y, z = (np.linspace(grid.origin[a], end[a], count[a] + 1) for a in range(3))
    position, volume = fill((x, y, z), sampler(grid))
    if volume.sum() <= 0.0:
        raise GeometryError(
            f"the object encloses no volume at {1e3 * grid.spacing:.2g} mm: it is a sheet; give it a thickness"
        )
    return position, volume


def object_mass(setup: DropSetup, natural: float) -> float:
    """The object's mass [kg]: the given mass, or the usual mass of hollow things, else density times volume (`natural`)
    if that is plausible.
    """
    intent, trust = setup.intent, setup.config.mass_trust
    ratio = natural / intent.mass
    if not (intent.hollow or intent.mass_given) and 1.0 / trust <= ratio <= trust:
        if setup.body == OBJECT and abs(ratio - 1.0) > TOLD:
            setup.notes.append(
                f"object: weighs {natural:.3g} kg, its density times its volume, instead of {intent.mass:.3g} kg, "
                f"which is usual for its size; within a factor of {trust:g} the material counts (--mass overrides both)"
            )
        return natural
    if setup.body == OBJECT and abs(ratio - 1.0) > TOLD:  # a thing placed earlier keeps its mass
        setup.notes.append(
            f"object: density scaled by {1.0 / ratio:.3g} so that it weighs {intent.mass:.3g} kg, not {natural:.3g} kg"
        )
    return intent.mass


def soft_object(
    setup: DropSetup,
    foot: Footprint,
    rows: list[PartMaterial],
    part_of_face: NDArray[np.int32],
    grid: DistanceGrid,
    touching: Material,
) -> ObjectBody:
    """A soft object, possibly with a rigid core."""
    inside = sampler(grid)
    cells = object_cells(setup, foot, grid, inside)
    points = material_points(
        cells.planes, inside,
        lambda x: constants_of_parts(rows, part_at(setup.mesh, part_of_face, x), lambda: layer_normals(grid, x)),
        if_empty=f"{setup.body}: it encloses no volume at {1e3 * grid.spacing:.2g} mm: it is a sheet; give it a "
        "thickness",
    )  # fmt: skip
    points = with_mass(points, object_mass(setup, inertial_of_material(points).mass))
    setup.note_stiffness(setup.body, rows)
    surface = soft_object_surface(simplified_item(setup), setup.mesh.bounds, cells.size, setup.config.object_faces)
    body = SoftSimulationBody(
        name=setup.body, instance=setup.body, fixed=False, distance=grid, friction=touching.friction, surface=surface,
        face_friction=friction_of_surface(rows, surface, setup.mesh, part_of_face),
        inertial=inertial_of_material(points),
        points=points,
        grid=grid_of(cells.planes, core=core_nodes(setup, cells.planes, rows, part_of_face, inside)), loaded=False,
    )  # fmt: skip
    return ObjectBody(body, cells.size)


def object_cells(setup: DropSetup, foot: Footprint, grid: DistanceGrid, inside: Distance) -> Cells:
    """A uniform grid around a soft object; a note if there are fewer cells through thin parts than bending needs."""
    config, thin = setup.config, thickness(grid)
    contact = config.coarser * (config.cell or max(foot.half_width / config.least_cells_across, config.finest_cell))
    if config.uniform:
        thin = np.ptp(setup.mesh.bounds, axis=0)
    cells = uniform_cells(inside, setup.mesh.bounds, thin, contact, config.cells_through, config.object_cells)
    through = float(min(thin[a] / np.diff(cells.planes[a])[0] for a in range(3)))
    if through < config.least_cells_through:
        setup.notes.append(
            f"{setup.body}: only {through:.1f} cells through thin parts; {cells.count} cells of "
            f"{1e3 * cells.size:.2g} mm meet the budget of {config.object_cells} (ParticlesConfig.object_cells)"
        )
    return cells


def core_nodes(
    setup: DropSetup, planes: Planes, rows: list[PartMaterial], part_of_face: NDArray[np.int32], inside: Distance
) -> NDArray[np.bool_]:
    """Nodes inside rigid parts of a soft object: they move as one, if they span a volume."""
    point = nodes(planes)
    mask = np.zeros(len(point), dtype=bool)
    stiff = np.array([r.model is BodyModel.RIGID for r in rows])
    if stiff.any():
        within = np.flatnonzero(inside(point) < 0.0)
        core = within[stiff[part_at(setup.mesh, part_of_face, point[within])]]
        names = ", ".join(sorted({r.part for r in rows if r.model is BodyModel.RIGID}))
        spread = np.linalg.matrix_rank(point[core] - point[core].mean(axis=0), tol=1e-6) if len(core) > 3 else 0
        if spread == 3:
            mask[core] = True
            setup.notes.append(
                f"{setup.body}: {names} is a rigid core of {len(core)} nodes in a soft body; in cells shared with "
                f"the rest it is {RIGID_CONTRAST:g} times as stiff as the softest part"
            )
        else:
            setup.notes.append(
                f"{setup.body}: {names} is smaller than a cell and only stiffens it, to {RIGID_CONTRAST:g} times the "
                "softest part"
            )
    return mask.reshape([len(p) for p in planes])
