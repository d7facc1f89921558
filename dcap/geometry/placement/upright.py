"""Finds the side on which a mesh stands, from its shape alone: for files that are lying, tilted or overturned.

In: a mesh and a direction of it that may be down. Out: the quality of that stand: whether the centre of mass lies over
the footprint, the breadth of the footprint, the height of the centre, whether a hollow opens upwards, whether the shape
is round about the vertical. `upright_pose` weighs them. Features of this kind: Fu, Cohen-Or, Dror, Sheffer: Upright
orientation of man-made objects, 2008; the hollow and the weights are ours, from household things. Furniture on legs
looks overturned to them, because its hollow is below.
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
"""Height above the lowest point within which points touch the ground, over the largest extent [-]: scans are not
flat."""
LEAST_CONTACT = 0.02
"""Share of the plan below which a contact is an edge or a tip that nothing can stand on [-]."""
BESIDE = 0.05
"""Largest distance of the centre of mass outside the footprint, over the largest extent [-]: plush toys are hollow."""
RAYS = 24
"""Number of rays along each side of the plan that search for a hollow [-]."""
INNER = 0.4
"""Half width of the middle of the plan in which a hollow is searched, over the plan's half extents [-]."""
WEIGHTS = {"contact": 1.0, "low": 1.0, "probability": 0.3, "opening": 0.5, "round": 1.0, "aligned": 0.3}
ALIGNED = np.cos(np.radians(3.0))
"""Cosine of the tolerance for a file's own axes, along which files are mostly lying or overturned."""
FILE_DOWN = np.array([0.0, 0.0, -1.0])
SAME_SIDE = np.cos(np.radians(12.0))
"""Cosine of the largest angle between a stable pose and the side that it rests on; a standing pose within it is the
file's."""
OTHER_SIDE = np.cos(np.pi / 4.0)
"""Cosine of the angle from which a stable pose on a side is a different one: nobody would call both upright."""
MOST_POSES = 60
"""Maximum number of poses; a mesh with more is a ball [-]."""
LEAST_SHARE = 0.0005
"""Least share of directions of a pose [-]: things rarely fall on a slender foot, but are put on it."""
BEST_FEW = 12
"""Number of candidates that are examined from above and below [-]."""
ROUND_SHARE = 0.95
"""Least share of the surface of a round thing that maps onto itself when turned about its axis [-]."""
ROUND_SAMPLES = 2000
ROUND_SLACK = 0.05
"""Largest distance that counts as mapping onto itself, over the radius [-]."""


@dataclass(frozen=True, eq=False, slots=True)
class StandingFeatures:
    """Evidence for a direction being down."""

    down: Array
    """The direction in the mesh frame, unit, shape (3,)."""
    contact: float
    """Area of the footprint's hull over that of the plan's hull [-]."""
    height: float
    """Height of the centre of mass over that of the mesh [-]."""
    margin: float
    """Distance of the centre of mass inside the footprint's hull, over the largest extent; negative: outside [-]."""

    @property
    def stands(self) -> bool:
        """Whether it would stay in this pose on a plane, allowing for the flaws of a scan."""
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
    """Return whether a mesh would stand on a plane in its file's pose."""
    return standing_features(used_vertices(mesh), center_of_mass(mesh), FILE_DOWN).stands


def opening(mesh: Mesh, caster: Raycaster, down: Array) -> float:
    """Excess of the depth of the middle below the top over its height above the bottom, over the total height, -1..1;
    0.9 for a mug."""
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
    """The axis about which a mesh looks the same at any turn, a unit vector; None if there is none, or several."""
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
    # 37 and 133 degrees are not multiples of a fraction of a full turn, so a match is not a coincidence
    away = [tree.query(turned @ about_z(np.radians(angle)).T)[0] for angle in (37.0, 133.0)]
    return bool((np.maximum(*away) < near).mean() > ROUND_SHARE)


def upright_pose(mesh: Mesh) -> tuple[Array, float, float]:
    """Standing pose of a mesh by its shape alone, its advantage over the file's pose, and its certainty.

    Returns the rotation that puts the mesh on that side with its box's sides along x and y, shape (3, 3), and two
    differences of weighted sums of features [-]: to the file's side, and to the best of the sides far from the chosen
    one, inf if there is none.
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
    """Rotation to the pose in which the shape stands, and its advantage; the identity and 0 if that is the file's pose.
    And the shape's preference for it over any other side [-]."""
    own, gain, lead = upright_pose(mesh)
    return (np.eye(3), 0.0, lead) if gain <= 0.0 or own[2, 2] > SAME_SIDE else (own, gain, lead)


def probability_of(down: Array, poses: list[StablePose]) -> float:
    """Probability of the stable pose on that side; 0 if it is not stable."""
    return max((pose.probability for pose in poses if float(pose.down @ down) > SAME_SIDE), default=0.0)


def used_vertices(mesh: Mesh) -> Array:
    """The vertices that faces use [m], shape (n, 3)."""
    return mesh.vertices[np.unique(mesh.faces)]


def outermost(points: Array) -> Array:
    """The corners of the hull of points (n, 3); all points if they lie in a plane."""
    try:
        return np.asarray(points[ConvexHull(points).vertices])
    except QhullError:
        return points


def shape_score(one: StandingFeatures, probability: float, axis: Array | None) -> float:
    """Weighted sum of the features that do not require a search for a hollow."""
    upright = axis is not None and abs(float(axis @ one.down)) > np.cos(np.radians(10.0))
    aligned = float(np.abs(one.down).max()) > ALIGNED
    features = {"contact": one.contact, "low": 1.0 - one.height, "probability": probability,
                "round": float(upright), "aligned": float(aligned)}  # fmt: skip
    return sum(WEIGHTS[name] * value for name, value in features.items())
