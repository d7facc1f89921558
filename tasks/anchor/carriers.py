"""Faces of the scene that can carry an object on a part: the part's own, and those of things lying flat on it.

In: the scene, the base and the intended part. Out: sets of faces to try one after the other, and the owner of a face.
On a bed both the blanket and the uncovered mattress carry, unless the prompt names one of them; on a floor the rugs do
if the bare floor has no place.
"""

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.raycast import Raycaster
from dcap.scene.types.segmentation import Instance, Segmentation

COVERS = frozenset({"blanket", "mattress"})
"""Parts that lie on each other: whichever is on top there carries the object."""
SEEN = 0.3
"""Share of its box below which a named part is hidden from above, so that the thing on it carries instead [-]."""
FLAT = 0.03
"""Largest height of things that cover a floor [m]: rugs, mats."""

Mask = NDArray[np.bool_]


def carriers(scene: Segmentation, base: Instance, index: int, *, named: bool, caster: Raycaster) -> list[Mask]:
    """Faces that may carry, best first, each of shape (faces,); `named`: the prompt asks for this part."""
    own = faces_of(scene, base, index)
    if base.structure:
        flat = coverings(scene, base, index)
        return [own, own | flat] if flat.any() else [own]
    if base.parts[index].name not in COVERS or (named and exposed(scene, base, index, caster) > SEEN):
        return [own]
    parts = [number for number, part in enumerate(base.parts) if part.name in COVERS]
    covers = (scene.face_instance == scene.index_of(base.id)) & np.isin(scene.face_part, parts)
    return [np.asarray(covers)]


def faces_of(scene: Segmentation, base: Instance, index: int) -> Mask:
    """The faces of a part, shape (faces,)."""
    return np.asarray((scene.face_instance == scene.index_of(base.id)) & (scene.face_part == index))


def coverings(scene: Segmentation, base: Instance, index: int) -> Mask:
    """The faces of things that lie flat on a floor, shape (faces,)."""
    top = base.parts[index].box.top
    flat = [not one.structure and abs(one.box.bottom - top) < FLAT and one.box.top < top + FLAT
            for one in scene.instances]  # fmt: skip
    return np.array([*flat, False])[scene.face_instance]


def exposed(scene: Segmentation, base: Instance, index: int, caster: Raycaster) -> float:
    """Share of a part's box from which a ray down meets the part first [-]."""
    box = base.parts[index].box
    steps = (np.arange(12) + 0.5) / 6.0 - 1.0
    u, v = np.meshgrid(steps, steps)
    local = np.c_[u.ravel(), v.ravel(), np.ones(u.size)] * box.half_extents + (0.0, 0.0, 0.3)
    hits = caster.cast(box.to_world(local), np.tile([0.0, 0.0, -1.0], (u.size, 1)))
    mine = faces_of(scene, base, index)
    return float(np.mean((hits.face >= 0) & mine[hits.face]))


def owner(scene: Segmentation, face: int) -> tuple[Instance, int]:
    """The instance and the part that a face belongs to."""
    return scene.instances[int(scene.face_instance[face])], int(scene.face_part[face])
