"""Outcome of a drop and the evidence for it: every number with its threshold, as plain frozen values.

These values are also stored and reported, so this module imports nothing else from the solver. Fields are named as in
the certificate's JSON, so each name carries its unit. A field that is None by default belongs only to some drops (to
one method, or to an optional check).
"""

from dataclasses import dataclass, fields
from enum import StrEnum
from typing import Literal

import numpy as np
from numpy.typing import NDArray


class Verdict(StrEnum):
    """Outcome of a drop."""

    AT_REST = "at_rest"
    LEFT_TARGET = "left_target"
    """A free body has left everything that could carry it."""
    NO_EQUILIBRIUM = "no_equilibrium"
    """A body still moved when the steps were used up, or the kick moved it."""
    AS_POSED = "as_posed"
    """Nothing was dropped: the pose was proposed by a method."""


@dataclass(frozen=True, slots=True)
class CertificateRow:
    """A number with its threshold, both in the same unit."""

    value: float
    threshold: float
    margin: float
    """1 - value / threshold, or value / threshold - 1 if the threshold is a minimum [-]: negative if the threshold is
    violated."""

    @classmethod
    def at_most(cls, value: float, threshold: float) -> "CertificateRow":
        """A number that must not exceed its threshold."""
        return cls(value, threshold, 1.0 - value / threshold)

    @classmethod
    def at_least(cls, value: float, threshold: float) -> "CertificateRow":
        """A number that must not fall below its threshold."""
        return cls(value, threshold, value / threshold - 1.0)

    @property
    def holds(self) -> bool:
        """Whether the number meets its threshold; False for NaN."""
        return self.margin >= 0.0


@dataclass(frozen=True, slots=True)
class SignalRows:
    """The rest signals over a window of steps."""

    linear_speed: CertificateRow
    """Speed of a free body's centre of mass [m/s]."""
    angular_speed: CertificateRow
    """Angular speed of a free rigid body [rad/s]."""
    particle_speed: CertificateRow
    """Speed of a soft particle [m/s]; mls: at least the speed at which the free bodies have the energy of the strain
    motion."""
    center_drift: CertificateRow
    """Drift of the common centre of mass along an axis [m]."""
    box_change: CertificateRow
    """Change of a side of the joint box of the free bodies [m]."""
    force_residual: CertificateRow
    """Unbalanced force over the weight, or over the carried load [-]."""
    torque_residual: CertificateRow
    """Unbalanced torque over the same force times half the size [-]."""

    @property
    def exceeded(self) -> dict[str, CertificateRow]:
        """The signals above their thresholds, by name."""
        rows: dict[str, CertificateRow] = {one.name: getattr(self, one.name) for one in fields(self)}
        return {name: row for name, row in rows.items() if not row.holds}


@dataclass(frozen=True, slots=True)
class NotDone:
    """A check that was not made."""

    done: Literal[False] = False
    reason: str | None = None


@dataclass(frozen=True, slots=True)
class KickRow:
    """A number that is judged after the kick, with its threshold in the same unit."""

    value: float
    threshold: float
    largest: float | None = None
    """Largest value during the motion."""


@dataclass(frozen=True, slots=True, kw_only=True)
class KickCheck:
    """Outcome of the small kick that tests a rest state."""

    done: Literal[True] = True
    stable: bool
    """Whether the bodies came to rest again near the rest state."""
    speed_m_s: float
    """Speed of the kick."""
    angular_speed_rad_s: float
    """Angular speed of the kick, for a single body."""
    seconds: float
    """Duration of the motion that was followed."""
    steps: int
    growing: bool
    """Whether speeds still grew at the end."""
    speed_left: KickRow
    """Largest speed at the end over the kick's, 0 below the rest thresholds [-]."""
    distance_m: KickRow
    """Distance of a centre of mass from the rest state."""
    angle_rad: KickRow
    """Rotation of a body from the rest state."""


@dataclass(frozen=True, slots=True)
class RollingRow:
    """Rolling resistance between two bodies."""

    a: str
    b: str
    torque_n_m: float
    limit_length_m: float
    """Lever of the normal force at which the resistance yields."""


@dataclass(frozen=True, slots=True)
class BondRow:
    """A bond between two bodies."""

    a: str
    b: str
    points: int
    force_n: float
    stretch_m: float
    """Largest stretch of any point."""


@dataclass(frozen=True, slots=True)
class PushRow:
    """Pushes of one body in one direction, in units of its weight."""

    direction: tuple[float, float, float]
    """Horizontal unit vector."""
    held: float
    """Largest push after which everything came back to rest [-]."""
    lost: float | None
    """Smallest push after which it did not [-]; None if the largest tried push was held."""
    trials: int
    lost_moved_m: float | None
    """Distance that the smallest lost push moved a body; None if no push was lost or the solver could not follow it."""
    lost_turned_rad: float | None
    """Angle by which the smallest lost push turned a body."""


@dataclass(frozen=True, slots=True)
class BodyStability:
    """Resistance of one body to pushes."""

    grade: float
    """Smallest held push over all directions, over the body's weight [-]."""
    directions: tuple[PushRow, ...]


@dataclass(frozen=True, slots=True)
class PushBounds:
    """Limits within which a push counts as held."""

    distance_share: float
    """Distance over the pushed body's size [-]."""
    angle_rad: float
    step: float
    """Step between successive pushes, over the weight [-]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StabilityGrade:
    """Resistance of a rest state to pushes."""

    done: Literal[True] = True
    grade: float
    """Smallest grade of all bodies [-]."""
    bodies: dict[str, BodyStability]
    """Stability of each body, by name."""
    trials: int
    steps: int
    bounds: PushBounds


@dataclass(frozen=True, slots=True)
class ContactRow:
    """Contact of two touching bodies, with all their contact points together."""

    a: str
    b: str
    area_m2: float
    normal_force_n: float
    tangential_force_n: float
    max_penetration_m: float
    """Maximum over the loaded points."""
    max_gap_m: float
    """Maximum over the loaded points."""
    points: int
    sliding_points: int | None = None
    """Number of sliding points."""


@dataclass(frozen=True, eq=False, slots=True)
class PointForces:
    """All forces of contacts and bonds in a state, point by point, k in all; bodies are given by their index in the
    model."""

    a: NDArray[np.int64]
    """The body on which the force acts, shape (k,)."""
    b: NDArray[np.int64]
    """The body that exerts the force, shape (k,)."""
    position: NDArray[np.float64]
    """Point of application [m], shape (k, 3)."""
    force: NDArray[np.float64]
    """Force on a [N], shape (k, 3)."""
    bonded: NDArray[np.bool_]
    """Whether the force is that of a bond, shape (k,)."""


@dataclass(frozen=True, slots=True)
class ContactProof:
    """Check of the forces that hold the bodies against the final surfaces, measured without the solver; but the centre
    of mass of a soft body is that of its reported material."""

    points: int
    """Number of contact points that carry force."""
    gap_m: CertificateRow
    """Largest distance of such a point from the surface of one of its two bodies, without the points that carry the
    last tenth of the force between two bodies."""
    imbalance: CertificateRow
    """Largest share of a free body's weight or load, or of its torque, that is held neither by bonds nor by forces that
    push within a millimetre of the surfaces and inside the friction cone [-]."""
    overlap_m: CertificateRow
    """Increase since the start in the depth of a surface inside a closed piece of another body."""
    smallest_area_m2: float | None = None
    """Smallest area of a contact that carries force between two bodies, at least one of them soft; None if there is
    none."""

    @property
    def holds(self) -> bool:
        """Whether every body rests on its contacts."""
        rows = self.gap_m.holds and self.imbalance.holds and self.overlap_m.holds
        return rows and (self.smallest_area_m2 is None or self.smallest_area_m2 > 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Certificate:
    """All evidence for a verdict."""

    arch: str
    """Processor that ran the kernels: cpu or cuda."""
    method: str | None = None
    """mls, or None for tl."""
    signals: SignalRows
    kick: KickCheck | NotDone
    free_weight_n: float
    """Weight of all free bodies."""
    length_m: float
    """Size of the largest free body, which scales the signals."""
    newton_residual: float | None = None
    """Residual of the last step over the weight [-]; tl only."""
    friction_cone_margin: float
    """Smallest remaining share of the static friction cone over the touching pairs [-]; 0: at the cone."""
    inverted_particles: int
    unlocated_points: int | None = None
    """Points in a soft body that could neither be traced back to the start pose nor located at a surface near their
    last place; tl only."""
    material_damping_s: float | None = None
    """Stiffness-proportional damping; tl only."""
    rolling_resistance: tuple[RollingRow, ...] | None = None
    """Rolling resistance of each pair; tl only."""
    depth_error_m: float | None = None
    """Estimate of the additional depth at which the object would rest without discretisation error; tl with soft bodies
    only."""
    bonds: tuple[BondRow, ...] | None = None
    """The bonds; None if there are none."""
    stability: StabilityGrade | NotDone | None = None
    """Stability grade; None if it was not requested."""
    cell_m: float | None = None
    """Smallest cell of the soft bodies' grids; mls only."""
    substeps: int | None = None
    """Number of explicit steps; mls only."""
    inertia_scale: float | None = None
    """Largest factor by which inertia against strain was scaled up for the stability of these steps [-]; mls only."""
    interval_s: float | None = None
    """Interval at which motion was judged; mls only."""
    proof: ContactProof | None = None
    """Proof on the final surfaces; None before they were measured."""


@dataclass(frozen=True, eq=False, slots=True)
class History:
    """Signals over a run, one number per step, each of shape (steps,), as defined in SignalRows."""

    time: NDArray[np.float64]
    """Time [s]."""
    linear_speed: NDArray[np.float64]
    """Linear speed [m/s]."""
    angular_speed: NDArray[np.float64]
    """Angular speed [rad/s]."""
    particle_speed: NDArray[np.float64]
    """Particle speed [m/s]."""
    force_residual: NDArray[np.float64]
    """Force residual [-]."""
    torque_residual: NDArray[np.float64]
    """Torque residual [-]."""
    newton: NDArray[np.int64]
    """Newton iterations of a step; mls: explicit steps."""
    linear: NDArray[np.int64]
    """Iterations of the linear solver."""
