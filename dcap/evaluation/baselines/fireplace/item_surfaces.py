"""The object's interaction surfaces: those on which it may rest, and its six named sides.

In: the object's mesh at its final scale, and what it is called. Out: `ItemSurfaces`. A surface that looks in a given
direction is what the mesh has of planar faces at its outermost in that direction (the four feet of a chair together);
where it has none, as a ball or a plush toy, the outermost part of its shape stands in, flattened on its box's side.
The directions offered for resting are those that every method is shown: the six sides as the file has it, those of the
pose in which the shape stands where that is another, and the resting faces of its convex hull.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation as Turn

from dcap.evaluation.baselines.fireplace.planar import FINE, LEAST_SHARE, InteractionSurface, hull_on_plane, surface_of
from dcap.geometry.placement.poses import (
    StablePose,
    front_of,
    stable_poses,
    surface_points,
    symmetry_about_z,
    turn_between,
)
from dcap.geometry.placement.seat import on_legs
from dcap.geometry.placement.upright import stands_as_read, upright_pose, used_vertices
from dcap.language.offline.fronts import front_side
from dcap.language.offline.lexicon import thing_of
from dcap.language.offline.pose_choice import to_right
from dcap.language.protocol.requests import PoseView, Vector
from dcap.scene.types.mesh import Mesh

Array = NDArray[np.float64]
SAME_POSE = float(np.radians(12.0))
"""Directions nearer than this are one [rad]."""
LOWEST = 0.08
"""What lies within this share of the extent of the outermost point belongs to a side without planar faces [-]."""
POINTS = 4000
"""Points that stand for a shape without planar faces [-]."""
DOWN = np.array([0.0, 0.0, -1.0])
FLIPS = {"x": (1.0, -1.0, -1.0), "y": (-1.0, 1.0, -1.0), "z": (-1.0, -1.0, 1.0)}
"""Diagonals of the half turns."""


@dataclass(frozen=True, eq=False, slots=True)
class ItemSurfaces:
    """What of the object can take part in a constraint; everything in the mesh's frame, at its final scale."""

    poses: tuple[PoseView, ...]
    """Surfaces on which it may rest, as the poses in which they look down."""
    sides: Mapping[str, InteractionSurface]
    """front, back, left, right, top, bottom of the standing object."""
    up: Array
    """Unit vector up of the standing object, shape (3,)."""
    symmetry: int
    """Order of the rotational symmetry about `up`; 0: any angle, 1: none."""
    has_front: bool
    stands: bool
    righting: float
    on_legs: bool
    """As in `OutlinesRequest`."""


def item_surfaces(mesh: Mesh, name: str) -> ItemSurfaces:
    """All surfaces of an object that is called so."""
    turn, gain, _ = upright_pose(mesh)
    own, righting = (np.eye(3), 0.0) if gain <= 0.0 or turn[2, 2] > np.cos(SAME_POSE) else (turn, gain)
    stands, side = stands_as_read(mesh), front_side(name)
    trusted = to_right(thing_of(name), righting=righting, stands=stands, file_up=float(own[2, 2]))
    believed = own if trusted else np.eye(3)
    standing = rotated(mesh, believed)
    front, has_front = front_of(standing, side)
    left = np.cross((0.0, 0.0, 1.0), front)
    ways = {"front": front, "back": -front, "left": left, "right": -left, "top": -DOWN, "bottom": DOWN}
    return ItemSurfaces(
        poses=rest_poses(mesh, own, (believed, side)),
        sides={key: surface_towards(mesh, believed.T @ way, key) for key, way in ways.items()},
        up=believed[2].copy(),
        symmetry=symmetry_about_z(standing),
        has_front=has_front,
        stands=stands,
        righting=righting,
        on_legs=on_legs(mesh, believed[2]),
    )


def surface_towards(mesh: Mesh, way: Array, name: str) -> InteractionSurface:
    """The outermost surface of a mesh in a direction (3,): its planar faces there, else its outermost part, flat."""
    along = used_vertices(mesh) @ way
    depth = max(FINE.offset, 0.01 * float(np.ptp(along)))
    normal, area = mesh.face_normals, mesh.face_areas
    looking = normal @ way > np.cos(FINE.angle) * 2.0 * area
    outer = (along.max() - mesh.triangles.mean(axis=1) @ way < depth) & looking & (area > 0.0)
    if area[outer].sum() > LEAST_SHARE * area.sum():
        return surface_of(mesh, np.flatnonzero(outer), name)
    points = np.concatenate([surface_points(mesh, POINTS), used_vertices(mesh)])
    reach = max(LOWEST * float(np.ptp(along)), FINE.offset)
    points = points[along.max() - points @ way < reach]
    points = points - (points @ way - along.max())[:, None] * way
    outline = hull_on_plane(points, points.mean(axis=0), way)
    center = outline.mean(axis=0) if len(outline) else points.mean(axis=0)
    size = float(np.prod(np.ptp(outline @ np.linalg.svd(way[None])[2][1:].T, axis=0))) if len(outline) else 0.0
    return InteractionSurface(name, center, way, points, outline, size, np.zeros(0, dtype=np.int64))


def rest_poses(mesh: Mesh, own: Array, believed: tuple[Array, str]) -> tuple[PoseView, ...]:
    """Ways to rest; `own` (3, 3) is how it stands by its shape, `believed` the frame of its up and its front's side."""
    stable = stable_poses(mesh)
    frame, side = believed
    frames = {"upright": np.eye(3)} | ({} if np.allclose(own, np.eye(3)) else {"righted": own})
    views = []
    for prefix, matrix in frames.items():
        axes = axes_of(mesh, matrix, side)
        views += [
            pose_view(name, turn @ matrix, probability_of(turn @ matrix, stable), mesh, axes)
            for name, turn in turns_of(prefix, matrix @ axes[1]).items()
        ]
    axes = axes_of(mesh, frame, side)
    views += [pose_view(f"stable_{k}", one.rotation, one.probability, mesh, axes) for k, one in enumerate(stable)]
    return tuple(views)


def turns_of(frame: str, front: Array) -> dict[str, Array]:
    """Standing, the half turns about x, y, z and the quarter turns on to sides, back and front, by id."""
    side = np.cross(front, (0.0, 0.0, 1.0))
    prefix = "" if frame == "upright" else f"{frame}_"
    quarters = {"on_left_side": -front, "on_right_side": front, "on_back": side, "on_front": -side}
    halves = {f"{prefix}flip_{axis}": np.diag(diagonal) for axis, diagonal in FLIPS.items()}
    turned = {
        prefix + name: np.asarray(Turn.from_rotvec(np.pi / 2 * way).as_matrix()) for name, way in quarters.items()
    }
    return {frame: np.eye(3)} | halves | turned


def axes_of(mesh: Mesh, frame: Array, side: str) -> tuple[Array, Array]:
    """Up and front of a mesh that stands in a frame, shape (3, 3), as unit vectors of the mesh."""
    return frame[2], frame.T @ front_of(rotated(mesh, frame), side)[0]


def probability_of(matrix: Array, stable: list[StablePose]) -> float:
    """Probability of the stable pose whose resting face points down under this rotation; 0 if none does."""
    return max((one.probability for one in stable if one.down @ (matrix.T @ DOWN) > np.cos(SAME_POSE)), default=0.0)


def pose_view(name: str, matrix: Array, probability: float, mesh: Mesh, axes: tuple[Array, Array]) -> PoseView:
    """One way to rest, with what it does to up, front and extents."""
    rows = (as_vector(matrix[0]), as_vector(matrix[1]), as_vector(matrix[2]))
    up, front = (as_vector(matrix @ axis) for axis in axes)
    size = as_vector(np.ptp(used_vertices(mesh) @ matrix.T, axis=0))
    return PoseView(name, rows, round(probability, 6), up, front, size)


def rotated(mesh: Mesh, matrix: Array) -> Mesh:
    """The mesh under a rotation."""
    pose = np.eye(4)
    pose[:3, :3] = matrix
    return mesh.transformed(pose)


def as_vector(values: Array) -> Vector:
    """Three floats."""
    x, y, z = (float(v) for v in values)
    return x, y, z


def turned_down(way: Array) -> Array:
    """The smallest rotation that makes a direction (3,) look down, shape (3, 3)."""
    return turn_between(way / np.linalg.norm(way), DOWN)
