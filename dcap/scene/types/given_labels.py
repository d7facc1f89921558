"""Labels of a scene's things from a person or another program: names of faces, boxes or vertices."""

import hashlib
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from dcap.scene.errors import GeometryError
from dcap.scene.types.arrays import check_array
from dcap.scene.types.mesh import Mesh


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
