"""Which side of a mesh is down when it stands, told by its shape alone: for files that are lying, tilted or overturned.

In: a mesh and one direction of it that may be down. Out: how good a stand that is: whether the centre of mass lies
over the footprint, how broad that is, how low the centre, whether a hollow opens upwards, whether the shape is round
about the vertical. `upright_pose` weighs them. Features of this kind: Fu, Cohen-Or, Dror, Sheffer: Upright orientation
of man-made objects, 2008; the hollow and the weights are ours, from household things. Furniture on legs looks
overturned to them: its hollow is below.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, QhullError, cKDTree

from dcap.arrays import Array
from dcap.geometry.placement.polygons import smallest_rectangle
from dcap.geometry.placement.poses import (
    StablePose,
    about_z,
    center_of_mass,
    stable_poses,
    surface_points,
    turn_between,
)
from dcap.geometry.raycast import Raycaster
from dcap.scene.types.mesh import Mesh

CONTACT_BAND = 0.01
"""Points this near to the lowest one touch the ground, over the largest extent [-]: scans are not flat."""
LEAST_CONTACT = 0.02
"""Share of the plan below which a contact is an edge or a tip, nothing to stand on [-]."""
BESIDE = 0.05
"""How far the centre of mass may lie outside the footprint, over the largest extent [-]: plush toys are hollow."""
RAYS = 24
"""Rays along each side of the plan that look for a hollow [-]."""
INNER = 0.4
"""The middle of the plan, in which a hollow is looked for, over its half extents [-]."""
WEIGHTS = {"contact": 1.0, "low": 1.0, "probability": 0.3, "opening": 0.5, "round": 1.0, "aligned": 0.3}
ALIGNED = np.cos(np.radians(3.0))
"""Files are mostly lying or overturned along their own axes."""
FILE_DOWN = np.array([0.0, 0.0, -1.0])
SAME_SIDE = np.cos(np.radians(12.0))
"""A stable pose rests on a side within this angle of it; a standing pose within it is the file's."""
OTHER_SIDE = np.cos(np.pi / 4.0)
"""A stable pose on a side beyond this angle is another one: nobody would call both upright."""
MOST_POSES = 60
"""More poses than that are those of a ball [-]."""
LEAST_SHARE = 0.0005
"""Things fall on a slender foot rarely, but are put on it [-]."""
BEST_FEW = 12
"""Number of candidates that are examined from above and below [-]."""
ROUND_SHARE = 0.95
"""Share of the surface that falls on itself when turned about the axis of a round thing [-]."""
ROUND_SAMPLES = 2000
ROUND_SLACK = 0.05
"""Distance that counts as falling on itself, over the radius [-]."""


@dataclass(frozen=True, eq=False, slots=True)
class StandingFeatures:
    """Evidence for one direction as down."""

    down: Array
    """In the mesh frame, unit, shape (3,)."""
    contact: float
    """Area of the footprint's hull over that of the plan's hull [-]."""
    height: float
    """Height of the centre of mass over that of the mesh [-]."""
    margin: float
    """Distance of the centre of mass inside of the footprint's hull, over the largest extent; negative: outside [-]."""

    @property
    def stands(self) -> bool:
        """Whether it would stay like that on a plane, the flaws of a scan allowed for."""
        return self.contact > LEAST_CONTACT and self.margin > -BESIDE


def standing_features(points: Array, center: Array, down: Array) -> StandingFeatures:
    """Footprint and centre of mass of vertices (n, 3) put down on that side."""
    turned = turn_between(down, np.array([0.0, 0.0, -1.0]))
    points, center = points @ turned.T, turned @ center
    size = np.ptp(points, axis=0)
    bottom = float(points[:, 2].min())
    low = points[points[:, 2] < bottom + CONTACT_BAND * size.max(), :2]
    height = float((center[2] - bottom) / max(size[2], 1e-12))
    try:
        footprint, plan = ConvexHull(low), ConvexHull(points[:, :2])
    except (QhullError, ValueError):  # a point, an edge
        return StandingFeatures(down, 0.0, height, -1.0)
    inside = -float((footprint.equations[:, :2] @ center[:2] + footprint.equations[:, 2]).max())
    return StandingFeatures(down, float(footprint.volume / plan.volume), height, inside / float(size.max()))


def stands_as_read(mesh: Mesh) -> bool:
    """Whether it would stand on a plane as it is in its file."""
    return standing_features(used_vertices(mesh), center_of_mass(mesh), FILE_DOWN).stands


def opening(mesh: Mesh, caster: Raycaster, down: Array) -> float:
    """How much deeper the middle lies below the top than above the bottom, over the height, -1..1; a mug's is 0.9."""
    turned = turn_between(down, np.array([0.0, 0.0, -1.0]))
    points = mesh.vertices @ turned.T
    low, high = points.min(axis=0), points.max(axis=0)
    steps = INNER * ((np.arange(RAYS) + 0.5) / RAYS * 2.0 - 1.0)
    x, y = (grid.ravel() for grid in np.meshgrid(steps, steps))
    plan = (low + high)[:2] / 2 + np.c_[x, y] * (high - low)[:2] / 2
    start = 0.01 * float((high - low).max())
    depths = []
    for height, way in ((high[2] + start, -1.0), (low[2] - start, 1.0)):
        origins = np.c_[plan, np.full(len(plan), height)] @ turned
        hits = caster.cast(origins, np.tile(np.array([0.0, 0.0, way]) @ turned, (len(plan), 1)))
        if not (hits.face >= 0).any():
            return 0.0
        depths.append(float(hits.distance[hits.face >= 0].mean()) - start)
    return (depths[0] - depths[1]) / max(float(high[2] - low[2]), 1e-12)


def round_axis(mesh: Mesh) -> Array | None:
    """The axis about which a mesh looks the same at any turn, a unit vector; None where there is none or many."""
    points = surface_points(mesh, ROUND_SAMPLES)
    points = points - points.mean(axis=0)
    _, axes = np.linalg.eigh(points.T @ points)
    found = [axis for axis in axes.T if _round_about(points, axis)]
    return np.asarray(found[0]) if len(found) == 1 else None


def _round_about(points: Array, axis: Array) -> bool:
    turned = points @ turn_between(axis, np.array([0.0, 0.0, 1.0])).T
    tree = cKDTree(turned)
    spacing = float(np.median(tree.query(turned, k=2)[0][:, 1]))
    near = ROUND_SLACK * float(np.linalg.norm(turned[:, :2], axis=1).max()) + 1.5 * spacing
    # 37 and 133 degrees are no multiple of a fraction of a full turn that could be met by chance
    away = [tree.query(turned @ about_z(np.radians(angle)).T)[0] for angle in (37.0, 133.0)]
    return bool((np.maximum(*away) < near).mean() > ROUND_SHARE)


def upright_pose(mesh: Mesh) -> tuple[Array, float, float]:
    """How a mesh stands by its shape alone, how much better than as it is in its file, and how sure that is.

    Returns the rotation that puts it on that side with its box's sides along x and y, shape (3, 3), and two differences
    of weighted sums of features [-]: to the file's side, and to the best of the sides far from the chosen one, inf
    where there is none.
    """
    caster, axis, center = Raycaster(mesh), round_axis(mesh), center_of_mass(mesh)
    points = used_vertices(mesh)

    def score(pose: StablePose) -> float:
        return shape_score(standing_features(points, center, pose.down), pose.probability, axis)

    poses = stable_poses(mesh, most=MOST_POSES, least=LEAST_SHARE)
    own = StablePose(np.eye(3), probability_of(FILE_DOWN, poses), FILE_DOWN, 0.0, 0.0)
    best = sorted(poses, key=score, reverse=True)[:BEST_FEW]
    full = [score(pose) + WEIGHTS["opening"] * opening(mesh, caster, pose.down) for pose in (own, *best)]
    chosen = best[int(np.argmax(full[1:]))]
    others = [value for value, pose in zip(full[1:], best, strict=True) if float(pose.down @ chosen.down) < OTHER_SIDE]
    corners = outermost(points)
    side, _ = smallest_rectangle((corners @ chosen.rotation.T)[:, :2])
    angle = float(np.arctan2(side[1], side[0]))
    aligned = about_z(np.pi / 2 * np.round(angle / (np.pi / 2)) - angle) @ chosen.rotation
    return np.asarray(aligned), max(full[1:]) - full[0], max(full[1:]) - max(others, default=-np.inf)


def standing_pose(mesh: Mesh) -> tuple[Array, float, float]:
    """Rotation to the pose in which the shape stands, and how much better; none and 0 where that is as in the file. And
    by how much the shape prefers it to any other side [-]."""
    own, gain, lead = upright_pose(mesh)
    return (np.eye(3), 0.0, lead) if gain <= 0.0 or own[2, 2] > SAME_SIDE else (own, gain, lead)


def probability_of(down: Array, poses: list[StablePose]) -> float:
    """Probability of the stable pose on that side; 0 if it is none."""
    return max((pose.probability for pose in poses if float(pose.down @ down) > SAME_SIDE), default=0.0)


def used_vertices(mesh: Mesh) -> Array:
    """The vertices that faces use [m], shape (n, 3)."""
    return mesh.vertices[np.unique(mesh.faces)]


def outermost(points: Array) -> Array:
    """The corners of the hull of points (n, 3); all of them where they lie in a plane."""
    try:
        return np.asarray(points[ConvexHull(points).vertices])
    except QhullError:
        return points


def shape_score(one: StandingFeatures, probability: float, axis: Array | None) -> float:
    """Weighted sum of what can be told without looking for a hollow."""
    upright = axis is not None and abs(float(axis @ one.down)) > np.cos(np.radians(10.0))
    aligned = float(np.abs(one.down).max()) > ALIGNED
    features = {"contact": one.contact, "low": 1.0 - one.height, "probability": probability,
                "round": float(upright), "aligned": float(aligned)}  # fmt: skip
    return sum(WEIGHTS[name] * value for name, value in features.items())
