"""What a person says of a scene's things: names of faces, boxes or vertices, by hand or from another program."""

import hashlib
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from dcap.scene.errors import GeometryError
from dcap.scene.types.arrays import check_array
from dcap.scene.types.mesh import Mesh


class CornerFrame(StrEnum):
    """What the corners of given boxes are in."""

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
    """0..1, how sure the label is; 1 where a person said so."""
    faces: NDArray[np.int64]
    """Runs of faces of the scene's mesh, first and one past the last, shape (k, 2); none: the box decides."""
    corners: NDArray[np.float64]
    """The corners of its box, shape (8, 3), or (0, 3) where it has none."""
    parts: tuple[GivenPart, ...] = ()
    """Its parts where they are known; empty: found by its label."""
    guesses: tuple[tuple[str, float], ...] = ()
    """What else it may be and how probable that is, where nobody has corrected it."""

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
    """What the corners are in."""
    complete: bool
    """Whether these are all things: what is in none of them is nothing. Else the rest is found by its shape."""
    mesh: str
    """Digest of the mesh that runs of faces refer to; empty: there are none."""
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
    """One for each id; empty where nobody named it."""
    notes: tuple[str, ...] = ()


def faces_digest(mesh: Mesh) -> str:
    """What tells whether runs of faces fit a mesh: the digest of how its faces hang together, 16 hex digits.

    Places do not count, so the same file read in another unit still fits.
    """
    return hashlib.sha256(np.ascontiguousarray(mesh.faces, dtype="<i4").tobytes()).hexdigest()[:16]
