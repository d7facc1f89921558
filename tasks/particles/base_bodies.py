"""The base of the drop within the crop: its soft parts as one bonded body, clamped where it is cut and carried."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dcap.arrays import Array
from dcap.geometry.distance import Distance, MeshDistance, sampler
from dcap.geometry.solid.support import shell_bottoms
from dcap.scene.errors import NothingBeneathError
from dcap.scene.types.materials import BodyModel, PartMaterial
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.particles import (
    ColumnLayer,
    DistanceGrid,
    RigidSimulationBody,
    SimulationBody,
    SoftSimulationBody,
)
from tasks.bodies.discretization import MaterialConstants, distance_samples, inertial_of_material, material_points
from tasks.bodies.footprint import PER_CELL, Footprint, soft_support_surface
from tasks.bodies.soft_cells import (
    CELLS_ACROSS,
    MOST_PIECES,
    Cells,
    Limit,
    UnderResolved,
    WantedCells,
    cells_within,
    occupied,
    through_thin_parts,
    wanted_in_height,
    wanted_in_plan,
)
from tasks.bodies.solver_model import grid_of, nodes_at_bottoms, nodes_at_cuts, nodes_within
from tasks.particles.config import ParticlesConfig
from tasks.particles.contact_layers import footprint_on, layers_of, names_of, soft_bottoms
from tasks.particles.drop_setup import (
    REACH_BELOW,
    DropSetup,
    constants_of_parts,
    friction_of_surface,
)
from tasks.particles.layers import COLUMN_STEPS, NEAR_EDGE, BaseLayers, column_of, covers_beneath, covers_of
from tasks.particles.obstacles import NEARBY, SoundSupport, governing_part, rigid_base, sound_support

SOFT_REACH = 0.05  # soft parts of the base farther than this [m] from the object's box are not dented
MARGIN = 0.01  # a signed distance reaches this far beyond the soft solid [m]
CELLS_THROUGH = 4.0  # least cells through the box of the soft parts along each axis
SAMPLES_PER_CELL = 3.0  # samples of the signed distance that contact reads


@dataclass(frozen=True, eq=False, slots=True)
class BaseBodies:
    """The bodies of the base instance."""

    soft: SoftSimulationBody | None
    rigid: RigidSimulationBody | None
    cell: float
    """Cell size under the contact [m]; 0 without a soft part."""
    footprint: Footprint
    """The object's predicted contact with the base."""
    column: tuple[ColumnLayer, ...]
    """Layers under the predicted contact, from the top down; empty without a soft part."""

    @property
    def bodies(self) -> list[SimulationBody]:
        """The soft and the rigid body, if they exist."""
        return [b for b in (self.soft, self.rigid) if b is not None]


def base_bodies(setup: DropSetup) -> BaseBodies:
    """Soft parts as one bonded body, rigid parts as another; both fixed."""
    base_id, parts = setup.anchor.base_id, setup.base.parts
    rows = setup.materials.of_parts(base_id, len(parts))
    faces = setup.faces_near_crop(setup.base_index, NEARBY)
    if len(faces) == 0:
        raise NothingBeneathError(
            f"{base_id} has no surface within {setup.config.crop_margin} object sizes of the object; "
            "raise ParticlesConfig.crop_margin"
        )
    part = np.clip(setup.scene.face_part[faces], 0, None)
    stiff = np.array([r.model is BodyModel.RIGID for r in rows])[part] | ~soft_in_reach(setup, rows, faces, part)
    solid = rigid_solid(setup, faces[stiff], part[stiff]) if stiff.any() else None
    if stiff.all():
        base = BaseBodies(None, None, 0.0, footprint_on(setup, []), ())
    else:
        held_by = None if solid is None else solid.solid
        base = soft_base(setup, rows, faces[~stiff], part[~stiff], held_by)
    if solid is not None:
        base = replace(base, rigid=rigid_base(setup, base.footprint, rows, solid))
    if not base.bodies:
        raise NothingBeneathError(f"{base_id} has no surface beneath the object; raise ParticlesConfig.crop_margin")
    return base


def rigid_solid(setup: DropSetup, faces: NDArray[np.int64], part: NDArray[np.int32]) -> SoundSupport:
    """The solid of the base's rigid parts."""
    mesh = setup.scene.mesh.submesh(faces)
    own = np.array([p.box.bottom for p in setup.base.parts])[part]
    bottom = shell_bottoms(mesh, own, setup.config.shell)
    names = [setup.base.parts[p].name for p in np.unique(part)]
    return sound_support(setup, f"{setup.anchor.base_id}/rigid", names, mesh, part, bottom, torn=setup.torn)


def soft_in_reach(
    setup: DropSetup, rows: list[PartMaterial], faces: NDArray[np.int64], part: NDArray[np.int32]
) -> NDArray[np.bool_]:
    """Mask of shape (m,), all true if the soft parts together are so near to the object that they may be dented."""
    soft = np.array([r.model is BodyModel.MPM for r in rows])[part]
    low, high = setup.mesh.bounds + np.array([[-SOFT_REACH], [SOFT_REACH]])
    low[2] = setup.mesh.bounds[0, 2] - setup.descent.gap - REACH_BELOW
    corner = setup.scene.mesh.corners(faces[soft])
    if ((corner.max(axis=1) >= low) & (corner.min(axis=1) <= high)).all(axis=1).any():
        return np.ones(len(faces), dtype=bool)
    if soft.any():
        names = ", ".join(sorted({rows[p].part for p in part[soft].tolist()}))
        setup.notes.append(f"{setup.anchor.base_id}: {names}, out of the object's reach, is treated as rigid")
    return np.zeros(len(faces), dtype=bool)


def soft_base(
    setup: DropSetup,
    rows: list[PartMaterial],
    faces: NDArray[np.int64],
    part: NDArray[np.int32],
    rigid: MeshDistance | None,
) -> BaseBodies:
    """All soft parts of the base within the crop as one fixed body, and the object's predicted contact with it."""
    base_id, config, mesh = setup.anchor.base_id, setup.config, setup.scene.mesh.submesh(faces)
    layers = base_layers(setup, rows, mesh, part)
    bottom = soft_bottoms(setup, layers)
    names = [setup.base.parts[p].name for p in np.unique(part)]
    sound = sound_support(setup, base_id, names, mesh, part, bottom, torn=setup.torn)
    solid, mesh, part, bottom = sound.solid, sound.mesh, sound.part, sound.bottom
    box, cut = soft_box(setup, solid)
    grid = distance_samples(solid, box, 2.0 * config.finest_cell, margin=MARGIN, most=config.distance_samples)
    inside = sampler(grid)
    column = column_under(setup, rows, layers, float(box[0, 2]))
    foot = footprint_on(setup, layers_of(column, rows))
    for_contact = base_cells(setup, foot, inside, box)
    cells, thin = for_contact, list[UnderResolved]()
    if not config.uniform:
        cells, thin = through_thin_parts(
            for_contact, grid, loaded_region(setup), config.base_cells, config.finest_cell
        )  # fmt: skip
    note_cells(setup, for_contact, cells)
    note_thin(setup, layers, thin)
    points = material_points(
        cells.planes, inside, lambda x: constants_in(rows, layers, x),
        if_empty=f"{base_id}: no solid beneath the object; raise ParticlesConfig.least_thickness",
    )  # fmt: skip
    held = held_nodes(setup, cells, cut, bottom, part, rigid)
    main = governing_part(setup, [r for r in rows if r.model is BodyModel.MPM], part)
    setup.note_stiffness(base_id, rows)
    surface = base_surface(setup, foot, mesh, box, cells.size)
    body = SoftSimulationBody(
        name=base_id, instance=base_id, fixed=True, surface=surface,
        face_friction=friction_of_surface(rows, surface, mesh, part),
        distance=contact_distance(setup, solid, box, cells.size), inertial=inertial_of_material(points),
        friction=main.material.friction, points=points, grid=grid_of(cells.planes, held=held), loaded=True,
    )  # fmt: skip
    return BaseBodies(body, None, cells.size, foot, column)


def base_layers(setup: DropSetup, rows: list[PartMaterial], mesh: Mesh, part: NDArray[np.int32]) -> BaseLayers:
    """The soft parts of the base with their covers, which are searched all over it: the part that carries a blanket may
    only be visible far from the object. The assumed thickness of each cover is noted."""
    soft = [r.part_index for r in rows if r.model is BodyModel.MPM]
    faces = np.flatnonzero(setup.scene.face_instance == setup.base_index)
    whole, parts = setup.scene.mesh.submesh(faces), np.clip(setup.scene.face_part[faces], 0, None)
    around = setup.beside_base(NEAR_EDGE) if len(setup.base.parts) == 1 else []
    covers = covers_of(setup.base, soft, whole, parts, around)
    for cover in covers.values():
        name = setup.base.parts[cover.part].name
        setup.notes.append(f"{setup.anchor.base_id}: {name} is a layer of {1e3 * cover.thickness:.0f} mm, {cover.why}")
    return BaseLayers.of(setup.base, soft, covers, covers_beneath(setup.base, covers, whole, parts), mesh, part)


def constants_in(rows: list[PartMaterial], layers: BaseLayers, position: Array) -> MaterialConstants:
    """Material constants at points (n, 3) of the soft base."""
    owner, layered = layers.owners(position), [r.part_index for r in rows if r.material.layers is not None]
    return constants_of_parts(rows, owner, lambda: layers.normals(position, owner, layered))


def loaded_region(setup: DropSetup) -> Array:
    """Box in which the object's weight may bend something [m], shape (2, 3): around the object by half its larger
    horizontal side."""
    low, high = setup.mesh.bounds
    margin = 0.5 * float((high - low)[:2].max())
    box = setup.contact_region
    box[0, :2], box[1, :2] = low[:2] - margin, high[:2] + margin
    return box


def note_cells(setup: DropSetup, for_contact: Cells, cells: Cells) -> None:
    """Note where thin parts took more cells than the contact, beyond the budget."""
    budget = setup.config.base_cells
    if cells.count > max(budget, for_contact.count):
        setup.notes.append(
            f"{setup.anchor.base_id}: {cells.count} cells instead of {for_contact.count}, to resolve thin parts, "
            f"beyond the budget of {budget} cells (ParticlesConfig.base_cells)"
        )


def note_thin(setup: DropSetup, layers: BaseLayers, thin: list[UnderResolved]) -> None:
    """Note every part with too few cells through it, its worst place and the reason."""
    if not thin:
        return
    worst: dict[int, UnderResolved] = {}
    owner = layers.owners(np.array([one.place for one in thin]))
    for part, one in zip(owner.tolist(), thin, strict=True):
        worst[part] = min(worst.get(part, one), one, key=lambda found: found.cells)
    why = {
        Limit.BUDGET: f"to meet the budget of {setup.config.base_cells} cells (ParticlesConfig.base_cells)",
        Limit.FINEST: f"as none is finer than {1e3 * setup.config.finest_cell:.2g} mm (ParticlesConfig.finest_cell)",
        Limit.PIECES: f"as a cell of the contact is cut into at most {MOST_PIECES}; use finer cells at the contact "
        "(ParticlesConfig.cell)",
    }
    for part, one in worst.items():
        setup.notes.append(
            f"{setup.anchor.base_id}: only {one.cells:.1f} cells through {setup.base.parts[part].name} where it is "
            f"{1e3 * one.thickness:.0f} mm thick, {why[one.limit]}"
        )


def column_under(
    setup: DropSetup, rows: list[PartMaterial], layers: BaseLayers, bottom: float
) -> tuple[ColumnLayer, ...]:
    """Parts and materials straight below the first contact, down to `bottom` [m]."""
    first = setup.descent.first
    depth = np.linspace(0.0, max(float(first[2]) - bottom, 0.0), COLUMN_STEPS)
    points = np.column_stack([np.tile(first[:2], (len(depth), 1)), first[2] - depth])
    return column_of(layers.owners(points), depth, names_of(rows))


def contact_distance(setup: DropSetup, solid: MeshDistance, box: Array, cell: float) -> DistanceGrid:
    """Signed distance for contact, finer than the cells [m], where the object may touch."""
    region = setup.contact_region
    reached = np.stack([np.maximum(box[0], region[0]), np.minimum(box[1], region[1])])
    return distance_samples(solid, reached, cell / SAMPLES_PER_CELL, margin=MARGIN, most=setup.config.distance_samples)


def soft_box(setup: DropSetup, solid: MeshDistance) -> tuple[Array, NDArray[np.bool_]]:
    """The solid's box within the crop [m], shape (2, 3), and the mask of its sides (2, 2) = (low/high, x/y) that are
    cuts."""
    corner = solid.mesh.triangles
    inside = (corner.max(axis=1) >= setup.crop[0]) & (corner.min(axis=1) <= setup.crop[1])
    used = corner[inside[:, :2].all(axis=1)]
    own = np.stack([used.min(axis=(0, 1)), used.max(axis=(0, 1))])
    box = own.copy()
    box[0, :2], box[1, :2] = np.maximum(own[0, :2], setup.crop[0, :2]), np.minimum(own[1, :2], setup.crop[1, :2])
    cut = np.stack([own[0, :2] < setup.crop[0, :2] - 1e-3, own[1, :2] > setup.crop[1, :2] + 1e-3])
    return box, cut


def base_cells(setup: DropSetup, foot: Footprint, distance: Distance, box: Array) -> Cells:
    """A graded grid over the soft box, fine under the predicted contact."""
    config = setup.config
    if config.uniform:
        return even_cells(config, distance, box)

    asked = [wanted_along(foot, axis, config) for axis in range(3)]
    through = [WantedCells(box[:1, a], box[1:, a], np.ptp(box[:, a], keepdims=True) / CELLS_THROUGH) for a in range(3)]

    def wanted(scale: float) -> list[WantedCells]:
        return [WantedCells.joined([through[a], asked[a].resized(scale=scale)]) for a in range(3)]

    budget = int(config.base_cells / config.coarser**2)
    cells, scale = cells_within(box, wanted, lambda planes: occupied(planes, distance), budget)
    if scale > config.cells_across / config.least_cells_across or (config.cell is not None and scale > 1.0):
        finest = min(float(one.size.min(initial=cells.size)) for one in asked)
        setup.notes.append(
            f"{setup.anchor.base_id}: cells of {1e3 * cells.size:.2g} mm at the contact instead of "
            f"{1e3 * finest:.2g} mm, to meet the budget of {budget} cells (ParticlesConfig.base_cells"
            f"{'' if config.coarser == 1.0 else ', coarser'})"
        )
    return cells


def even_cells(config: ParticlesConfig, distance: Distance, box: Array) -> Cells:
    """A grid of uniform cells over the soft box, as fine as the budget allows."""
    budget = int(config.base_cells / config.coarser**2)
    size = float(np.cbrt(np.prod(np.ptp(box, axis=0)) / budget))

    def wanted(scale: float) -> list[WantedCells]:
        return [WantedCells(box[:1, a], box[1:, a], np.array([scale * size])) for a in range(3)]

    return cells_within(box, wanted, lambda planes: occupied(planes, distance), budget)[0]


def wanted_along(foot: Footprint, axis: int, config: ParticlesConfig) -> WantedCells:
    """The largest cells of the base along an axis where the object touches it."""
    found = []
    for contact in foot.contacts:
        wanted = wanted_in_plan(contact, axis) if axis < 2 else wanted_in_height(contact, *contact.touched_heights)
        size = np.clip(wanted.size * CELLS_ACROSS / config.cells_across, config.finest_cell, config.coarsest_cell)
        found.append(replace(wanted, size=size).resized(size=config.cell).resized(scale=config.coarser))
    return WantedCells.joined(found)


def held_nodes(
    setup: DropSetup,
    cells: Cells,
    cut: NDArray[np.bool_],
    bottom: Array,
    part: NDArray[np.int32],
    rigid: MeshDistance | None,
) -> NDArray[np.bool_]:
    """Nodes that are held: at the cut, at or in rigid parts, and at the bottom of the soft parts."""
    bottoms = [
        (float(height), [setup.base.parts[i].box for i in sorted(set(part[bottom == height].tolist()))])
        for height in np.unique(bottom)
    ]
    held = nodes_at_cuts(cells.planes, cut) | nodes_at_bottoms(cells.planes, bottoms)
    if rigid is not None:
        held |= nodes_within(cells.planes, rigid, setup.config.hold_distance)
    return held


def base_surface(setup: DropSetup, foot: Footprint, mesh: Mesh, box: Array, cell: float) -> Mesh:
    """Visible soft faces within the grid; a note if the budget leaves edges longer than half a cell [m]."""
    most = setup.config.base_faces
    surface, edge = soft_support_surface(mesh, foot, setup.crop, box, cell, most)
    if edge > 1.001 * cell / PER_CELL:
        setup.notes.append(
            f"{setup.anchor.base_id}: faces of up to {1e3 * edge:.2g} mm under the object, not half a cell "
            f"({1e3 * cell / PER_CELL:.2g} mm), to meet the budget of {most} (ParticlesConfig.base_faces)"
        )
    return surface
