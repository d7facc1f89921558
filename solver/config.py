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
    """Where the kernels run; decides the last digits of a result, so what `auto` stands for is settled before a
    configuration is made (runtime.available_arch)."""
    method: Literal["tl", "mls"] = "tl"
    """tl: implicit, total-Lagrangian, the default; mls: explicit MLS-MPM, as the paper's."""

    start_overlap: PositiveFloat = 5e-3
    """Bodies that start deeper inside each other than this [m] are refused: no rest state can be reached from
    there honestly. Where a final state is simulated on, they are pushed apart."""
    step_seconds: PositiveFloat = 4e-3
    """First step [s]: a fall of 1 cm takes 45 ms, so about ten steps resolve it."""
    step_distance: PositiveFloat = 2e-3
    """Steps are short enough that no free body moves farther than this [m] in one, or than step_share."""
    step_share: PositiveFloat = 0.01
    """... of its size L [-]: larger bodies may move farther, contact is implicit."""
    longest_step: PositiveFloat = 0.3
    """Longest step on the way to rest over sqrt(L / 2g), the time in which a body of size L falling over leaves its
    balance by a factor e: backward Euler follows that growth up to 1, a third of it closely [-]."""
    hanging_step_seconds: PositiveFloat = 0.16
    """Longest step of clamped bodies alone [s]: nearly static solves, with no contact to skip."""
    shortest_step_seconds: PositiveFloat = 2.5e-4
    """A step that does not converge is halved down to this, then UnstableStep."""

    newton_limit: PositiveInt = 12
    """Newton iterations in a step before it counts as not converged."""
    newton_tolerance: PositiveFloat = 1e-3
    """Residual of a body over its weight, or what it carries, at which a step at rest is solved: a fifth of what the
    certificate allows."""
    moving_tolerance: PositiveFloat = 1e-2
    """The same while a free body is faster than moving_speed."""
    moving_speed: PositiveFloat = 0.02
    """Speed over sqrt(g L) above which the looser tolerance is enough [-]."""
    acceptable_residual: PositiveFloat = 0.1
    """A step that ends above this after newton_limit iterations is taken back and halved."""
    impact_share: NonNegativeFloat = 0.05
    """... plus this share of the force that would stop the fastest body within the step: in an impact forces are
    many weights, and the bound then keeps errors of its speed below acceptable_residual times this [-]."""
    linear_tolerance: PositiveFloat = 1e-1
    """Reduction of the preconditioned residual per Newton step: inexact Newton, tighter pays only where it stalls
    (step.py then asks for a hundred times more)."""
    linear_limit: PositiveInt = 400
    """Iterations of the linear solver per Newton step."""
    tangent_refresh: NonNegativeFloat = 0.1
    """The elastic tangent is rebuilt when an entry of a particle's deformation gradient has changed by this [-], in all
    cells where one has by half of that."""
    longest_move: PositiveFloat = 0.01
    """Longest move of any point per Newton iteration [m]."""

    penetration_target: PositiveFloat = 5e-5
    """Load-weighted mean penetration [m] that the contact stiffness aims at: invisible in any picture."""
    inertia: bool = False
    """tl: true-mass elastodynamics: no material damping, the theta method, steps that resolve elastic waves. Bodies
    ring and rebound; hardly anything but friction brings them to rest."""
    inertia_theta: Annotated[float, Field(ge=0.5, le=1.0)] = 0.52
    """Where in a step forces are taken [-]: 1/2 (midpoint) keeps energy and angular momentum, 1 is backward Euler;
    above 1/2 energy never grows, and frequencies that the step does not resolve die out."""
    inertia_step: PositiveFloat = 0.1
    """Longest step with inertia over the time that a wave of speed sqrt(E / rho) takes through the thinnest soft body:
    the first period of a bar held at one end has at least 40 of them [-]."""
    damping_ratio: NonNegativeFloat = 1.0
    """Damping of the predicted bounce of the object on soft supports, relative to critical."""

    step_limit: PositiveInt = 600
    """Steps before the verdict is no_equilibrium."""
    rest_steps: PositiveInt = 12
    """Consecutive quiet steps that count as rest (K)."""
    rest_speed: PositiveFloat = 5e-4
    """Largest speed at rest over sqrt(g L), L the object's size [-]."""
    rest_drift: PositiveFloat = 1e-4
    """Largest change of centre of mass and of the joint box over the rest window, over L [-]."""
    rest_residual: PositiveFloat = 5e-3
    """Unbalanced force on a free body over its weight, or over what it carries where that is more (torque: over that
    times half the size) [-]."""

    kick_speed: NonNegativeFloat = 1e-3
    """Verification kick [m/s]."""
    kick_angular_speed: NonNegativeFloat = 1e-2
    """Verification kick [rad/s]."""
    kick_seconds: PositiveFloat = 0.5
    """How long the kicked state is followed before it is judged [s]."""
    kick_segments: PositiveInt = 4
    """How often that time is added while the motion is small but neither dies nor leaves."""
    kick_decay: PositiveFloat = 0.5
    """Share of the kick's speeds that may be left after that time [-]; an unstable balance gains speed."""
    kick_distance: PositiveFloat = 5e-3
    """How far the kicked state may end from the rest state, over L [-]."""
    kick_angle: PositiveFloat = 0.0174533
    """How far it may turn [rad]: one degree."""

    stability: bool = False
    """Push the verified rest state around and grade how far it can be nudged (stability.py); tl only."""
    push_directions: PositiveInt = 8
    """Horizontal directions, the first one along x."""
    push_step: PositiveFloat = 0.02
    """Difference of neighbouring pushes over the pushed body's weight: how finely the grade is known [-]."""
    push_most: PositiveFloat = 1.26
    """Largest push over the weight [-]: 63 steps, six trials by bisection."""
    push_time: PositiveFloat = 4.0
    """Time in which a push grows, and then stays, over sqrt(L / 2g), in which a balance is lost by a factor e [-]: what
    is 3 % above the tipping push has gone by then."""
    push_distance: PositiveFloat = 0.05
    """How far from the rest state it may come to rest after a push, over the pushed body's size [-]."""
    push_angle: PositiveFloat = 0.0872665
    """How far turned [rad]: five degrees."""

    mls_step_seconds: PositiveFloat = 5e-4
    """Explicit step of mls [s]. Inertia against strain is scaled up until waves are slow enough for it."""
    mls_cfl: PositiveFloat = 0.2
    """Share of a cell that waves and particles may cross in one explicit step of mls [-]."""
    mls_interval_seconds: PositiveFloat = 8e-3
    """mls judges its motion this often [s]: step_limit and rest_steps count these intervals."""
