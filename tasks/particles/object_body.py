"""The object of the drop as a simulated body: rigid, soft, or soft with a rigid core."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.distance import Distance, MeshDistance, sampler
from dcap.geometry.solid.boundary import is_closed
from dcap.geometry.solid.closed import Allowed, enclosed, is_sheet, tidied, used_as_given, with_faces_kept
from dcap.geometry.solid.fill import fill
from dcap.geometry.solid.repair import mass_properties, outer_faces, simplified, subdivide_near
from dcap.geometry.solid.repair import volume as mesh_volume
from dcap.geometry.solid.repairs_done import Done
from dcap.scene.errors import GeometryError
from dcap.scene.types.materials import BodyModel, Material, PartMaterial
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.particles import DistanceGrid, SimulationBody
from dcap.scene.types.repair_report import RepairReport
from tasks.bodies.footprint import Footprint
from tasks.bodies.soft_cells import Cells, nodes, thickness, uniform_cells
from tasks.particles.scenario import (
    CORE,
    FREE,
    Scenario,
    body_grid,
    constants,
    moments,
    note_friction,
    note_geometry,
    rigid_body,
)

Array = NDArray[np.float64]

UNMOVED = 1e-4  # what can be seen of an object may move this far [m]: contact points are its given faces
SAMPLES = 220.0  # of the distance along the object's diagonal, if ParticlesConfig.object_distance_samples allow
LEAST_EDGE = 2e-3  # contact points are never refined beyond this [m]


def object_body(s: Scenario, foot: Footprint, contact_cell: float, on_soft: bool) -> tuple[SimulationBody, float]:
    """The thing to place and its cell size [m] (a rigid one: the size that its contact points resolve)."""
    instance = s.item.instances[0]
    rows = s.rows("object", len(instance.parts))
    part_of_face = np.clip(s.item.face_part, 0, None)
    used = sorted(set(part_of_face.tolist()))
    rigid = all(rows[p].model is BodyModel.RIGID for p in used)
    size = float(np.linalg.norm(np.ptp(s.mesh.vertices, axis=0)))
    solid, report = solid_of(s.mesh)
    note_geometry(s, "object", [instance.parts[p].name for p in used], report)
    spacing = min(contact_cell / 3.0, size / SAMPLES)
    grid = body_grid(solid, s.mesh.bounds, spacing, 0.01, s.config.object_distance_samples)
    touching = rows[int(part_of_face[foot.face_nearest])]
    note_friction(s, "object", touching, len(used))
    if rigid:
        mass, center, inertia = rigid_mass(s, rows, part_of_face, grid)
        surface = contact_surface(s, foot, contact_cell if on_soft else foot.small_side / 10.0)
        body = rigid_body("object", "object", False, surface, grid, touching.material)
        return replace(body, mass=mass, center_of_mass=center, inertia=inertia), contact_cell
    return soft_object(s, foot, rows, part_of_face, grid, touching.material)


def contact_surface(s: Scenario, foot: Footprint, cell: float) -> Mesh:
    """Surface of a rigid object: edges of about `cell` [m] where it will touch, no more points than contact needs."""
    mesh = simplified_item(s)
    margin = 0.3 * (foot.high - foot.low) + foot.depth
    region = foot.wider + np.stack([-margin, margin])
    return subdivide_near(mesh, region, max(cell, foot.small_side / 24.0, LEAST_EDGE))


def simplified_item(s: Scenario) -> Mesh:
    """The object's surface with as many vertices as contact needs."""
    mesh = simplified(s.mesh, s.config.contact_vertices)
    if mesh is not s.mesh:
        s.notes.append(
            f"object: contact surface simplified from {len(s.mesh.vertices)} to {len(mesh.vertices)} vertices"
        )
    return mesh


def rigid_mass(
    s: Scenario, rows: list[PartMaterial], part_of_face: NDArray[np.int32], grid: DistanceGrid
) -> tuple[float, Array, Array]:
    """Mass [kg], centre of mass [m] and inertia [kg m^2] of a rigid object."""
    densities = {rows[p].material.density for p in set(part_of_face.tolist())}
    if len(densities) == 1 and is_closed(s.mesh):
        natural, center, inertia = mass_properties(s.mesh, densities.pop())
    else:
        position, volume = filled(grid)
        density = np.array([r.material.density for r in rows])[part_at(s.mesh, part_of_face, position)]
        natural, center, inertia = moments(position, volume * density)
    mass = authoritative_mass(s, natural)
    return mass, center, inertia * (mass / natural)


def filled(grid: DistanceGrid) -> tuple[Array, Array]:
    """Points and volumes [m^3] that fill the solid of a distance grid."""
    count = np.minimum(np.array(grid.values.shape) - 1, 36)
    end = grid.origin + grid.spacing * (np.array(grid.values.shape) - 1)
    x, y, z = (np.linspace(grid.origin[a], end[a], count[a] + 1) for a in range(3))
    position, volume = fill((x, y, z), sampler(grid))
    if volume.sum() <= 0.0:
        raise GeometryError(
            f"the object encloses no volume at {1e3 * grid.spacing:.2g} mm: it is a sheet; give it a thickness"
        )
    return position, volume


def authoritative_mass(s: Scenario, natural: float) -> float:
    """The object's mass [kg]: what was given or is usual for hollow things, else density times volume if that is
    plausible.
    """
    ratio = natural / s.intent.mass
    if not (s.intent.hollow or s.intent.mass_given) and 1.0 / s.config.mass_trust <= ratio <= s.config.mass_trust:
        return natural
    s.notes.append(
        f"object: density scaled by {1.0 / ratio:.3g} so that it weighs {s.intent.mass:.3g} kg, not {natural:.3g} kg"
    )
    return s.intent.mass


def soft_object(
    s: Scenario,
    foot: Footprint,
    rows: list[PartMaterial],
    part_of_face: NDArray[np.int32],
    grid: DistanceGrid,
    touching: Material,
) -> tuple[SimulationBody, float]:
    """A soft object, possibly with a rigid core, and its cell size [m]."""
    distance = sampler(grid)
    contact = s.config.cell or max(foot.radius / s.config.least_cells_per_radius, s.config.finest_cell)
    thin = thickness(grid)
    cells = uniform_cells(distance, s.mesh.bounds, thin, contact, s.config.cells_through, s.config.object_cells)
    through = float(min(thin[a] / np.diff(cells.planes[a])[0] for a in range(3)))
    if through < s.config.least_cells_through:
        s.notes.append(
            f"object: only {through:.1f} cells through thin parts; {cells.count} cells of {1e3 * cells.size:.2g} mm "
            f"meet the budget of {s.config.object_cells} (ParticlesConfig.object_cells)"
        )
    position, volume = fill(cells.planes, distance)
    part = part_at(s.mesh, part_of_face, position)
    density, stiffness, poisson = constants(rows, part)
    natural, _, _ = moments(position, volume * density)
    density = density * (authoritative_mass(s, natural) / natural)
    mass, center, inertia = moments(position, volume * density)
    edge = max(cells.size, float(np.ptp(s.mesh.vertices, axis=0).max()) / 100.0)
    surface = subdivide_near(simplified_item(s), s.mesh.bounds, edge)
    body = rigid_body("object", "object", False, surface, grid, touching)
    return replace(
        body, rigid=False, mass=mass, center_of_mass=center, inertia=inertia, particle_position=position,
        particle_volume=volume, particle_density=density, particle_youngs_modulus=stiffness,
        particle_poisson_ratio=poisson, grid_x=cells.planes[0], grid_y=cells.planes[1], grid_z=cells.planes[2],
        node_held=core_nodes(s, cells, rows, part_of_face, distance),
    ), cells.size  # fmt: skip


def core_nodes(
    s: Scenario,
    cells: Cells,
    rows: list[PartMaterial],
    part_of_face: NDArray[np.int32],
    distance: Distance,
) -> NDArray[np.int8]:
    """Nodes inside rigid parts of a soft object: they move as one."""
    point = nodes(cells.planes)
    state = np.full(len(point), FREE, dtype=np.int8)
    stiff = np.array([r.model is BodyModel.RIGID for r in rows])
    inside = np.flatnonzero(distance(point) < 0.0)
    if stiff.any():
        core = inside[stiff[part_at(s.mesh, part_of_face, point[inside])]]
        names = ", ".join(sorted({r.part for r in rows if r.model is BodyModel.RIGID}))
        spread = np.linalg.matrix_rank(point[core] - point[core].mean(axis=0), tol=1e-6) if len(core) > 3 else 0
        if spread == 3:
            state[core] = CORE
            s.notes.append(f"object: {names} is a rigid core of {len(core)} nodes in a soft body")
        else:
            s.notes.append(f"object: {names} is smaller than a cell and only stiffens it")
    return state.reshape([len(p) for p in cells.planes])


def part_at(mesh: Mesh, part_of_face: NDArray[np.int32], points: Array) -> NDArray[np.int64]:
    """Part of an object that each point belongs to, shape (n,): the smallest closed one around it, else the nearest."""
    owner = part_of_face[MeshDistance(mesh).nearest_face(points)].astype(np.int64)
    parts = [(one, mesh.submesh(np.flatnonzero(part_of_face == one))) for one in np.unique(part_of_face).tolist()]
    closed = [(mesh_volume(piece), one, MeshDistance(piece)) for one, piece in parts if is_closed(piece)]
    if len(parts) > 1:
        for _, one, piece_field in sorted(closed, key=lambda c: -c[0]):
            owner[piece_field.inside(points)] = one
    return owner


def solid_of(mesh: Mesh) -> tuple[MeshDistance, RepairReport]:
    """Signed distance to the object as one solid, and what that took: faces of its pieces inside one another do not
    count.
    """
    allowed, done = Allowed(tolerance=UNMOVED), Done()
    given = tidied(mesh, None, done)
    field = MeshDistance(mesh)
    if is_closed(mesh):
        outer = mesh.submesh(outer_faces(mesh))
        field = MeshDistance(outer, sides=mesh) if len(outer.faces) else field
    as_given = used_as_given(field, given, Allowed(), done.copy())
    sheet = any(is_sheet(piece) for piece in given.pieces)  # its contact points have one side only
    if sheet or (field.closed and not as_given.problem):
        return field, as_given
    found = with_faces_kept(given, enclosed(given, allowed), allowed, done)
    return (MeshDistance(found[0]), found[1]) if found is not None and not found[1].problem else (field, as_given)
