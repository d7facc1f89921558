"""A settled scene for a simulator of rigid bodies: visible meshes, convex collision pieces, friction."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.scene.types.materials import ContactFriction, Material
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.particles import InertialProperties


@dataclass(frozen=True, eq=False, slots=True)
class SeenPart:
    """Visible mesh of one part of a thing."""

    name: str
    """Name of the part, unique within its thing."""
    mesh: Mesh
    """Mesh in the frame of its body."""
    material: Material | None
    """None if its material was not determined."""


@dataclass(frozen=True, eq=False, slots=True)
class ConvexPiece:
    """A convex collision shape."""

    name: str
    """Unique in the scene."""
    mesh: Mesh
    """A closed convex surface in the frame of its body."""
    friction: ContactFriction
    """For a piece of the free body its own friction; for a fixed piece that of the pair with the free body's main
    friction."""


@dataclass(frozen=True, eq=False, slots=True)
class ContactPatch:
    """The surface near the free body with a uniform friction: as triangles, and as convex prisms under them."""

    name: str
    """Unique in the scene."""
    surface: Mesh
    """World frame [m], faces look outwards."""
    prisms: tuple[Mesh, ...]
    """A prism under each face except slivers, closed and convex, in the world frame."""
    friction: ContactFriction
    """Friction of the pair with the free body's main friction."""


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
    """Main friction of the object."""
    parts: tuple[SeenPart, ...]
    pieces: tuple[ConvexPiece, ...]
    soft: bool
    """Whether the object was simulated as a soft body."""


@dataclass(frozen=True, eq=False, slots=True)
class FixedBody:
    """A settled thing of the scene, in the world frame."""

    name: str
    """Id of the instance."""
    label: str
    parts: tuple[SeenPart, ...]
    patches: tuple[ContactPatch, ...]
    """Patches near the object."""
    pieces: tuple[ConvexPiece, ...]
    """Convex pieces elsewhere."""


@dataclass(frozen=True, slots=True)
class PieceFriction:
    """Friction of a pair of shapes, if it differs from that of the fixed shape."""

    piece: str
    """Name of the free body's piece."""
    patch: str
    prism: int
    """Index of the patch's prism."""
    friction: ContactFriction


@dataclass(frozen=True, eq=False, slots=True)
class ExportScene:
    """Content of an exported file."""

    thing: FreeBody
    fixed: tuple[FixedBody, ...]
    pairs: tuple[PieceFriction, ...]
    resting: ContactFriction
    """Friction of the pair at the object's rest contact, with its main friction."""
    deviation: float
    """Largest distance of the patches' triangles from the settled surface [m]."""
    notes: tuple[str, ...]
    """Notes for users of the file, one sentence each."""


def replace_friction(pair: ContactFriction, main: ContactFriction, own: ContactFriction) -> ContactFriction:
    """The friction of a pair with the object's main friction replaced: sqrt(own b) from sqrt(main b)."""

    def other(given: float, before: float, now: float) -> float:
        return given * float(np.sqrt(now / before)) if before > 0.0 else given

    return ContactFriction(
        other(pair.static, main.static, own.static),
        other(pair.dynamic, main.dynamic, own.dynamic),
        other(pair.rolling_resistance, main.rolling_resistance, own.rolling_resistance),
    )
