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
    """Confidence of the name, 0..1."""


@dataclass(frozen=True, eq=False, slots=True)
class Instance:
    """One thing in the scene, or the object itself."""

    id: str
    label: str
    """Category in lower case: bed, sofa, table lamp ..."""
    box: OrientedBox
    parts: tuple[Part, ...]
    """Parts; at least one."""
    front: NDArray[np.float64] | None
    """Horizontal unit vector out of the front (away from headboard, backrest or wall), shape (3,); None without a
    front."""
    structure: bool = False
    """True for walls, floor and ceiling: never a movable thing, but possibly a support (floor)."""
    confidence: float = 1.0
    """Confidence of the label, 0..1: 1 if the source names the thing, less if it was guessed from its shape."""
    guesses: tuple[tuple[str, float], ...] = ()
    """Possible labels with probabilities, the likeliest first; empty if the source names the thing."""
    placed: bool = False
    """True for a thing from an earlier placement, which may move again."""

    def __post_init__(self) -> None:
        if self.front is not None:
            check_array(f"front of {self.id}", self.front, 3)


def part_nodes(instance_id: str, parts: Sequence[str]) -> list[str]:
    """Names of the nodes of an instance's parts, `id/part`; repeated names are numbered, as in scene.glb."""
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
"""The scene of a placement; a distinct type, so that the wiring of the stages cannot confuse it with the object."""
SegmentedObject = NewType("SegmentedObject", Segmentation)
"""The object of a placement."""


class CornerFrame(StrEnum):
    """Frames for the corners of given boxes."""

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
    """Confidence of the label, 0..1; 1 if a person gave it."""
    faces: NDArray[np.int64]
    """Runs of faces of the scene's mesh, first and one past the last, shape (k, 2); empty: the box decides."""
    corners: NDArray[np.float64]
    """The corners of the box, shape (8, 3), or (0, 3) without a box."""
    parts: tuple[GivenPart, ...] = ()
    """Parts if they are known; empty: determined by the label."""
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
    """Whether these are all things of the scene, so that other faces belong to none; otherwise the rest is found by
    shape."""
    mesh: str
    """Digest of the mesh to which runs of faces refer; empty without runs."""
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
    """Label of each id; empty if it has none."""
    notes: tuple[str, ...] = ()


def faces_digest(mesh: Mesh) -> str:
    """Digest of a mesh's connectivity, 16 hex digits, which decides whether runs of faces apply to it.

    Positions do not count, so that the same file read in another unit still matches.
    """
    return hashlib.sha256(np.ascontiguousarray(mesh.faces, dtype="<i4").tobytes()).hexdigest()[:16]


@dataclass(frozen=True, eq=False, slots=True)
class Pointed:
    """A point on a thing, or a region that carries the object."""

    base_id: str
    """Id of the thing; a new id if faces are cut out."""
    label: str
    """Label of the thing from now on."""
    part: str
    """Name of its only part if faces are cut out, else empty: parts are kept, or determined by the label."""
    point: NDArray[np.float64]
    """The place on the surface [m], shape (3,), or (0,) if a region was given."""
    cut: NDArray[np.int64]
    """Faces that become the thing, as runs, first and one past the last, shape (k, 2); empty: the thing is not
    changed."""
    renamed: bool
    """Whether the existing thing gets the label, and its parts are segmented again."""
    notes: tuple[str, ...]

    def __post_init__(self) -> None:
        check_array("point", self.point, None)
        check_array("cut", self.cut, None, 2)
