"""Obstacles around the soft part of the base, as fixed rigid bodies, and the solids of supports.

The solid of a support or an obstacle: from its faces if they bound a solid, else from their visible side.

In: the faces of a fixed body near the object and a bottom height for each. Out: its signed distance, the faces that
contact and pictures of dents use, and a report. For scans that make no sound solid (holes, second layers, sheets
inside, missing sides) it is the solid under the faces that the object sees.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dcap.arrays import Array
from dcap.geometry.distance import MeshDistance
from dcap.geometry.pieces import is_soup
from dcap.geometry.solid.closed import RepairLimits
from dcap.geometry.solid.columns import ColumnSolid, column_solid
from dcap.geometry.solid.repair_log import RepairLog
from dcap.geometry.solid.support import ready_support, shell_bottoms, under_thin_faces
from dcap.scene.types.materials import PartMaterial
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.particles import DistanceGrid, RigidSimulationBody
from dcap.scene.types.segmentation import Instance
from tasks.bodies.discretization import affordable_spacing, distance_samples, inertial_of_shell
from tasks.bodies.footprint import Footprint, obstacle_surface
from tasks.particles.drop_setup import DropSetup, friction_of_surface

TOLERANCE = RepairLimits().tolerance
BEYOND = 0.03  # the solid under visible faces reaches this far beyond the crop [m] and is cut there
SAMPLES = 80.0  # of an obstacle's signed distance along the object's diagonal
THROUGH = 4.0  # least samples through a support: interpolation reads three
MARGIN = 0.02  # a signed distance reaches this far beyond the faces in reach [m]
TOWARDS = 0.75  # share of a wall's area in reach that lies behind its face: selects the nearer of two skins [-]
SLAB = 0.3  # thickness of the block that represents a wall [m]
NEARBY = 0.1  # faces this far around the crop determine the solid of an obstacle [m]


@dataclass(frozen=True, eq=False, slots=True)
class SoundSupport:
    """A fixed body near the object."""

    solid: MeshDistance
    mesh: Mesh
    """Its faces."""
    part: NDArray[np.int32]
    """Part of each face, shape (m,)."""
    bottom: Array
    """Height down to which the body is solid under each face [m], shape (m,)."""


def sound_support(
    setup: DropSetup, body: str, names: list[str], mesh: Mesh, part: NDArray[np.int32], bottom: Array, *, torn: bool
) -> SoundSupport:
    """The solid under faces, each of a `part` and solid down to its own `bottom` [m]; `names` are the names of its
    parts.

    `torn`: a hole under the object was closed, so that faces lie over one another there. In this case, and where no two
    faces are connected, the visible faces are tried first.
    """
    if torn or is_soup(mesh):
        seen = under_what_is_seen(setup, mesh, bottom)
        if seen is not None:
            return kept_seen(setup, body, names, seen, part, bottom)
    solid, report = ready_support(mesh, bottom, setup.contact_region, setup.config.hole_perimeter)
    if report.problem:
        seen = under_what_is_seen(setup, mesh, bottom)
        if seen is not None and (not seen.report.problem or seen.report.hausdorff < report.hausdorff):
            return kept_seen(setup, body, names, seen, part, bottom)
    setup.note_geometry(body, names, report)
    return SoundSupport(solid, mesh, part, bottom)


def kept_seen(
    setup: DropSetup, body: str, names: list[str], seen: ColumnSolid, part: NDArray[np.int32], bottom: Array
) -> SoundSupport:
    """The solid under the visible faces, with these as its faces."""
    setup.note_geometry(body, names, seen.report)
    top = np.flatnonzero(seen.top)
    source = seen.source[top]
    return SoundSupport(MeshDistance(seen.mesh), seen.mesh.submesh(top), part[source], bottom[source])


def under_what_is_seen(setup: DropSetup, mesh: Mesh, bottom: Array) -> ColumnSolid | None:
    """The solid under the faces that the object sees; None if it sees none."""
    region = setup.contact_region
    region[0, :2] -= BEYOND
    region[1, :2] += BEYOND
    return column_solid(mesh, bottom, region, setup.mesh, TOLERANCE, RepairLog())


def rigid_base(
    setup: DropSetup, foot: Footprint, rows: list[PartMaterial], sound: SoundSupport
) -> RigidSimulationBody | None:
    """The rigid parts of the base in reach as one obstacle."""
    kept = setup.in_contact_region(sound.mesh.triangles)
    if not kept.any():
        return None
    part = sound.part[kept]
    there = set(part.tolist())
    main = governing_part(setup, [r for r in rows if r.part_index in there], part)
    name = f"{setup.anchor.base_id}/rigid"
    return obstacle(setup, foot, (name, setup.anchor.base_id), sound, kept, rows, main)


def neighbours(setup: DropSetup, foot: Footprint) -> list[RigidSimulationBody]:
    """Other things in reach as fixed rigid bodies, without walls, floor and ceiling, unless the object leans on
    them."""
    bodies = []
    held = setup.anchor.lean.on if setup.anchor.lean is not None else ""
    for index, instance in enumerate(setup.scene.instances):
        if index == setup.base_index or instance.id in setup.free or (instance.structure and instance.id != held):
            continue
        faces = setup.faces_near_crop(index, 0.0)
        faces = faces[setup.in_contact_region(setup.scene.mesh.corners(faces))]
        if len(faces) == 0:
            continue
        sound = wall_support(setup, instance, faces) if instance.structure else neighbour_solid(setup, index)
        kept = setup.in_contact_region(sound.mesh.triangles) & in_plan(sound.mesh.triangles, setup.crop)
        rows = rows_of(setup, instance)
        main = most_seen(rows, np.clip(setup.scene.face_part[faces], 0, None))
        bodies.append(obstacle(setup, foot, (instance.id, instance.id), sound, kept, rows, main))
        setup.notes.append(f"{instance.id} ({instance.label}) is in reach: a fixed rigid obstacle")
    return bodies


def wall_support(setup: DropSetup, wall: Instance, faces: NDArray[np.int64]) -> SoundSupport:
    """A wall as a block, with its faces in reach (k,)."""
    mesh, part = setup.scene.mesh.submesh(faces), np.clip(setup.scene.face_part[faces], 0, None)
    return SoundSupport(MeshDistance(wall_slab(setup, wall, faces)), mesh, part, mesh.triangles[:, :, 2].min(axis=1))


def wall_slab(setup: DropSetup, wall: Instance, faces: NDArray[np.int64]) -> Mesh:
    """A wall as a closed block: a scan shows only its skin, so the block extends behind the face nearest to the object.

    That face is at the depth of most of the wall's area (k faces in reach) towards the object: rims and sockets stand
    out.
    """
    box, thin = wall.box, int(np.argmin(wall.box.half_extents[:2]))
    axis = box.axes[:, thin]
    side = np.sign(float((setup.mesh.bounds.mean(axis=0) - box.center) @ axis)) or 1.0
    out = side * ((setup.scene.mesh.corners(faces).mean(axis=1) - box.center) @ axis)
    order = np.argsort(out)
    area = np.cumsum(setup.scene.mesh.face_areas[faces][order])
    face = side * float(out[order][np.searchsorted(area, TOWARDS * area[-1])])
    half = box.half_extents.copy()
    half[thin] = 0.5 * SLAB
    import trimesh  # takes a quarter of a second, which cached results need not wait for

    solid = trimesh.creation.box(2.0 * half)
    return Mesh.of(solid.vertices @ box.axes.T + box.center + (face - side * half[thin]) * axis, solid.faces)


def in_plan(triangles: NDArray[np.float64], crop: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Mask of the triangles (n, 3, 3) that reach into a crop (2, 3) as seen from above, shape (n,)."""
    corner = triangles[:, :, :2]
    return np.asarray(((corner.max(axis=1) >= crop[0, :2]) & (corner.min(axis=1) <= crop[1, :2])).all(axis=1))


def neighbour_solid(setup: DropSetup, index: int) -> SoundSupport:
    """The solid of another instance near the crop."""
    instance, faces = setup.scene.instances[index], setup.faces_near_crop(index, NEARBY)
    mesh = setup.scene.mesh.submesh(faces)
    part = np.clip(setup.scene.face_part[faces], 0, None)
    own = np.array([p.box.bottom for p in instance.parts])[part]
    bottom = shell_bottoms(mesh, own, setup.config.shell)
    names = [instance.parts[p].name for p in np.unique(part)]
    return sound_support(setup, instance.id, names, mesh, part, bottom, torn=False)


def rows_of(setup: DropSetup, instance: Instance) -> list[PartMaterial]:
    """The material of each part of another thing; if its materials were not asked for, the material under the
    anchor."""
    if any(row.body == instance.id for row in setup.materials.rows):
        return setup.materials.of_parts(instance.id, len(instance.parts))
    return [setup.materials.of(setup.anchor.base_id, setup.anchor.part_index)] * len(instance.parts)


def obstacle(
    setup: DropSetup,
    foot: Footprint,
    name: tuple[str, str],
    sound: SoundSupport,
    kept: NDArray[np.bool_],
    rows: list[PartMaterial],
    main: PartMaterial,
) -> RigidSimulationBody:
    """A fixed rigid body, given its own `name` and its instance's: its faces (m,) in reach, each with the friction of
    its part, and its distance where the object may come. `rows` are the materials of all parts, `main` the material of
    the whole."""
    mesh, part = sound.mesh.submesh(np.flatnonzero(kept)), sound.part[kept]
    box, surface = setup.contact_region, obstacle_surface(mesh, foot)
    reached = np.stack([np.maximum(mesh.bounds[0], box[0]), np.minimum(mesh.bounds[1], box[1])])
    return RigidSimulationBody(
        name=name[0], instance=name[1], fixed=True, surface=surface,
        distance=obstacle_distance(setup, sound.solid, reached),
        inertial=inertial_of_shell(surface, main.material.density), friction=main.material.friction,
        face_friction=friction_of_surface(rows, surface, mesh, part),
    )  # fmt: skip


def obstacle_distance(setup: DropSetup, solid: MeshDistance, box: NDArray[np.float64]) -> DistanceGrid:
    """Samples of a fixed solid's distance over a box (2, 3) [m], at least THROUGH of them through a support."""
    wanted = float(np.linalg.norm(np.ptp(setup.mesh.vertices, axis=0))) / SAMPLES
    margin = max(MARGIN, THROUGH * wanted)
    spacing = affordable_spacing(box, wanted, margin, setup.config.distance_samples)
    grid = distance_samples(solid, box, spacing, margin=margin)
    beneath = under_thin_faces(solid, setup.mesh, box, THROUGH * spacing)
    if beneath is None:
        return grid
    return replace(grid, values=np.minimum(grid.values, distance_samples(beneath, box, spacing, margin=margin).values))


def governing_part(setup: DropSetup, rows: list[PartMaterial], part: NDArray[np.integer]) -> PartMaterial:
    """The part of the base whose friction represents the body, if its faces have none of their own: the part under the
    anchor if it is present, else the part with most faces (n,)."""
    for row in rows:
        if row.part_index == setup.anchor.part_index:
            return row
    return most_seen(rows, part)


def most_seen(rows: list[PartMaterial], part: NDArray[np.integer]) -> PartMaterial:
    """The part to which most of the faces (n,) belong, the first of several."""
    return max(rows, key=lambda r: (int((part == r.part_index).sum()), -r.part_index))
