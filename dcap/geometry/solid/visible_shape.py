"""A solid of an object's visible shape: what is open or one-sided is closed as such a thing is.

In: the faces of an object and whether it is a vessel. Out: a closed surface that keeps the given faces, with a sentence
for each thing that was done, or the hole that cannot be closed. Sheets inside a closed shell are left out. A shell
that lacks a side (a pillow without underside, a toy scanned from the front) is closed from its rim and full; a vessel
(a cup whose surface has one side) and a tube open at both ends get walls; a sheet gets a thickness. Where faces cut
through one another, so that these ways give no sound surface, it is meshed again from the winding number of the closed
faces.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.arrays import Array, IntArray
from dcap.geometry.distance import MeshDistance
from dcap.geometry.pieces import hole_loops, is_closed, is_soup, pieces_of, signed_volume
from dcap.geometry.raycast import Raycaster
from dcap.geometry.solid.cleaning import cleaned
from dcap.geometry.solid.closed import SOUND, CleanedPart, RepairLimits, remeshed
from dcap.geometry.solid.closing import SKIN, area_vector, capped, perimeter, slab
from dcap.geometry.solid.mending import without_floating, wound_outwards
from dcap.geometry.solid.repair_log import RepairLog
from dcap.geometry.solid.soundness import WAYS, agreement, moved, well_formed
from dcap.geometry.solid.union import united
from dcap.scene.errors import GeometryError
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.outcome import Cause, Caution

MOUTH = 0.1  # least area of an opening over that of the surface for it to be a mouth, not damage [-]
NECK = 0.04  # the same for what is known to be a vessel: a vase has a narrow one [-]
DEEP = 0.25  # least depth of what is a vessel by its shape over the width of its mouth [-]
FLAT = 0.04  # volume over that of a cube on its opening below which a piece is a sheet [-]
WALL, THINNEST, THICKEST = 0.02, 1e-3, 5e-3  # of walls and sheets: over the object's size [-], and limits [m]
GAP = 0.02  # pieces nearer than this to one another, over the object's size, touch [-]
FLAKE = 0.01  # smaller pieces than this share of the area decide nothing [-]
LONE = 0.25  # share of the area in open pieces that touch nothing beyond which an object falls apart [-]
UNSEEN = 0.55  # share of a closed surface that was not seen beyond which the shape is a guess [-]
TOLERANCE = 0.02  # what is seen may be off a remesh by this share of the object's size [-]
CELLS = 150  # of a remesh along the object's longest side
TURNED = 0.02  # share of faces that were wound inwards beyond which that is told [-]
UPWARD = 0.7  # vertical component of the unit normal of a mouth that opens upwards
PLACES = np.array([[1 / 3, 1 / 3, 1 / 3], [0.9, 0.05, 0.05], [0.05, 0.9, 0.05], [0.05, 0.05, 0.9]])  # on a face
NOTED = 0.02  # holes of more than this share of the object's size around are told one by one [-]


@dataclass(frozen=True, eq=False, slots=True)
class OpenRim:
    """A hole in an object's surface."""

    rim: Array
    """Its border, a closed chain [m], shape (n, 3)."""

    @property
    def size(self) -> tuple[float, float]:
        """Length and width [m]."""
        _, _, axes = np.linalg.svd(self.rim - self.rim.mean(axis=0), full_matrices=False)
        length, width = np.ptp((self.rim - self.rim.mean(axis=0)) @ axes[:2].T, axis=0)
        return float(length), float(width)

    @property
    def middle(self) -> Array:
        """Middle of its border [m], shape (3,)."""
        return np.asarray(self.rim.mean(axis=0))

    @property
    def in_words(self) -> str:
        """Its size, for people."""
        return f"{1e2 * self.size[0]:.2g} x {1e2 * self.size[1]:.2g} cm"


@dataclass(frozen=True, eq=False, slots=True)
class VisibleShape:
    """Solid made of an object's faces."""

    mesh: Mesh | None
    """Closed and wound outwards; None if that cannot be done."""
    notes: tuple[str, ...]
    """Changes made, one sentence each; where `mesh` is None, why."""
    holes: tuple[OpenRim, ...]
    """The openings of the given faces, the largest first."""


def visible_shape(mesh: Mesh, *, vessel: bool | None) -> VisibleShape:
    """The solid of what is seen of an object. `vessel`: whether it holds something by its kind; None: not known."""
    if not mesh.face_areas.sum() > 0.0:
        return VisibleShape(None, ("its surface has no area",), ())
    kept, scraps, area = without_floating(mesh)
    whole = mesh.submesh(kept)
    outside = whole.submesh(np.flatnonzero(seen_from_outside(whole)))
    inner = len(whole.faces) - len(outside.faces)
    if inner and is_closed(outside):  # else what seems hidden may be the bottom of a cleft
        whole = outside
    # from above one looks into a cup, at the back of its floor: only the ways out tell
    faces, turned = wound_outwards(whole, Raycaster(whole), None)
    notes = [f"{scraps} scraps of {1e4 * area:.2g} cm2 in all, apart from it, are left out"] if scraps else []
    if whole is outside:
        notes.append(f"{inner} faces inside it, which nothing is seen of, are left out")
    if turned > TURNED * len(faces):
        notes.append(f"{turned} faces were inside out and are turned")
    whole, size = Mesh(whole.vertices, faces, whole.colors), float(np.ptp(mesh.bounds, axis=0).max())
    if is_soup(whole):
        return meshed_again([whole], [whole], size, notes, [])
    pieces = [p for p in pieces_of(cleaned(whole, RepairLog())) if p.face_areas.sum() > 0.0]
    rims = sorted(
        (OpenRim(p.vertices[loop]) for p in pieces for loop in hole_loops(p)), key=lambda one: -perimeter(one.rim)
    )  # fmt: skip
    if not pieces:
        return VisibleShape(None, ("its surface has no area",), ())
    if lone := apart(pieces, size):
        many = f"{lone} open pieces that do" if lone > 1 else "an open piece that does"
        why = f"it has {many} not touch{' the rest' if lone == 1 else ''}{largest_told(rims)}"
        return VisibleShape(None, (why,), tuple(rims))
    unseen = guessed_share(pieces, vessel)
    if unseen > UNSEEN:
        why = f"{100.0 * unseen:.0f} % of its surface would be a guess{largest_told(rims)}"
        return VisibleShape(None, (why,), tuple(rims))
    closed = []
    for piece in pieces:
        made, note = closed_piece(piece, vessel, size)
        closed.append(made)
        notes += [note] if note else []
    solid = united(closed, RepairLog())
    if solid is not None and well_formed(solid) and agreement(solid) >= SOUND:
        return VisibleShape(solid, tuple(dict.fromkeys(notes)), tuple(rims))
    return meshed_again(pieces, closed, size, notes, rims)


def seen_from_outside(mesh: Mesh) -> NDArray[np.bool_]:
    """Which faces can be seen from either side, shape (m,): a way leads out from one of four places on them."""
    caster, normal = Raycaster(mesh), mesh.face_normals
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), np.finfo(float).tiny)
    seen = np.zeros(len(mesh.faces), dtype=bool)
    for weight in PLACES:
        for way in np.concatenate([WAYS, -WAYS]):
            asked = np.flatnonzero(~seen)
            off = np.sign(normal[asked] @ way)[:, None] * SKIN * normal[asked]
            start = np.einsum("c,nci->ni", weight, mesh.corners(asked)) + off
            seen[asked] = ~caster.occluded(start, np.broadcast_to(way, start.shape))
    return seen


def largest_told(rims: list[OpenRim]) -> str:
    """How large the first of the holes is, to be added to a sentence; empty where there is none."""
    return f"; the largest hole is {rims[0].in_words}" if rims else ""


def apart(pieces: list[Mesh], size: float) -> int:
    """How many open pieces lie apart if much of the surface is open pieces that do not hang together, closed from their
    rims, with the largest, which counts if it is open too; else 0."""
    area = np.array([float(p.face_areas.sum()) for p in pieces])
    large = np.flatnonzero(area > FLAKE * area.sum()).tolist()
    whole = {one: capped(pieces[one], hole_loops(pieces[one]), RepairLog()) for one in large}
    caster = {one: Raycaster(mesh) for one, mesh in whole.items()}

    def near(one: int, other: int) -> bool:
        """Whether vertices of either lie on the other."""
        away = (caster[a].distance_to(whole[b].vertices).min() for a, b in ((one, other), (other, one)))
        return any(distance <= GAP * size for distance in away)

    main = int(np.argmax(area))
    waiting, left = [main], set(large) - {main}
    while waiting:
        start = waiting.pop()
        touching = {one for one in left if near(start, one)}
        left -= touching
        waiting += touching
    lone = [one for one in left if not is_closed(pieces[one])]
    count = len(lone) + (not is_closed(pieces[main]))
    return count if float(area[lone].sum()) > LONE * float(area.sum()) else 0


def guessed_share(pieces: list[Mesh], vessel: bool | None) -> float:
    """Share of the closed surface that caps would be [-]: those of pieces that get caps only."""
    seen = caps = 0.0
    for piece in pieces:
        areas = cap_areas(piece)
        seen += float(piece.face_areas.sum())
        if vessel is False or not (is_thin(piece, areas) or has_walls(piece, areas, vessel)):
            caps += float(areas.sum())
    return caps / (seen + caps)


def cap_areas(piece: Mesh) -> Array:
    """Area of the plane across each opening [m^2]."""
    return np.array([float(np.linalg.norm(area_vector(piece.vertices[loop]))) for loop in hole_loops(piece)])


def is_thin(piece: Mesh, caps: Array) -> bool:
    """Whether an open piece is a sheet: across its border there is next to no volume."""
    if len(caps) == 0 or caps.max() < MOUTH * float(piece.face_areas.sum()):
        return False
    whole = capped(piece, hole_loops(piece), RepairLog())
    return bool(abs(signed_volume(whole.vertices, whole.faces)) < FLAT * float(caps.max()) ** 1.5)


def has_walls(piece: Mesh, caps: Array, vessel: bool | None) -> bool:
    """Whether an open piece is the skin of a vessel, or of a tube: two large openings and none."""
    mouths = np.flatnonzero(caps > (NECK if vessel else MOUTH) * float(piece.face_areas.sum()))
    if len(mouths) == 0 or vessel:
        return len(mouths) > 0
    loops = hole_loops(piece)
    along = [area_vector(piece.vertices[loops[one]]) for one in mouths]
    if len(mouths) == 2 and along[0] @ along[1] < -UPWARD * float(np.prod(np.linalg.norm(along, axis=1))):
        return True
    rim = piece.vertices[loops[int(np.argmax(caps))]]
    # the border runs with the faces: seen from above clockwise around a mouth that opens upwards
    up = bool(-area_vector(rim)[2] > UPWARD * float(caps.max()))
    depth = float(rim[:, 2].min() - piece.bounds[0, 2])
    return vessel is None and up and depth > DEEP * float(np.sqrt(caps.max()))


def closed_piece(piece: Mesh, vessel: bool | None, size: float) -> tuple[Mesh, str]:
    """A piece closed, and what that took, in words."""
    loops = hole_loops(piece)
    if not loops:
        return piece, ""
    caps = cap_areas(piece)
    thickness = float(np.clip(WALL * size, THINNEST, THICKEST))
    if is_thin(piece, caps):
        return slab(piece, thickness, RepairLog()), f"a sheet with one side is taken as {1e3 * thickness:.2g} mm thick"
    largest = OpenRim(piece.vertices[loops[int(np.argmax(caps))]])
    if has_walls(piece, caps, vessel):
        least = (NECK if vessel else MOUTH) * float(piece.face_areas.sum())
        damage = [loop for loop, cap in zip(loops, caps, strict=True) if cap <= least]
        whole = capped(piece, damage, RepairLog())
        opening = f"with an opening of {largest.in_words}, gets walls of {1e3 * thickness:.2g} mm"
        return slab(whole, thickness, RepairLog()), f"its surface has one side and, {opening}"
    large = [one for one in loops if perimeter(piece.vertices[one]) > NOTED * size * np.pi]
    return capped(piece, loops, RepairLog()), capped_in_words(piece, loops, largest, told_where=bool(large))


def told_holes(piece: Mesh, size: float) -> str:
    """Sentence about a piece of a thing of that size [m] whose holes were capped; empty: there are none but cracks."""
    loops = [one for one in hole_loops(piece) if perimeter(piece.vertices[one]) > NOTED * size * np.pi]
    if not loops:
        return ""
    largest = max((OpenRim(piece.vertices[one]) for one in loops), key=lambda rim: perimeter(rim.rim))
    return capped_in_words(piece, loops, largest, told_where=True)


def capped_in_words(piece: Mesh, loops: list[IntArray], largest: OpenRim, *, told_where: bool) -> str:
    """That holes were closed, for people."""
    told = f"its surface is open: {len(loops)} hole{'s' * (len(loops) > 1)}, the largest of {largest.in_words} "
    where = f"{side_of(largest.middle, piece.bounds)}, closed from " if told_where else "closed from "
    return Caution(Cause.ASSUMED, f"{told}{where}{'the rim' if len(loops) == 1 else 'their rims'}")


def side_of(point: Array, bounds: Array) -> str:
    """On which side of a thing a point lies, in words."""
    offset = (point - bounds.mean(axis=0)) / np.maximum(0.5 * np.ptp(bounds, axis=0), 1e-9)
    axis = int(np.argmax(np.abs(offset)))
    if abs(offset[axis]) < 0.3:
        return "in its middle"
    return (("on its -x side", "on its +x side"), ("on its -y side", "on its +y side"), ("below", "above"))[axis][
        int(offset[axis] > 0.0)
    ]


def meshed_again(
    pieces: list[Mesh], closed: list[Mesh], size: float, notes: list[str], rims: list[OpenRim]
) -> VisibleShape:
    """The surface of what closed pieces enclose by winding number, if it is where the pieces are."""
    soup = Mesh.concatenate(closed)
    given = CleanedPart(tuple(closed), tuple(None for _ in closed))
    allowed = RepairLimits(tolerance=TOLERANCE * size, cell=size / CELLS)
    try:
        solid, report = remeshed(given, MeshDistance(soup), allowed, RepairLog())
    except GeometryError as error:
        return VisibleShape(None, (str(error),), tuple(rims))
    off = moved(Mesh.concatenate(pieces), solid)[0]
    if not is_closed(solid) or report.agreement < SOUND or off > TOLERANCE * size:
        why = f"closing it would move what is seen by up to {1e3 * off:.2g} mm{largest_told(rims)}"
        return VisibleShape(None, (why,), tuple(rims))
    told = f"it is meshed anew in cells of {1e3 * report.resolution:.2g} mm, at most {1e3 * off:.2g} mm off"
    return VisibleShape(solid, (*dict.fromkeys(notes), told), tuple(rims))
