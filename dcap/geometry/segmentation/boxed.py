"""Instances of an annotated scene: assigns faces to labelled boxes.

A connected component inside boxes belongs as a whole to the smallest of them: the lamp on the table is not the table.
Components outside all boxes are the shell of the room or several things fused by the scan; their faces are assigned to
floor, ceiling and walls by level and plane first, then to the smallest box around them.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.segmentation.faces import FaceTable
from dcap.geometry.segmentation.labels import Category, category_of, plain_structure
from dcap.geometry.segmentation.rooms.shell import PLANE_BAND, ceiling_faces, find_levels, floor_faces, wall_number
from dcap.scene.text import words_of
from dcap.scene.types.boxes import OrientedBox
from dcap.scene.types.scan import LabelBox

MARGIN = 0.03
"""Margin of boxes in testing their content [m]: annotations and scans are no more precise."""

HELD = 0.75
"""Share of a component's area that a box must hold to own it as a whole [-]."""

CLAIM_MARGIN = 0.01
"""Margin of a small thing's box in claiming faces from its support [m]."""

FLAT_THING = 0.06
"""Thickness below which a box on the floor is a rug [m]."""

FLAT_ON_WALL = 0.25
"""Thickness below which a box is a thing in or on a wall [m]: doors and windows reach through the wall."""

NEAR_BEST = 0.12
"""Excess share of a component that a larger box must hold to win over a smaller one [-]."""


@dataclass(frozen=True, eq=False, slots=True)
class Group:
    """A labelled set of faces, before its parts are determined."""

    id: str
    label: str
    faces: NDArray[np.int64]
    axes: NDArray[np.float64] | None
    """Annotated orientation, shape (3, 3)."""
    confidence: float = 1.0
    """Confidence of the label, 0..1; below 1 if it was guessed."""
    guesses: tuple[tuple[str, float], ...] = ()
    """Possible labels and their probabilities; empty if the source names the thing."""
    stands_at: float | None = None
    """Height at which the thing stands, if none of its faces is visible there [m]; None if its faces show it."""


def is_opening(label: str) -> bool:
    """Return whether a label is a window or a door, which are in walls."""
    return bool({"window", "door", "opening", "windows", "doors"} & set(words_of(label)))


def boxed_groups(table: FaceTable, boxes: tuple[LabelBox, ...]) -> list[Group]:
    """Labelled things, then floor, ceiling and walls; boxes without faces are left out."""
    things = [b for b in boxes if category_of(b.label) is not Category.STRUCTURE]
    owner = _claimed_back(table, things, _whole_components(table, things))
    shell = owner < 0
    levels = find_levels(table)
    walls = [b for b in boxes if category_of(b.label) is Category.STRUCTURE and plain_structure(b.label) == "wall"]
    floor = shell & floor_faces(table, levels)
    ceiling = shell & ceiling_faces(table, levels) & ~floor
    in_box = _smallest_box(table, things, shell)
    wall = wall_number(table, [b.box for b in walls], shell & ~floor & ~ceiling, in_box >= 0)
    loose = shell & ~floor & ~ceiling & (wall < 0)
    owner = np.where(loose, in_box, owner)
    owner = _flush(table, things, owner, floor, floor)
    owner = _flush(table, things, owner, wall >= 0, floor)
    floor &= owner < 0
    wall = np.where(owner < 0, wall, -1)
    floor, ceiling, wall = _completed(table, floor, ceiling, wall, loose & (in_box < 0))
    groups = [Group(b.id, b.label, np.flatnonzero(owner == i), b.box.axes) for i, b in enumerate(things)]
    groups += _structure_groups(boxes, walls, floor, ceiling, wall)
    return [group for group in groups if len(group.faces)]


def _completed(
    table: FaceTable,
    floor: NDArray[np.bool_],
    ceiling: NDArray[np.bool_],
    wall: NDArray[np.int64],
    rest: NDArray[np.bool_],
) -> tuple[NDArray[np.bool_], NDArray[np.bool_], NDArray[np.int64]]:
    """Masks of floor, ceiling and wall, where rims of walls and slabs belong to the rest of their component if most of
    that is structure."""
    code = np.where(floor, 1, np.where(ceiling, 2, np.where(wall >= 0, wall + 3, 0)))
    kinds = int(code.max()) + 1
    key = table.component * kinds + code
    votes = np.bincount(key, table.area, (int(table.component.max()) + 1) * kinds).reshape(-1, kinds)
    mostly = votes[:, 0] < 0.5 * votes.sum(axis=1)
    best = np.where(mostly, 1 + np.argmax(votes[:, 1:], axis=1), 0) if kinds > 1 else np.zeros(len(votes), dtype=int)
    code = np.where(rest, best[table.component], code)
    return code == 1, code == 2, np.where(code >= 3, code - 3, -1)


def _structure_groups(
    boxes: tuple[LabelBox, ...],
    walls: list[LabelBox],
    floor: NDArray[np.bool_],
    ceiling: NDArray[np.bool_],
    wall: NDArray[np.int64],
) -> list[Group]:
    """Groups of floor, ceiling and walls under their annotated ids, or under default ids."""
    taken = {b.id for b in boxes}
    groups = [
        Group(_id_of(boxes, name), name, np.flatnonzero(mask), None)
        for name, mask in (("floor", floor), ("ceiling", ceiling))
    ]
    for number in range(int(wall.max(initial=-1)) + 1):
        name = walls[number].id if walls else next(n for n in _numbered("wall", number) if n not in taken)
        groups.append(Group(name, "wall", np.flatnonzero(wall == number), walls[number].box.axes if walls else None))
    return groups


def _numbered(name: str, number: int) -> tuple[str, str]:
    return f"{name}_{number}", f"{name}_found_{number}"


def _id_of(boxes: tuple[LabelBox, ...], name: str) -> str:
    """Id of the box annotated as this structure ('floor', not 'floor lamp'), else the structure's name."""
    structures = [b for b in boxes if category_of(b.label) is Category.STRUCTURE]
    return next((b.id for b in structures if plain_structure(b.label) == name), name)


def _volume(box: OrientedBox) -> float:
    return float(np.prod(box.half_extents))


def _inside(table: FaceTable, box: OrientedBox, margin: float) -> NDArray[np.int64]:
    """Indices of the faces whose centre lies in a box grown by `margin`; first filtered by its axis-aligned hull."""
    low, high = box.corners.min(axis=0) - margin, box.corners.max(axis=0) + margin
    near = np.arange(len(table.center))
    for axis in range(3):  # each axis only tests the faces left by the previous ones
        along = table.center[near, axis]
        near = near[(along >= low[axis]) & (along <= high[axis])]
    return near[box.contains(table.center[near], margin=margin)]


def _whole_components(table: FaceTable, things: list[LabelBox]) -> NDArray[np.int64]:
    """The box that owns the component of each face, -1 for none, shape (m,)."""
    count = int(table.component.max(initial=-1)) + 1
    total = np.bincount(table.component, table.area, count)
    best_share = np.zeros(count)
    shares: list[tuple[int, NDArray[np.float64]]] = []
    for i, thing in enumerate(things):
        inside = _inside(table, thing.box, MARGIN)
        share = np.bincount(table.component[inside], table.area[inside], count) / np.maximum(total, 1e-12)
        shares.append((i, share))
        np.maximum(best_share, share, out=best_share)
    owner = np.full(count, -1, dtype=np.int64)
    for i, share in sorted(shares, key=lambda s: -_volume(things[s[0]].box)):
        owner[(share >= HELD) & (share >= best_share - NEAR_BEST)] = i
    return np.asarray(owner[table.component])


def _claimed_back(table: FaceTable, things: list[LabelBox], owner: NDArray[np.int64]) -> NDArray[np.int64]:
    """Owners of the faces after small boxes have taken their faces back where a scan fused a small thing with its
    support, shape (m,).

    This only happens if the box owns less than half of the faces in it. Upward faces at its foot stay with the support.
    """
    volume = np.array([_volume(thing.box) for thing in things])
    result = owner.copy()
    for i in np.argsort(-volume, kind="stable"):
        inside = _inside(table, things[i].box, CLAIM_MARGIN)
        inside = inside[table.center[inside, 2] > things[i].box.bottom + CLAIM_MARGIN]
        if is_opening(things[i].label) or table.area[inside[owner[inside] == i]].sum() > 0.5 * table.area[inside].sum():
            continue
        foot = table.center[inside, 2] < things[i].box.bottom + 2.0 * CLAIM_MARGIN
        carried = ~(foot & (table.normal[inside, 2] > 0.7))
        larger = (owner[inside] >= 0) & (volume[owner[inside]] > volume[i])
        result[inside[carried & larger]] = i
    return result


def _flush(
    table: FaceTable,
    things: list[LabelBox],
    owner: NDArray[np.int64],
    shell: NDArray[np.bool_],
    floor: NDArray[np.bool_],
) -> NDArray[np.int64]:
    """Owners of the faces after flat things that the scan fused with floor or wall (`shell`) have taken the faces in
    their boxes, shape (m,): rugs, pictures, doors. Across the thing a box has the thickness of a scan's uncertainty,
    along it there is no margin."""
    result = owner.copy()
    for i, thing in enumerate(things):
        half = thing.box.half_extents
        thin = int(np.argmin(half))
        flat = 2.0 * half[thin] < (FLAT_ON_WALL if shell is not floor else FLAT_THING)
        if not flat or (abs(thing.box.axes[2, thin]) > 0.9) != (shell is floor):
            continue
        side = float(4.0 * np.prod(np.delete(half, thin)))
        if table.area[owner == i].sum() < 0.3 * side:
            slab = half.copy()
            slab[thin] = max(half[thin], 0.5 * FLAT_THING) if shell is floor else half[thin] + PLANE_BAND
            inside = _inside(table, OrientedBox(thing.box.center, thing.box.axes, slab), 0.0)
            result[inside[shell[inside]]] = i
    return result


def _smallest_box(table: FaceTable, things: list[LabelBox], loose: NDArray[np.bool_]) -> NDArray[np.int64]:
    """The smallest box around each loose face, -1 for none, shape (m,)."""
    owner = np.full(len(table.area), -1, dtype=np.int64)
    for i in sorted(range(len(things)), key=lambda i: -_volume(things[i].box)):
        if not is_opening(things[i].label):
            inside = _inside(table, things[i].box, MARGIN)
            owner[inside[loose[inside]]] = i
    return owner
