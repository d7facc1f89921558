"""One object on one surface, from the meshes to measured placements.

In: the scene's mesh, the surface that carries, the object's mesh and the pose in which it rests, and the other
constraints. Out: placements that are free of collisions and inside the room, few and diverse, the best first. The
samples of the solve propose; here each pose is measured between the meshes, set so that it touches, and left out if the
two cut through each other by more than 2 mm.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from dcap.evaluation.baselines.fireplace.anchors import AnchorSurface
from dcap.evaluation.baselines.fireplace.constraints import COLLISION
from dcap.evaluation.baselines.fireplace.item_surfaces import surface_towards
from dcap.evaluation.baselines.fireplace.planar import InteractionSurface
from dcap.evaluation.baselines.fireplace.problem import PlacementProblem, ResolvedConstraint, SupportArea
from dcap.evaluation.baselines.fireplace.solve import SolvedPoses, solved
from dcap.geometry.placement.clearance import Clearance
from dcap.geometry.placement.polygons import convex_hull
from dcap.geometry.placement.poses import about_z, turn_between
from dcap.geometry.placement.search import PlacementSearch
from dcap.geometry.raycast import Raycaster
from dcap.geometry.segmentation.faces import surface_points
from dcap.scene.types.mesh import Mesh

Array = NDArray[np.float64]
UP = np.array([0.0, 0.0, 1.0])
LEVEL = float(np.cos(np.radians(3.0)))
"""Planes nearer to level than this are level [-]: noise of scans and seams."""
FLOOR_LIKE = 0.5
"""Surfaces whose normals rise less hold things to a wall: then the object is kept upright [-]."""
RAISED = 0.02
"""Gaps are measured from so high above the proposed pose [m]."""
OUTLINE_POINTS = 24
"""Points along the object's outline [-]."""
SPACING = 0.5
"""Of the points that fill a surface, in its cells [-]."""
MOST_CHECKED = 3
"""So many times the wanted number of poses are measured at most [-]."""
BESIDE_FLOOR = 0.02
"""How far over the floor's outline an object may reach [m]: walls overlap the floor of many files."""


@dataclass(frozen=True, eq=False, slots=True)
class RestingItem:
    """The object with one surface turned down, that surface's middle over the origin."""

    mesh: Mesh
    """Lowest point at height 0 [m]."""
    matrix: Array
    """From the mesh as read to that pose, scale included, shape (4, 4)."""
    contact: InteractionSurface
    """The surface, in that pose."""
    sides: Mapping[str, tuple[Array, Array]]
    """Middle and unit normal of the named sides in that pose, shape (3,) each."""
    up: Array
    """Its own up in that pose, shape (3,)."""


@dataclass(frozen=True, eq=False, slots=True)
class SurfaceFrame:
    """The frame of a surface that carries: origin at its middle, third axis along its normal."""

    rotation: Array
    """From the world, shape (3, 3)."""
    origin: Array
    """[m], shape (3,)."""

    @classmethod
    def of(cls, surface: InteractionSurface) -> "SurfaceFrame":
        """Of a surface; of nearly level ones the world's axes."""
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
    """One placement that satisfies the constraints as well as any."""

    world_from_object: Array
    """Of the mesh as read, scale included, shape (4, 4)."""
    loss: float
    """[-]."""
    overhang: float
    """Share of the contact surface beyond the rim [-]."""
    margin: float
    """How far its middle is inside the surface's rim [m]."""
    gap: float
    """Smallest distance along the normal between the object and what is under it, negative where it cuts in [m]."""
    terms: tuple[tuple[str, float], ...]
    """Each constraint's value [-]."""


@dataclass(frozen=True, eq=False, slots=True)
class SolveOutcome:
    """What the solve found."""

    placements: tuple[SolvedPlacement, ...]
    least_overhang: float
    """Of all poses that were looked at without anything in the way [-]."""
    proposed: int
    """Poses that the samples found good; those that the meshes refused are no placements [-]."""


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
    """The problem in the frame of the surface, and the frame; `scene` is the world's."""
    surface = anchor.surface
    frame = SurfaceFrame.of(surface)
    local = scene.transformed(frame.from_world)
    carries = np.zeros(len(scene.faces), dtype=bool)
    carries[surface.faces] = True
    ring = convex_hull(frame.points(surface.outline)[:, :2])
    search = PlacementSearch(local, Raycaster(local), carries, item.mesh)
    tilted = surface.normal[2] < FLOOR_LIKE
    return PlacementProblem(
        area=SupportArea.of(filled(local, anchor, ring), ring),
        search=search,
        flatness=anchor.flatness,
        item_height=search.height,
        contact_points=item.contact.points[:: max(1, len(item.contact.points) // 80), :2],
        footprint=along_ring(convex_hull(item.mesh.vertices[:, :2]), OUTLINE_POINTS),
        sides=item.sides,
        constraints=tuple(constraints),
        upright=(item.up, frame.rotation @ UP) if tilted else None,
    ), frame


def filled(local: Mesh, anchor: AnchorSurface, ring: Array) -> Array:
    """Points (k, 2) dense enough to fill every cell of the surface, whose hull is `ring` [m]."""
    if anchor.kind == "box":
        low, high = ring.min(axis=0), ring.max(axis=0)
        x, y = np.meshgrid(*(np.linspace(a, b, 320) for a, b in zip(low, high, strict=True)))
        points = np.c_[x.ravel(), y.ravel()]
        return np.asarray(points[shapely.contains_xy(shapely.Polygon(ring).buffer(1e-6), points)])
    cell = float(np.ptp(ring, axis=0).max()) / 160
    corners = local.corners(anchor.surface.faces)
    area = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    points, _ = surface_points(corners, area, SPACING * max(cell, 0.004))
    return np.asarray(np.concatenate([points, corners.reshape(-1, 3)])[:, :2])


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
    room: shapely.Geometry | None,
    *,
    seed: int,
    most: int,
) -> SolveOutcome:  # fmt: skip
    """Solve, then measure: up to `most` placements, the best first. `room`: the floor's outline; None: not known."""
    problem, frame = problem_of(scene, anchor, item, constraints)
    poses = solved(problem, seed, MOST_CHECKED * most)
    near = nearby(scene.transformed(frame.from_world), poses, item)
    caster = Raycaster(near)
    found: list[SolvedPlacement] = []
    for k in range(len(poses.poses)):
        if len(found) == most:
            break
        one = measured_placement(k, problem, poses, frame, item, near, caster)
        if one is not None and inside_room(item, one.world_from_object, room):
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
    near: Mesh,
    caster: Raycaster,
) -> SolvedPlacement | None:
    """The k-th pose, set so that it touches; None where it cuts through the scene."""
    turn = np.eye(4)
    turn[:3, :3] = about_z(poses.poses[k, 2])
    exact = Clearance(item.mesh.transformed(turn), near, caster)
    xy, proposed = poses.poses[k, :2], float(poses.height[k])
    touching = proposed + RAISED - exact.gap(np.array([*xy, proposed + RAISED]))
    if not np.isfinite(touching):
        return None
    height = float(problem.resting_height(np.array([touching]))[0])
    lifted = problem.beyond_flat(np.array([height])) - problem.beyond_flat(poses.height[k : k + 1])
    if lifted[0] > COLLISION and lifted[0] > 0.05 * problem.item_height:
        return None  # something thin that the samples missed is in the way
    if len(exact.cuts(np.array([*xy, height + COLLISION]))[0]):
        return None
    value = problem.evaluate(poses.poses[k : k + 1])
    turn[:3, 3] = (*xy, height)
    return SolvedPlacement(
        world_from_object=np.linalg.inv(frame.from_world) @ turn @ item.matrix,
        loss=float(value.loss[0]),
        overhang=float(value.overhang[0]),
        margin=float(problem.area.depth_at(xy[None])[0]),
        gap=height - touching,
        terms=tuple((name, float(one[0])) for name, one in value.terms),
    )


def inside_room(item: RestingItem, world_from_object: Array, room: shapely.Geometry | None) -> bool:
    """Whether the object's outline, seen from above, lies inside the floor's."""
    if room is None:
        return True
    resting_points = (item.mesh.vertices - item.matrix[:3, 3]) @ np.linalg.inv(item.matrix[:3, :3]).T
    ring = convex_hull((resting_points @ world_from_object[:3, :3].T + world_from_object[:3, 3])[:, :2])
    return bool(room.covers(shapely.Polygon(ring)))


def room_outline(floor: Mesh) -> shapely.Geometry | None:
    """The outline of a floor from above, a little wider; None where it has no area."""
    corners = floor.triangles[:, :, :2]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    flat = corners[np.abs(area) > 1e-9]
    if len(flat) == 0:
        return None
    return shapely.buffer(shapely.union_all(shapely.buffer(shapely.polygons(flat), 1e-4)), BESIDE_FLOOR)
