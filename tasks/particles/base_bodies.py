"""The base of the drop within the crop: its soft parts one bonded body, clamped where it is cut and carried."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.distance import Distance, MeshDistance, sampler
from dcap.geometry.solid.fill import fill
from dcap.geometry.solid.repair import subdivide_near
from dcap.geometry.solid.support import carried_bottoms, ready_support, shell_bottoms
from dcap.scene.errors import GeometryError
from dcap.scene.types.materials import BodyModel, PartMaterial
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.particles import SimulationBody
from tasks.bodies.footprint import Footprint
from tasks.bodies.soft_cells import Cells, graded_cells, nodes
from tasks.particles.obstacles import main_row, rigid_base
from tasks.particles.scenario import (
    FREE,
    HELD,
    REACH_BELOW,
    Scenario,
    body_grid,
    cell_wanted,
    constants,
    moments,
    near_faces,
    note_friction,
    note_geometry,
    reach_box,
    rigid_body,
)

Array = NDArray[np.float64]

SOFT_REACH = 0.05  # soft parts of the base farther than this [m] from the object's box are not dented


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
    stiff = np.array([r.model is BodyModel.RIGID for r in rows])[part] | ~soft_in_reach(s, foot, rows, faces, part)
    solid = None
    if stiff.any():
        mesh = s.scene.mesh.submesh(faces[stiff])
        own = np.array([p.box.bottom for p in s.base.parts])[part[stiff]]
        bottom = shell_bottoms(mesh, own, s.config.shell)
        solid, report = ready_support(mesh, bottom, reach_box(s, foot), s.config.hole_perimeter)
        names = [s.base.parts[p].name for p in np.unique(part[stiff])]
        note_geometry(s, f"{s.anchor.base_id}/rigid", names, report)
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
    soft = np.array([r.model is BodyModel.MPM for r in rows])[part]
    low, high = s.mesh.bounds + np.array([[-SOFT_REACH], [SOFT_REACH]])
    low[2] = s.mesh.bounds[0, 2] - foot.gap - REACH_BELOW
    corner = s.scene.mesh.triangles[faces[soft]]
    if ((corner.max(axis=1) >= low) & (corner.min(axis=1) <= high)).all(axis=1).any():
        return np.ones(len(faces), dtype=bool)
    if soft.any():
        names = ", ".join(sorted({rows[p].part for p in part[soft].tolist()}))
        s.notes.append(f"{s.anchor.base_id}: {names}, out of the object's reach, is treated as rigid")
    return np.zeros(len(faces), dtype=bool)


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
    solid, report = ready_support(mesh, bottom, reach_box(s, foot), s.config.hole_perimeter)
    note_geometry(s, s.anchor.base_id, [s.base.parts[p].name for p in np.unique(part)], report)
    box, cut = soft_box(s, solid)
    grid = body_grid(solid, box, 2.0 * s.config.finest_cell, 0.01, s.config.distance_samples)
    distance = sampler(grid)
    cells = base_cells(s, foot, distance, box)
    position, volume = fill(cells.planes, distance)
    if len(position) == 0:
        raise GeometryError(f"{s.anchor.base_id}: no solid beneath the object; raise ParticlesConfig.least_thickness")
    owner = owners(s, rows, mesh, part, position)
    density, stiffness, poisson = constants(rows, owner)
    held = held_nodes(s, cells, cut, bottom, part, rigid)
    main = main_row(s, [r for r in rows if r.model is BodyModel.MPM], part)
    note_friction(s, s.anchor.base_id, main, len(set(part.tolist())))
    surface = base_surface(s, foot, mesh, box, cells.size)
    contact_box = np.stack([np.maximum(box[0], reach_box(s, foot)[0]), np.minimum(box[1], reach_box(s, foot)[1])])
    near = body_grid(solid, contact_box, cells.size / 3.0, 0.01, s.config.distance_samples)
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
    index = [r.part_index for r in rows if r.model is BodyModel.MPM]
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
    given = foot.flat or s.config.cell is not None
    coarsest = wanted if given else foot.radius / s.config.least_cells_per_radius
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
    """Visible soft faces within the grid: a third of a fine cell long near the contact, coarser away from it.

    Flat faces as long as a cell cut the corners of the dent under an edge: they showed a dumbbell 1 mm deep in its bed.
    """
    margin = np.array([0.3, 0.3, 0.0]) * (foot.high - foot.low) + 0.5 * foot.radius
    low, high = foot.wider[0] - margin, foot.wider[1] + margin
    low[2] = -np.inf
    mesh = subdivide_near(mesh, s.crop, max(4.0 * cell, 0.02))
    size = np.maximum(np.minimum(high, box[1]) - np.maximum(low, box[0]), 0.0)[:2]
    least = float(np.sqrt(2.0 * size.prod() / s.config.base_faces))
    if least > cell / 3.0:
        s.notes.append(
            f"{s.anchor.base_id}: faces of {1e3 * least:.2g} mm under the object, not a third of a cell "
            f"({1e3 * cell / 3.0:.2g} mm), to meet the budget of {s.config.base_faces} (ParticlesConfig.base_faces)"
        )
    mesh = subdivide_near(mesh, np.stack([low, high]), max(cell / 3.0, least))
    inside = ((mesh.vertices[:, :2] >= box[0, :2]) & (mesh.vertices[:, :2] <= box[1, :2])).all(axis=1)
    inside &= (mesh.vertices[:, 2] >= box[0, 2]) & (mesh.vertices[:, 2] <= box[1, 2])
    return mesh.submesh(np.flatnonzero(inside[mesh.faces].all(axis=1)))
