"""The base's parts and the meaning of the intent's words there; shared by the stages that orient and aim.

In: scene and intent. Out: the viewer's frame of a part, boxes of references, directions to faced things.
"""

from collections.abc import Sequence

import numpy as np

from dcap.arrays import Array
from dcap.geometry.pieces import components
from dcap.geometry.placement.named_regions import ViewerFrame, regions, viewer_frame
from dcap.scene.types.boxes import OrientedBox
from dcap.scene.types.choices import Intent
from dcap.scene.types.segmentation import Instance, Segmentation
from tasks.requests.views import part_views, room_center

PART = "part:"
UP = np.array([0.0, 0.0, 1.0])
WIDE = 1.2
"""Length above which a thing is faced at its nearest point rather than its middle [m]: walls, sofas."""
FLAT = 0.05
"""Largest height of a thing that people walk on: things on it count as standing on the floor [m]."""
LARGE = 0.2
"""Share of the largest piece's faces from which a piece of a part counts as a separate thing [-]: a sofa's arms."""


def part_frame(scene: Segmentation, base: Instance, box: OrientedBox) -> ViewerFrame:
    """A part's rectangle as seen by a viewer of the base's front."""
    return viewer_frame(box, base.front, room_center(scene))


def boxes_of(scene: Segmentation, base: Instance, reference: str) -> list[OrientedBox]:
    """Boxes of a referenced instance, or of all pieces of the parts of that name of the base."""
    if reference.startswith(PART):
        name, _, side = reference.removeprefix(PART).partition("/")
        named = [number for number, part in enumerate(base.parts) if part.name == name]
        boxes = [box for number in named for box in piece_boxes(scene, base, number)]
        return boxes if not side else outermost_box(boxes, side, part_frame(scene, base, base.box))
    return [scene.instances[scene.index_of(reference)].box]


def parts_meant(scene: Segmentation, base: Instance, reference: str) -> list[int]:
    """Indices of the base's parts for a reference `part:NAME` or `part:NAME/SIDE`."""
    name, _, side = reference.removeprefix(PART).partition("/")
    named = [number for number, part in enumerate(base.parts) if part.name == name]
    if not side or not named:
        return named
    boxes = [base.parts[number].box for number in named]
    best = outermost_box(boxes, side, part_frame(scene, base, base.box))[0]
    return [number for number, box in zip(named, boxes, strict=True) if box is best]


def outermost_box(boxes: list[OrientedBox], side: str, frame: ViewerFrame) -> list[OrientedBox]:
    """The box on one side: the leftmost, the frontmost or the uppermost, as the viewer of the frame sees them."""
    right, front = np.append(frame.right, 0.0), np.append(frame.front, 0.0)
    ways = {"left": -right, "right": right, "front": front, "back": -front, "top": UP, "bottom": -UP}
    return [max(boxes, key=lambda box: float(box.center @ ways[side]))] if boxes else []


def piece_boxes(scene: Segmentation, base: Instance, index: int) -> list[OrientedBox]:
    """A box for each large connected piece of a part, turned like the part's."""
    box = base.parts[index].box
    mine = np.flatnonzero((scene.face_instance == scene.index_of(base.id)) & (scene.face_part == index))
    piece = components(scene.mesh.submesh(mine))
    numbers, count = np.unique(piece, return_counts=True)
    large = numbers[count >= LARGE * count.max(initial=0)]
    if len(large) < 2:
        return [box]
    boxes = []
    for number in large:
        local = box.to_local(scene.mesh.corners(mine[piece == number]).reshape(-1, 3))
        low, high = local.min(axis=0), local.max(axis=0)
        boxes.append(OrientedBox(box.to_world(0.5 * (low + high)[None])[0], box.axes, 0.5 * (high - low)))
    return boxes


def reference_frame(
    scene: Segmentation, base: Instance, names: tuple[str, ...], regions: Sequence[str] = ()
) -> ViewerFrame | None:
    """Frame that defines left and front: on the floor the frame of a single referenced thing; otherwise None, for the
    part's frame.

    Doors and walls are seen from the room, as are things without a front. On a table, "in front of the chair" that
    stands next to it is the table's side at the chair: there the chair's front is towards the table.
    """
    if len(names) != 1 or names[0].startswith(PART):
        return None
    one = scene.instances[scene.index_of(names[0])]
    if not is_floor(base):
        stands_next_to_it = "front" in regions and horizontal_gap(base.box, one.box) > 0.0
        return (
            viewer_frame(one.box, base.box.center - one.box.center, room_center(scene)) if stands_next_to_it else None
        )
    return viewer_frame(one.box, None if one.structure else one.front, room_center(scene))


def is_floor(base: Instance) -> bool:
    """Return whether people walk on the base: a floor or a rug."""
    return base.structure or 2.0 * float(base.box.half_extents[2]) < FLAT


def horizontal_gap(a: OrientedBox, b: OrientedBox) -> float:
    """Horizontal distance of the axis-aligned boxes around two boxes [m]."""
    low, high = (np.stack([one.corners[:, :2].min(axis=0) for one in (a, b)]),
                 np.stack([one.corners[:, :2].max(axis=0) for one in (a, b)]))  # fmt: skip
    gap = np.maximum(low.max(axis=0) - high.min(axis=0), 0.0)
    return float(np.linalg.norm(gap))


def reference_boxes(scene: Segmentation, base: Instance, names: tuple[str, ...], near: Array) -> list[OrientedBox]:
    """Boxes of all references; those of the same name in order of distance to a point, nearest first."""
    found: list[OrientedBox] = []
    for name in names:
        boxes = sorted(boxes_of(scene, base, name), key=lambda b: float(np.linalg.norm(b.center[:2] - near[:2])))
        found.extend(boxes)
    return found


def wished_place(scene: Segmentation, base: Instance, intent: Intent, radius: float) -> Array:
    """Approximate place of the object [m], shape (3,): the aim of the requested region on the requested or the widest
    part."""
    views = part_views(scene, scene.index_of(base.id))
    widest = max(views, key=lambda view: (view.support_area, -view.index)).index
    box = next((part.box for part in base.parts if part.name == intent.region.part), base.parts[widest].box)
    frame = part_frame(scene, base, box)
    references = reference_boxes(scene, base, intent.region.references, box.center)
    areas = regions(frame, intent.region.names, references, np.full(2, radius))
    xy = areas[0].target if areas else box.center[:2]
    return np.array([*xy, box.top])


def direction_to(scene: Segmentation, base: Instance, place: Array, facing: str) -> Array | None:
    """Horizontal unit vector from the place to the faced thing, shape (3,); None if the thing does not exist."""
    if facing.startswith("away:"):
        opposite = direction_to(scene, base, place, facing.removeprefix("away:"))
        return None if opposite is None else -opposite
    frame = part_frame(scene, base, base.box)
    ways = {
        "viewer": frame.front,
        "front": frame.front,
        "back": -frame.front,
        "left": -frame.right,
        "right": frame.right,
    }
    if facing in ways:
        return np.array([*ways[facing], 0.0])
    if facing == "room":
        return horizontal(room_center(scene) - place)
    if facing in ("wall", "door", "window"):
        named = [i.box for i in scene.instances if facing in i.label]
    elif facing.startswith(PART) or any(i.id == facing for i in scene.instances):
        named = boxes_of(scene, base, facing)
    else:
        named = []
    points = [faced_point(box, place) for box in named]
    if not points:
        return None
    if facing.startswith(PART):  # two pillows count as one target
        return horizontal(np.mean(points, axis=0) - place)
    return horizontal(min(points, key=lambda p: float(np.linalg.norm(p[:2] - place[:2]))) - place)


def faced_point(box: OrientedBox, place: Array) -> Array:
    """The middle of a small thing, the nearest point of a long one [m], shape (3,)."""
    if 2.0 * box.half_extents[:2].max() < WIDE:
        return box.center
    local = np.clip(box.to_local(place[None])[0], -box.half_extents, box.half_extents)
    return np.asarray(box.to_world(local[None])[0])


def horizontal(vector: Array) -> Array | None:
    """Horizontal direction of a vector as a unit vector, shape (3,); None if it is vertical."""
    flat = np.array([vector[0], vector[1], 0.0])
    length = float(np.linalg.norm(flat))
    return None if length < 1e-6 else flat / length
