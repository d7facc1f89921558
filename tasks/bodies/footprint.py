"""Predicts pose, place and width of the object's contact, and refines the surfaces there.

In: the object at its pre-drop pose, the surfaces beneath it, its weight, and the layers that press on each other.
Contact is predicted for the pose after the object has tilted onto the surface below; before that, one end hangs
higher than the other. The gap between underside and surface is measured along gravity; the object first touches where
the gap is smallest.

The gap over the plan has a lower convex hull. A rigid object comes to rest on the corners of the hull's facet under its
centre of mass, so it turns by the slope of this facet.

Faces are subdivided where the predicted contact needs smaller ones, within a budget. If the wanted edges do not fit,
the faces of the predicted contact get them first, and the rest of the reachable surface gets edges as short as the
remaining budget allows.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError
from scipy.spatial.transform import Rotation

from dcap.arrays import Array
from dcap.geometry.pieces import is_closed
from dcap.geometry.raycast import Raycaster
from dcap.geometry.solid.repair import longest_near, subdivide_near
from dcap.scene.errors import GeometryError
from dcap.scene.types.mesh import Mesh
from tasks.bodies.discretization import inertial_of_solid
from tasks.bodies.plan_contact import Heights, PlanContact, Stack, gap_map, plan_contact

TURNS = 3  # if the object is not flat, turning it changes the facet
STEEP = 0.5  # slope [-] from which an object falls over or slides instead of lying down
LEVEL = 1e-3  # slope too small to change a patch [-]
LEAST_DEPTH, MOST_DEPTH = 5e-4, 0.06  # expected indentation [m]: below it is invisible, above it no formula holds
WIDER = 4.0  # faces within this multiple of the indentation may touch before the object has tilted
UP = (0.0, 0.0, 1.0)
BELOW = 0.01  # a ray that looks for an underside starts this far below it [m]
MOST_POINTS_ACROSS = 24.0  # edges across the shorter side of a rigid object's footprint
LEAST_EDGE = 2e-3  # contact points of a rigid object are never refined beyond this [m]
EDGES_ACROSS = 100.0  # edges along a soft object's longest side
OBSTACLE_EDGES = 8.0  # edges of an obstacle across the shorter side of the footprint
LEAST_OBSTACLE_EDGE = 0.01  # [m]
OBSTACLE_FACES = 60_000  # maximum number of faces that refinement adds to an obstacle
FAR_EDGE = 0.02  # least edge of a soft support away from the footprint [m]
PER_CELL = 2.0  # edges per fine cell of a soft support under the footprint


def levelling(item: Mesh, center: Array, heights_of: Callable[[Mesh], Heights]) -> Array:
    """Matrix (4, 4) that turns the object about its centre of mass [m] onto the surface; the identity if it would fall
    over. `heights_of` measures the gap under the turned object."""
    turn = Rotation.identity()
    for _ in range(TURNS):
        turned = item.transformed(about(center, turn))
        x, y, gap, _ = gap_map(heights_of(turned), turned.bounds[:, :2])
        slope = slope_below(x, y, gap, center[:2])
        if slope is None or np.linalg.norm(slope) > STEEP:
            return np.eye(4)
        steepness = float(np.linalg.norm(slope))
        if steepness < LEVEL:
            break
        axis = np.array([-slope[1], slope[0], 0.0]) / steepness
        turn = Rotation.from_rotvec(np.arctan(steepness) * axis) * turn
    return about(center, turn)


def about(center: Array, turn: Rotation) -> Array:
    """A turn about a point as a matrix (4, 4)."""
    matrix = np.eye(4)
    matrix[:3, :3] = turn.as_matrix()
    matrix[:3, 3] = center - turn.apply(center)
    return matrix


def slope_below(x: Array, y: Array, gap: Array, center: Array) -> Array | None:
    """Slope along x and y of the facet of the gap's lower hull under a point in plan, shape (2,); None if no facet lies
    under it. `gap` [m] is known at some of x (k,) and y (m,), shape (k, m)."""
    point = np.stack([*np.meshgrid(x, y, indexing="ij"), gap], axis=-1).reshape(-1, 3)
    point = point[np.isfinite(point[:, 2])]
    if len(point) < 4 or np.linalg.matrix_rank(point[:, :2] - point[:, :2].mean(axis=0), tol=1e-9) < 2:
        return None
    try:
        hull = ConvexHull(point, qhull_options="QJ")  # flat gaps span no volume
    except QhullError:
        return None
    normal = hull.equations[:, :3]
    below = normal[:, 2] < -1e-9
    corner = point[hull.simplices[below]][:, :, :2] - center
    after = np.roll(corner, -1, axis=1)
    area = corner[:, :, 0] * after[:, :, 1] - corner[:, :, 1] * after[:, :, 0]
    around = np.flatnonzero((area >= 0.0).all(axis=1) | (area <= 0.0).all(axis=1))
    if len(around) == 0:
        return None
    facet = normal[below][around[0]]
    return np.asarray(-facet[:2] / facet[2])


@dataclass(frozen=True, eq=False, slots=True)
class Footprint:
    """The predicted contact."""

    low: Array
    """Lower corner of its bounding box [m], shape (3,)."""
    high: Array
    """Upper corner of its bounding box [m], shape (3,)."""
    wider: Array
    """Lower and upper corner of the surface that touches at WIDER times the indentation [m], shape (2, 3)."""
    on_base: Array
    """The same two boxes on the surface below, after the object has tilted [m], shape (2, 2, 3)."""
    half_width: float
    """Half the width of the contact along its narrower side [m]."""
    depth: float
    """Expected indentation [m]."""
    contacts: tuple[PlanContact, ...]
    """The patch, and the patch at the rest position of an earlier drop; empty if nothing there is soft."""

    @property
    def small_side(self) -> float:
        """Shorter horizontal side after the object has tilted [m]."""
        return float(np.ptp(self.on_base[0], axis=0)[:2].min())


def joined(one: Footprint, other: Footprint) -> Footprint:
    """Union of two places where the object may touch."""
    return Footprint(
        np.minimum(one.low, other.low), np.maximum(one.high, other.high), around(one.wider, other.wider),
        np.stack([around(a, b) for a, b in zip(one.on_base, other.on_base, strict=True)]),
        min(one.half_width, other.half_width), max(one.depth, other.depth), one.contacts + other.contacts,
    )  # fmt: skip


def around(one: Array, other: Array) -> Array:
    """The bounding box of two boxes, all of shape (2, 3)."""
    return np.stack([np.minimum(one[0], other[0]), np.maximum(one[1], other[1])])


@dataclass(frozen=True, eq=False, slots=True)
class Descent:
    """The object over the surface on which it comes down, before its contact is known."""

    beneath: Raycaster
    fallback_height: float
    """Height assumed for the surface below if a ray meets nothing [m]."""
    lying: Mesh
    """The object after it has tilted onto the surface below."""
    under: Array
    """Its downward faces at the pre-drop pose [m], shape (k, 3, 3)."""
    laid: Array
    """The same faces after the object has tilted [m], shape (k, 3, 3)."""
    gap: float
    """Smallest gap at the start [m]."""
    way: Array
    """Free distance below each face after the object has tilted [m], shape (k,)."""
    face_nearest: int
    """Face of the object that touches first."""
    first: Array
    """First point of contact on the surface below; the nearest to the object's middle wins a tie [m], shape (3,)."""

    @classmethod
    def of(cls, item: Mesh, beneath: Raycaster, fallback_height: float, *, tilts: bool) -> "Descent":
        """Descent of an object from its pre-drop pose; `tilts`: it may tilt onto the surface that it meets."""
        center = center_of(item)
        turn = levelling(item, center, lambda turned: heights_over(turned, beneath)) if tilts else np.eye(4)
        fine, under, gap, _ = underside(item, beneath, fallback_height)
        nearest = nearest_face(item, fine.triangles[under[int(np.argmin(gap))]].mean(axis=0))
        laid = fine.transformed(turn).triangles[under]
        middle = laid.mean(axis=1)
        way = gaps(middle, beneath, fallback_height)
        at_once = np.flatnonzero(way <= way.min() + LEAST_DEPTH)
        first = at_once[int(np.argmin(np.linalg.norm((middle[at_once] - center)[:, :2], axis=1)))]
        place = middle[first] - [0.0, 0.0, way[first]]
        return cls(
            beneath, fallback_height, item.transformed(turn), fine.triangles[under], laid, float(gap.min()), way,
            nearest, place,
        )  # fmt: skip

    def footprint(self, weight: float, stacks: tuple[Stack, Stack]) -> Footprint:
        """The contact under a weight [N] between the layers of the object and the layers below it."""
        contact = None
        if any(compliance > 0.0 for stack in stacks for _, compliance in stack):
            box = self.lying.bounds[:, :2]
            contact = plan_contact(heights_over(self.lying, self.beneath), box, weight, stacks)
            if contact is None:  # all of it is over a hole in the scan
                level = heights_over(self.lying, self.beneath, self.fallback_height)
                contact = plan_contact(level, box, weight, stacks)
        depth = LEAST_DEPTH if contact is None else float(np.clip(contact.patch.approach, LEAST_DEPTH, MOST_DEPTH))
        boxes, below = [], []
        for times in (1.0, WIDER):
            touching = self.way <= self.way.min() + times * depth
            boxes.append(box_of(self.under[touching]))
            below.append(box_of(self.laid[touching] - self.way[touching, None, None] * np.array(UP)))
        (low, high), wider = boxes
        half = 0.5 * float(np.ptp(below[0], axis=0)[:2].min()) if contact is None else contact.half_width
        contacts = () if contact is None else (contact,)
        return Footprint(low, high, wider, np.stack(below), half, depth, contacts)


def box_of(corner: Array) -> Array:
    """Bounding box of triangles (n, 3, 3) [m], shape (2, 3)."""
    return np.stack([corner.min(axis=(0, 1)), corner.max(axis=(0, 1))])


def heights_over(item: Mesh, beneath: Raycaster, fallback_height: float = np.nan) -> Heights:
    """Function that returns the heights at which vertical lines enter the object from below and meet the surface below
    it; `fallback_height` [m] if there is no surface."""
    own, start = Raycaster(item), float(item.bounds[0, 2]) - BELOW

    def heights(plan: Array) -> tuple[Array, Array]:
        origin = np.column_stack([plan, np.full(len(plan), start)])
        under = start + own.cast(origin, np.tile(UP, (len(plan), 1))).distance
        there = np.isfinite(under)
        top = np.full(len(plan), np.nan)
        top[there] = under[there] - gaps(np.column_stack([plan, under])[there], beneath, fallback_height)
        return np.where(there, under, np.nan), top

    return heights


def center_of(item: Mesh) -> Array:
    """Centre of mass of the solid, or of the surface if it is open [m], shape (3,)."""
    if is_closed(item):
        try:
            return inertial_of_solid(item, 1.0).center_of_mass
        except GeometryError:
            pass
    return np.average(item.triangles.mean(axis=1), axis=0, weights=np.maximum(item.face_areas, 1e-12))


def underside(
    item: Mesh, beneath: Raycaster, fallback_height: float
) -> tuple[Mesh, NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """The object with small faces, the indices of its downward faces (k,), the distance below them [m] and their area
    in plan [m^2]."""
    size = float(np.ptp(item.vertices, axis=0).max())
    fine = subdivide_near(item, item.bounds, max(size / 40.0, 1e-3)) if len(item.faces) < 4000 else item
    normal = fine.face_normals
    under = np.flatnonzero(normal[:, 2] < 0.0)
    if len(under) == 0:  # wound inside out, or a sheet seen from above
        under = np.flatnonzero(np.abs(normal[:, 2]) > 0.0)
    center = fine.triangles[under].mean(axis=1)
    return fine, under, gaps(center, beneath, fallback_height), 0.5 * np.abs(normal[under, 2])


def first_curvature(item: Mesh, beneath: Raycaster, fallback_height: float) -> float:
    """Radius [m] of the sphere whose cap of LEAST_DEPTH has the same area as the object within that depth of first
    contact: A = 2 pi R d. For a flat underside the radius is much larger than its width, and a larger radius sinks in
    deeper."""
    _, _, gap, area = underside(item, beneath, fallback_height)
    return float(area[gap <= gap.min() + LEAST_DEPTH].sum()) / (2.0 * np.pi * LEAST_DEPTH)


def gaps(points: NDArray[np.float64], beneath: Raycaster, fallback_height: float) -> NDArray[np.float64]:
    """Free distance below points (n, 3), along gravity [m], shape (n,)."""
    hits = beneath.cast(points, np.broadcast_to(np.array([0.0, 0.0, -1.0]), points.shape))
    return np.where(np.isfinite(hits.distance), hits.distance, points[:, 2] - fallback_height)


def nearest_face(mesh: Mesh, point: NDArray[np.float64]) -> int:
    """The face whose middle is nearest to a point."""
    return int(np.argmin(np.linalg.norm(mesh.triangles.mean(axis=1) - point, axis=1)))


def rigid_object_surface(mesh: Mesh, foot: Footprint, edge: float, most_faces: int) -> Mesh:
    """The surface with edges of about `edge` [m] where a rigid object will touch, within `most_faces` additional
    faces."""
    margin = 0.3 * (foot.high - foot.low) + foot.depth
    first, later = (grown(part, margin) for part in (np.stack([foot.low, foot.high]), foot.wider))
    return refined(mesh, first, later, max(edge, foot.small_side / MOST_POINTS_ACROSS, LEAST_EDGE), most_faces)


def soft_object_surface(mesh: Mesh, bounds: Array, cell: float, most_faces: int) -> Mesh:
    """The surface of a soft object with the given bounds (2, 3), with edges as long as a cell [m], within `most_faces`
    additional faces."""
    return subdivide_near(mesh, bounds, max(cell, float(np.ptp(bounds, axis=0).max()) / EDGES_ACROSS), most_faces)


def obstacle_surface(mesh: Mesh, foot: Footprint) -> Mesh:
    """The surface of a fixed rigid body, finer where the object will probably touch it."""
    edge = max(foot.small_side / OBSTACLE_EDGES, LEAST_OBSTACLE_EDGE)
    region = grown(around(np.stack([foot.low, foot.high]), foot.on_base[0]), np.full(3, foot.half_width + edge))
    return subdivide_near(mesh, region, edge, OBSTACLE_FACES)


def soft_support_surface(
    mesh: Mesh, foot: Footprint, crop: Array, box: Array, cell: float, most_faces: int
) -> tuple[Mesh, float]:
    """Visible soft faces within the box (2, 3), and the longest remaining edge where the object may touch [m].

    Edges under the footprint are half a fine cell long, as far as `most_faces` allows; they are longer farther away in
    the crop and below the expected depth of the object. Faces as long as a cell cut off the dent under an edge: a
    dumbbell seemed to stick 1 mm into its bed.
    """
    margin = np.array([0.3, 0.3, 0.0]) * np.ptp(foot.on_base[0], axis=0) + 0.5 * foot.half_width
    first, later = (grown(part, margin) for part in foot.on_base)
    first[0, 2] -= foot.depth
    later[0, 2] -= WIDER * foot.depth
    mesh = subdivide_near(mesh, crop, max(4.0 * cell, FAR_EDGE), most_faces)
    mesh = refined(mesh, first, later, cell / PER_CELL, most_faces)
    longest = longest_near(mesh, later)
    inside = ((mesh.vertices >= box[0]) & (mesh.vertices <= box[1])).all(axis=1)
    return mesh.submesh(np.flatnonzero(inside[mesh.faces].all(axis=1))), longest


def refined(mesh: Mesh, first: Array, later: Array, edge: float, most_added: int) -> Mesh:
    """The mesh with edges of at most `edge` [m] in the box `later` (2, 3); if the budget is too small, only its part
    `first` (2, 3) gets them, and the rest the shortest edges that fit."""
    fine = subdivide_near(mesh, later, edge, most_added)
    if longest_near(fine, later) <= edge * (1.0 + 1e-9):
        return fine
    fine = subdivide_near(mesh, first, edge, most_added)
    return subdivide_near(fine, later, edge, most_added - (len(fine.faces) - len(mesh.faces)))


def grown(box: Array, margin: Array) -> Array:
    """A box (2, 3) that is wider by a margin [m] on each side."""
    return np.stack([box[0] - margin, box[1] + margin])
