"""Instances and parts of the faces of a mesh."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NewType

import numpy as np
from numpy.typing import NDArray

from dcap.scene.types.arrays import check_array, check_index
from dcap.scene.types.box import OrientedBox
from dcap.scene.types.mesh import Mesh


@dataclass(frozen=True, eq=False, slots=True)
class Part:
    """A named piece of one instance; parts of an instance cover it without overlap."""

    name: str
    """Semantic name in lower case: mattress, frame, headboard, pillow, blanket, seat cushion, back, arm, top, leg,
    shade, pole, base, body ..."""
    box: OrientedBox
    """Oriented box in the world frame."""
    confidence: float
    """0..1, confidence of the name."""


@dataclass(frozen=True, eq=False, slots=True)
class Instance:
    """One thing in the scene, or the object itself."""

    id: str
    label: str
    """Category in lower case: bed, sofa, table lamp ..."""
    box: OrientedBox
    parts: tuple[Part, ...]
    """At least one."""
    front: NDArray[np.float64] | None
    """Horizontal unit vector out of the front (away from headboard, backrest or wall), None if none, shape (3,)."""
    structure: bool = False
    """True for walls, floor, ceiling: never a movable thing, may still be a support (floor)."""
    confidence: float = 1.0
    """0..1, confidence of the label: 1 if the source names the thing, less if it was guessed from its shape."""
    guesses: tuple[tuple[str, float], ...] = ()
    """Possible labels with probabilities, the likeliest first; empty if the source names it."""
    placed: bool = False
    """True for a thing from an earlier placement, which may move again."""

    def __post_init__(self) -> None:
        if self.front is not None:
            check_array(f"front of {self.id}", self.front, 3)


def part_nodes(instance_id: str, parts: Sequence[str]) -> list[str]:
    """Names of the nodes of an instance's parts, `id/part`: one that repeats is counted, as in scene.glb."""
    used: dict[str, int] = {}
    nodes = []
    for name in parts:
        used[name] = used.get(name, 0) + 1
        nodes.append(f"{instance_id}/{name}" if used[name] == 1 else f"{instance_id}/{name}.{used[name]}")
    return nodes


@dataclass(frozen=True, eq=False, slots=True)
class Segmentation:
    """A mesh with its instances and parts."""

    mesh: Mesh
    instances: tuple[Instance, ...]
    face_instance: NDArray[np.int32]
    """Index into `instances` per face, -1 for none, shape (m,)."""
    face_part: NDArray[np.int32]
    """Index into that instance's `parts` per face, -1 for none, shape (m,)."""
    notes: tuple[str, ...] = ()
    """Assumptions and omissions, one sentence each."""
    unit_source: str = field(default="estimate", kw_only=True)
    """Source of the file's unit: option, format or estimate."""

    def __post_init__(self) -> None:
        length, most = len(self.mesh.faces), max((len(one.parts) for one in self.instances), default=0)
        check_index("face_instance", self.face_instance, length=length, count=len(self.instances))
        check_index("face_part", self.face_part, length=length, count=most)

    def instance_mesh(self, instance: int) -> Mesh:
        """The faces of one instance."""
        return self.mesh.submesh(np.flatnonzero(self.face_instance == instance))

    def index_of(self, instance_id: str) -> int:
        """Position of the instance with this id."""
        return next(i for i, one in enumerate(self.instances) if one.id == instance_id)


SegmentedScene = NewType("SegmentedScene", Segmentation)
"""The scene of a placement; a type of its own, so that the wiring of the stages cannot swap it with the object."""
SegmentedObject = NewType("SegmentedObject", Segmentation)
"""The object of a placement."""
