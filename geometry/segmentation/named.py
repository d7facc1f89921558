"""Instances of a mesh without annotated boxes: by its nodes, by one label for everything, or by shape alone."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from geometry.segmentation.annotated import annotated_groups
from geometry.segmentation.boxed import Group
from geometry.segmentation.faces import FaceTable, renumbered, surface_points
from geometry.segmentation.labels import Category, category_of, part_word, plain_structure, readable, says_something
from geometry.segmentation.structure import ceiling_faces, find_levels, floor_faces, wall_number
from scene.scan import Scan

TOUCHING = 0.02
"""Components about this close belong to one thing [m]."""

ROOM_SIZE = 3.2
"""A room is at least this long [m]."""


def named_groups(table: FaceTable, scan: Scan) -> list[Group]:
    """Instances by annotated nodes, then by the names in the file; what is unnamed takes the scan's label."""
    if scan.node_labels:
        groups, silent = annotated_groups(scan)
        return with_ids(groups + _spoken_groups(table, scan, silent))
    if _is_one_thing(_top_names(scan.node_names), scan.label):
        return _unnamed_groups(table, np.arange(len(table.area)), readable(scan.label))
    return with_ids(_spoken_groups(table, scan, np.arange(len(table.area))))


def _spoken_groups(table: FaceTable, scan: Scan, faces: NDArray[np.int64]) -> list[Group]:
    """Instances among some faces by the names of their nodes."""
    top = _top_names(scan.node_names)
    node_label = [readable(name) if says_something(name) else "" for name in top]
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
    if scan.node_labels:  # scraps between what is annotated are not one thing
        return groups + [Group("", readable(scan.label), cluster, None) for cluster in _clusters(table, unnamed)]
    return groups + (_unnamed_groups(table, unnamed, readable(scan.label)) if len(unnamed) else [])


def _apart(table: FaceTable, faces: NDArray[np.int64], thing: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """Faces of one name by the node that they belong to (chair, chair.001); nodes that touch are one thing."""
    node = renumbered(thing)
    count = int(node.max(initial=-1)) + 1
    if count < 2:
        return [np.arange(len(faces))] if count else []
    points, owner = surface_points(table.corners[faces], table.area[faces], TOUCHING)
    group = _joined(points, node[owner], count)[node]
    return [np.flatnonzero(group == i) for i in dict.fromkeys(group.tolist())]


def _named_structure(table: FaceTable, faces: NDArray[np.int64], name: str) -> list[Group]:
    """Floor or ceiling; the walls of a room, named as one, are told apart by their planes."""
    label = plain_structure(name)
    if label != "wall":
        return [Group("", label, faces, None)]
    inside = np.zeros(len(table.area), dtype=bool)
    inside[faces] = True
    number = wall_number(table, [], inside, np.zeros_like(inside))
    number = np.where(inside & (number < 0), int(number.max()) + 1, number)
    return [Group("", label, np.flatnonzero(inside & (number == i)), None) for i in np.unique(number[faces])]


def _top_names(names: Sequence[str]) -> list[str]:
    """The outermost name that tells things apart: wrappers that hold everything are taken off."""
    trails = [name.split("/") for name in names]
    while trails and all(len(t) > 1 for t in trails) and len({t[0] for t in trails}) == 1:
        trails = [t[1:] for t in trails]
    return [next((piece for piece in trail if says_something(piece)), trail[-1]) for trail in trails]


def _is_one_thing(top: Sequence[str], label: str) -> bool:
    """One node, only nameless nodes, or nodes that are all parts of the labelled thing."""
    telling = [name for name in top if says_something(name)]
    if len(top) <= 1 or not telling:
        return True
    parts = [name for name in telling if part_word(name) and category_of(name) in (Category.OTHER, category_of(label))]
    return len(parts) == len(telling) and not any(readable(name) == readable(label) for name in telling)


def _unnamed_groups(table: FaceTable, faces: NDArray[np.int64], label: str) -> list[Group]:
    """A furnished room is taken apart; anything else is one thing."""
    if not _is_room(table, faces, label):
        return with_ids([Group("", label, faces, None)])
    inside = np.zeros(len(table.area), dtype=bool)
    inside[faces] = True
    levels = find_levels(table)
    floor = inside & floor_faces(table, levels)
    ceiling = inside & ceiling_faces(table, levels) & ~floor
    wall = wall_number(table, [], inside & ~floor & ~ceiling, np.zeros_like(inside))
    groups = [Group("", name, np.flatnonzero(mask), None) for name, mask in (("floor", floor), ("ceiling", ceiling))]
    groups += [Group("", "wall", np.flatnonzero(wall == i), None) for i in range(int(wall.max(initial=-1)) + 1)]
    rest = np.flatnonzero(inside & ~floor & ~ceiling & (wall < 0))
    groups += [Group("", label, cluster, None) for cluster in _clusters(table, rest)]
    return with_ids([group for group in groups if len(group.faces)])


def _is_room(table: FaceTable, faces: NDArray[np.int64], label: str) -> bool:
    """Large, with a floor under most of it; a label that names furniture does not make a hall of a bed."""
    points = table.corners[faces].reshape(-1, 3)
    size = np.ptp(points, axis=0)
    if size[:2].max() < ROOM_SIZE:
        return False
    z = table.center[faces, 2]
    low = (z < points[:, 2].min() + 0.15 * size[2]) & (table.normal[faces, 2] > 0.8)
    covered = float(table.area[faces][low].sum()) / float(np.prod(size[:2]))
    furniture = category_of(label) not in (Category.OTHER, Category.STRUCTURE)
    return covered > 0.5 and not (furniture and size[:2].max() < 2.0 * ROOM_SIZE)


def _clusters(table: FaceTable, faces: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """Components that touch are one thing; crumbs far from everything are left out."""
    if not len(faces):
        return []
    component = renumbered(table.component[faces])
    points, owner = surface_points(table.corners[faces], table.area[faces], TOUCHING)
    group = _joined(points, component[owner], int(component.max()) + 1)[component]
    area = np.bincount(group, table.area[faces])
    return [faces[group == i] for i in np.argsort(-area, kind="stable") if area[i] > 1e-3]


def _joined(points: NDArray[np.float64], component: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """Group of each component: components with points in the same cell of a grid touch, shape (count,).

    Two grids, half a cell apart, so that neighbours on either side of a cell's border are seen.
    """
    edges = []
    cells = 0
    for shift in (0.0, 0.5):
        key = np.floor(points / (2.0 * TOUCHING) + shift).astype(np.int64)
        cell = np.asarray(np.unique(key, axis=0, return_inverse=True)[1]).reshape(-1) + cells
        cells = int(cell.max()) + 1
        edges.append(np.stack([component, count + cell], axis=1))
    a, b = np.unique(np.concatenate(edges), axis=0).T
    graph = coo_matrix((np.ones(len(a), dtype=np.int8), (a, b)), shape=(count + cells, count + cells))
    return np.asarray(connected_components(graph, directed=False)[1][:count], dtype=np.int64)


def with_ids(groups: list[Group]) -> list[Group]:
    """Give every group without an id one made of its label, numbered where a label repeats or the id is taken."""
    labels = [group.label for group in groups]
    taken = {group.id for group in groups}
    seen: dict[str, int] = {}
    named = []
    for group in groups:
        plain = group.label.replace(" ", "_") or "thing"
        unique = group.id or plain
        if not group.id and (labels.count(group.label) > 1 or plain in taken):
            number = seen.get(plain, 0)
            while f"{plain}_{number}" in taken:
                number += 1
            unique, seen[plain] = f"{plain}_{number}", number + 1
        taken.add(unique)
        named.append(Group(unique, group.label or "thing", group.faces, group.axes))
    return named
