"""How a drop ended and what that rests on: every number with its threshold, as plain frozen values.

They are what is stored and reported, too: this module imports nothing else of the solver. Names of fields are those of
the certificate's JSON, so each carries its unit. A field that is None by default belongs to some drops only (to one
method, or to what was asked for).
"""

from dataclasses import dataclass, fields
from enum import StrEnum
from typing import Literal

import numpy as np
from numpy.typing import NDArray


class Verdict(StrEnum):
    """How a drop ended."""

    AT_REST = "at_rest"
    LEFT_TARGET = "left_target"
    """A free body has left everything that could carry it."""
    NO_EQUILIBRIUM = "no_equilibrium"
    """Something still moved when the steps were used up, or the kick moved it."""
    AS_POSED = "as_posed"
    """Nothing was dropped: the pose is what a method proposed."""


@dataclass(frozen=True, slots=True)
class CertificateRow:
    """A number with its threshold, both in one unit."""

    value: float
    threshold: float
    margin: float
    """1 - value / threshold, or value / threshold - 1 where that is the least value [-]: negative on the wrong side."""

    @classmethod
    def at_most(cls, value: float, threshold: float) -> "CertificateRow":
        """A number that may not be above its threshold."""
        return cls(value, threshold, 1.0 - value / threshold)

    @classmethod
    def at_least(cls, value: float, threshold: float) -> "CertificateRow":
        """A number that may not be below its threshold."""
        return cls(value, threshold, value / threshold - 1.0)

    @property
    def holds(self) -> bool:
        """Whether the number is on the right side, or at the threshold; one that is not a number is not."""
        return self.margin >= 0.0


@dataclass(frozen=True, slots=True)
class SignalRows:
    """The rest signals over a window of steps."""

    linear_speed: CertificateRow
    """Of a free body's centre of mass [m/s]."""
    angular_speed: CertificateRow
    """Of a free rigid body [rad/s]."""
    particle_speed: CertificateRow
    """Of a soft particle [m/s]; mls: at least that at which the free bodies have the energy of the strain motion."""
    center_drift: CertificateRow
    """Of the common centre of mass along an axis [m]."""
    box_change: CertificateRow
    """Of a side of the free bodies' joint box [m]."""
    force_residual: CertificateRow
    """Unbalanced force over the weight, or over what is carried [-]."""
    torque_residual: CertificateRow
    """Unbalanced torque over the same times half the size [-]."""

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
    """One number that is judged after the kick; all in one unit."""

    value: float
    threshold: float
    largest: float | None = None
    """On the way there."""


@dataclass(frozen=True, slots=True, kw_only=True)
class KickCheck:
    """Outcome of the small kick that tests a rest state."""

    done: Literal[True] = True
    stable: bool
    """At rest again, near where it was."""
    speed_m_s: float
    """Of the kick."""
    angular_speed_rad_s: float
    """Of the kick, for a body alone."""
    seconds: float
    """How long it was followed."""
    steps: int
    growing: bool
    """Whether speeds still grew at the end."""
    speed_left: KickRow
    """Largest speed at the end over the kick's, 0 below the rest thresholds [-]."""
    distance_m: KickRow
    """Of a centre of mass from the rest state."""
    angle_rad: KickRow
    """Turn of a body from the rest state."""


@dataclass(frozen=True, slots=True)
class RollingRow:
    """Rolling resistance between two bodies."""

    a: str
    b: str
    torque_n_m: float
    limit_length_m: float
    """Lever of the normal force at which it gives way."""


@dataclass(frozen=True, slots=True)
class BondRow:
    """A bond between two bodies."""

    a: str
    b: str
    points: int
    force_n: float
    stretch_m: float
    """Largest of any point."""


@dataclass(frozen=True, slots=True)
class PushRow:
    """Pushes of one body in one direction, as shares of its weight."""

    direction: tuple[float, float, float]
    """Horizontal unit vector."""
    held: float
    """Largest share after which everything came back to rest [-]."""
    lost: float | None
    """Smallest after which it did not [-]; None where the largest one tried was held."""
    trials: int
    lost_moved_m: float | None
    """How far the smallest lost push moved a body; None where there is none or the solver could not follow it."""
    lost_turned_rad: float | None
    """How far it turned one."""


@dataclass(frozen=True, slots=True)
class BodyStability:
    """How far one body can be pushed."""

    grade: float
    """Smallest share of its weight that is held, over the directions [-]."""
    directions: tuple[PushRow, ...]


@dataclass(frozen=True, slots=True)
class PushBounds:
    """Thresholds below which a push counts as held."""

    distance_share: float
    """Over the pushed body's size [-]."""
    angle_rad: float
    step: float
    """Between neighbouring pushes, over the weight [-]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StabilityGrade:
    """How far a rest state can be pushed before it is lost."""

    done: Literal[True] = True
    grade: float
    """Smallest of all bodies [-]."""
    bodies: dict[str, BodyStability]
    """By name."""
    trials: int
    steps: int
    bounds: PushBounds


@dataclass(frozen=True, slots=True)
class ContactRow:
    """Two touching bodies, all their contact points together."""

    a: str
    b: str
    area_m2: float
    normal_force_n: float
    tangential_force_n: float
    max_penetration_m: float
    """Over the loaded points."""
    max_gap_m: float
    """Over the loaded points."""
    points: int
    sliding_points: int | None = None
    """tl only."""


@dataclass(frozen=True, eq=False, slots=True)
class PointForces:
    """Every force of a contact or a bond in a state, point by point, k in all; bodies by their index in the model."""

    a: NDArray[np.int64]
    """The body that it acts on, shape (k,)."""
    b: NDArray[np.int64]
    """The body that it comes from, shape (k,)."""
    position: NDArray[np.float64]
    """[m], shape (k, 3)."""
    force: NDArray[np.float64]
    """On a [N], shape (k, 3)."""
    bonded: NDArray[np.bool_]
    """Of a bond, shape (k,)."""


@dataclass(frozen=True, slots=True)
class ContactProof:
    """Check of the forces that hold the bodies against the final surfaces, measured without the solver."""

    points: int
    """Contact points that carry force."""
    gap_m: CertificateRow
    """Largest distance of such a point from the surface of one of its two bodies; those that carry the last tenth of
    the force between two bodies do not count."""
    imbalance: CertificateRow
    """Largest part of what a free body weighs or carries, or of its torque, that is not held by forces which push
    within a millimetre of the surfaces, inside the cone of friction, or by bonds [-]."""
    overlap_m: CertificateRow
    """How much deeper than at the start a surface lies in a closed piece of another one."""
    smallest_area_m2: float | None = None
    """Of the contacts that carry force between two bodies of which one is soft; None where there are none."""

    @property
    def holds(self) -> bool:
        """Whether every body rests on what it touches."""
        rows = self.gap_m.holds and self.imbalance.holds and self.overlap_m.holds
        return rows and (self.smallest_area_m2 is None or self.smallest_area_m2 > 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Certificate:
    """Everything that a verdict rests on."""

    arch: str
    """Where the kernels ran: cpu or cuda."""
    method: str | None = None
    """mls; None for tl."""
    signals: SignalRows
    kick: KickCheck | NotDone
    free_weight_n: float
    """Of all free bodies."""
    length_m: float
    """Size of the largest free body, by which signals are scaled."""
    newton_residual: float | None = None
    """Of the last step, over the weight [-]; tl only."""
    friction_cone_margin: float
    """Smallest share of the static friction cone that is left over the touching pairs [-]; 0: at the cone."""
    inverted_particles: int
    unlocated_points: int | None = None
    """Points in a soft body for which neither the way back to the start pose nor a surface near its last place was
    found; tl only."""
    material_damping_s: float | None = None
    """Stiffness-proportional; tl only."""
    rolling_resistance: tuple[RollingRow, ...] | None = None
    """tl only."""
    depth_error_m: float | None = None
    """Estimate of how much deeper than on its grid the object would rest; tl with soft bodies only."""
    bonds: tuple[BondRow, ...] | None = None
    """None where there are none."""
    stability: StabilityGrade | NotDone | None = None
    """None where nobody asked."""
    cell_m: float | None = None
    """Smallest of the soft bodies' grids; mls only."""
    substeps: int | None = None
    """Explicit steps; mls only."""
    inertia_scale: float | None = None
    """Largest factor by which inertia against strain was scaled up, so that such steps are stable [-]; mls only."""
    interval_s: float | None = None
    """How often motion was judged; mls only."""
    proof: ContactProof | None = None
    """None before somebody has measured the final surfaces."""


@dataclass(frozen=True, eq=False, slots=True)
class History:
    """Signals over a run, one number per step, each of shape (steps,); what they are: SignalRows."""

    time: NDArray[np.float64]
    """[s]."""
    linear_speed: NDArray[np.float64]
    """[m/s]."""
    angular_speed: NDArray[np.float64]
    """[rad/s]."""
    particle_speed: NDArray[np.float64]
    """[m/s]."""
    force_residual: NDArray[np.float64]
    """[-]."""
    torque_residual: NDArray[np.float64]
    """[-]."""
    newton: NDArray[np.int64]
    """Newton iterations of a step; mls: explicit steps."""
    linear: NDArray[np.int64]
    """Iterations of the linear solver."""
