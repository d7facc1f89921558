"""Finds the earlier placed things that the object may touch or move: those take part in the drop.

Those whose box comes near the object's start; those that rest on, carry or touch one of them; those that lie in the
same dent, and where the object's support is dented within reach, those that dented it. Of these only things that
the same instance carries count: a thing on the table next to the bed stays in place.
"""

import numpy as np
from numpy.typing import NDArray

from dcap.scene.types.anchor import Anchor
from dcap.scene.types.earlier import EarlierPlacements
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.segmentation import Segmentation

Array = NDArray[np.float64]

ASIDE, LEAST_ASIDE = 0.75, 0.15
"""Horizontal reach of the object from its start, over its larger horizontal side, and at least [-, m]: as far as its
support takes part in the drop."""
BELOW = 0.12
"""Vertical reach of the object [m]: deeper than any dent."""
TOUCHING = 5e-3
"""Distance within which boxes may touch as things settle again [m]."""
FELT = 1e-4
"""Displacement beyond which a surface counts as dented [m]."""


def things_in_reach(
    scene: Segmentation, mesh: Mesh, anchor: Anchor, earlier: EarlierPlacements
) -> tuple[list[str], list[str]]:
    """Ids of the placed things that take part, and of nearby ones that rest on something else.

    `mesh` is the object at its start.
    """
    box = reached_box(mesh)
    ids = [one.id for one in earlier.placed]
    boxes = {one: scene.instance_mesh(scene.index_of(one)).bounds for one in ids}
    found = {one for one in ids if meet(boxes[one], box, 0.0)}
    if anchor.base_id in boxes:
        found.add(anchor.base_id)
    ground = earlier.ground_of(anchor.base_id)
    for one in earlier.deformations:
        dented = one.surface.vertices[np.linalg.norm(one.shift, axis=1) > FELT]
        if one.instance != ground or not len(dented):
            continue
        if meet(np.stack([dented.min(axis=0), dented.max(axis=0)]), box, 0.0):
            found |= set(one.loads)
    found = closed(found, earlier, boxes)
    own = [one for one in ids if one in found and earlier.ground_of(one) == ground]
    return own, [one for one in ids if one in found and one not in own]


def closed(found: set[str], earlier: EarlierPlacements, boxes: dict[str, Array]) -> set[str]:
    """The things with all that touch one of them or lie in the same dent, and so on."""
    while True:
        more = set(found)
        for a, b in earlier.touching:
            more |= {a, b} & set(boxes) if {a, b} & found else set()
        for one in earlier.deformations:
            more |= set(one.loads) if {*one.loads, one.instance} & found else set()
        more |= {one for one in boxes if any(meet(boxes[one], boxes[other], TOUCHING) for other in found)}
        if more == found:
            return found
        found = more


def reached_box(mesh: Mesh) -> Array:
    """Box that the object may reach [m], shape (2, 3)."""
    low, high = mesh.bounds
    margin = max(ASIDE * float((high - low)[:2].max()), LEAST_ASIDE)
    away = np.array([margin, margin, BELOW])
    return np.stack([low - away, high + away])


def meet(one: Array, other: Array, margin: float) -> bool:
    """Whether two boxes (2, 3) are at most a margin [m] apart along every axis."""
    return bool(((one[0] <= other[1] + margin) & (other[0] <= one[1] + margin)).all())
