"""The constant part of a simulation: bodies as arrays, checked once at the border.

Every body is given in its start pose in the world frame: metres, z up. A rigid body is a surface, a signed distance
and mass properties; a soft body adds particles (the quadrature points) and the node planes of its background grid.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from solver.box import bounds
from solver.errors import ModelError
from solver.model.layers import Layers

LEAST_GRAVITY = 1e-12  # [m/s^2], so that ratios to weights stay finite without gravity
FREE, HELD, CORE = 0, 1, 2  # node states: free, held by the world, moving with the rigid core of the body


@dataclass(frozen=True, eq=False, slots=True)
class SignedDistance:
    """Samples of a signed distance, negative inside."""

    origin: NDArray[np.float64]
    """Position of sample (0, 0, 0) [m], shape (3,)."""
    spacing: float
    """Distance between neighbouring samples [m]."""
    values: NDArray[np.float32]
    """Signed distances [m], shape (nx, ny, nz), each side at least 3."""

    def at(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Distances at points (n, 3) of the start pose, trilinear between samples; outside, the distance at the border
        [m]."""
        index = ((points - self.origin) / self.spacing).T
        return np.asarray(map_coordinates(self.values, index, order=1, mode="nearest", output=np.float64), np.float64)

    def outward(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Unit gradient at points (n, 3), by central differences; zero where the gradient vanishes."""
        step = self.spacing
        gradient = np.stack([self.at(points + step * e) - self.at(points - step * e) for e in np.eye(3)], axis=1)
        size = np.linalg.norm(gradient, axis=1, keepdims=True)
        return np.where(size > 0.1 * step, gradient / np.maximum(size, 1e-300), 0.0)


@dataclass(frozen=True, eq=False, slots=True)
class Interior:
    """Interior of a soft body: material points, which are the quadrature points, and their background grid."""

    position: NDArray[np.float64]
    """Particle rest positions X_p [m], shape (p, 3)."""
    volume: NDArray[np.float64]
    """Particle rest volumes V_p [m^3], shape (p,)."""
    density: NDArray[np.float64]
    """Mass densities [kg/m^3], shape (p,)."""
    youngs_modulus: NDArray[np.float64]
    """Young's moduli E [Pa], shape (p,)."""
    poisson_ratio: NDArray[np.float64]
    """Poisson ratios nu [-], shape (p,)."""
    planes: tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]
    """Node planes along x, y, z [m]."""
    node_state: NDArray[np.int8]
    """FREE, HELD or CORE per grid node, shape (kx, ky, kz)."""
    loaded: bool
    """True: the given shape is already in balance with the body's own weight (a scan at rest)."""
    layers: Layers | None = None
    """Layers of the material, if it has any: E and nu are then those across the layers."""


@dataclass(frozen=True, eq=False, slots=True)
class _CommonBody:
    """Fields common to rigid and soft bodies."""

    name: str
    fixed: bool
    """The body does not move as a whole: a rigid body is fixed, a soft one is clamped at its HELD nodes."""
    vertices: NDArray[np.float64]
    """Surface points [m], shape (n, 3)."""
    faces: NDArray[np.int32]
    """Triangles, counter-clockwise from outside, shape (m, 3)."""
    distance: SignedDistance
    mass: float
    """Mass [kg]; > 0 for a free body."""
    center_of_mass: NDArray[np.float64]
    """Centre of mass [m], shape (3,)."""
    static_friction: float
    dynamic_friction: float
    rolling_resistance: float
    """Length b of the resisting torque b * N [m]."""
    face_friction: NDArray[np.float64] | None = field(default=None, kw_only=True)
    """Static and dynamic friction and rolling resistance of each face, in place of the three values above, if they
    differ between faces, shape (m, 3)."""
    velocity: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3), kw_only=True)
    """Start velocity [m/s], shape (3,)."""
    angular_velocity: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3), kw_only=True)
    """Start angular velocity [rad/s], shape (3,)."""
    size: float = field(init=False)
    """Diagonal of the start box [m]."""

    def __post_init__(self) -> None:
        _check_surface(self)
        low, high = bounds(self.vertices)
        object.__setattr__(self, "size", float(np.linalg.norm(high - low)))
        if not self.fixed and not self.mass > 0.0:
            raise ModelError(f"body {self.name!r}: mass is {self.mass} kg; a free body needs a positive mass")
        if not (0.0 <= self.dynamic_friction <= self.static_friction):
            raise ModelError(
                f"body {self.name!r}: friction static {self.static_friction}, dynamic {self.dynamic_friction}; "
                "need 0 <= dynamic <= static"
            )
        if self.rolling_resistance < 0.0:
            raise ModelError(
                f"body {self.name!r}: rolling_resistance is {self.rolling_resistance} m, must not be negative"
            )
        if (rows := self.face_friction) is not None:
            if rows.shape != (len(self.faces), 3):
                raise ModelError(
                    f"body {self.name!r}: face_friction has shape {rows.shape}, not ({len(self.faces)}, 3)"
                )
            if not ((rows >= 0.0) & (rows[:, 1:2] <= rows[:, :1] + np.array([0.0, 0.0, np.inf]))).all():
                raise ModelError(f"body {self.name!r}: face_friction needs 0 <= dynamic <= static and rolling >= 0")

    @property
    def friction_rows(self) -> NDArray[np.float64]:
        """Static and dynamic friction [-] and rolling resistance length [m] of each point (n, 3), or of all points (1,
        3). A point between faces with different values has their mean by area, weighted like its share of the
        surface."""
        own = np.array([[self.static_friction, self.dynamic_friction, self.rolling_resistance]])
        if self.face_friction is None:
            return own
        a, b, c = self.vertices[self.faces].transpose(1, 0, 2)
        area = np.repeat(np.linalg.norm(np.cross(b - a, c - a), axis=1), 3)
        corner, rows = self.faces.ravel(), np.repeat(self.face_friction, 3, axis=0)
        some = np.repeat(own, len(self.vertices), axis=0)
        some[corner] = rows  # values of one of its faces
        share = area / np.maximum(np.bincount(corner, area, len(some)), np.finfo(float).tiny)[corner]
        # differences from those values, so that equal rows give the same bytes
        change = share[:, None] * (rows - some[corner])
        return some + np.stack([np.bincount(corner, change[:, k], len(some)) for k in range(3)], axis=1)


@dataclass(frozen=True, eq=False, slots=True)
class RigidBody(_CommonBody):
    """A body that keeps its shape."""

    inertia: NDArray[np.float64]
    """Inertia about the centre of mass, world axes [kg m^2], shape (3, 3)."""
    vertical: bool = field(default=False, kw_only=True)
    """Guided: moves only along z; its x, y and rotation are held."""

    def __post_init__(self) -> None:
        _CommonBody.__post_init__(self)
        _check_finite(self, "inertia")
        if self.vertical and (self.velocity[:2].any() or self.angular_velocity.any()):
            raise ModelError(f"body {self.name!r}: moves along z alone, so its start velocity must, too")
        if not self.fixed and np.linalg.eigvalsh(self.inertia).min() <= 0.0:
            raise ModelError(f"body {self.name!r}: inertia is not positive definite: {self.inertia.tolist()}")


@dataclass(frozen=True, eq=False, slots=True)
class SoftBody(_CommonBody):
    """A body that deforms."""

    interior: Interior

    def __post_init__(self) -> None:
        _CommonBody.__post_init__(self)
        _check_interior(self.name, self.fixed, self.interior)


Body = RigidBody | SoftBody
VERTICAL = np.array([False, False, True, False, False, False])


def free_motions(body: Body) -> NDArray[np.bool_]:
    """Mask of the translations and rotations along and about x, y, z that a body may do, shape (6,)."""
    return VERTICAL if isinstance(body, RigidBody) and body.vertical else np.ones(6, dtype=bool)


def _check_finite(body: _CommonBody, *names: str) -> None:
    for name in names:
        if not np.isfinite(getattr(body, name)).all():
            raise ModelError(f"body {body.name!r}: {name} holds values that are not finite")


def _check_surface(body: _CommonBody) -> None:
    _check_finite(body, "vertices", "center_of_mass", "velocity", "angular_velocity")
    if len(body.vertices) < 3 or len(body.faces) < 1:
        raise ModelError(f"body {body.name!r}: empty surface ({len(body.vertices)} vertices, {len(body.faces)} faces)")
    if body.faces.min() < 0 or body.faces.max() >= len(body.vertices):
        raise ModelError(f"body {body.name!r}: face index {int(body.faces.max())} for {len(body.vertices)} vertices")
    if min(body.distance.values.shape) < 3 or not np.isfinite(body.distance.values).all():
        raise ModelError(f"body {body.name!r}: signed distance needs at least 3 finite samples per axis")


def _check_interior(name: str, fixed: bool, soft: Interior) -> None:
    if len(soft.position) == 0:
        raise ModelError(f"body {name!r}: soft but without particles; its grid cells are larger than the body")
    positive = [("volume", 0.0, np.inf), ("density", 0.0, np.inf), ("youngs_modulus", 0.0, np.inf)]
    for field_name, low, high in [*positive, *([("poisson_ratio", -1.0, 0.5)] if soft.layers is None else [])]:
        values = getattr(soft, field_name)
        bad = np.flatnonzero(~((values > low) & (values < high)))
        if len(bad):
            raise ModelError(f"body {name!r}: {field_name} is {values[bad[0]]}, must lie between {low} and {high}")
    if soft.layers is not None:
        soft.layers.check(name, soft.youngs_modulus, soft.poisson_ratio)
    expected = tuple(len(p) for p in soft.planes)
    if soft.node_state.shape != expected:
        raise ModelError(f"body {name!r}: node_state has shape {soft.node_state.shape}, the grid has {expected} nodes")
    if any((np.diff(p) <= 0).any() for p in soft.planes):
        raise ModelError(f"body {name!r}: node planes must increase")
    if fixed and not (soft.node_state == HELD).any():
        raise ModelError(f"body {name!r}: fixed and soft, but nothing holds it: give it a clamp")


@dataclass(frozen=True, eq=False, slots=True)
class Model:
    """All bodies and the loads on them."""

    bodies: tuple[Body, ...]
    gravity: NDArray[np.float64]
    """Gravity [m/s^2], shape (3,)."""
    friction_pairs: tuple[tuple[str, str, float, float], ...] = ()
    """(body, body, mu_s, mu_d) for pairs that differ from the geometric mean of the two."""
    bonds: tuple[tuple[str, str], ...] = ()
    """Pairs of bodies that stay bonded where they touch at the start."""

    def __post_init__(self) -> None:
        names = [b.name for b in self.bodies]
        if len(set(names)) != len(names):
            raise ModelError(f"body names must differ: {names}")
        for a, b, mu_s, mu_d in self.friction_pairs:
            for one in (a, b):
                if one not in names:
                    raise ModelError(f"friction pair names body {one!r}; there is {names}")
            if not 0.0 <= mu_d <= mu_s:
                raise ModelError(
                    f"friction pair {a!r}, {b!r}: static {mu_s}, dynamic {mu_d}; need 0 <= dynamic <= static"
                )

        fixed = {b.name: b.fixed for b in self.bodies}
        for a, b in self.bonds:
            for one in (a, b):
                if one not in fixed:
                    raise ModelError(f"bond names body {one!r}; there is {names}")
            if a == b or (fixed[a] and fixed[b]):
                raise ModelError(f"bond {a!r}, {b!r}: needs two bodies of which one is free")

    @property
    def gravity_strength(self) -> float:
        """Magnitude of gravity [m/s^2], at least LEAST_GRAVITY."""
        return max(float(np.linalg.norm(self.gravity)), LEAST_GRAVITY)

    @property
    def rigid_bodies(self) -> list[tuple[int, RigidBody]]:
        """The rigid bodies with their indices."""
        return [(i, b) for i, b in enumerate(self.bodies) if isinstance(b, RigidBody)]

    @property
    def soft_bodies(self) -> list[tuple[int, SoftBody]]:
        """The soft bodies with their indices."""
        return [(i, b) for i, b in enumerate(self.bodies) if isinstance(b, SoftBody)]

    def bonded(self, a: Body, b: Body) -> bool:
        """Return whether two bodies are bonded to each other."""
        return any({one, two} == {a.name, b.name} for one, two in self.bonds)

    def given_friction(self, a: Body, b: Body) -> tuple[float, float] | None:
        """(mu_s, mu_d) set explicitly for a pair, if any."""
        for one, two, mu_s, mu_d in self.friction_pairs:
            if {one, two} == {a.name, b.name}:
                return mu_s, mu_d
        return None
