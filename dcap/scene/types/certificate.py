"""What a placement's verdict rests on, as it is stored: every number with its threshold.

Names of fields are those of placement.json, so each carries its unit; a field that is None by default is left out
there.
"""

from dataclasses import dataclass, fields
from typing import Literal


@dataclass(frozen=True, slots=True)
class SettledRow:
    """A number with its threshold, both in one unit."""

    value: float
    threshold: float
    margin: float
    """[-]; negative where the number is on the wrong side."""

    @classmethod
    def at_most(cls, value: float, threshold: float) -> "SettledRow":
        """A number that may not be above its threshold."""
        return cls(value, threshold, 1.0 - value / threshold)

    @classmethod
    def at_least(cls, value: float, threshold: float) -> "SettledRow":
        """A number that may not be below its threshold."""
        return cls(value, threshold, value / threshold - 1.0)

    @property
    def holds(self) -> bool:
        """Whether the number is on the right side."""
        return self.margin >= 0.0


@dataclass(frozen=True, slots=True)
class SettledSignals:
    """The rest signals over the last window of steps."""

    linear_speed: SettledRow
    """Of a free body's centre of mass [m/s]."""
    angular_speed: SettledRow
    """Of a free rigid body [rad/s]."""
    particle_speed: SettledRow
    """Of a soft particle [m/s]."""
    center_drift: SettledRow
    """Of the common centre of mass along an axis [m]."""
    box_change: SettledRow
    """Of a side of the free bodies' joint box [m]."""
    force_residual: SettledRow
    """Unbalanced force over the weight, or over what is carried [-]."""
    torque_residual: SettledRow
    """Unbalanced torque over the same times half the size [-]."""

    @property
    def exceeded(self) -> dict[str, SettledRow]:
        """The signals above their thresholds, by name."""
        rows: dict[str, SettledRow] = {one.name: getattr(self, one.name) for one in fields(self)}
        return {name: row for name, row in rows.items() if not row.holds}


@dataclass(frozen=True, slots=True)
class SkippedCheck:
    """A check that was not made."""

    done: Literal[False] = False
    reason: str | None = None


@dataclass(frozen=True, slots=True)
class SettledKickRow:
    """One number that is judged after the kick; all in one unit."""

    value: float
    threshold: float
    largest: float | None = None
    """On the way there."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SettledKick:
    """What became of the rest state when it got a small kick."""

    done: Literal[True] = True
    stable: bool
    speed_m_s: float
    angular_speed_rad_s: float
    seconds: float
    """How long it was followed."""
    steps: int
    growing: bool
    """Whether speeds still grew at the end."""
    speed_left: SettledKickRow
    """Over the kick's [-]."""
    distance_m: SettledKickRow
    """Of a centre of mass from the rest state."""
    angle_rad: SettledKickRow


@dataclass(frozen=True, slots=True)
class SettledRolling:
    """Rolling resistance between two bodies."""

    a: str
    b: str
    torque_n_m: float
    limit_length_m: float
    """Lever of the normal force at which it gives way."""


@dataclass(frozen=True, slots=True)
class SettledPush:
    """Pushes of one body in one direction, as shares of its weight [-]."""

    direction: tuple[float, float, float]
    """Horizontal unit vector."""
    held: float
    """Largest after which everything came back to rest."""
    lost: float | None
    """Smallest after which it did not; None where the largest one tried was held."""
    trials: int
    lost_moved_m: float | None
    lost_turned_rad: float | None


@dataclass(frozen=True, slots=True)
class SettledBodyStability:
    """How far one body can be pushed."""

    grade: float
    """Smallest share of its weight that is held, over the directions [-]."""
    directions: tuple[SettledPush, ...]


@dataclass(frozen=True, slots=True)
class SettledPushBounds:
    """What counts as held."""

    distance_share: float
    """Over the pushed body's size [-]."""
    angle_rad: float
    step: float
    """Between neighbouring pushes, over the weight [-]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SettledStability:
    """How far the rest state can be pushed before it is lost."""

    done: Literal[True] = True
    grade: float
    """Smallest of all bodies [-]."""
    bodies: dict[str, SettledBodyStability]
    """By name."""
    trials: int
    steps: int
    bounds: SettledPushBounds


@dataclass(frozen=True, slots=True)
class PlacementChecks:
    """What was asked of the rest state."""

    carried_share: SettledRow
    """Share of the object's weight that the base carries [-]."""
    tilt_rad: SettledRow | None = None
    """Change of the object's tilt, where an orientation was asked."""
    turn_rad: SettledRow | None = None
    """Turn about the vertical, where a facing was asked."""


@dataclass(frozen=True, slots=True)
class SettledContact:
    """Two touching bodies, all their contact points together."""

    a: str
    b: str
    area_m2: float
    normal_force_n: float
    tangential_force_n: float
    max_penetration_m: float
    max_gap_m: float
    points: int
    sliding_points: int | None = None
    """tl only."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SettledCertificate:
    """Everything that the verdict rests on."""

    arch: str
    """Where the kernels ran: cpu or cuda."""
    method: str | None = None
    """mls; None for tl."""
    signals: SettledSignals
    kick: SettledKick | SkippedCheck
    free_weight_n: float
    length_m: float
    """Size of the object, by which signals are scaled."""
    newton_residual: float | None = None
    """Of the last step, over the weight [-]; tl only."""
    friction_cone_margin: float
    """Smallest share of the static friction cone that is left [-]."""
    inverted_particles: int
    unlocated_points: int | None = None
    """tl only."""
    material_damping_s: float | None = None
    """tl only."""
    rolling_resistance: tuple[SettledRolling, ...] | None = None
    """tl only."""
    stability: SettledStability | SkippedCheck | None = None
    """None where nobody asked."""
    cell_m: float | None = None
    """Of the uniform grid; mls only."""
    substeps: int | None = None
    """mls only."""
    interval_s: float | None = None
    """How often motion was judged; mls only."""
    placement: PlacementChecks | None = None
    """None before the rest state is compared with what was asked."""
