"""A segmented scene as a floor plan: the outline of its floor and an upright box for each thing and part.

The outline is the union of the floor's faces seen from above, closed over gaps as wide as a wall, so that rooms that a
door joins are one; holes are filled, and of several pieces the largest is taken. A scene without a floor has the
rectangle about all of it. Boxes look where the thing's front is, as a viewer of it is defined elsewhere
(`dcap.geometry.placement.named_regions.viewer_frame`).
"""

from collections.abc import Mapping

import numpy as np
import shapely

from dcap.arrays import Array
from dcap.geometry.placement.named_regions import viewer_frame
from dcap.geometry.placement.polygons import counter_clockwise
from dcap.scene.types.boxes import OrientedBox
from dcap.scene.types.floor_plan import FloorPlan, PlanBox
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
