"""A closed, oriented solid of the faces of one part, and a report of what that took.

In: the faces of one part as scanned or modelled: an open sheet, a surface seen from above only, several closed shells
that overlap, a soup. Out: a closed surface wound outwards, without degenerate and duplicate faces, whose inside and
outside are beyond doubt, and measurements of how far it is from the visible faces. The given faces are kept where
that is possible: closed with walls down to a floor or with flat caps, and made one by a boolean union. The first way
whose result is sound and encloses what the generalised winding number of the given faces does is taken. Where none
is, the solid is sampled and meshed again by marching cubes.
"""

from dataclasses import dataclass
from functools import cached_property

import manifold3d
import numpy as np
from skimage.measure import marching_cubes

from dcap.arrays import Array
from dcap.geometry.distance import MeshDistance, sampled
from dcap.geometry.pieces import INSIDE, hole_loops, inside_out_shells, is_closed, own_shells, pieces_of, signed_volume
from dcap.geometry.raycast import Raycaster
from dcap.geometry.solid.cleaning import cleaned, without_scraps
from dcap.geometry.solid.closing import area_vector, borders, capped, room_behind, slab, walled
from dcap.geometry.solid.openings import filled_opening
from dcap.geometry.solid.repair import outer_faces, solid_under
from dcap.geometry.solid.repair_log import RepairKind, RepairLog
from dcap.geometry.solid.soundness import NEAR, agreement, moved, probes, well_formed
from dcap.geometry.solid.union import inside_out, manifold_of, mesh_of, united
from dcap.scene.errors import GeometryError
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.particles import DistanceGrid
from dcap.scene.types.scan import Method, RepairReport

SAME_SOLID = 0.98  # least overlap (intersection over union) of a repair with what the winding number says is inside
SOUND = 0.999  # least share of points on which winding number and parity agree: rays graze an edge now and then
SHEET = 1.5  # a piece of less than this times the area of the caps that would close it is a sheet, not a vessel
NONZERO = 0.01  # share of a cell that a sample is away from the surface at least
WHOLE = 0.1  # a winding number nearer than this to a whole one leaves no doubt
COARSER = 0.05  # share of a cell by which a remesh may be simplified
LOOSE = 0.25  # share of sheets in the surface of a support that may be ignored
CRUMB = 8.0  # pieces of a remesh smaller than this many cells are noise


@dataclass(frozen=True, slots=True)
class RepairLimits:
    """Limits of a repair; lengths in metres."""

    tolerance: float = 5e-3
    """The visible surface may move this far."""
    thickness: float = 0.03
    """A sheet that encloses nothing becomes this thick."""
    cell: float = 2e-3
    """Cells of a remesh; larger ones where `samples` would not do."""
    samples: int = 6_000_000
    """Most samples of a remesh."""
    opening: float = np.inf
    """A border of a support longer than this, seen from above and with faces below it, must not be filled. Of a part
    alone nobody can tell a tub from a mattress whose top a blanket hides: ask only for a whole thing."""


@dataclass(frozen=True, eq=False)
class CleanedPart:
    """The cleaned faces of a part."""

    pieces: tuple[Mesh, ...]
    """Its connected pieces."""
    floors: tuple[float | None, ...]
    """Height that each piece is solid down to [m]; None: as far as its own faces say."""
    within: Array | None = None
    """Where it matters how far what can be seen is from the solid [m], shape (2, 3); None: everywhere."""

    @cached_property
    def visible(self) -> Mesh:
        """All faces."""
        return Mesh.concatenate(list(self.pieces))

    @cached_property
    def stood_up(self) -> Mesh:
        """All faces, and walls and bottoms under supports: nobody looks in from below."""
        return Mesh.concatenate([on_floor(p, f, RepairLog()) for p, f in zip(self.pieces, self.floors, strict=True)])

    @cached_property
    def raycaster(self) -> Raycaster:
        """Rays against all faces."""
        return Raycaster(self.visible)

    def thickness(self, piece: Mesh, most: float) -> Array:
        """Return how thick a sheet becomes at each of its vertices [m], shape (n,): `most`, or less where it would come
        out of what lies behind it."""
        return np.minimum(most, room_behind(piece, self.raycaster))

    def moved(self, solid: Mesh) -> tuple[float, float, float]:
        """`soundness.moved` of what can be seen and matters."""
        return moved(self.visible, solid, behind=self.stood_up, within=self.within)

    def filled(self, solid: MeshDistance, allowed: RepairLimits) -> float:
        """Border of the largest opening of a support that a solid fills though it must not [m]; 0: none."""
        supports = [p for p, floor in zip(self.pieces, self.floors, strict=True) if floor is not None]
        return filled_opening(
            supports, self.visible, solid, longest=allowed.opening, shallow=allowed.tolerance, within=self.within
        )

    @property
    def region(self) -> tuple[float, ...]:
        """`within` as numbers for a report."""
        return () if self.within is None else tuple(self.within.reshape(-1).tolist())


def simulation_ready(
    mesh: Mesh, *, floor: Array | None = None, allowed: RepairLimits = RepairLimits()
) -> tuple[Mesh, RepairReport]:
    """The closed surface of a part, and its report.

    `floor` [m], shape (m,), one height per face, is given for supports that may have been seen from above only: they
    are solid down to it. What cannot be made a good solid is returned as near as it came; the report says why.
    """
    log = RepairLog()
    given = tidied(mesh, floor, log)
    inside = enclosed(given, allowed)
    found = with_faces_kept(given, inside, allowed, log)
    if found is not None and (not found[1].problem or given.filled(inside, allowed)):
        return found  # where what the winding number says is inside is too full, a remesh would be as well
    try:
        sampled_anew = remeshed(given, inside, allowed, log)
    except GeometryError:  # the given faces enclose nothing
        if found is None:
            raise
        return found
    # what is sound but hides a little too much is still better than what moves more
    if found is not None and (sampled_anew[1].agreement < SOUND or found[1].hausdorff < sampled_anew[1].hausdorff):
        return found
    return sampled_anew


def used_as_given(field: MeshDistance, given: CleanedPart, allowed: RepairLimits, log: RepairLog) -> RepairReport:
    """The report of a solid whose distance is read from the faces as they are and whose sides are told by winding
    number: where no way of closing them gives a sound surface that moves nothing. Its `agreement` is the share of
    points whose winding number is nearly a whole one, its `closed` asks for opposite edges only.
    """
    most, mean, spacing = given.moved(field.mesh)
    points = probes(field.mesh)
    points = points[field.unsigned(points) > NEAR]
    winding = field.winding(points)
    agree = float((np.abs(winding - np.round(winding)) < WHOLE).mean())
    single = field.closed and bool(np.isin(np.round(winding), (0.0, 1.0)).all())
    box = float(np.prod(1.1 * np.ptp(field.mesh.bounds, axis=0)))
    volume = field.volume if single else box * float((winding > INSIDE).mean())
    problem = ""
    if not (winding > INSIDE).any():
        problem = "its faces enclose nothing"
    elif agree < SOUND:
        problem = f"{100.0 * (1.0 - agree):.2g} % of the points tested are neither inside nor outside"
    elif most > allowed.tolerance:
        problem = f"what can be seen lies up to {1e3 * most:.2g} mm off its surface > {1e3 * allowed.tolerance:.2g} mm"
    log.add(RepairKind.BY_WINDING)
    return RepairReport(
        Method.WINDING, field.closed, agree, most, mean, allowed.tolerance, spacing, volume, 0.0,
        log.sentences(), problem, given.region,
    )  # fmt: skip


def tidied(mesh: Mesh, floor: Array | None, log: RepairLog, within: Array | None = None) -> CleanedPart:
    """The faces cleaned and divided into connected pieces of one floor, without scraps."""
    pieces: list[Mesh] = []
    floors: list[float | None] = []
    for level in [None] if floor is None else np.unique(floor).tolist():
        group = mesh if level is None else mesh.submesh(np.flatnonzero(floor == level))
        found = [p for apart in own_shells(group) for p in pieces_of(cleaned(apart, log))]
        pieces += found
        floors += [level] * len(found)
    closed = [i for i, piece in enumerate(pieces) if is_closed(piece)]
    for i, wrong in zip(closed, inside_out_shells([pieces[i] for i in closed]), strict=True):
        log.add(RepairKind.INVERTED, times=int(wrong))
        pieces[i] = inside_out(pieces[i]) if wrong else pieces[i]
    kept = without_scraps(pieces, log)
    if len(kept) == 0:
        raise GeometryError(f"none of {len(mesh.faces)} faces has an area: there is nothing to make a solid of")
    return CleanedPart(tuple(pieces[i] for i in kept), tuple(floors[i] for i in kept), within)


def is_sheet(piece: Mesh) -> bool:
    """Whether the caps that would close an open piece are about as large as the piece: it encloses nothing."""
    caps = sum(float(np.linalg.norm(area_vector(piece.vertices[loop]))) for loop in hole_loops(piece))
    return float(piece.face_areas.sum()) < SHEET * caps


def looks_down(piece: Mesh) -> bool:
    """Whether more of a piece is an underside than a top: what it belongs to lies above it."""
    return float(piece.face_normals[:, 2].sum()) < 0.0


def enclosed(given: CleanedPart, allowed: RepairLimits) -> MeshDistance:
    """Distance to the faces, with the sign of their generalised winding number; under a support's faces down to its
    floor, in a sheet over its thickness.
    """
    soup = []
    for piece, floor in zip(given.pieces, given.floors, strict=True):
        below, holes = borders(piece)
        if is_sheet(piece) and (floor is None or not below or looks_down(piece)):
            soup.append(slab(piece, given.thickness(piece, allowed.thickness), RepairLog()))
        elif floor is None:
            soup.append(piece)
        else:
            whole = capped(piece, holes, RepairLog())
            solid = solid_under(whole, np.full(len(whole.faces), floor))
            soup.append(inside_out(solid) if signed_volume(solid.vertices, solid.faces) < 0.0 else solid)
    sides = Mesh.concatenate(soup)
    if not is_closed(sides):
        return MeshDistance(sides)
    hull = outer_faces(sides)
    return MeshDistance(sides.submesh(hull) if len(hull) else sides, sides=sides)


def with_faces_kept(
    given: CleanedPart, inside: MeshDistance, allowed: RepairLimits, log: RepairLog
) -> tuple[Mesh, RepairReport] | None:
    """The first way of closing the pieces and uniting them that is good; else the one that moves least of what can be
    seen; None if none gives a sound solid.
    """
    ways = [with_caps] if all(floor is None for floor in given.floors) else [with_walls, with_caps]
    best = None
    for way in ways:
        own_log = log.copy()
        closed = [
            way(piece, floor, given, allowed, own_log) for piece, floor in zip(given.pieces, given.floors, strict=True)
        ]
        solid = united(closed, own_log)
        if solid is None or not well_formed(solid):
            continue
        report = reported(solid, given, 0.0, allowed, own_log)
        if report.agreement < SOUND or not (same_solid(solid, inside) or (way is not with_walls and vessels(given))):
            continue
        if not report.problem:
            return solid, report
        if best is None or report.hausdorff < best[1].hausdorff:
            best = solid, report
    return best


def vessels(given: CleanedPart) -> bool:
    """Whether nearly all pieces of a support end below by themselves: then a cap on each is as good as its floor."""
    if any(floor is None for floor in given.floors):
        return False
    area = np.array([float(p.face_areas.sum()) for p in given.pieces])
    return float(area[[is_sheet(p) for p in given.pieces]].sum()) < LOOSE * float(area.sum())


def with_walls(piece: Mesh, floor: float | None, given: CleanedPart, allowed: RepairLimits, log: RepairLog) -> Mesh:
    """A piece of a support closed by walls down to its floor."""
    below, holes = borders(piece)
    if floor is None or not below or (is_sheet(piece) and looks_down(piece)):
        return with_caps(piece, floor, given, allowed, log)
    return walled(capped(piece, holes, log), below, floor, log)


def on_floor(piece: Mesh, floor: float | None, log: RepairLog) -> Mesh:
    """A piece of a support with walls down to its floor where it ends below; its holes stay open."""
    below = borders(piece)[0] if floor is not None else []
    if floor is None or not below or (is_sheet(piece) and looks_down(piece)):
        return piece
    return walled(piece, below, floor, log)


def with_caps(piece: Mesh, floor: float | None, given: CleanedPart, allowed: RepairLimits, log: RepairLog) -> Mesh:
    """A piece closed by caps, a sheet by a second side."""
    if is_sheet(piece):
        return slab(piece, given.thickness(piece, allowed.thickness), log)
    return capped(piece, hole_loops(piece), log)


def same_solid(solid: Mesh, inside: MeshDistance) -> bool:
    """Whether a repair encloses what the given faces do, by their generalised winding number."""
    points = probes(solid, inside.mesh)
    one, two = MeshDistance(solid).inside(points), inside.inside(points)
    return float((one & two).sum()) >= SAME_SOLID * float((one | two).sum())


def remeshed(
    given: CleanedPart, inside: MeshDistance, allowed: RepairLimits, log: RepairLog
) -> tuple[Mesh, RepairReport]:
    """The surface of the sampled solid by marching cubes."""
    low, high = inside.mesh.bounds
    cell = max(allowed.cell, float(np.prod(high - low + 4.0 * allowed.cell) / allowed.samples) ** (1.0 / 3.0))
    grid = sampled(inside, low - 2.0 * cell, high + 2.0 * cell, cell)
    if not grid.values.min() < 0.0:
        raise GeometryError(
            f"{len(given.visible.faces)} faces enclose nothing at {1e3 * cell:.2g} mm; give a finer cell or a thickness"
        )
    log = log.copy()
    log.add(RepairKind.REMESHED, cell)
    solid = without_crumbs(level_set(grid), CRUMB * cell**3, log)
    return solid, reported(solid, given, cell, allowed, log)


def level_set(grid: DistanceGrid) -> Mesh:
    """The zero of a sampled distance as a closed surface, with no more faces than a twentieth of a cell demands."""
    least = NONZERO * grid.spacing  # a sample on the surface would make faces without area
    values = np.where(np.abs(grid.values) < least, np.copysign(least, grid.values), grid.values)
    rim = np.ones(values.shape, dtype=bool)
    rim[1:-1, 1:-1, 1:-1] = False
    values[rim] = np.abs(values[rim])  # nothing reaches out of the samples
    points, faces, _, _ = marching_cubes(values, 0.0, allow_degenerate=False)  # type: ignore[no-untyped-call]
    rough = Mesh.of(grid.origin + grid.spacing * points, faces)
    rough = inside_out(rough) if signed_volume(rough.vertices, rough.faces) < 0.0 else rough
    found = manifold_of(rough)
    if found.status() != manifold3d.Error.NoError:
        return rough
    coarse = mesh_of(found.simplify(COARSER * grid.spacing), [rough])
    return coarse if well_formed(coarse) else rough  # collapsed edges leave a face without area now and then


def without_crumbs(mesh: Mesh, least: float, log: RepairLog) -> Mesh:
    """The mesh without pieces of less than `least` volume [m^3]."""
    pieces = pieces_of(mesh)
    volume = [signed_volume(p.vertices, p.faces) for p in pieces]
    large = [i for i, v in enumerate(volume) if abs(v) > least] or list(range(len(pieces)))
    for crumb in set(range(len(pieces))) - set(large):
        log.add(RepairKind.CRUMB, abs(volume[crumb]))
    return Mesh.concatenate([pieces[i] for i in large])


def reported(solid: Mesh, given: CleanedPart, cell: float, allowed: RepairLimits, log: RepairLog) -> RepairReport:
    """Everything measured on a repaired surface. Its `agreement` is the share of points at which winding number and ray
    parity say the same, its `closed` asks also for good faces wound outwards.
    """
    closed = well_formed(solid)
    agree = agreement(solid) if closed else 0.0
    most, mean, spacing = given.moved(solid)
    problem = ""
    if not is_closed(solid):
        problem = "it is not closed"
    elif not closed:
        problem = "it has degenerate or duplicate faces, or encloses nothing"
    elif agree < SOUND:
        problem = f"winding number and ray parity disagree at {100.0 * (1.0 - agree):.2g} % of the points tested"
    elif most > allowed.tolerance:
        problem = f"its visible surface moved by {1e3 * most:.2g} mm > {1e3 * allowed.tolerance:.2g} mm"
    elif around := given.filled(MeshDistance(solid), allowed):
        problem = f"an opening of {around:.2g} m around, seen from above, is filled"
    method = Method.REMESHED if cell else Method.CLOSED
    return RepairReport(
        method, closed, agree, most, mean, allowed.tolerance, spacing, signed_volume(solid.vertices, solid.faces), cell,
        log.sentences(), problem, given.region,
    )  # fmt: skip
