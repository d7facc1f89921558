"""Stage 7, particles: from meshes, a pose and materials to everything the drop simulates.

In: the segmented scene and object, the intent (mass), the pre-drop pose and the material of every part. Out:
`Particles`: the object, the base within a crop around it (its soft parts one bonded body, its rigid parts another)
and the neighbours in reach as obstacles. Every crop, cap and treatment is named in the notes.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, NonNegativeFloat, PositiveFloat, PositiveInt

from geometry.boundary import is_closed
from geometry.distance import Distance, MeshDistance, sampled, sampler
from geometry.fill import fill
from geometry.raycast import Raycaster
from geometry.repair import mass_properties, outer_faces, simplified, subdivide_near
from geometry.repair import volume as mesh_volume
from geometry.support import carried_bottoms, shell_bottoms, support_solid
from scene.anchor import Anchor
from scene.errors import GeometryError
from scene.intent import Intent
from scene.materials import Material, Model, PartMaterial, PartMaterials
from scene.mesh import Mesh
from scene.outcome import Infeasible
from scene.particles import DistanceGrid, Particles, SimulationBody
from scene.segmentation import Instance, Segmentation
from tasks.footprint import GRAVITY, Footprint, predicted_footprint
from tasks.soft_cells import Cells, graded_cells, nodes, thickness, uniform_cells
from tasks.stage import stage

Array = NDArray[np.float64]

FREE, HELD, CORE = 0, 1, 2  # states of grid nodes, as in scene.particles
RIGID_MODULUS = 2e11  # Young's modulus [Pa] that stands for a rigid part in the predicted contact
CORE_STIFFNESS = (
    100.0  # rigid material inside a soft body is at most this many times stiffer than its softest: conditioning
)
REACH_BELOW = 0.12  # how far below the predicted contact fields are sampled [m]: deeper than any dent
LEAST_EDGE = 2e-3  # contact points are never refined beyond this [m]
SOFT_REACH = 0.05  # soft parts of the base farther than this [m] from the object's box are not dented
REACH_ABOVE = 0.03  # above the object's top [m]
EMPTY = np.zeros((0, 3))


class ParticlesConfig(BaseModel, frozen=True, extra="forbid"):
    """What is simulated and how finely."""

    crop_margin: PositiveFloat = 0.75
    """The base is cut this far around the object, in units of its larger horizontal side [-]."""
    least_crop_margin: PositiveFloat = 0.15
    """... but at least this far [m]."""
    cells_per_radius: PositiveFloat = 6.0
    """Cells across the predicted contact radius (section 6: about a sixth)."""
    least_cells_per_radius: PositiveFloat = 4.0
    """Cells are never coarser than this many per contact radius without a note."""
    cells_per_side: PositiveFloat = 7.0
    """Cells across the shorter side of an extended footprint."""
    coarsest_cell: PositiveFloat = 0.025
    """Largest cell under an extended footprint [m]."""
    finest_cell: PositiveFloat = 0.0015
    """Smallest cell under the contact [m]: what a picture can show."""
    cells_through: PositiveInt = 4
    """Cells through the thinnest dimension of a soft object."""
    least_cells_through: PositiveFloat = 3.0
    """Fewer are named in a note."""
    object_cells: PositiveInt = 2500
    """Budget of cells of a soft object."""
    base_cells: PositiveInt = 7000
    """Budget of cells of the base."""
    particle_limit: PositiveInt = 250_000
    """More particles than this are refused."""
    distance_samples: PositiveInt = 1_000_000
    """Budget of samples per distance grid."""
    hold_distance: NonNegativeFloat = 2e-3
    """Soft nodes nearer than this to a rigid part of the base are bonded to it [m]."""
    hole_perimeter: NonNegativeFloat = 0.25
    """Holes of a support's surface up to this perimeter are closed [m]."""
    layer: PositiveFloat = 0.02
    """Depth to which a thin part (a blanket) is made of its own material; below is what carries it [m]."""
    least_thickness: PositiveFloat = 0.04
    """A soft part seen only as a sheet is at least this thick [m]."""
    mass_trust: PositiveFloat = 1.5
    """Density times volume counts for solid things while it is within this factor of the usual mass [-]."""
    shell: PositiveFloat = 0.03
    """Thickness of a rigid sheet [m]."""
    contact_vertices: PositiveInt = 6000
    """Contact points of the object; a finer mesh is simplified for the drop, pictures keep the fine one."""


@dataclass(eq=False, slots=True)
class Scenario:
    """The inputs together, with what several bodies need."""

    scene: Segmentation
    item: Segmentation
    intent: Intent
    anchor: Anchor
    materials: PartMaterials
    config: ParticlesConfig
    mesh: Mesh
    """The object at its pre-drop pose."""
    base_index: int
    crop: Array
    """Region of the base that takes part [m], shape (2, 3)."""
    notes: list[str] = field(default_factory=list)

    @property
    def base(self) -> Instance:
        """The instance to place on."""
        return self.scene.instances[self.base_index]

    def rows(self, body: str, count: int) -> list[PartMaterial]:
        """Materials of all parts of a body."""
        return [self.materials.of(body, index) for index in range(count)]


def particles(
    scene: Segmentation,
    item: Segmentation,
    intent: Intent,
    anchor: Anchor,
    materials: PartMaterials,
    config: ParticlesConfig,
) -> Particles | Infeasible:
    """Build every body of the drop."""
    s = scenario(scene, item, intent, anchor, materials, config)
    foot = footprint(s)
    base = base_bodies(s, foot)
    contact_cell = base.cell if base.soft is not None else cell_wanted(foot, config)
    item_body, item_cell = object_body(s, foot, contact_cell, base.soft is not None)
    resolution = base.cell if base.soft is not None else item_cell
    bodies = [item_body, *base.bodies, *neighbours(s, foot)]
    note_overlaps(s, bodies)
    total = sum(len(b.particle_volume) for b in bodies)
    if total > config.particle_limit:
        raise GeometryError(
            f"{total} particles > {config.particle_limit}; lower ParticlesConfig.object_cells ({config.object_cells}) "
            f"or base_cells ({config.base_cells}), or raise particle_limit"
        )
    return Particles(tuple(bodies), (), resolution, tuple(s.notes))


def scenario(
    scene: Segmentation,
    item: Segmentation,
    intent: Intent,
    anchor: Anchor,
    materials: PartMaterials,
    config: ParticlesConfig,
) -> Scenario:
    """Put the object at its pre-drop pose and cut the region of the base out."""
    mesh = item.mesh.transformed(anchor.world_from_object)
    low, high = mesh.bounds
    margin = max(config.crop_margin * float((high - low)[:2].max()), config.least_crop_margin)
    crop = np.stack([low - margin, high + margin])
    s = Scenario(scene, item, intent, anchor, materials, config, mesh, scene.index_of(anchor.base_id), crop)
    s.notes.append(f"{anchor.base_id} is cut {margin:.2f} m around the object and clamped at the cut")
    return s


def footprint(s: Scenario) -> Footprint:
    """The predicted contact of the object with what lies beneath it."""
    base_faces = np.flatnonzero(s.scene.face_instance == s.base_index)
    row = s.materials.of(s.anchor.base_id, s.anchor.part_index)
    softest = min(s.rows("object", len(s.item.instances[0].parts)), key=lambda r: modulus(r))
    compliance = sum((1.0 - r.material.poisson_ratio**2) / modulus(r) for r in (row, softest))
    return predicted_footprint(
        s.mesh, Raycaster(s.scene.mesh.submesh(base_faces)), s.intent.mass * GRAVITY, compliance,
        float(s.anchor.surface_point[2]),
    )  # fmt: skip


def modulus(row: PartMaterial) -> float:
    """Young's modulus that counts in a predicted contact [Pa]."""
    return RIGID_MODULUS if row.model is Model.RIGID else row.material.youngs_modulus


def cell_wanted(foot: Footprint, config: ParticlesConfig) -> float:
    """Cell size under the contact [m]."""
    if foot.flat:
        cell = min(foot.small_side / config.cells_per_side, config.coarsest_cell)
    else:
        cell = foot.radius / config.cells_per_radius
    return float(np.clip(cell, config.finest_cell, config.coarsest_cell))


# --- object -----------------------------------------------------------------------------------------------------------


def object_body(s: Scenario, foot: Footprint, contact_cell: float, on_soft: bool) -> tuple[SimulationBody, float]:
    """The thing to place and its cell size [m] (a rigid one: the size that its contact points resolve)."""
    instance = s.item.instances[0]
    rows = s.rows("object", len(instance.parts))
    part_of_face = np.clip(s.item.face_part, 0, None)
    used = sorted(set(part_of_face.tolist()))
    rigid = all(rows[p].model is Model.RIGID for p in used)
    size = float(np.linalg.norm(np.ptp(s.mesh.vertices, axis=0)))
    solid = solid_of(s.mesh)
    grid = body_grid(solid, s.mesh.bounds, min(contact_cell / 3.0, size / 140.0), 0.01, s.config)
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
    reach = 0.3 * (foot.high - foot.low) + foot.depth
    region = np.stack([foot.low - reach, foot.high + reach])
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


def moments(position: Array, mass: Array) -> tuple[float, Array, Array]:
    """Total mass, centre and inertia about it of point masses."""
    total = float(mass.sum())
    center = mass @ position / total
    arm = position - center
    second = np.einsum("i,ij,ik->jk", mass, arm, arm)
    return total, center, np.trace(second) * np.eye(3) - second


def authoritative_mass(s: Scenario, natural: float) -> float:
    """The object's mass [kg]: what was given or is usual for hollow things, else density times volume if that is
    plausible.
    """
    given = any(note.startswith("mass") and note.endswith("was given") for note in s.intent.notes)
    ratio = natural / s.intent.mass
    if not (s.intent.hollow or given) and 1.0 / s.config.mass_trust <= ratio <= s.config.mass_trust:
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
    contact = max(foot.radius / s.config.least_cells_per_radius, s.config.finest_cell)
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
    stiff = np.array([r.model is Model.RIGID for r in rows])
    inside = np.flatnonzero(distance(point) < 0.0)
    if stiff.any():
        core = inside[stiff[part_at(s.mesh, part_of_face, point[inside])]]
        names = ", ".join(sorted({r.part for r in rows if r.model is Model.RIGID}))
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


def solid_of(mesh: Mesh) -> MeshDistance:
    """Signed distance to the object as one solid: faces of its pieces inside one another do not count."""
    if not is_closed(mesh):
        return MeshDistance(mesh)
    outer = mesh.submesh(outer_faces(mesh))
    return MeshDistance(outer, sides=mesh) if len(outer.faces) else MeshDistance(mesh)


def constants(rows: list[PartMaterial], part: NDArray[np.integer]) -> tuple[Array, Array, Array]:
    """Density, Young's modulus and Poisson ratio of particles that belong to the given parts."""
    soft = [r.material.youngs_modulus for r in rows if r.model is Model.MPM]
    most = CORE_STIFFNESS * min(soft)
    table = np.array(
        [(r.material.density, min(r.material.youngs_modulus, most), r.material.poisson_ratio) for r in rows]
    )
    density, stiffness, poisson = table[part].T
    return density.copy(), stiffness.copy(), poisson.copy()


# --- base -------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False, slots=True)
class Base:
    """The bodies of the base instance."""

    soft: SimulationBody | None
    rigid: SimulationBody | None
    cell: float
    """Cell size under the contact, 0 without a soft part [m]."""

    @property
    def bodies(self) -> list[SimulationBody]:
        """Those that there are."""
        return [b for b in (self.soft, self.rigid) if b is not None]


def base_bodies(s: Scenario, foot: Footprint) -> Base:
    """Soft parts as one bonded body, rigid parts as another; both fixed."""
    rows = s.rows(s.anchor.base_id, len(s.base.parts))
    faces = near_faces(s, s.base_index, 0.1)
    if len(faces) == 0:
        raise GeometryError(
            f"{s.anchor.base_id} has no surface within {s.config.crop_margin} object sizes of the object; "
            "raise ParticlesConfig.crop_margin"
        )
    part = np.clip(s.scene.face_part[faces], 0, None)
    stiff = np.array([r.model is Model.RIGID for r in rows])[part] | ~soft_in_reach(s, foot, rows, faces, part)
    solid = None
    if stiff.any():
        mesh = s.scene.mesh.submesh(faces[stiff])
        own = np.array([p.box.bottom for p in s.base.parts])[part[stiff]]
        solid = support_solid(mesh, shell_bottoms(mesh, own, s.config.shell), s.crop, s.config.hole_perimeter)
    soft, cell = None, 0.0
    if not stiff.all():
        soft, cell = soft_base(s, foot, rows, faces[~stiff], part[~stiff], solid)
    rigid = None if solid is None else rigid_base(s, foot, rows, faces[stiff], part[stiff], solid)
    if soft is None and rigid is None:
        raise GeometryError(f"{s.anchor.base_id} has no surface beneath the object; raise ParticlesConfig.crop_margin")
    return Base(soft, rigid, cell)


def soft_in_reach(
    s: Scenario, foot: Footprint, rows: list[PartMaterial], faces: NDArray[np.int64], part: NDArray[np.int32]
) -> NDArray[np.bool_]:
    """Whether the soft parts, taken together, come so near to the object that they may be dented, shape (m,)."""
    soft = np.array([r.model is Model.MPM for r in rows])[part]
    low, high = s.mesh.bounds + np.array([[-SOFT_REACH], [SOFT_REACH]])
    low[2] = s.mesh.bounds[0, 2] - foot.gap - REACH_BELOW
    corner = s.scene.mesh.triangles[faces[soft]]
    if ((corner.max(axis=1) >= low) & (corner.min(axis=1) <= high)).all(axis=1).any():
        return np.ones(len(faces), dtype=bool)
    if soft.any():
        names = ", ".join(sorted({rows[p].part for p in part[soft].tolist()}))
        s.notes.append(f"{s.anchor.base_id}: {names}, out of the object's reach, is treated as rigid")
    return np.zeros(len(faces), dtype=bool)


def rigid_base(
    s: Scenario,
    foot: Footprint,
    rows: list[PartMaterial],
    faces: NDArray[np.int64],
    part: NDArray[np.int32],
    solid: MeshDistance,
) -> SimulationBody | None:
    """The rigid parts of the base in reach as one obstacle."""
    kept = in_reach(s, s.scene.mesh.triangles[faces], foot)
    if not kept.any():
        return None
    there = set(part[kept].tolist())
    main = main_row(s, [r for r in rows if r.part_index in there], part[kept])
    name = f"{s.anchor.base_id}/rigid"
    note_friction(s, name, main, len(there))
    return obstacle(s, foot, name, s.anchor.base_id, s.scene.mesh.submesh(faces[kept]), solid, main.material)


def near_faces(s: Scenario, instance: int, margin: float) -> NDArray[np.int64]:
    """Faces of an instance whose plan reaches into the crop grown by `margin` [m]."""
    faces = np.flatnonzero(s.scene.face_instance == instance)
    corner = s.scene.mesh.triangles[faces][:, :, :2]
    low, high = s.crop[0, :2] - margin, s.crop[1, :2] + margin
    return np.asarray(faces[((corner.max(axis=1) >= low) & (corner.min(axis=1) <= high)).all(axis=1)])


def reach_box(s: Scenario, foot: Footprint) -> Array:
    """Where the object may touch anything [m], shape (2, 3): the crop, cut in height to the object's own way."""
    top, lowest = float(s.mesh.bounds[1, 2]), float(s.mesh.bounds[0, 2])
    box = s.crop.copy()
    box[:, 2] = lowest - foot.gap - REACH_BELOW, top + REACH_ABOVE
    return box


def in_reach(s: Scenario, triangles: Array, foot: Footprint) -> NDArray[np.bool_]:
    """Which triangles (n, 3, 3) reach into the box where the object may touch."""
    low, high = reach_box(s, foot)
    inside = (triangles.max(axis=1) >= low) & (triangles.min(axis=1) <= high)
    return np.asarray(inside.all(axis=1))


def main_row(s: Scenario, rows: list[PartMaterial], part: NDArray[np.integer]) -> PartMaterial:
    """The part under the anchor if it is among the rows, else the one with most faces."""
    for row in rows:
        if row.part_index == s.anchor.part_index:
            return row
    return max(rows, key=lambda r: (int((part == r.part_index).sum()), -r.part_index))


def soft_base(
    s: Scenario,
    foot: Footprint,
    rows: list[PartMaterial],
    faces: NDArray[np.int64],
    part: NDArray[np.int32],
    rigid: MeshDistance | None,
) -> tuple[SimulationBody, float]:
    """All soft parts of the base within the crop as one fixed body, and its cell size at the contact [m]."""
    mesh = s.scene.mesh.submesh(faces)
    bottom = soft_bottoms(s, rows, mesh, part)
    solid = support_solid(mesh, bottom, s.crop, s.config.hole_perimeter)
    box, cut = soft_box(s, solid)
    grid = body_grid(solid, box, 2.0 * s.config.finest_cell, 0.01, s.config)
    distance = sampler(grid)
    cells = base_cells(s, foot, distance, box)
    position, volume = fill(cells.planes, distance)
    if len(position) == 0:
        raise GeometryError(f"{s.anchor.base_id}: no solid beneath the object; raise ParticlesConfig.least_thickness")
    owner = owners(s, rows, mesh, part, position)
    density, stiffness, poisson = constants(rows, owner)
    held = held_nodes(s, cells, cut, bottom, part, rigid)
    main = main_row(s, [r for r in rows if r.model is Model.MPM], part)
    note_friction(s, s.anchor.base_id, main, len(set(part.tolist())))
    surface = base_surface(s, foot, mesh, box, cells.size)
    contact_box = np.stack([np.maximum(box[0], reach_box(s, foot)[0]), np.minimum(box[1], reach_box(s, foot)[1])])
    near = body_grid(solid, contact_box, cells.size / 3.0, 0.01, s.config)
    mass, center, inertia = moments(position, volume * density)
    body = rigid_body(s.anchor.base_id, s.anchor.base_id, True, surface, near, main.material)
    return replace(
        body, rigid=False, mass=mass, center_of_mass=center, inertia=inertia, particle_position=position,
        particle_volume=volume, particle_density=density, particle_youngs_modulus=stiffness,
        particle_poisson_ratio=poisson, grid_x=cells.planes[0], grid_y=cells.planes[1], grid_z=cells.planes[2],
        node_held=held,
    ), cells.size  # fmt: skip


def soft_bottoms(s: Scenario, rows: list[PartMaterial], mesh: Mesh, part: NDArray[np.int32]) -> Array:
    """Bottom of the soft solid under each face [m], shape (m,)."""
    index = [r.part_index for r in rows if r.model is Model.MPM]
    carried = carried_bottoms([s.base.parts[i].box for i in index])
    bottom = np.full(len(rows), np.inf)
    bottom[index] = carried
    for one in sorted(set(part.tolist())):
        top = float(np.median(mesh.triangles[part == one][:, :, 2]))
        if top - bottom[one] < s.config.least_thickness:
            bottom[one] = top - s.config.least_thickness
            s.notes.append(
                f"{s.anchor.base_id}: {s.base.parts[one].name} shows no thickness and is taken as "
                f"{s.config.least_thickness} m thick (ParticlesConfig.least_thickness)"
            )
    return bottom[part]


def soft_box(s: Scenario, solid: MeshDistance) -> tuple[Array, NDArray[np.bool_]]:
    """The solid's box within the crop [m], shape (2, 3), and which of its sides (2, 2) = (low/high, x/y) are cuts."""
    corner = solid.mesh.triangles
    inside = (corner.max(axis=1) >= s.crop[0]) & (corner.min(axis=1) <= s.crop[1])
    used = corner[inside[:, :2].all(axis=1)]
    own = np.stack([used.min(axis=(0, 1)), used.max(axis=(0, 1))])
    box = own.copy()
    box[0, :2], box[1, :2] = np.maximum(own[0, :2], s.crop[0, :2]), np.minimum(own[1, :2], s.crop[1, :2])
    cut = np.stack([own[0, :2] < s.crop[0, :2] - 1e-3, own[1, :2] > s.crop[1, :2] + 1e-3])
    return box, cut


def base_cells(s: Scenario, foot: Footprint, distance: Distance, box: Array) -> Cells:
    """A graded grid over the soft box, fine under the predicted contact."""
    wanted = cell_wanted(foot, s.config)
    coarsest = wanted if foot.flat else foot.radius / s.config.least_cells_per_radius
    reach = 0.3 * foot.small_side if foot.flat else 0.3 * foot.radius
    middle = 0.5 * (foot.low + foot.high)
    half = np.maximum(0.5 * (foot.high - foot.low), 0.0 if foot.flat else foot.radius) + reach
    fine = np.stack([middle - half, middle + half])
    depth = min(foot.radius, 4.0 * wanted)
    fine[:, 2] = foot.low[2] - foot.gap - foot.depth - depth, foot.high[2] - foot.gap + wanted
    cells = graded_cells(distance, box, fine, wanted, max(coarsest, wanted), s.config.base_cells)
    if cells.size > 1.001 * max(coarsest, wanted):
        s.notes.append(
            f"{s.anchor.base_id}: cells of {1e3 * cells.size:.2g} mm at the contact, not {1e3 * wanted:.2g} mm to "
            f"meet the budget of {s.config.base_cells} cells (ParticlesConfig.base_cells)"
        )
    return cells


def owners(
    s: Scenario, rows: list[PartMaterial], mesh: Mesh, part: NDArray[np.int32], position: Array
) -> NDArray[np.int64]:
    """Part of each particle: that of the nearest face; below a thin part's layer that of the nearest other part."""
    field_ = MeshDistance(mesh)
    owner = part[field_.nearest_face(position)].astype(np.int64)
    thin = np.array([r.material.kind == "thin" for r in rows])
    deep = np.flatnonzero(thin[owner])
    others = np.flatnonzero(~thin[part])
    if len(deep) and len(others):
        deep = deep[field_.unsigned(position[deep]) > s.config.layer]
        below = MeshDistance(mesh.submesh(others))
        owner[deep] = part[others][below.nearest_face(position[deep])]
    return owner


def held_nodes(
    s: Scenario,
    cells: Cells,
    cut: NDArray[np.bool_],
    bottom: Array,
    part: NDArray[np.int32],
    rigid: MeshDistance | None,
) -> NDArray[np.int8]:
    """Nodes that stand still: at the cut, at or in rigid parts, and at the bottom of the soft parts."""
    shape = tuple(len(p) for p in cells.planes)
    state = np.full(shape, FREE, dtype=np.int8)
    for axis in range(2):
        for side, end in ((0, 0), (1, -1)):
            if cut[side, axis]:
                np.moveaxis(state, axis, 0)[end] = HELD
    point = nodes(cells.planes).reshape(*shape, 3)
    step = np.diff(cells.planes[2])
    tolerance = 0.5 * np.minimum(np.append(step, step[-1]), np.insert(step, 0, step[0]))
    for height in np.unique(bottom):
        level = np.abs(cells.planes[2] - height) <= tolerance
        boxes = [s.base.parts[i].box for i in sorted(set(part[bottom == height].tolist()))]
        for k in np.flatnonzero(level):
            plan = point[:, :, k].reshape(-1, 3).copy()
            over = np.zeros(len(plan), dtype=bool)
            for box in boxes:
                local = np.abs(box.to_local(plan))[:, :2]
                over |= (local <= box.half_extents[:2] + 0.05).all(axis=1)
            state[:, :, k][over.reshape(shape[:2])] = HELD
    if rigid is not None:
        touching = rigid(point.reshape(-1, 3)).reshape(shape) <= s.config.hold_distance
        state[touching] = HELD
    return state


def base_surface(s: Scenario, foot: Footprint, mesh: Mesh, box: Array, cell: float) -> Mesh:
    """Visible soft faces within the grid: one fine cell long near the contact, coarser away from it."""
    reach = np.array([0.3, 0.3, 0.0]) * (foot.high - foot.low) + foot.radius
    low, high = foot.low - reach, foot.high + reach
    low[2] = -np.inf
    mesh = subdivide_near(mesh, s.crop, max(4.0 * cell, 0.02))
    mesh = subdivide_near(mesh, np.stack([low, high]), cell)
    inside = ((mesh.vertices[:, :2] >= box[0, :2]) & (mesh.vertices[:, :2] <= box[1, :2])).all(axis=1)
    inside &= (mesh.vertices[:, 2] >= box[0, 2]) & (mesh.vertices[:, 2] <= box[1, 2])
    return mesh.submesh(np.flatnonzero(inside[mesh.faces].all(axis=1)))


# --- obstacles --------------------------------------------------------------------------------------------------------


def neighbours(s: Scenario, foot: Footprint) -> list[SimulationBody]:
    """Other things in reach as fixed rigid bodies; walls, floor and ceiling are left out."""
    bodies = []
    for index, instance in enumerate(s.scene.instances):
        if index == s.base_index or instance.structure:
            continue
        faces = near_faces(s, index, 0.0)
        faces = faces[in_reach(s, s.scene.mesh.triangles[faces], foot)]
        if len(faces) == 0:
            continue
        wide = near_faces(s, index, 0.1)
        mesh = s.scene.mesh.submesh(wide)
        part = np.clip(s.scene.face_part[wide], 0, None)
        own = np.array([p.box.bottom for p in instance.parts])[part]
        solid = support_solid(mesh, shell_bottoms(mesh, own, s.config.shell), s.crop, s.config.hole_perimeter)
        rows = [r for r in s.materials.rows if r.body == instance.id]
        base_row = s.materials.of(s.anchor.base_id, s.anchor.part_index)
        row = rows[0] if rows else base_row
        bodies.append(obstacle(s, foot, instance.id, instance.id, s.scene.mesh.submesh(faces), solid, row.material))
        s.notes.append(f"{instance.id} ({instance.label}) is in reach: a fixed rigid obstacle")
    return bodies


def obstacle(
    s: Scenario, foot: Footprint, name: str, instance: str, mesh: Mesh, solid: MeshDistance, material: Material
) -> SimulationBody:
    """A fixed rigid body: its faces in reach and its distance field where the object may come."""
    box = reach_box(s, foot)
    low, high = np.maximum(mesh.bounds[0], box[0]), np.minimum(mesh.bounds[1], box[1])
    edge = max(foot.small_side / 8.0, 0.01)
    surface = subdivide_near(mesh, np.stack([foot.low - foot.radius - edge, foot.high + foot.radius + edge]), edge)
    spacing = float(np.linalg.norm(np.ptp(s.mesh.vertices, axis=0))) / 80.0
    grid = body_grid(solid, np.stack([low, high]), spacing, 0.02, s.config)
    return rigid_body(name, instance, True, surface, grid, material)


# --- common -----------------------------------------------------------------------------------------------------------


def rigid_body(
    name: str, instance: str, fixed: bool, surface: Mesh, grid: DistanceGrid, material: Material
) -> SimulationBody:
    """A body without particles; mass properties of a fixed one are informative: its surface as a shell."""
    area = surface.face_areas
    mass, center, inertia = moments(surface.triangles.mean(axis=1), np.maximum(area, 1e-12) * material.density * 0.01)
    none = np.zeros(0)
    return SimulationBody(
        name, instance, fixed, surface, grid, True, mass, center, inertia, material.static_friction,
        material.dynamic_friction, material.rolling_resistance, EMPTY, none, none, none, none, none, none, none,
        np.zeros((0, 0, 0), dtype=np.int8),
    )  # fmt: skip


def body_grid(
    distance: Distance, bounds: Array, spacing: float, margin: float, config: ParticlesConfig
) -> DistanceGrid:
    """A distance grid over a box and a margin [m], coarser than `spacing` where the budget of samples demands it."""
    low, high = bounds[0] - margin, bounds[1] + margin
    least = float(np.prod(high - low) / config.distance_samples) ** (1.0 / 3.0)
    return sampled(distance, low, high, max(spacing, least))


def note_friction(s: Scenario, body: str, row: PartMaterial, part_count: int) -> None:
    """Say which part's friction a body of several parts has."""
    if part_count > 1:
        s.notes.append(f"{body}: friction of {row.part} ({row.material.id}) for all its parts")


def note_overlaps(s: Scenario, bodies: list[SimulationBody]) -> None:
    """Say where the object starts inside something."""
    for body in bodies[1:]:
        depth = -float(sampler(body.distance)(bodies[0].surface.vertices).min())
        if depth > 1e-3:
            s.notes.append(f"the object starts {1e3 * depth:.1f} mm inside {body.name}")


particles_task = stage(particles)
