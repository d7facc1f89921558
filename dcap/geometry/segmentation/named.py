"""Instances of a mesh by annotated nodes, by its own nodes, by one label for everything, or by shape alone.

Instances and parts of a mesh with annotated nodes: a ScanNet scene, or a GLB written by us.

An annotated node is called `instance id` or `instance id/part`; its annotation is accepted unchanged.
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.segmentation.boxed import Group
from dcap.geometry.segmentation.faces import FaceTable, connected_regions, plan_cells, renumbered, surface_heights
from dcap.geometry.segmentation.labels import Category, category_of, part_word, plain_structure
from dcap.geometry.segmentation.rooms.contacts import segments_of
from dcap.geometry.segmentation.rooms.shell import ScannedShell, wall_number
from dcap.scene.text import names_several, readable, says_something
from dcap.scene.types.scan import Scan

COUNTER = re.compile(r"\.\d+$")
"""Suffix that distinguishes two nodes with the same name."""
Index: TypeAlias = NDArray[np.int64]
TakeApart: TypeAlias = Callable[[NDArray[np.bool_]], list[Group]]
"""Function that divides the unnamed faces of a room into things, given their mask, shape (m,)."""
NamesThing: TypeAlias = Callable[[str], bool]
"""Function that returns whether a name contains a word for a thing."""

THING = "thing"
"""Label of a thing that could not be named."""
ROOM = "room"
"""Label of a scan without a name that is seen from inside."""
INSIDE = -0.5
"""Volume enclosed by faces around their middle, over the sum of the absolute contributions, below which they are seen
from inside: third-party things have -0.03 to 0.64, scanned rooms and parts of them -0.94 to -0.68 [-]."""
ROOM_SIZE = 3.2
"""Least length of a scan with a floor that is a room [m]."""
FLOORED = 0.35
"""Least visible share of the floor in a room's plan: furniture hides the rest [-]."""
LOOKS_UP = 0.6
"""Least normal z of an upward face [-]: floors of scans are rough."""
FLOOR_CELLS = 64
"""Cells along the longer side in which the floor is counted [-]."""
SMALL_ROOM = (1.2, 1.6)
"""Least breadth and height of a smaller room, which must have inward-facing walls [m]."""
WALLED = 0.5
"""Least share of the outline covered by walls [-]."""


def annotated_groups(scan: Scan) -> tuple[list[Group], NDArray[np.int64]]:
    """The annotated instances in the order of their nodes, and the faces without annotation."""
    trails = [name.split("/") for name in scan.node_names]
    labels = {trail[0]: label for trail, label in zip(trails, scan.node_labels, strict=True) if label}
    number = {one: index for index, one in enumerate(labels)}
    of_node = [number.get(trail[0], -1) if label else -1 for trail, label in zip(trails, scan.node_labels, strict=True)]
    instance = np.array([*of_node, -1], dtype=np.int64)[scan.face_node]
    silent = np.array([*(label is None for label in scan.node_labels), True])[scan.face_node]
    order = np.argsort(instance, kind="stable")
    ends = np.searchsorted(instance[order], np.arange(len(labels) + 1))
    groups = [
        Group(one, label, order[ends[i] : ends[i + 1]], None) for i, (one, label) in enumerate(labels.items())
    ]  # fmt: skip
    return [group for group in groups if len(group.faces)], np.flatnonzero(silent)


def annotated_parts(scan: Scan, faces: NDArray[np.int64]) -> tuple[NDArray[np.int64], list[str]] | None:
    """Part index of each face (k,) and the parts' names; None if the nodes of the faces name no parts."""
    if not scan.node_labels:
        return None
    nodes, number = np.unique(scan.face_node[faces], return_inverse=True)
    if nodes[0] < 0 or any(scan.node_labels[node] is None or "/" not in scan.node_names[node] for node in nodes):
        return None
    pieces = [scan.node_names[node].split("/")[1] for node in nodes]
    kinds = list(dict.fromkeys(pieces))
    part = np.array([kinds.index(piece) for piece in pieces], dtype=np.int64)[number.reshape(-1)]
    return part, [COUNTER.sub("", kind) for kind in kinds]


def named_groups(table: FaceTable, scan: Scan, taken_apart: TakeApart, names_thing: NamesThing) -> list[Group]:
    """Instances by annotated nodes, then by the names in the file; the unnamed rest is divided if it is a room, else it
    gets the scan's label."""
    every, top = np.arange(len(table.area)), _top_names(scan.node_names)
    if scan.node_labels:
        groups, silent = annotated_groups(scan)
        return with_ids(groups + _spoken_groups(table, scan, silent, taken_apart, names_thing))
    if _is_one_thing(top, scan.label):
        alone = len(top) == 1 and not says_something(scan.label) and names_thing(top[0])
        return with_ids(_unnamed_groups(table, every, readable(top[0] if alone else scan.label), taken_apart))
    return with_ids(_spoken_groups(table, scan, every, taken_apart, names_thing))


def _node_labels(table: FaceTable, scan: Scan, top: Sequence[str], names_thing: NamesThing) -> list[str]:
    """Label from the outermost name of each node, "" if it names nothing.

    A word for a thing is a label. An unknown word may be one (a whiteboard), unless several nodes share it, as for the
    blocks of a scanning device, or it names a whole room.
    """
    said = [readable(name) if says_something(name) else "" for name in top]

    def counts(name: str, words: str) -> bool:
        if names_thing(name) or part_word(name):
            return True
        nodes = [node for node, other in enumerate(said) if other == words]
        faces = np.flatnonzero(np.isin(scan.face_node, nodes))
        return len({top[node] for node in nodes}) == 1 and len(faces) > 0 and not _is_room(table, faces, "")

    kept = {words: counts(name, words) for name, words in zip(top, said, strict=True) if words}
    return [words if kept.get(words) else "" for words in said]


def _spoken_groups(
    table: FaceTable, scan: Scan, faces: Index, taken_apart: TakeApart, names_thing: NamesThing
) -> list[Group]:
    """Instances among some faces by the names of their nodes."""
    top = _top_names(scan.node_names)
    node_label = _node_labels(table, scan, top, names_thing)
    label = np.array([*node_label, ""], dtype=object)[scan.face_node[faces]]
    thing = np.array([*(top.index(name) for name in top), -1])[scan.face_node[faces]]
    groups: list[Group] = []
    for name in [one for one in dict.fromkeys(node_label) if one]:
        mine = np.flatnonzero(label == name)
        if category_of(name) is Category.STRUCTURE:
            groups += _named_structure(table, faces[mine], name)
        else:
            groups += [Group("", name, faces[mine[own]], None) for own in _apart(table, faces[mine], thing[mine])]
    unnamed = faces[label == ""]
    return groups + (_unnamed_groups(table, unnamed, readable(scan.label), taken_apart) if len(unnamed) else [])


def _apart(table: FaceTable, faces: NDArray[np.int64], thing: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """Faces with the same name, separated by node (chair, chair.001); nodes that touch are one thing."""
    node = renumbered(thing)
    count = int(node.max(initial=-1)) + 1
    if count < 2:
        return [np.arange(len(faces))] if count else []
    piece = np.full(len(table.area), -1, dtype=np.int64)
    piece[faces] = node
    touching = [(a, b) for a, one in segments_of(table, piece).alive.items() for b in one.touches]
    pairs = np.array(touching, dtype=np.int64).reshape(-1, 2)
    group = connected_regions(count, pairs, np.ones(len(pairs), dtype=bool))[node]
    return [np.flatnonzero(group == i) for i in dict.fromkeys(group.tolist())]


def _named_structure(table: FaceTable, faces: NDArray[np.int64], name: str) -> list[Group]:
    """Groups of the floor or ceiling, or of the walls of a room, which share a name and are separated by their
    planes."""
    label = plain_structure(name)
    if label != "wall":
        return [Group("", label, faces, None)]
    inside = np.zeros(len(table.area), dtype=bool)
    inside[faces] = True
    number = wall_number(table, [], inside, np.zeros_like(inside))
    number = np.where(inside & (number < 0), int(number.max()) + 1, number)
    return [Group("", label, np.flatnonzero(inside & (number == i)), None) for i in np.unique(number[faces])]


def _top_names(names: Sequence[str]) -> list[str]:
    """The outermost names that distinguish things: wrappers around everything are removed."""
    trails = [name.split("/") for name in names]
    while trails and all(len(t) > 1 for t in trails) and len({t[0] for t in trails}) == 1:
        trails = [t[1:] for t in trails]
    return [next((piece for piece in trail if says_something(piece)), trail[-1]) for trail in trails]


def _is_one_thing(top: Sequence[str], label: str) -> bool:
    """Return whether there is only one node, only nameless nodes, or only nodes that are parts of the labelled
    thing."""
    telling = [name for name in top if says_something(name)]
    if len(top) <= 1 or not telling:
        return True
    parts = [name for name in telling if part_word(name) and category_of(name) in (Category.OTHER, category_of(label))]
    return len(parts) == len(telling) and not any(readable(name) == readable(label) for name in telling)


def _unnamed_groups(table: FaceTable, faces: Index, label: str, taken_apart: TakeApart) -> list[Group]:
    """Groups of unnamed faces: a furnished room is divided; anything else is one thing."""
    if not _is_room(table, np.arange(len(table.area)), label):
        unsaid = category_of(label) is Category.STRUCTURE or not says_something(label)  # a file called "room" or "scan"
        said = label if not unsaid else ROOM if _is_seen_from_inside(table, faces) else ""
        return [Group("", said, faces, None)]
    inside = np.zeros(len(table.area), dtype=bool)
    inside[faces] = True
    return [group for group in taken_apart(inside) if len(group.faces)]


def shell_groups(shell: ScannedShell) -> list[Group]:
    """Groups of the floor, ceiling and walls of a divided room."""
    groups = [
        Group("", name, np.flatnonzero(mask), None)
        for name, mask in (("floor", shell.floor), ("ceiling", shell.ceiling))
    ]
    return groups + [Group("", "wall", np.flatnonzero(shell.wall == i), None) for i in range(len(shell.planes))]


def _is_room(table: FaceTable, faces: Index, label: str) -> bool:
    """A floor under most of it, and large or walled; a label that names a piece of furniture does not make a hall
    of a bed."""
    points = table.corners[faces].reshape(-1, 3)
    size = np.ptp(points, axis=0)
    small = bool(size[:2].max() < ROOM_SIZE)
    if small and (size[:2].min() < SMALL_ROOM[0] or size[2] < SMALL_ROOM[1] or not _is_walled(table, faces)):
        return False
    furniture = category_of(label) not in (Category.OTHER, Category.STRUCTURE) and not names_several(label)
    return _floored(table, faces) > FLOORED and not (furniture and size[:2].max() < 2.0 * ROOM_SIZE)


def _is_seen_from_inside(table: FaceTable, faces: Index) -> bool:
    """Return whether most faces face the middle, like the walls and the floor of a part of a room, unlike a thing's."""
    corners = table.corners[faces].reshape(-1, 3)
    middle = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
    out = np.einsum("ki,ki->k", table.normal[faces], table.center[faces] - middle) * table.area[faces]
    return float(out.sum()) < INSIDE * float(np.abs(out).sum())


def _floored(table: FaceTable, faces: Index) -> float:
    """Share of the scanned plan with a low upward surface: also rough floors, at any heading."""
    corners, area = table.corners[faces], table.area[faces]
    low, high = surface_heights(table.center[faces, 2], area)
    chosen = (table.center[faces, 2] < low + 0.15 * (high - low)) & (table.normal[faces, 2] > LOOKS_UP)
    step = max(float(np.ptp(corners.reshape(-1, 3)[:, :2], axis=0).max()) / FLOOR_CELLS, 1e-9)
    return plan_cells(corners[chosen], area[chosen], step) / max(plan_cells(corners, area, step), 1)


def _is_walled(table: FaceTable, faces: Index) -> bool:
    """Return whether upright faces near the outline face inwards and make up a good part of it: a room, not a
    cupboard."""
    center, normal, area = table.center[faces], table.normal[faces], table.area[faces]
    low, high = table.corners[faces].reshape(-1, 3).min(axis=0), table.corners[faces].reshape(-1, 3).max(axis=0)
    size = high - low
    inward = np.zeros(len(faces), dtype=bool)
    for axis in (0, 1):
        inward |= (center[:, axis] < low[axis] + 0.15 * size[axis]) & (normal[:, axis] > 0.8)
        inward |= (center[:, axis] > high[axis] - 0.15 * size[axis]) & (normal[:, axis] < -0.8)
    return float(area[inward].sum()) > WALLED * 2.0 * float(size[:2].sum() * size[2])


def with_ids(groups: list[Group]) -> list[Group]:
    """Give every group without an id one made of its label, numbered if the label repeats or the id is taken."""
    labels = [group.label for group in groups]
    taken = {group.id for group in groups}
    seen: dict[str, int] = {}
    named = []
    for group in groups:
        plain = group.label.replace(" ", "_") or THING
        unique = group.id or plain
        if not group.id and (labels.count(group.label) > 1 or plain in taken):
            number = seen.get(plain, 0)
            while f"{plain}_{number}" in taken:
                number += 1
            unique, seen[plain] = f"{plain}_{number}", number + 1
        taken.add(unique)
        named.append(replace(group, id=unique, label=group.label or THING))
    return named
