"""Divides one instance into named parts with boxes, by the rule of its category or the names of its nodes."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.segmentation.faces import FaceTable, connected_regions, renumbered
from dcap.geometry.segmentation.labels import (
    Category,
    category_of,
    part_word,
    plain_structure,
)
from dcap.geometry.segmentation.oversegmentation import merged_crumbs
from dcap.geometry.segmentation.parts.bed import bed_parts
from dcap.geometry.segmentation.parts.instance_surface import InstanceSurface, PartMap, instance_surface
from dcap.geometry.segmentation.parts.seating import chair_parts, sofa_parts, stool_parts
from dcap.geometry.segmentation.parts.small_things import (
    bathtub_parts,
    dumbbell_parts,
    flat_parts,
    lamp_parts,
    laptop_parts,
    plant_parts,
    plush_parts,
    shoe_parts,
)
from dcap.geometry.segmentation.parts.tables import (
    basin_parts,
    cabinet_parts,
    other_parts,
    shelf_parts,
    storage_parts,
    table_parts,
    window_parts,
)
from dcap.scene.text import readable, says_something
from dcap.scene.types.boxes import OrientedBox, min_area_box
from dcap.scene.types.segmentation import Instance, Part

RULES: dict[Category, Callable[[InstanceSurface], PartMap]] = {
    Category.BED: bed_parts,
    Category.SOFA: sofa_parts,
    Category.CHAIR: chair_parts,
    Category.STOOL: stool_parts,
    Category.TABLE: table_parts,
    Category.CABINET: cabinet_parts,
    Category.SHELF: shelf_parts,
    Category.STORAGE: storage_parts,
    Category.LAMP: lamp_parts,
    Category.BATHTUB: bathtub_parts,
    Category.FLAT: flat_parts,
    Category.DUMBBELL: dumbbell_parts,
    Category.SHOE: shoe_parts,
    Category.LAPTOP: laptop_parts,
    Category.PLUSH: plush_parts,
    Category.PLANT: plant_parts,
    Category.BASIN: basin_parts,
    Category.WINDOW: window_parts,
    Category.OTHER: other_parts,
}
"""The part rule of each category."""

SMALLEST_PATCH = 2e-3
"""Share of the instance's area below which patches of one name join their neighbour [-]."""

STACK_GAP = 0.35
"""Largest vertical gap between patches that are two sides of one part, as a share of the thing's depth [-]."""

THINNEST = 5e-4
"""Half thickness of the box of a sheet [m], so that no box is without volume."""

AXES_TIE = 1.06
"""Factor by which a turned box must have a smaller footprint to replace the instance's axes [-]."""

ONLY_SCENE_THINGS = frozenset(
    {
        Category.OTHER,
        Category.CABINET,
        Category.TABLE,
        Category.SHELF,
        Category.STORAGE,
        Category.STRUCTURE,
        Category.BED,
        Category.SOFA,
        Category.BASIN,
    }
)
"""Categories whose rules are for furniture; an object to be placed with such a category is one body."""


def find_parts(
    table: FaceTable,
    faces: NDArray[np.int64],
    label: str,
    axes: NDArray[np.float64] | None,
    node_words: Sequence[str],
    *,
    annotated: tuple[NDArray[np.int64], list[str]] | None = None,
    as_object: bool = False,
) -> tuple[NDArray[np.int32], tuple[Part, ...], OrientedBox, NDArray[np.float64] | None]:
    """Parts of one instance.

    `axes` (3, 3) is the annotated orientation, or None to find it; `node_words` names the part of each face according
    to its node (or is empty); `annotated` are known parts (an index per face, and their names) that only need boxes.
    Returns the part of each face (k,), the parts, the box and the front (world).
    """
    box = _box_of(table.corners[faces].reshape(-1, 3), axes, tie=1.0)
    surface = instance_surface(table, faces, box)
    parts = _named_by_nodes(surface, node_words) or _rule(label, as_object=as_object)(surface)
    if category_of(label) is Category.STRUCTURE:
        parts = PartMap.filled(len(faces), plain_structure(label))
    index, names = _grouped(surface, parts) if annotated is None else annotated
    confidence = parts.confidence if annotated is None else 1.0
    found = tuple(
        Part(name, _box_of(table.corners[faces[index == i]].reshape(-1, 3), box.axes, tie=AXES_TIE), confidence)
        for i, name in enumerate(names)
    )
    front = None if parts.front is None else box.axes @ parts.front
    return index.astype(np.int32), found, box, front


def _rule(label: str, *, as_object: bool) -> Callable[[InstanceSurface], PartMap]:
    category = category_of(label)
    return flat_parts if as_object and category in ONLY_SCENE_THINGS else RULES.get(category, flat_parts)


def _named_by_nodes(surface: InstanceSurface, node_words: Sequence[str]) -> PartMap | None:
    """Parts by node names, if these name at least two parts and nearly all of the surface."""
    if not node_words:
        return None
    names = np.array(node_words, dtype=object)
    named = names != ""
    if len(set(names[named])) < 2 or surface.area[named].sum() < 0.9 * surface.area.sum():
        return None
    main = max(set(names[named]), key=lambda n: float(surface.area[names == n].sum()))
    names[~named] = main
    return PartMap(names, confidence=0.95, separate=frozenset({"pillow", "board"}))


def _grouped(surface: InstanceSurface, parts: PartMap) -> tuple[NDArray[np.int64], list[str]]:
    """Part index of each face and the name of each part, larger parts first."""
    kinds = sorted(set(parts.names))
    code = np.array([kinds.index(name) for name in parts.names], dtype=np.int64)
    same = code[surface.pairs[:, 0]] == code[surface.pairs[:, 1]]
    region = connected_regions(len(code), surface.pairs, same)
    region = merged_crumbs(region, surface.area, surface.pairs, smallest=SMALLEST_PATCH)
    code = _main_code(region, code, surface.area, len(kinds))
    part = code.copy()
    for kind in sorted(parts.separate & set(kinds)):
        chosen = np.flatnonzero(code == kinds.index(kind))
        part[chosen] = len(kinds) + int(part.max()) + _stacks(surface, chosen, region)
    part = renumbered(part)
    order = np.argsort(-np.bincount(part, surface.area), kind="stable")
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = np.arange(len(order))
    part = rank[part]
    first = np.unique(part, return_index=True)[1]
    return part, [kinds[code[i]] for i in first]


def _main_code(
    region: NDArray[np.int64], code: NDArray[np.int64], area: NDArray[np.float64], kinds: int
) -> NDArray[np.int64]:
    """Name code of each face after each region has taken the name of most of its area, shape (k,)."""
    votes = np.bincount(region * kinds + code, area + 1e-15, (int(region.max()) + 1) * kinds).reshape(-1, kinds)
    return np.asarray(np.argmax(votes, axis=1)[region], dtype=np.int64)


def _stacks(surface: InstanceSurface, faces: NDArray[np.int64], region: NDArray[np.int64]) -> NDArray[np.int64]:
    """Group of each face (k,): patches that overlap in plan and lie close together, like the two sides of a board, are
    one group."""
    patches, number = np.unique(region[faces], return_inverse=True)
    points = [surface.corners[faces[number == i]].reshape(-1, 3) for i in range(len(patches))]
    low, high = np.array([p.min(axis=0) for p in points]), np.array([p.max(axis=0) for p in points])
    close = STACK_GAP * float(surface.size[:2].min())
    group = np.arange(len(patches))
    for i in range(len(patches)):
        for j in range(i):
            overlap = np.minimum(high[i], high[j]) - np.maximum(low[i], low[j])
            smaller = np.minimum(high[i] - low[i], high[j] - low[j])
            if (overlap[:2] > 0.5 * smaller[:2]).all() and overlap[2] > -close:
                group[group == group[i]] = group[j]
    return np.asarray(group[number], dtype=np.int64)


def _box_of(points: NDArray[np.float64], axes: NDArray[np.float64] | None, *, tie: float) -> OrientedBox:
    """Box of points along the given axes, or along the best axes if those are clearly better."""
    best = min_area_box(points)
    chosen = best
    if axes is not None:
        local = points @ axes
        low, high = local.min(axis=0), local.max(axis=0)
        given = OrientedBox(axes @ (0.5 * (low + high)), axes, 0.5 * (high - low))
        better = tie > 1.0 and np.prod(given.half_extents[:2]) > tie * np.prod(best.half_extents[:2])
        chosen = best if better else given
    return OrientedBox(chosen.center, chosen.axes, np.maximum(chosen.half_extents, THINNEST))


def node_words(names: Sequence[str], face_node: NDArray[np.int32], faces: NDArray[np.int64]) -> list[str]:
    """The part named by the node of each face, '' if there is none."""
    return _spread([part_word(name.rsplit("/", 1)[-1]) for name in names], face_node, faces)


def object_node_words(names: Sequence[str], face_node: NDArray[np.int32], faces: NDArray[np.int64]) -> list[str]:
    """The same as `node_words`, but any meaningful name is a part, because nodes of a single object can only be
    parts."""
    own = [name.rsplit("/", 1)[-1] for name in names]
    return _spread([part_word(n) or (readable(n) if says_something(n) else "") for n in own], face_node, faces)


def _spread(words: Sequence[str], face_node: NDArray[np.int32], faces: NDArray[np.int64]) -> list[str]:
    return [words[node] if node >= 0 else "" for node in face_node[faces]]


def make_instance(
    instance_id: str, label: str, table: FaceTable, faces: NDArray[np.int64], axes: NDArray[np.float64] | None,
    words: Sequence[str], annotated: tuple[NDArray[np.int64], list[str]] | None = None,
) -> tuple[Instance, NDArray[np.int32]]:  # fmt: skip
    """One instance of a scene and the part of each of its faces (k,)."""
    face_part, parts, box, front = find_parts(table, faces, label, axes, words, annotated=annotated)
    structure = category_of(label) is Category.STRUCTURE
    return Instance(instance_id, label, box, parts, front, structure=structure), face_part
