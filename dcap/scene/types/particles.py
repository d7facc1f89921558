"""Input of the solver: gravity, and bodies with surfaces, signed distances and, if soft, points and a grid."""

from dataclasses import dataclass, field
from enum import IntEnum
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from dcap.scene.errors import GeometryError
from dcap.scene.types.arrays import check_array
from dcap.scene.types.materials import ContactFriction
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.scan import BodyGeometry

GRAVITY = 9.81
"""Magnitude of gravitational acceleration [m/s^2], as in the paper's section 4.3."""


@dataclass(frozen=True, eq=False, slots=True)
class DistanceGrid:
    """Signed distance (negative inside) sampled on a regular grid in the body's start pose (world frame)."""

    origin: NDArray[np.float64]
    """Position of sample (0, 0, 0) [m], shape (3,)."""
    spacing: float
    """Distance between neighbouring samples [m]."""
    values: NDArray[np.float32]
    """Signed distance [m], shape (nx, ny, nz)."""

    def __post_init__(self) -> None:
        check_array("origin of a distance grid", self.origin, 3)
        check_array("values of a distance grid", self.values, None, None, None)


@dataclass(frozen=True, eq=False, slots=True)
class InertialProperties:
    """Mass, centre of mass and inertia; informative for a fixed body."""

    mass: float
    """Mass [kg]."""
    center_of_mass: NDArray[np.float64]
    """Centre of mass [m], shape (3,)."""
    inertia: NDArray[np.float64]
    """Inertia about the centre of mass, world axes [kg m^2], shape (3, 3)."""

    def __post_init__(self) -> None:
        check_array("center_of_mass of a body", self.center_of_mass, 3)
        check_array("inertia of a body", self.inertia, 3, 3)

    def scaled_to(self, mass: float) -> "InertialProperties":
        """The same distribution of matter with another mass [kg]."""
        return InertialProperties(mass, self.center_of_mass, self.inertia * (mass / self.mass))


@dataclass(frozen=True, eq=False, slots=True)
class LayeredPoints:
    """Layer constants of material points, whose E and nu are those across the layers; isotropic points repeat E and
    nu."""

    youngs_modulus: NDArray[np.float64]
    """Young's modulus in the layers [Pa], shape (p,)."""
    poisson_ratio: NDArray[np.float64]
    """Poisson ratio in the layers [-], shape (p,)."""
    shear_modulus: NDArray[np.float64]
    """Shear modulus between the layers [Pa], shape (p,)."""
    normal: NDArray[np.float64]
    """Unit normals of the layers, of either sign, shape (p, 3)."""

    def __post_init__(self) -> None:
        count = len(self.normal)
        check_array("normal of layered points", self.normal, count, 3)
        for name in ("youngs_modulus", "poisson_ratio", "shear_modulus"):
            check_array(f"{name} of layered points", getattr(self, name), count)


@dataclass(frozen=True, eq=False, slots=True)
class MaterialPoints:
    """The material of a soft body, lumped into quadrature points."""

    position: NDArray[np.float64]
    """Rest positions X_p [m], shape (p, 3), p > 0."""
    volume: NDArray[np.float64]
    """Rest volumes V_p [m^3], shape (p,)."""
    density: NDArray[np.float64]
    """Density [kg/m^3], shape (p,)."""
    youngs_modulus: NDArray[np.float64]
    """Young's modulus [Pa], shape (p,)."""
    poisson_ratio: NDArray[np.float64]
    """Poisson ratio [-], shape (p,)."""
    layers: LayeredPoints | None = None
    """Layer constants; None if all points are isotropic."""

    def __post_init__(self) -> None:
        count = len(self.position)
        if count == 0:
            raise GeometryError("a soft body without material points: the cells of its grid are larger than it")
        check_array("position of material points", self.position, count, 3)
        for name in ("volume", "density", "youngs_modulus", "poisson_ratio"):
            check_array(f"{name} of material points", getattr(self, name), count)


class NodeState(IntEnum):
    """Kinds of nodes of a background grid."""

    FREE = 0
    HELD = 1
    """Held by a fixed thing: a frame below, a clamp, the cut of a crop."""
    CORE = 2
    """Moves with the rigid core of the body."""


@dataclass(frozen=True, eq=False, slots=True)
class BackgroundGrid:
    """The grid for a soft body's displacement: a tensor product of node planes in its start pose."""

    x: NDArray[np.float64]
    """Node planes along x [m], increasing, shape (kx,). `y` and `z` likewise."""
    y: NDArray[np.float64]
    z: NDArray[np.float64]
    node_state: NDArray[np.int8]
    """A `NodeState` for each node, shape (kx, ky, kz)."""

    def __post_init__(self) -> None:
        for name, planes in zip("xyz", self.planes, strict=True):
            check_array(f"node planes of a background grid along {name}", planes, None)
            if len(planes) < 2 or (np.diff(planes) <= 0.0).any():
                raise GeometryError(f"node planes of a background grid along {name} must be two or more that increase")
        check_array("node_state of a background grid", self.node_state, *(len(planes) for planes in self.planes))

    @property
    def planes(self) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Node planes along x, y and z [m]."""
        return self.x, self.y, self.z


@dataclass(frozen=True, eq=False, slots=True, kw_only=True)
class SimulationBodyBase:
    """Fields common to all bodies at the start of the drop, in the world frame."""

    name: str
    """Unique name: 'object', the id of the base instance, or 'ID/PART' for a further body of the same instance."""
    instance: str
    """'object', or the id of the scene instance to which it belongs."""
    fixed: bool
    surface: Mesh
    """Surface for contact and pictures; faces near the contact are no larger than the contact spacing."""
    distance: DistanceGrid
    """Signed distance to the solid, sampled where contact is possible."""
    inertial: InertialProperties
    friction: ContactFriction
    """Friction of the part with the predicted contact."""
    face_friction: NDArray[np.float64] | None = None
    """Static and dynamic friction [-] and rolling resistance [m] of each face of the surface, shape (m, 3), if they
    differ."""
    velocity: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))
    """Initial velocity [m/s], shape (3,)."""
    angular_velocity: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))
    """Initial angular velocity [rad/s], shape (3,)."""

    def __post_init__(self) -> None:
        if self.face_friction is not None:
            check_array(f"face_friction of {self.name}", self.face_friction, len(self.surface.faces), 3)
        check_array(f"velocity of {self.name}", self.velocity, 3)
        check_array(f"angular_velocity of {self.name}", self.angular_velocity, 3)


@dataclass(frozen=True, eq=False, slots=True, kw_only=True)
class RigidSimulationBody(SimulationBodyBase):
    """A body that does not deform."""

    vertical: bool = False
    """Guided: moves only along z; its x, y and rotation are held."""


@dataclass(frozen=True, eq=False, slots=True, kw_only=True)
class SoftSimulationBody(SimulationBodyBase):
    """A body that deforms; some of its points may belong to a rigid core."""

    points: MaterialPoints
    grid: BackgroundGrid
    loaded: bool
    """Whether the rest shape is that under the body's own weight, as for a scan at rest; otherwise the body still has
    to sag."""


SimulationBody: TypeAlias = RigidSimulationBody | SoftSimulationBody


@dataclass(frozen=True, slots=True)
class ColumnLayer:
    """One layer of the soft base under the predicted contact."""

    part: str
    material: str
    """Id of the material in the library."""
    from_m: float
    """Depth of its top below the surface [m]."""
    to_m: float
    """Depth of its bottom below the surface [m]."""


@dataclass(frozen=True, eq=False, slots=True)
class Particles:
    """The complete input of the simulation."""

    bodies: tuple[SimulationBody, ...]
    """All bodies; in a placement the object is first."""
    friction_pairs: tuple[tuple[str, str, float, float], ...]
    """(body a, body b, mu_s, mu_d) for pairs that differ from the geometric mean."""
    resolution: float
    """Cell size at the predicted contact [m]."""
    notes: tuple[str, ...]
    """Crops, caps and treatments, one sentence each."""
    geometry: tuple[BodyGeometry, ...] = ()
    """Report on the construction of each body's solid from its faces, and on its deviation from them."""
    column: tuple[ColumnLayer, ...] = ()
    """Layers under the predicted contact, from the top down; empty on a rigid base."""
    foreseen: NDArray[np.float64] | None = None
    """Boxes in plan of the predicted contact with a soft base, where cells are fine [m], shape (k, 2, 2); None on a
    rigid base."""
