"""The asset in the baselines' form, and the `Anchor` of a pose that a baseline proposes.

Their sources place assets of libraries in which every asset stands upright and faces the same way. A file may have any
orientation, so our own method's rules for shapes bring it into that pose; the sentence's words on orientation are not
used.

Turns a proposed pose into the `Anchor` that all methods return: the thing it seems to be on, and the reason.

Base and part only serve the report: the surface below the middle of the object if it is nearest to the object's lowest
point, else the thing or part under the middle of its box whose top is nearest. The pose itself stays as proposed, even
if it intersects something or hovers.
"""

from dataclasses import dataclass

import numpy as np

from dcap.arrays import Array
from dcap.geometry.placement.named_regions import outline, viewer_frame
from dcap.geometry.placement.polygons import inside
from dcap.geometry.placement.poses import about_z, front_of
from dcap.geometry.placement.upright import standing_pose, stands_as_read
from dcap.geometry.raycast import Raycaster
from dcap.knowledge.kinds import front_side, to_right
from dcap.knowledge.lexicon import thing_of
from dcap.scene.types.boxes import OrientedBox
from dcap.scene.types.choices import Anchor
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.segmentation import Instance, Segmentation


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


def proposed_anchor(scene: Segmentation, item: Mesh, world_from_object: Array, region: str, reason: str) -> Anchor:
    """The anchor for a final pose, shape (4, 4), of the object's own mesh."""
    low, high = item.transformed(world_from_object).bounds
    middle = 0.5 * (low + high)
    base, index = beneath(scene, middle[:2], float(low[2]), float(middle[2]))
    box = base.parts[index].box
    frame = viewer_frame(box, base.front, scene.mesh.bounds.mean(axis=0))
    return Anchor(
        base_id=base.id,
        part=base.parts[index].name,
        part_index=index,
        region=region,
        local=frame.local(middle[:2]),
        surface_point=np.array([*middle[:2], box.top]),
        world_from_object=world_from_object,
        clearance=float(low[2] - box.top),
        region_polygon=outline(frame),
        reason=reason,
    )


def beneath(scene: Segmentation, spot: Array, height: float, middle: float) -> tuple[Instance, int]:
    """The instance, and the index of its part, that carries or would carry an object over a spot (2,).

    Either the surface that a ray down from the object's middle [m] meets first, or the part whose top is nearest to
    the object's lowest `height` [m], of those under the spot (of all where nothing is under it): whichever is nearer
    to that height. A vessel carries in its hollow, far below its top; a deep cut hides the surface from the ray.
    """
    every = [(one, k) for one in scene.instances for k in range(len(one.parts))]
    under = [(one, k) for one, k in every if covers(one.parts[k].box, spot)]
    best = min(under or every, key=lambda pair: abs(pair[0].parts[pair[1]].box.top - height))
    away = abs(best[0].parts[best[1]].box.top - height)
    hit = Raycaster(scene.mesh).cast(np.array([[*spot, middle]]), np.array([[0.0, 0.0, -1.0]]))
    face = int(hit.face[0])
    if face < 0 or scene.face_instance[face] < 0 or scene.face_part[face] < 0:
        return best
    nearer = abs(float(hit.position[0, 2]) - height) <= away
    return (scene.instances[scene.face_instance[face]], int(scene.face_part[face])) if nearer else best


def covers(box: OrientedBox, spot: Array) -> bool:
    """Whether a spot (2,) lies in a box seen from above."""
    return bool(inside(box.corners[:4, :2], spot[None])[0])
