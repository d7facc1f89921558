"""What stands around the soft part of the base: its rigid parts and other things in reach, as fixed rigid bodies."""

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.distance import MeshDistance
from dcap.geometry.solid.repair import subdivide_near
from dcap.geometry.solid.support import ready_support, shell_bottoms
from dcap.scene.types.materials import Material, PartMaterial
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.particles import SimulationBody
from tasks.bodies.footprint import Footprint
from tasks.particles.scenario import (
    Scenario,
    body_grid,
    in_reach,
    near_faces,
    note_friction,
    note_geometry,
    reach_box,
    rigid_body,
)


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
        bottom = shell_bottoms(mesh, own, s.config.shell)
        solid, report = ready_support(mesh, bottom, reach_box(s, foot), s.config.hole_perimeter)
        note_geometry(s, instance.id, [instance.parts[p].name for p in np.unique(part)], report)
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
    grid = body_grid(solid, np.stack([low, high]), spacing, 0.02, s.config.distance_samples)
    return rigid_body(name, instance, True, surface, grid, material)


def main_row(s: Scenario, rows: list[PartMaterial], part: NDArray[np.integer]) -> PartMaterial:
    """The part under the anchor if it is among the rows, else the one with most faces."""
    for row in rows:
        if row.part_index == s.anchor.part_index:
            return row
    return max(rows, key=lambda r: (int((part == r.part_index).sum()), -r.part_index))
