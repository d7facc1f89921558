"""A segmented scene as a floor plan, the asset in its canonical pose, and the anchor of a proposed pose.

The plan has the outline of the floor and an upright box for each thing and part. The outline is the union of the
floor's faces seen from above, closed over gaps as wide as a wall, so that rooms that a door joins are one; holes are
filled, and of several pieces the largest is taken. A scene without a floor has the rectangle about all of it. Boxes
look where the thing's front is, as a viewer of it is defined elsewhere
(`dcap.geometry.placement.named_regions.viewer_frame`).

The sources of the baselines place assets that stand upright and face the same way. A file may have any orientation, so
our own method's rules for shapes bring it into that pose; the sentence's words on orientation are not used. The base
and part of an anchor only serve the report: the pose stays as proposed, even if it intersects something or hovers.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import shapely

from dcap.arrays import Array
from dcap.geometry.placement.named_regions import outline, viewer_frame
from dcap.geometry.placement.polygons import counter_clockwise, inside
from dcap.geometry.placement.poses import about_z, front_of
from dcap.geometry.placement.upright import standing_pose, stands_as_read
from dcap.geometry.raycast import Raycaster
from dcap.knowledge.kinds import front_side, to_right
from dcap.knowledge.lexicon import thing_of
from dcap.scene.types.boxes import OrientedBox
from dcap.scene.types.choices import Anchor
from dcap.scene.types.floor_plan import FloorPlan, PlanBox
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.segmentation import Instance, Segmentation

GAP = 0.25
"""Half of the widest gap in a floor that is bridged [m]: the width of a wall or a threshold."""
PLAIN = 0.02
"""Corners of the outline that stand out less are dropped [m]."""
LEVEL = 0.5
"""Faces of a floor whose unit normal's vertical component is larger show its outline [-]."""
SHELL = ("wall", "floor", "ceiling")
"""Labels of the room's structure, which are not things in it."""
KINDS: Mapping[str, tuple[str, ...]] = {
    "bathroom": ("bathtub", "toilet", "shower", "wash basin"),
    "bedroom": ("bed", "functional bed", "bed combination"),
    "kitchen": ("stove", "refrigerator", "kitchen counter"),
    "living room": ("sofa", "multi person sofa", "sofa combination"),
    "dining room": ("dining table",),
    "study": ("desk",),
}
"""Kinds of rooms by a typical thing in them, the first match counts; the source's rooms state their kind."""


def floor_plan_of(scene: Segmentation) -> FloorPlan:
    """The plan of a scene."""
    floors = [index for index, one in enumerate(scene.instances) if is_shell(one, ("floor",))]
    shape = outline_of(scene, floors)
    height = max((scene.instances[index].box.top for index in floors), default=float(scene.mesh.bounds[0, 2]))
    middle = np.array([*shape.mean(axis=0), height])
    boxes = [box for one in scene.instances if not is_shell(one) for box in boxes_of(one, middle)]
    return FloorPlan(kind_of(scene), shape, height, tuple(boxes))


def is_shell(one: Instance, names: tuple[str, ...] = SHELL) -> bool:
    """Whether an instance is a wall, a floor or a ceiling."""
    return one.structure and any(name in one.label for name in names)


def outline_of(scene: Segmentation, floors: list[int]) -> Array:
    """Corners of the floor seen from above [m], shape (k, 2)."""
    mine = np.flatnonzero(np.isin(scene.face_instance, floors))
    normals = scene.mesh.face_normals[mine]
    level = np.abs(normals[:, 2]) > LEVEL * np.maximum(np.linalg.norm(normals, axis=1), 1e-30)
    corners = scene.mesh.corners(mine[level])[:, :, :2].astype(np.float64)
    whole = shapely.union_all(shapely.polygons(corners)) if len(corners) else shapely.Polygon()
    closed = whole.buffer(GAP, join_style="mitre").buffer(-GAP, join_style="mitre")
    pieces = [one for one in shapely.get_parts(closed) if one.geom_type == "Polygon" and one.area > 0.0]
    if not pieces:
        low, high = scene.mesh.bounds[:, :2]
        return np.array([low, (high[0], low[1]), high, (low[0], high[1])], dtype=np.float64)
    largest = max(pieces, key=lambda one: float(one.area))
    ring = shapely.get_coordinates(shapely.Polygon(largest.exterior).simplify(PLAIN).normalize())[:-1]
    return counter_clockwise(np.asarray(ring, dtype=np.float64))


def boxes_of(one: Instance, room: Array) -> list[PlanBox]:
    """The box of a thing, and those of its parts where it has several; `room` is the room's middle [m], shape (3,)."""
    boxes = [plan_box(one, -1, one.label, one.box, room)]
    if len(one.parts) > 1:
        boxes += [plan_box(one, k, f"{one.label} {part.name}", part.box, room) for k, part in enumerate(one.parts)]
    return boxes


def plan_box(one: Instance, part: int, label: str, box: OrientedBox, room: Array) -> PlanBox:
    """A box that faces the viewer of the thing's front."""
    frame = viewer_frame(box, one.front, room)
    size = np.array([*(2.0 * frame.half), 2.0 * box.half_extents[2]])
    yaw = float(np.arctan2(frame.front[0], -frame.front[1]))
    return PlanBox(one.id, part, label, box.center.copy(), size, yaw)


def kind_of(scene: Segmentation) -> str:
    """Kind of the room."""
    labels = {one.label for one in scene.instances}
    return next((kind for kind, things in KINDS.items() if labels & set(things)), "room")


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
