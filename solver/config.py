"""Settings of the solver with units and reasons."""

from typing import Annotated, Literal

from pydantic import BaseModel, Field, NonNegativeFloat, PositiveFloat, PositiveInt


class SolverConfig(BaseModel, frozen=True, extra="forbid"):
    """Everything that may change a result; budgets count steps, never seconds."""

    threads: int = 0
    """Worker threads, 0: all cores. Results do not depend on it."""
    seed: int = 0
    """Seed of the verification kick."""
    arch: Literal["cpu", "cuda"] = "cpu"
    """Device of the kernels; decides the last digits of a result. runtime.available_arch resolves `auto`."""
    method: Literal["tl", "mls"] = "tl"
    """tl: implicit, total-Lagrangian; mls: explicit MLS-MPM, as the paper's."""

    start_overlap: PositiveFloat = 5e-3
    """Bodies that overlap more than this at the start [m] are refused; for a measured drift they are pushed apart."""
    step_seconds: PositiveFloat = 4e-3
    """First step [s]; a fall of 1 cm takes 45 ms."""
    step_distance: PositiveFloat = 2e-3
    """No free body moves farther than this in a step [m], or than step_share."""
    step_share: PositiveFloat = 0.01
    """... of its size L [-], if that is more."""
    longest_step: PositiveFloat = 0.3
    """Longest step on the way to rest over sqrt(L / 2g), the time constant of a body that topples [-]."""
    hanging_step_seconds: PositiveFloat = 0.16
    """Longest step if only clamped bodies deform [s]."""
    shortest_step_seconds: PositiveFloat = 2.5e-4
    """A step that does not converge is halved down to this [s], then UnstableStep."""

    newton_limit: PositiveInt = 12
    """Newton iterations before a step counts as not converged."""
    newton_tolerance: PositiveFloat = 1e-3
    """Residual of a body over its weight or load at which a step near rest is solved [-]."""
    moving_tolerance: PositiveFloat = 1e-2
    """The same while a free body is faster than moving_speed [-]."""
    moving_speed: PositiveFloat = 0.02
    """Speed over sqrt(g L) above which moving_tolerance holds [-]."""
    acceptable_residual: PositiveFloat = 0.1
    """A step that ends above this after newton_limit iterations is taken back and halved [-]."""
    impact_share: NonNegativeFloat = 0.05
    """... plus this share of the force that would stop the fastest body within the step, for impacts [-]."""
    linear_tolerance: PositiveFloat = 1e-1
    """Reduction of the preconditioned residual per Newton step [-]; a hundred times smaller where Newton stalls."""
    linear_limit: PositiveInt = 400
    """Iterations of the linear solver per Newton step."""
    tangent_refresh: NonNegativeFloat = 0.1
    """Change of an entry of the deformation gradient that rebuilds the elastic tangent [-]."""
    longest_move: PositiveFloat = 0.01
    """Longest move of any point per Newton iteration [m]."""

    penetration_target: PositiveFloat = 5e-5
    """Load-weighted mean penetration that the contact stiffness aims at [m]."""
    inertia: bool = False
    """Follow elastic waves with true masses and without material damping (tl); bodies ring and seldom come to rest."""
    inertia_theta: Annotated[float, Field(ge=0.5, le=1.0)] = 0.52
    """Point in a step at which forces are taken [-]: 1/2 conserves energy and angular momentum, 1 is backward Euler."""
    inertia_step: PositiveFloat = 0.1
    """Longest step with inertia over the time that a wave takes through the thinnest soft body [-]."""
    damping_ratio: NonNegativeFloat = 1.0
    """Damping of the object's predicted bounce, relative to critical [-]."""

    step_limit: PositiveInt = 600
    """Steps before the verdict is no_equilibrium."""
    rest_steps: PositiveInt = 12
    """Consecutive quiet steps that count as rest (K)."""
    rest_speed: PositiveFloat = 5e-4
    """Largest speed at rest over sqrt(g L), L the object's size [-]."""
    rest_drift: PositiveFloat = 1e-4
    """Largest change of centre of mass and of the joint box over these steps, over L [-]."""
    rest_residual: PositiveFloat = 5e-3
    """Unbalanced force on a free body over its weight or load [-] (torque: over that times half its size)."""

    kick_speed: NonNegativeFloat = 1e-3
    """Linear speed of the kick [m/s]."""
    kick_angular_speed: NonNegativeFloat = 1e-2
    """Angular speed of the kick [rad/s]."""
    kick_seconds: PositiveFloat = 0.5
    """Time for which the kicked state is followed [s]."""
    kick_segments: PositiveInt = 4
    """Most extensions by that time, while the motion is small but neither dies nor leaves."""
    kick_decay: PositiveFloat = 0.5
    """Share of the kick's speeds that may remain [-]."""
    kick_distance: PositiveFloat = 5e-3
    """Largest distance from the rest state after the kick, over L [-]."""
    kick_angle: PositiveFloat = 0.0174533
    """Largest turn from the rest state after the kick [rad]."""

    stability: bool = False
    """Push the verified rest state and report the largest push that it survives; tl only."""
    push_directions: PositiveInt = 8
    """Horizontal directions of pushes, the first along x."""
    push_step: PositiveFloat = 0.02
    """Resolution of the push over the weight [-]."""
    push_most: PositiveFloat = 1.26
    """Largest push over the weight [-]."""
    push_time: PositiveFloat = 4.0
    """Time in which a push grows, and then stays, over sqrt(L / 2g) [-]."""
    push_distance: PositiveFloat = 0.05
    """Largest distance from the rest state after a survived push, over the body's size [-]."""
    push_angle: PositiveFloat = 0.0872665
    """Largest turn after a survived push [rad]."""

    mls_step_seconds: PositiveFloat = 5e-4
    """Explicit step of mls [s]; inertia against strain is scaled up until waves are slow enough."""
    mls_cfl: PositiveFloat = 0.2
    """Share of a cell that waves and particles may cross in a step of mls [-]."""
    mls_interval_seconds: PositiveFloat = 8e-3
    """Interval at which mls judges its motion [s]; step_limit and rest_steps count these."""
