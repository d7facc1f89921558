"""Instances and parts of the faces of a mesh; things that a person or a program has named or pointed at."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import NewType

import numpy as np
from numpy.typing import NDArray

from dcap.scene.errors import GeometryError
from dcap.scene.types.arrays import check_array, check_index
from dcap.scene.types.boxes import OrientedBox
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


class CornerFrame(StrEnum):
    """Frames of the corners of given boxes."""

    FILE = "file"
    """The scene file's own axes and unit."""
    Y_UP = "y_up"
    """Metres, y up: the frame of a phone's scan."""
    Z_UP = "z_up"
    """Metres, z up."""


@dataclass(frozen=True, eq=False, slots=True)
class GivenPart:
    """A part of a thing."""

    name: str
    faces: NDArray[np.int64]
    """Runs of faces of the scene's mesh, first and one past the last, shape (k, 2)."""


@dataclass(frozen=True, eq=False, slots=True)
class GivenThing:
    """A thing with its name."""

    id: str
    label: str
    confidence: float
    """0..1, confidence of the label; 1 if a person gave it."""
    faces: NDArray[np.int64]
    """Runs of faces of the scene's mesh, first and one past the last, shape (k, 2); none: the box decides."""
    corners: NDArray[np.float64]
    """The corners of its box, shape (8, 3), or (0, 3) without one."""
    parts: tuple[GivenPart, ...] = ()
    """Its parts if they are known; empty: found by its label."""
    guesses: tuple[tuple[str, float], ...] = ()
    """Alternative labels with probabilities, if nobody has corrected the label."""

    def __post_init__(self) -> None:
        check_array(f"faces of {self.id}", self.faces, None, 2)
        check_array(f"corners of {self.id}", self.corners, None, 3)
        if len(self.corners) not in (0, 8):
            raise GeometryError(f"the box of {self.id} has {len(self.corners)} corners, expected 8")


@dataclass(frozen=True, eq=False, slots=True)
class GivenLabels:
    """The things of a scene."""

    source: str
    """The file's name, for messages."""
    things: tuple[GivenThing, ...]
    frame: CornerFrame
    """Frame of the corners."""
    complete: bool
    """Whether these are all things, so that the other faces belong to none. Else the rest is found by its shape."""
    mesh: str
    """Digest of the mesh that runs of faces refer to; empty without runs."""
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False, slots=True)
class VertexLabels:
    """The thing of each vertex of the scene's file."""

    source: str
    """The file's name, for messages."""
    instance: NDArray[np.int32]
    """Index into `ids` for each vertex in the file's order, -1 for nothing, shape (n,)."""
    ids: tuple[str, ...]
    labels: tuple[str, ...]
    """One for each id; empty if it has no name."""
    notes: tuple[str, ...] = ()


def faces_digest(mesh: Mesh) -> str:
    """Digest of a mesh's connectivity, 16 hex digits, which decides whether runs of faces fit it.

    Positions do not count, so the same file read in another unit still fits.
    """
    return hashlib.sha256(np.ascontiguousarray(mesh.faces, dtype="<i4").tobytes()).hexdigest()[:16]


@dataclass(frozen=True, eq=False, slots=True)
class Pointed:
    """A point on a thing, or a region that carries."""

    base_id: str
    """Id of the thing; that of a new one if faces are cut out."""
    label: str
    """Its name from now on."""
    part: str
    """Name of its one part if faces are cut out, else empty: parts stay or are found by its label."""
    point: NDArray[np.float64]
    """The place on its surface [m], shape (3,), or (0,) if a region was given."""
    cut: NDArray[np.int64]
    """Faces that become the thing, as runs, first and one past the last, shape (k, 2); none: it is not changed."""
    renamed: bool
    """Whether the existing thing gets the label, and its parts are segmented again."""
    notes: tuple[str, ...]

    def __post_init__(self) -> None:
        check_array("point", self.point, None)
        check_array("cut", self.cut, None, 2)
