"""The poses in which a thing can be put down: what may be chosen from, before any turn about the vertical.

In: a mesh, how it stands by its shape, and which frame is believed. Out: the pose of the file, its half turns and
quarter turns, the same of the pose in which the shape stands where that is another (a file that is lying or
overturned), and the stable poses of the convex hull. Each has up and front of the frame that it is turned from.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from dcap.geometry.placement.poses import front_of, rotated, stable_poses
from dcap.geometry.placement.upright import FILE_DOWN, probability_of, used_vertices
from dcap.scene.types.mesh import Mesh

Array = NDArray[np.float64]
FLIPS = {"x": (1.0, -1.0, -1.0), "y": (-1.0, 1.0, -1.0), "z": (-1.0, -1.0, 1.0)}
"""Diagonals of the half turns."""


@dataclass(frozen=True, eq=False, slots=True)
class RestingPose:
    """One way to put a thing down."""

    id: str
    """upright (as in the file), flip_x, on_left_side ..., righted (as its shape says), righted_flip_x ..., stable_0"""
    rotation: Array
    """From the mesh frame to the world, shape (3, 3)."""
    probability: float
    """Share of directions from which it comes to rest like that [-]; 0 where it is no stable pose."""
    up: Array
    """Where its own up points in the world, shape (3,)."""
    front: Array
    """Where its front points in the world, shape (3,)."""
    size: Array
    """Extents along world x, y, z [m], shape (3,)."""


def resting_poses(mesh: Mesh, own: Array, believed: Array, side: str) -> tuple[RestingPose, ...]:
    """All poses, that of the file first.

    Args:
        mesh: the thing at its scale.
        own: how it stands by its shape, shape (3, 3); the identity where that is as in the file.
        believed: the frame whose up and front stable poses have, to which any frame leads, shape (3, 3).
        side: what its category says of its front, as `front_of` takes it.
    """
    stable, points = stable_poses(mesh), used_vertices(mesh)

    def pose(name: str, rotation: Array, probability: float, axes: tuple[Array, Array]) -> RestingPose:
        up, front = (rotation @ axis for axis in axes)
        return RestingPose(name, rotation, probability, up, front, np.ptp(points @ rotation.T, axis=0))

    frames = {"upright": np.eye(3)} | ({} if np.allclose(own, np.eye(3)) else {"righted": own})
    found = []
    for name, frame in frames.items():
        axes = axes_of(mesh, frame, side)
        for turned, turn in turns_of(name, frame @ axes[1]).items():
            rotation = turn @ frame
            found.append(pose(turned, rotation, probability_of(rotation.T @ FILE_DOWN, stable), axes))
    axes = axes_of(mesh, believed, side)
    found += [pose(f"stable_{k}", one.rotation, one.probability, axes) for k, one in enumerate(stable)]
    return tuple(found)


def axes_of(mesh: Mesh, frame: Array, side: str) -> tuple[Array, Array]:
    """Up and front of a mesh that stands in a frame, shape (3, 3), as unit vectors of the mesh."""
    return frame[2], frame.T @ front_of(rotated(mesh, frame), side)[0]


def turns_of(frame: str, front: Array) -> dict[str, Array]:
    """Standing, the half turns about x, y, z and the quarter turns on to sides, back and front, by id."""
    side = np.cross(front, (0.0, 0.0, 1.0))
    prefix = "" if frame == "upright" else f"{frame}_"
    quarters = {"on_left_side": -front, "on_right_side": front, "on_back": side, "on_front": -side}
    halves = {f"{prefix}flip_{axis}": np.diag(diagonal) for axis, diagonal in FLIPS.items()}
    turned = {f"{prefix}{name}": Rotation.from_rotvec(np.pi / 2 * way).as_matrix() for name, way in quarters.items()}
    return {frame: np.eye(3)} | halves | turned
