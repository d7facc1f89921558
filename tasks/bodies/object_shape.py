"""The object as one solid: from its file if that is sound, otherwise from its visible shape, otherwise refused.

In: the object, its name and its pose before the drop. Out: the object with a surface that encloses a solid, or the hole
that cannot be closed. Lengths are measured at the object's size in the scene.
"""

from dataclasses import dataclass, replace

import numpy as np

from dcap.geometry.distance import MeshDistance
from dcap.geometry.pieces import hole_loops, is_closed
from dcap.geometry.solid.closed import RepairLimits, enclosed, is_sheet, tidied, used_as_given, with_faces_kept
from dcap.geometry.solid.repair import outer_faces
from dcap.geometry.solid.repair_log import RepairLog
from dcap.geometry.solid.visible_shape import OpenRim, cap_areas, has_walls, told_holes, visible_shape
from dcap.knowledge.kinds import is_vessel
from dcap.scene.types.choices import Anchor, Intent
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.outcome import Infeasible, ObjectHole, OpenObject, Reason
from dcap.scene.types.scan import RepairReport
from dcap.scene.types.segmentation import Segmentation

UNMOVED = 1e-4  # the visible surface may move this far [m]: contact points lie on the faces of the file
TOLD = 5  # maximum number of holes that are listed one by one


@dataclass(frozen=True, eq=False, slots=True)
class ObjectShape:
    """An object whose surface encloses a solid."""

    item: Segmentation
    """The object as given, or with a closed surface; in its own frame."""
    solid: MeshDistance
    """Its signed distance at the pose before the drop."""
    report: RepairReport
    notes: tuple[str, ...] = ()
    """Steps that closed the surface, one sentence each."""


@dataclass(frozen=True, eq=False, slots=True)
class OpenShape:
    """An object whose surface cannot be closed."""

    rims: tuple[OpenRim, ...]
    """Its holes at the pose before the drop, the largest first."""
    why: str


def object_shape(item: Segmentation, intent: Intent, anchor: Anchor) -> ObjectShape | OpenShape:
    """The object as a solid."""
    mesh = item.mesh.transformed(anchor.world_from_object)
    vessel = is_vessel(intent.object_name)
    solid, report = solid_of(mesh)
    if not report.problem and not one_sided(mesh, vessel):
        return ObjectShape(item, solid, report, closed_holes(mesh))
    shape = visible_shape(mesh, vessel=vessel)
    if shape.mesh is None:
        return OpenShape(shape.holes, shape.notes[0])
    closed = shape.mesh.transformed(np.linalg.inv(anchor.world_from_object).astype(np.float64))
    part = item.face_part[MeshDistance(mesh).nearest_face(shape.mesh.triangles.mean(axis=1))]
    whole = replace(item, mesh=closed, face_instance=np.zeros(len(part), dtype=np.int32), face_part=part)
    solid, found = solid_of(shape.mesh)
    if found.problem:
        return OpenShape(shape.holes, found.problem)
    found = replace(found, repairs=(*found.repairs, *shape.notes))
    return ObjectShape(whole, solid, found, shape.notes)


def closed_holes(mesh: Mesh) -> tuple[str, ...]:
    """Sentence about the holes of a mesh that are closed with caps while its faces are kept."""
    if is_closed(mesh):
        return ()
    size = float(np.ptp(mesh.bounds, axis=0).max())
    pieces = [p for p in tidied(mesh, None, RepairLog()).pieces if not is_sheet(p)]
    return tuple(dict.fromkeys(filter(None, (told_holes(piece, size) for piece in pieces))))


def one_sided(mesh: Mesh, vessel: bool | None) -> bool:
    """Return whether a mesh that caps would turn into a solid is the skin of a vessel with walls."""
    if is_closed(mesh) or not hole_loops(mesh):
        return False
    pieces = tidied(mesh, None, RepairLog()).pieces
    return any(not is_closed(p) and has_walls(p, cap_areas(p), vessel) for p in pieces)


def refused(shape: OpenShape, name: str) -> Infeasible:
    """The refusal of an object that is not a solid."""
    holes = tuple(ObjectHole(tuple(one.middle.tolist()), one.size) for one in shape.rims[:TOLD])
    place = ", ".join(f"{value:.3g}" for value in shape.rims[0].middle) if shape.rims else ""
    where = f" at ({place}) before the drop" if place else ""
    message = (
        f"the surface of the object ({name}) cannot be closed: {shape.why}{where}; close it in a mesh editor (fill "
        "holes, solidify)"
    )
    return Infeasible(Reason.OBJECT_NOT_SOLID, message, OpenObject(len(shape.rims), holes))


def solid_of(mesh: Mesh) -> tuple[MeshDistance, RepairReport]:
    """Signed distance to the object as one solid, and the repairs made; faces of pieces inside one another do not
    count.
    """
    allowed, log = RepairLimits(tolerance=UNMOVED), RepairLog()
    given = tidied(mesh, None, log)
    field = MeshDistance(mesh)
    if is_closed(mesh):
        outer = mesh.submesh(outer_faces(mesh))
        field = MeshDistance(outer, sides=mesh) if len(outer.faces) else field
    as_given = used_as_given(field, given, RepairLimits(), log.copy())
    sheet = any(is_sheet(piece) for piece in given.pieces)  # its contact points have one side only
    if sheet or (field.closed and not as_given.problem):
        return field, as_given
    found = with_faces_kept(given, enclosed(given, allowed), allowed, log)
    return (MeshDistance(found[0]), found[1]) if found is not None and not found[1].problem else (field, as_given)
