"""A settled scene as a simulator of rigid bodies takes it: meshes to be seen, convex pieces to collide, friction."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.scene.types.materials import ContactFriction, Material
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.particles import InertialProperties


@dataclass(frozen=True, eq=False, slots=True)
class SeenPart:
    """What is seen of one part of a thing."""

    name: str
    """Of the part, unique within its thing."""
    mesh: Mesh
    """In the frame of its body."""
    material: Material | None
    """None where nobody was asked what it is made of."""


@dataclass(frozen=True, eq=False, slots=True)
class ConvexPiece:
    """A convex collision shape."""

    name: str
    """Unique in the scene."""
    mesh: Mesh
    """A closed convex surface in the frame of its body."""
    friction: ContactFriction
    """Of the free body's piece: its own. Of a fixed one: that of the pair with the free body's main friction."""


@dataclass(frozen=True, eq=False, slots=True)
class ContactPatch:
    """The surface near the free body with one friction: as triangles, and as convex prisms under them."""

    name: str
    """Unique in the scene."""
    surface: Mesh
    """World frame [m], faces look outwards."""
    prisms: tuple[Mesh, ...]
    """One under each face that is no sliver, closed and convex, in the world frame."""
    friction: ContactFriction
    """Of the pair with the free body's main friction."""


@dataclass(frozen=True, eq=False, slots=True)
class FreeBody:
    """The object: a rigid body in the shape in which it settled."""

    name: str
    label: str
    position: NDArray[np.float64]
    """World position of its origin [m], shape (3,)."""
    quaternion: NDArray[np.float64]
    """World-from-body rotation (w, x, y, z), shape (4,)."""
    inertial: InertialProperties
    """Centre of mass and inertia in the body's frame."""
    friction: ContactFriction
    """Its main friction."""
    parts: tuple[SeenPart, ...]
    pieces: tuple[ConvexPiece, ...]
    soft: bool
    """Whether it was simulated as a soft body."""


@dataclass(frozen=True, eq=False, slots=True)
class FixedBody:
    """A thing of the scene as it settled, in the world frame."""

    name: str
    """Id of the instance."""
    label: str
    parts: tuple[SeenPart, ...]
    patches: tuple[ContactPatch, ...]
    """Near the object."""
    pieces: tuple[ConvexPiece, ...]
    """Elsewhere."""


@dataclass(frozen=True, slots=True)
class PieceFriction:
    """Friction of a pair of shapes that is not the one of its fixed shape."""

    piece: str
    """Of the free body."""
    patch: str
    prism: int
    """Of the patch."""
    friction: ContactFriction


@dataclass(frozen=True, eq=False, slots=True)
class ExportScene:
    """Everything that an exported file says."""

    thing: FreeBody
    fixed: tuple[FixedBody, ...]
    pairs: tuple[PieceFriction, ...]
    resting: ContactFriction
    """Of the pair where the object rests, with its main friction."""
    deviation: float
    """How far the patches' triangles are at most from the settled surface [m]."""
    notes: tuple[str, ...]
    """What a user of the file should know, one sentence each."""


def instead(pair: ContactFriction, main: ContactFriction, own: ContactFriction) -> ContactFriction:
    """The friction of a pair with another one in the place of the object's main one: sqrt(own b), where sqrt(main b) is
    given."""

    def other(given: float, before: float, now: float) -> float:
        return given * float(np.sqrt(now / before)) if before > 0.0 else given

    return ContactFriction(
        other(pair.static, main.static, own.static),
        other(pair.dynamic, main.dynamic, own.dynamic),
        other(pair.rolling_resistance, main.rolling_resistance, own.rolling_resistance),
    )
