"""The asset in the baselines' form: at the common scale, upright, its front along -y, its box about the origin.

Their sources place assets of libraries in which every asset stands upright and faces the same way. A file may have any
orientation, so our own method's rules for shapes bring it into that pose; the sentence's words on orientation are not
used.
"""

from dataclasses import dataclass

import numpy as np

from dcap.arrays import Array
from dcap.geometry.placement.poses import about_z, front_of
from dcap.geometry.placement.upright import standing_pose, stands_as_read
from dcap.language.offline.kinds import front_side
from dcap.language.offline.lexicon import thing_of
from dcap.language.offline.pose_choice import to_right
from dcap.scene.types.mesh import Mesh


@dataclass(frozen=True, eq=False, slots=True)
class CanonicalAsset:
    """A mesh in its canonical pose."""

    mesh: Mesh
    """At its scale, the middle of its box at the origin."""
    canonical_from_object: Array
    """Maps the object's own mesh to it, scale included, shape (4, 4)."""
    has_front: bool
    """Whether shape or category distinguish front from back."""

    @property
    def size(self) -> Array:
        """Extents along x, y and z [m], shape (3,)."""
        return np.asarray(np.ptp(self.mesh.bounds, axis=0))

    def pose(self, center: Array, yaw: float, tilt: Array | None = None) -> Array:
        """World from object, shape (4, 4): the box's middle at `center` [m], turned by `yaw` [rad] after `tilt`, shape
        (3, 3)."""
        world = np.eye(4)
        world[:3, :3] = about_z(yaw) @ (np.eye(3) if tilt is None else tilt)
        world[:3, 3] = center
        return np.asarray(world @ self.canonical_from_object)


def canonical_asset(mesh: Mesh, scale: float, name: str) -> CanonicalAsset:
    """The asset of that name at an isotropic scale."""
    pose = np.diag([scale] * 3 + [1.0])
    scaled = mesh.transformed(pose)
    own, righting, _ = standing_pose(scaled)
    stands = stands_as_read(scaled)
    if to_right(thing_of(name), righting=righting, stands=stands, file_up=float(own[2, 2])):
        pose = with_rotation(own) @ pose
    front, told = front_of(mesh.transformed(pose), front_side(name))
    # the angle from the front to -y
    pose = with_rotation(about_z(float(-np.arctan2(front[0], -front[1])))) @ pose
    low, high = mesh.transformed(pose).bounds
    pose[:3, 3] -= 0.5 * (low + high)
    return CanonicalAsset(mesh.transformed(pose), pose, told)


def with_rotation(matrix: Array) -> Array:
    """A rotation, shape (3, 3), as a homogeneous matrix, shape (4, 4)."""
    pose = np.eye(4)
    pose[:3, :3] = matrix
    return pose
