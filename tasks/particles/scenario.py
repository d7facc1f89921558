"""What the drop is built from: the inputs of stage 7 together, the region that takes part, and what bodies share."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, NonNegativeFloat, PositiveFloat, PositiveInt

from dcap.geometry.distance import Distance, sampled
from dcap.geometry.raycast import Raycaster
from dcap.scene.types.anchor import Anchor
from dcap.scene.types.intent import Intent
from dcap.scene.types.materials import BodyModel, Material, PartMaterial, PartMaterials
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.particles import DistanceGrid, SimulationBody
from dcap.scene.types.repair_report import BodyGeometry, RepairReport
from dcap.scene.types.segmentation import Instance, Segmentation
from tasks.bodies.footprint import GRAVITY, Footprint, predicted_footprint

Array = NDArray[np.float64]

FREE, HELD, CORE = 0, 1, 2  # states of grid nodes, as in scene.particles
RIGID_MODULUS = 2e11  # Young's modulus [Pa] that stands for a rigid part in the predicted contact
# rigid material inside a soft body is at most this many times stiffer than its softest: conditioning
CORE_STIFFNESS = 100.0
REACH_BELOW = 0.12  # how far below the predicted contact fields are sampled [m]: deeper than any dent
REACH_ABOVE = 0.03  # above the object's top [m]
ROUND = 0.1  # relative spread of a ball's radius; a cube has 0.14
EMPTY = np.zeros((0, 3))


class ParticlesConfig(BaseModel, frozen=True, extra="forbid"):
    """What is simulated and how finely."""

    crop_margin: PositiveFloat = 0.75
    """The base is cut this far around the object, in units of its larger horizontal side [-]."""
    least_crop_margin: PositiveFloat = 0.15
    """... but at least this far [m]."""
    rolling_margin: PositiveFloat = 2.5
    """Times farther around a ball, which may roll before it rests [-]."""
    cell: PositiveFloat | None = None
    """Cell size at the contact that was asked for [m]; without it the predicted contact decides."""
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
    base_faces: PositiveInt = 120_000
    """Budget of visible faces of a soft base under the object; each is a point of contact."""
    particle_limit: PositiveInt = 250_000
    """More particles than this are refused."""
    distance_samples: PositiveInt = 1_000_000
    """Budget of samples of a base's or a neighbour's distance."""
    object_distance_samples: PositiveInt = 3_000_000
    """Budget of samples of the object's distance: its edges are rounded by a quarter of their spacing."""
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
    geometry: list[BodyGeometry] = field(default_factory=list)

    @property
    def base(self) -> Instance:
        """The instance to place on."""
        return self.scene.instances[self.base_index]

    def rows(self, body: str, count: int) -> list[PartMaterial]:
        """Materials of all parts of a body."""
        return [self.materials.of(body, index) for index in range(count)]


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
    if is_ball(mesh):
        margin *= config.rolling_margin
    crop = np.stack([low - margin, high + margin])
    s = Scenario(scene, item, intent, anchor, materials, config, mesh, scene.index_of(anchor.base_id), crop)
    s.notes += materials.notes
    s.notes.append(f"{anchor.base_id} is cut {margin:.2f} m around the object and clamped at the cut")
    return s


def is_ball(mesh: Mesh) -> bool:
    """Whether all of the surface is about as far from its centroid."""
    away = np.linalg.norm(mesh.triangles.mean(axis=1) - mesh.vertices.mean(axis=0), axis=1)
    return float(away.std() / away.mean()) < ROUND


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
    return RIGID_MODULUS if row.model is BodyModel.RIGID else row.material.youngs_modulus


def cell_wanted(foot: Footprint, config: ParticlesConfig) -> float:
    """Cell size under the contact [m]."""
    if config.cell is not None:
        return config.cell
    if foot.flat:
        cell = min(foot.small_side / config.cells_per_side, config.coarsest_cell)
    else:
        cell = foot.radius / config.cells_per_radius
    return float(np.clip(cell, config.finest_cell, config.coarsest_cell))


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


def body_grid(distance: Distance, bounds: Array, spacing: float, margin: float, samples: int) -> DistanceGrid:
    """A distance grid over a box and a margin [m], coarser than `spacing` where the budget of `samples` demands it."""
    low, high = bounds[0] - margin, bounds[1] + margin
    least = float(np.prod(high - low) / samples) ** (1.0 / 3.0)
    return sampled(distance, low, high, max(spacing, least))


def moments(position: Array, mass: Array) -> tuple[float, Array, Array]:
    """Total mass, centre and inertia about it of point masses."""
    total = float(mass.sum())
    center = mass @ position / total
    arm = position - center
    second = np.einsum("i,ij,ik->jk", mass, arm, arm)
    return total, center, np.trace(second) * np.eye(3) - second


def constants(rows: list[PartMaterial], part: NDArray[np.integer]) -> tuple[Array, Array, Array]:
    """Density, Young's modulus and Poisson ratio of particles that belong to the given parts."""
    soft = [r.material.youngs_modulus for r in rows if r.model is BodyModel.MPM]
    most = CORE_STIFFNESS * min(soft)
    table = np.array(
        [(r.material.density, min(r.material.youngs_modulus, most), r.material.poisson_ratio) for r in rows]
    )
    density, stiffness, poisson = table[part].T
    return density.copy(), stiffness.copy(), poisson.copy()


def note_geometry(s: Scenario, body: str, parts: list[str], report: RepairReport) -> None:
    """Keep how a body's solid was made, and say where it is in doubt."""
    part = ", ".join(dict.fromkeys(parts))
    s.geometry.append(BodyGeometry(body, part, report))
    if report.problem:
        s.notes.append(f"{body}: {part} is no good solid: {report.problem}")


def note_friction(s: Scenario, body: str, row: PartMaterial, part_count: int) -> None:
    """Say which part's friction a body of several parts has."""
    if part_count > 1:
        s.notes.append(f"{body}: friction of {row.part} ({row.material.id}) for all its parts")
