"""One object on one surface, from the meshes to measured placements.

In: the scene's mesh, the supporting surface, the object's mesh and resting pose, and the other constraints. Out: a few
diverse placements that are free of collisions and inside the room, the best first. solve.py proposes poses; this module
measures each between the meshes, moves it into contact, and drops it if the meshes intersect by more than 2 mm.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from dcap.arrays import Array
from dcap.evaluation.baselines.fireplace.anchors import AnchorSurface, surface_towards
from dcap.evaluation.baselines.fireplace.planar import InteractionSurface
from dcap.evaluation.baselines.fireplace.problem import (
    COLLISION,
    FINEST,
    RASTER,
    PlacementProblem,
    ResolvedConstraint,
    SupportArea,
)
from dcap.evaluation.baselines.fireplace.solve import SolvedPoses, solved
from dcap.geometry.placement.clearance import Clearance, edges_of
from dcap.geometry.placement.polygons import convex_hull
from dcap.geometry.placement.poses import about_z, rotated, turn_between
from dcap.geometry.placement.search import PlacementSearch
from dcap.geometry.raycast import Raycaster
from dcap.geometry.segmentation.faces import surface_points
from dcap.scene.types.boxes import OrientedBox
from dcap.scene.types.mesh import Mesh

UP = np.array([0.0, 0.0, 1.0])
LEVEL = float(np.cos(np.radians(3.0)))
"""Least vertical part of the normal of a level plane [-]: 3 degrees for noise of scans and seams."""
FLOOR_LIKE = 0.5
"""Vertical part of a normal below which a surface counts as a wall, on which the object is kept upright [-]."""
RAISED = 0.02
"""Height above the proposed pose from which gaps are measured [m]."""
MISSED, MISSED_SHARE = 0.01, 0.05
"""Largest excess of the measured height over the sampled one, in metres and in object heights [m, -]: a larger one
means that something thin is in the way."""
OUTLINE_POINTS = 16
"""Points along the object's outline [-]."""
SPACING = 0.5
"""Spacing of the points that fill a surface, in its cells [-]."""
MOST_CHECKED = 3
"""Most proposed poses per wanted placement [-]."""
FLOOR_GAP = 0.2
"""Width of gaps in a floor that are bridged [m]: between things and under a skirting board."""
BESIDE_FLOOR = 0.02
"""Distance by which an object may extend over the floor's outline [m]: walls overlap the floor in many files."""


@dataclass(frozen=True, eq=False, slots=True)
class RestingItem:
    """The object with one surface facing down and its middle over the origin."""

    mesh: Mesh
    """Lowest point at height 0 [m]."""
    matrix: Array
    """From the mesh as read to that pose, scale included, shape (4, 4)."""
    contact: InteractionSurface
    """The surface, in that pose."""
    sides: Mapping[str, tuple[Array, Array]]
    """Middle and unit normal of the named sides in that pose, shape (3,) each."""
    up: Array
    """Its own up direction in that pose, shape (3,)."""


@dataclass(frozen=True, eq=False, slots=True)
class SurfaceFrame:
    """The frame of the supporting surface: origin at its middle, third axis along its normal."""

    rotation: Array
    """From the world, shape (3, 3)."""
    origin: Array
    """[m], shape (3,)."""

    @classmethod
    def of(cls, surface: InteractionSurface) -> "SurfaceFrame":
        """The frame of a surface; for a nearly level surface with the world's axes."""
        tilted = surface.normal[2] < LEVEL
        return cls(turn_between(surface.normal, UP) if tilted else np.eye(3), surface.center)

    @property
    def from_world(self) -> Array:
        """Shape (4, 4)."""
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = self.rotation, -self.rotation @ self.origin
        return matrix

    def points(self, world: Array) -> Array:
        """Points (n, 3) of the world in this frame."""
        return np.asarray((world - self.origin) @ self.rotation.T)


@dataclass(frozen=True, eq=False, slots=True)
class SolvedPlacement:
    """One of the placements that satisfy the constraints best."""

    world_from_object: Array
    """Of the mesh as read, scale included, shape (4, 4)."""
    loss: float
    """[-]."""
    overhang: float
    """Share of the contact surface beyond the rim [-]."""
    margin: float
    """Distance of the contact's middle inside the surface's rim [m]."""
    from_middle: float
    """Distance of the contact's middle from the surface's [m]."""
    gap: float
    """Smallest distance along the normal between the object and the surface under it, negative for an intersection
    [m]."""
    terms: tuple[tuple[str, float], ...]
    """Each constraint's value [-]."""


@dataclass(frozen=True, eq=False, slots=True)
class SolveOutcome:
    """Result of the solve."""

    placements: tuple[SolvedPlacement, ...]
    least_overhang: float
    """Least overhang of all examined poses without an obstacle [-]."""
    proposed: int
    """Number of poses that the solve proposed; the meshes may rule some out [-]."""


def resting(
    mesh: Mesh, scale: float, rotation: Array, sides: Mapping[str, InteractionSurface], up: Array
) -> RestingItem:
    """The object as read, scaled and turned (3, 3); `sides` and `up` (3,) are in the frame of the scaled mesh."""
    matrix = np.eye(4)
    matrix[:3, :3] = scale * rotation
    turned = mesh.transformed(matrix)
    contact = surface_towards(turned, -UP, "contact")
    shift = -np.array([*contact.center[:2], turned.bounds[0, 2]])
    matrix[:3, 3] = shift
    named = {name: (rotation @ one.center + shift, rotation @ one.normal) for name, one in sides.items()}
    placed = mesh.transformed(matrix)
    return RestingItem(placed, matrix, contact.transformed(np.eye(3), shift), named, rotation @ up)


def problem_of(
    scene: Mesh, anchor: AnchorSurface, item: RestingItem, constraints: Sequence[ResolvedConstraint]
) -> tuple[PlacementProblem, SurfaceFrame]:  # fmt: skip
    """The problem in the frame of the surface, and the frame; `scene` is in the world frame."""
    surface = anchor.surface
    frame = SurfaceFrame.of(surface)
    local = scene.transformed(frame.from_world)
    carries = np.zeros(len(scene.faces), dtype=bool)
    carries[surface.faces] = True
    ring = convex_hull(frame.points(surface.outline)[:, :2])
    cell = max(float(np.ptp(ring, axis=0).max()) / RASTER, FINEST)
    search = PlacementSearch(local, Raycaster(local), carries, item.mesh)
    tilted = surface.normal[2] < FLOOR_LIKE
    return PlacementProblem(
        area=SupportArea.of(filled(local, anchor, ring, cell), cell),
        search=search,
        flatness=anchor.flatness,
        item_height=search.height,
        contact_points=item.contact.points[:: max(1, len(item.contact.points) // 80), :2],
        footprint=along_ring(convex_hull(item.mesh.vertices[:, :2]), OUTLINE_POINTS),
        sides=item.sides,
        constraints=tuple(constraints),
        upright=(item.up, frame.rotation @ UP) if tilted else None,
    ), frame


def filled(local: Mesh, anchor: AnchorSurface, ring: Array, cell: float) -> Array:
    """Points (k, 2) dense enough to fill every cell [m] of the surface, whose hull is `ring`."""
    if anchor.kind == "box":
        return filled_polygon(ring, cell)
    corners = local.corners(anchor.surface.faces)
    area = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    points, _ = surface_points(corners, area, SPACING * cell)
    return np.asarray(np.concatenate([points, corners.reshape(-1, 3)])[:, :2])


def filled_polygon(ring: Array, cell: float) -> Array:
    """Points (k, 2) that fill a convex polygon, less than a cell [m] apart, its corners among them."""
    low, high = ring.min(axis=0), ring.max(axis=0)
    x, y = np.meshgrid(*(np.arange(a, b, SPACING * cell) for a, b in zip(low, high, strict=True)))
    points = np.c_[x.ravel(), y.ravel()]
    inner = shapely.contains_xy(shapely.Polygon(ring), points)
    return np.concatenate([ring, points[inner]])


def along_ring(ring: Array, count: int) -> Array:
    """The corners of a polygon (k, 2), and points between them at most a `count`-th of its length apart."""
    edge = np.roll(ring, -1, axis=0) - ring
    length = np.linalg.norm(edge, axis=1)
    parts = np.maximum(np.ceil(length / (length.sum() / count)).astype(int), 1)
    if len(ring) > 2 * count:  # a round thing
        return ring[:: len(ring) // count]
    return np.concatenate(
        [a + np.linspace(0, 1, n, endpoint=False)[:, None] * e for a, e, n in zip(ring, edge, parts, strict=True)]
    )


def placements(
    scene: Mesh,
    anchor: AnchorSurface,
    item: RestingItem,
    constraints: Sequence[ResolvedConstraint],
    room: SupportArea | None,
    *,
    seed: int,
    most: int,
) -> SolveOutcome:  # fmt: skip
    """Solve, then measure up to `most` placements, the best first. `room` is the room's plan, None if unknown."""
    problem, frame = problem_of(scene, anchor, item, constraints)
    poses = solved(problem, seed, MOST_CHECKED * most)
    edges = edges_of(item.mesh)
    near = nearby(scene.transformed(frame.from_world), poses, item)
    caster = Raycaster(near)
    found: list[SolvedPlacement] = []
    for k in range(len(poses.poses)):
        if len(found) == most:
            break
        start = posed(poses.poses[k], float(poses.height[k]))
        if not inside_room(item, np.linalg.inv(frame.from_world) @ start, room):
            continue
        turn = start[:3, :3]
        clearance = Clearance(
            rotated(item.mesh, turn), near, caster, (edges[0] @ turn.T, edges[1] @ turn.T)
        )  # fmt: skip
        one = measured_placement(k, problem, poses, frame, item, clearance)
        if one is not None:
            found.append(one)
    found.sort(key=lambda one: one.loss)
    return SolveOutcome(tuple(found), poses.least_overhang, len(poses.poses))


def nearby(local: Mesh, poses: SolvedPoses, item: RestingItem) -> Mesh:
    """The faces of the scene within reach of the object at some of the poses."""
    if len(poses.poses) == 0:
        return local
    reach = float(np.linalg.norm(item.mesh.vertices, axis=1).max()) + RAISED
    low = np.array([*poses.poses[:, :2].min(axis=0), poses.height.min()]) - reach
    high = np.array([*poses.poses[:, :2].max(axis=0), poses.height.max()]) + reach
    corners = local.triangles
    meets = ((corners.min(axis=1) <= high) & (corners.max(axis=1) >= low)).all(axis=1)
    return local.submesh(np.flatnonzero(meets))


def measured_placement(
    k: int,
    problem: PlacementProblem,
    poses: SolvedPoses,
    frame: SurfaceFrame,
    item: RestingItem,
    exact: Clearance,
) -> SolvedPlacement | None:
    """The k-th pose, moved into contact; None if it cuts through the scene."""
    xy, proposed = poses.poses[k, :2], float(poses.height[k])
    touching = proposed + RAISED - exact.gap(np.array([*xy, proposed + RAISED]))
    if not np.isfinite(touching):
        return None
    height = float(problem.resting_height(np.array([touching]))[0])
    if height - proposed > max(MISSED, MISSED_SHARE * problem.item_height):
        return None  # something thin that the samples missed is in the way
    if len(exact.cuts(np.array([*xy, height + COLLISION]))[0]):
        return None
    value = problem.evaluate(poses.poses[k : k + 1])
    return SolvedPlacement(
        world_from_object=np.linalg.inv(frame.from_world) @ posed(poses.poses[k], height) @ item.matrix,
        loss=float(value.loss[0]),
        overhang=float(value.overhang[0]),
        margin=float(problem.area.depth_at(xy[None])[0]),
        from_middle=float(np.linalg.norm(xy - problem.area.middle)),
        gap=height - touching,
        terms=tuple((name, float(one[0])) for name, one in value.terms),
    )


def posed(pose: Array, height: float) -> Array:
    """The object's pose in the surface's frame, shape (4, 4): x, y [m], yaw [rad]; height over the plane [m]."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = about_z(pose[2]), (pose[0], pose[1], height)
    return matrix


def inside_room(item: RestingItem, world_from_resting: Array, room: SupportArea | None) -> bool:
    """Whether the object's outline, seen from above, lies inside the room's."""
    if room is None:
        return True
    points = item.mesh.vertices @ world_from_resting[:3, :3].T + world_from_resting[:3, 3]
    return bool(room.depth_at(points[:, :2]).min() > -(BESIDE_FLOOR + 0.5 * room.cell))


def room_plan(floor: Mesh, things: Sequence[OrientedBox]) -> SupportArea:
    """The plan of a room: its floor and the outlines of the things in it, as a scan has no floor under them."""
    corners = floor.triangles
    cell = max(float(np.ptp(floor.bounds[:, :2], axis=0).max()) / RASTER, FINEST)
    points, _ = surface_points(corners, floor.face_areas, SPACING * cell)
    covered = [filled_polygon(one.corners[:4, :2], cell) for one in things if one.half_extents[:2].min() > 0.0]
    return SupportArea.of(np.concatenate([points[:, :2], *covered]), cell, round(FLOOR_GAP / cell), np.inf)
