"""Things of a scene as a person named them: by their faces if the mesh is the same, else by their boxes.

In: a scan and its labels. Out: groups of faces with names, their parts if known, and notes. Unlabelled faces stay
ungrouped if the labels are complete; otherwise they are divided by shape.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from dcap.arrays import IntArray, Mask
from dcap.geometry.segmentation.boxed import Group, boxed_groups
from dcap.geometry.segmentation.faces import FaceTable
from dcap.geometry.segmentation.labels import Category, category_of
from dcap.geometry.segmentation.named import with_ids
from dcap.scene.errors import InputError
from dcap.scene.readers.frame import WORLD_FROM_FILE
from dcap.scene.types.boxes import OrientedBox, min_area_box
from dcap.scene.types.outcome import Cause, Caution
from dcap.scene.types.scan import LabelBox, Scan
from dcap.scene.types.segmentation import CornerFrame, GivenLabels, GivenThing, faces_digest

Parts = tuple[IntArray, list[str]]

MARGIN = 0.01
"""Margin by which a drawn box grows before its content is determined [m]."""
WHOLE = 0.75
"""A named thing with at least this share inside a new box keeps its name: a lamp on an added table [-]."""
FLAT = 0.06
"""Largest height of the box of a rug or a mat, which takes faces of the floor [m]."""


@dataclass(frozen=True, slots=True)
class GivenGroups:
    """Labels of a scan."""

    groups: list[Group]
    parts: dict[str, Parts]
    """Part of each face and the parts' names, by the id of a group."""
    notes: tuple[str, ...]


def given_groups(
    scan: Scan, table: FaceTable, labels: GivenLabels, taken_apart: Callable[[Mask], list[Group]]
) -> GivenGroups:
    """The labelled things; raises InputError if none of them is in the scene."""
    if labels.mesh and labels.mesh == faces_digest(scan.mesh):
        return by_faces(scan, table, labels)
    other = Caution(Cause.ASSUMED, f"{labels.source} was made for another mesh; using its boxes, not its faces")
    found = by_boxes(scan, table, labels, taken_apart)
    return replace(found, notes=(*((other,) if labels.mesh else ()), *found.notes))


def by_faces(scan: Scan, table: FaceTable, labels: GivenLabels) -> GivenGroups:
    """Groups by faces; a thing that only has a box takes the faces inside it."""
    count = len(table.area)
    owner = np.full(count, -1, dtype=np.int64)
    for number, thing in enumerate(labels.things):
        mine = faces_in(thing.faces, count, labels, thing.id or thing.label)
        taken = owner[mine]
        if (taken >= 0).any():
            other = labels.things[int(taken[taken >= 0][0])]
            raise InputError(
                f"--labels {labels.source}: face {mine[taken >= 0][0]} is of {other.id!r} and of {thing.id!r}; "
                "give both the same id to merge them"
            )
        owner[mine] = number
    notes = []
    boxed = [i for i, thing in enumerate(labels.things) if not len(thing.faces)]
    for number in sorted(boxed, key=lambda i: -float(np.prod(box_of(scan, labels, labels.things[i]).half_extents))):
        mine = held_by(table, box_of(scan, labels, labels.things[number]), owner, labels)
        if not len(mine):
            empty = f"{labels.source}: no face is in the box of {labels.things[number].label}; it is left out"
            notes.append(Caution(Cause.NOT_UNDERSTOOD, empty))
        owner[mine] = number
    groups = with_ids(
        [
            Group(
                thing.id,
                thing.label,
                np.flatnonzero(owner == number),
                None,
                thing.confidence,
                thing.guesses,
                box_of(scan, labels, thing).bottom if len(thing.corners) else None,
            )
            for number, thing in enumerate(labels.things)
        ]
    )
    parts = {
        group.id: part_numbers(thing, group.faces, count, labels)
        for group, thing in zip(groups, labels.things, strict=True)
        if thing.parts and len(group.faces)
    }
    return GivenGroups([group for group in groups if len(group.faces)], parts, (*labels.notes, *notes))


def faces_in(runs: IntArray, count: int, labels: GivenLabels, name: str) -> IntArray:
    """The faces of runs (k, 2), in order."""
    if len(runs) and int(runs[:, 1].max()) > count:
        raise InputError(f"--labels {labels.source}: {name} has face {runs[:, 1].max() - 1}, the mesh has {count}")
    length = runs[:, 1] - runs[:, 0]
    start = np.repeat(runs[:, 0] - (np.cumsum(length) - length), length)
    return np.unique(start + np.arange(int(length.sum())))


def held_by(table: FaceTable, box: OrientedBox, owner: IntArray, labels: GivenLabels) -> IntArray:
    """The faces that a new box takes. Faces of floor and walls count only if the box is flat; faces of named things
    wholly inside do not count."""
    inside = np.flatnonzero(box.contains(table.center, margin=MARGIN))
    flat = 2.0 * float(box.half_extents.min()) <= FLAT
    kept = np.ones(len(inside), dtype=bool)
    for number in np.unique(owner[inside][owner[inside] >= 0]):
        thing = labels.things[number]
        mine = owner[inside] == number
        share = table.area[inside[mine]].sum() / max(float(table.area[owner == number].sum()), 1e-12)
        structure = category_of(thing.label) is Category.STRUCTURE
        named = thing.confidence > 0.0 and not structure
        if (structure and not flat) or (named and share >= WHOLE):
            kept[mine] = False
    return inside[kept]


def part_numbers(thing: GivenThing, faces: IntArray, count: int, labels: GivenLabels) -> Parts:
    """The part of each face of a thing (k,) and the parts' names; faces without a part get the first part."""
    number = np.zeros(count, dtype=np.int64)
    for index, part in enumerate(thing.parts):
        number[faces_in(part.faces, count, labels, f"{thing.id}, {part.name},")] = index
    used, inverse = np.unique(number[faces], return_inverse=True)
    return np.asarray(inverse, dtype=np.int64).reshape(-1), [thing.parts[int(one)].name for one in used]


def by_boxes(
    scan: Scan, table: FaceTable, labels: GivenLabels, taken_apart: Callable[[Mask], list[Group]]
) -> GivenGroups:
    """Groups by labelled boxes, as in an annotated scene; the other things are found by shape."""
    given = [thing for thing in labels.things if len(thing.corners)]
    boxes = tuple(
        LabelBox(thing.id or f"{thing.label.replace(' ', '_')}_{i}", thing.label, box_of(scan, labels, thing))
        for i, thing in enumerate(given)
    )
    groups = boxed_groups(table, boxes)
    confidence = {box.id: thing.confidence for box, thing in zip(boxes, given, strict=True)}
    groups = [replace(group, confidence=confidence.get(group.id, 1.0)) for group in groups]
    held = {group.id for group in groups}
    things = [box for box in boxes if category_of(box.label) is not Category.STRUCTURE]
    missed = [box.label for box in things if box.id not in held]
    if things and len(missed) == len(things):
        low, high = scan.mesh.bounds
        raise InputError(
            f"--labels {labels.source}: none of its {len(things)} boxes holds anything of the scene, which spans "
            f"{np.round(low, 2).tolist()} to {np.round(high, 2).tolist()} m, z up; give labels in the scene's frame"
        )
    empty = Caution(Cause.NOT_UNDERSTOOD, f"{labels.source}: nothing of the scene is in the box of {', '.join(missed)}")
    notes = (empty,) if missed else ()
    if not labels.complete:
        named = [group for group in groups if category_of(group.label) is not Category.STRUCTURE]
        rest = np.ones(len(table.area), dtype=bool)
        for group in named:
            rest[group.faces] = False
        groups = named + (taken_apart(rest) if rest.any() else [])
    return GivenGroups(with_ids([group for group in groups if len(group.faces)]), {}, (*labels.notes, *notes))


def box_of(scan: Scan, labels: GivenLabels, thing: GivenThing) -> OrientedBox:
    """The box of a thing in the world."""
    if labels.frame is CornerFrame.FILE:
        map_ = scan.world_from_file
        return min_area_box(thing.corners @ map_[:3, :3].T + map_[:3, 3])
    turn = np.array(WORLD_FROM_FILE["y"] if labels.frame is CornerFrame.Y_UP else WORLD_FROM_FILE["z"], dtype=float)
    return min_area_box(thing.corners @ turn.T)
