"""Stage 8, drop: from bodies and a pre-drop pose to the state at rest, or to the reason why there is none.

In: particles (bodies as arrays), the anchor (the requested place) and the intent. Out: `Settled` with verdict
`at_rest`, its contacts and certificate, or `Infeasible` with the drop's reason code and the same certificate as
evidence.
"""

import logging
from collections.abc import Collection
from dataclasses import replace

import numpy as np
from pydantic import BaseModel, NonNegativeInt, PositiveFloat
from scipy.spatial.transform import Rotation

from dcap.arrays import Array
from dcap.geometry.distance import sampler
from dcap.scene.errors import GeometryError, InputError
from dcap.scene.types.choices import Anchor, Intent
from dcap.scene.types.outcome import Cause, Caution, Infeasible, Reason
from dcap.scene.types.particles import GRAVITY, Particles, SoftSimulationBody
from dcap.scene.types.settled import EndPose, LastState, LeanCheck, PlacementChecks, Settled, SettledBody
from solver.certificate import CertificateRow, Verdict
from solver.config import SolverConfig
from solver.errors import ArchError, ModelError, UnstableStep
from solver.model.bodies import Model
from solver.rest import Signals
from tasks.bodies.plan_contact import share_within, within_any
from tasks.bodies.proof import proven, refutation
from tasks.bodies.soft_cells import interval_at, thin_profile
from tasks.bodies.solver_model import solver_model
from tasks.cache import stage
from tasks.drop.settled import angle_from_vertical, pose_checks, pose_warnings, settled_of

LOG = logging.getLogger(__name__)

PART = "part:"
FOOT = 0.25  # share of a leaning object's height above which contacts are with the thing that it leans on [-]
REPORTED = 10  # steps between two lines of progress
LEAST_PARTICLES = 3.0  # through a layer or a soft object; the paper requires three to five
PER_CELL = 2.0  # particles through a cell


class DropConfig(BaseModel, frozen=True, extra="forbid"):
    """Settings for simulating and judging the drop."""

    solver: SolverConfig = SolverConfig()
    threads: NonNegativeInt = 0
    """Worker threads, 0: all cores; never changes a result."""
    topple_angle: PositiveFloat = 0.7854
    """Change of the object's tilt that counts as toppling, if an orientation was requested [rad]."""
    turn_angle: PositiveFloat = 0.7854
    """Turn about the vertical that misses a requested facing [rad]."""
    lean_angle: PositiveFloat = 0.2618
    """Change of a leaning object's tilt that counts as sliding down or falling back [rad]."""
    held_share: PositiveFloat = 0.005
    """Least share of the force on a leaning object that comes from the thing it leans on [-]."""
    foreseen_share: PositiveFloat = 0.5
    """Least share of the contact inside the predicted patch; below it the drop is repeated with fine cells there
    [-]."""
    object_share: PositiveFloat = 0.5
    """Least share of the object's weight that the base carries [-]."""


def drop(particles: Particles, anchor: Anchor, intent: Intent, seed: int, config: DropConfig) -> Settled | Infeasible:
    """Settle the object and compare the outcome with the request."""
    from solver.settle import settle  # loads Taichi, which costs seconds

    model = solver_model(particles, (0.0, 0.0, -GRAVITY))
    solver, told = able(model, config.solver.model_copy(update={"threads": config.threads, "seed": seed}))
    if solver.method == "mls":
        refuse_coarse_layers(particles)
    try:
        result = proven(model, settle(model, solver, _progress))
    except ArchError as error:  # a run from a machine with a graphics card, repeated on a machine without
        raise InputError(f"arch {error}") from error
    except UnstableStep as error:
        return Infeasible(Reason.UNSTABLE_STEP, str(error), None)
    except ModelError as error:  # bodies that the solver cannot simulate, such as parts thinner than its cells
        raise GeometryError(str(error)) from error
    settled = settled_of(particles, result)
    settled = with_checks(replace(settled, warnings=settled.warnings + told), particles, anchor, intent, config)
    moving = settled.verdict is Verdict.NO_EQUILIBRIUM
    if not moving and (toppled := toppling(settled, intent)) is not None:
        return toppled  # also if it then left the simulated region: falling over came first
    if settled.verdict is not Verdict.AT_REST:
        return Infeasible(Reason(settled.verdict), _story(settled, particles), last_state(settled))
    return judge(settled, anchor)


def able(model: Model, config: SolverConfig) -> tuple[SolverConfig, tuple[str, ...]]:
    """The configuration, switched to tl if mls has no material to simulate, and a note on the switch."""
    if config.method != "mls" or model.soft_bodies:
        return config, ()
    instead = Caution(Cause.NOT_MET, "solver mls: everything is rigid, so method tl was used")
    return config.model_copy(update={"method": "tl"}), (instead,)


def _progress(step: int, seconds: float, signals: Signals) -> None:
    if step % REPORTED == 0:
        LOG.info("step %d, %.2f s, %.2g m/s", step, seconds, signals.speed)


def with_checks(settled: Settled, particles: Particles, anchor: Anchor, intent: Intent, config: DropConfig) -> Settled:
    """Add the requirements on the rest state to its certificate."""
    turned, orientation = settled.bodies[0].quaternion, intent.orientation
    share = CertificateRow.at_least(carried_share(settled, particles, anchor.base_id), config.object_share)
    tilt = turn = None
    if orientation.facing or orientation.pose != "any":
        # a turn about the vertical, or of a lying object about its own axis, does not count as tilting
        up = anchor.world_from_object[:3, 2] / np.linalg.norm(anchor.world_from_object[:3, 2])
        after = Rotation.from_quat(turned, scalar_first=True).apply(up)
        tilt = CertificateRow.at_most(abs(angle_from_vertical(after) - angle_from_vertical(up)), config.topple_angle)
    if orientation.facing:
        turn = CertificateRow.at_most(turn_of(turned), config.turn_angle)
    lean = lean_of(settled, particles, anchor, config)
    foreseen = None
    points = points_on(settled, particles, anchor.base_id)
    if particles.foreseen is not None and len(points) and anchor.lean is None:
        foreseen = CertificateRow.at_least(share_within(points, particles.foreseen), config.foreseen_share)
    bounds = config.topple_angle, config.turn_angle
    poses = pose_checks(anchor.pose, orientation, anchor.world_from_object, turned, turn_of(turned), bounds)
    checks = PlacementChecks(
        share,
        tilt,
        turn,
        lean,
        particles.column or None,
        foreseen,
        poses,
        indentation(settled, particles, anchor.base_id),
    )
    told: list[str] = []
    if lean is not None and not lean.held_share.holds:
        told.append(Caution(Cause.NOT_MET, f"it rests without leaning on {lean.on}"))
    if foreseen is not None and not foreseen.holds and len(settled.contact_points):
        told.append(
            f"only {foreseen.value:.0%} of the contact lies inside the predicted patch; outside it the grid is coarser "
            "and the dent less accurate"
        )
    return replace(settled, checks=checks, warnings=(*settled.warnings, *told, *pose_warnings(poses)))


def indentation(settled: Settled, particles: Particles, base_id: str) -> float:
    """Largest downward displacement of the surfaces of the base's bodies [m]."""
    mine = (end for end, start in zip(settled.bodies, particles.bodies, strict=True) if start.instance == base_id)
    return max((float(-end.displacement[:, 2].min(initial=0.0)) for end in mine), default=0.0)


def points_on(settled: Settled, particles: Particles, soft: str) -> Array:
    """Points (k, 3) at which the object lies on a soft body [m]; empty if it lies on something else.

    For an object that bounces and touches nothing at the moment: its point that was nearest to the others before the
    drop.
    """
    nothing = np.zeros((0, 3))
    if len(settled.contact_points):
        return settled.contact_points if force_share(settled, {soft}) > 0.5 else nothing
    if settled.verdict is not Verdict.NO_EQUILIBRIUM:
        return nothing
    vertices, others = settled.bodies[0].surface.vertices, particles.bodies[1:]
    gaps = np.stack([sampler(one.distance)(vertices) for one in others])
    other, vertex = np.unravel_index(gaps.argmin(), gaps.shape)
    return vertices[[vertex]] if others[other].name == soft else nothing


def force_share(settled: Settled, names: Collection[str]) -> float:
    """Normal force between the object and some bodies over the total normal force on the object [-]; 0 in the air."""
    own = settled.bodies[0].name
    rows = [row for row in settled.contacts if own in (row.a, row.b)]
    total = sum(row.normal_force_n for row in rows)
    theirs = sum(row.normal_force_n for row in rows if (row.b if row.a == own else row.a) in names)
    return theirs / total if total > 0.0 else 0.0


def unforeseen_end(outcome: Settled | Infeasible) -> EndPose | None:
    """Return the pose in which the object came to rest, or moved on endlessly, if its contact there is not resolved
    well enough; None if it is, or if the object lay on nothing soft."""
    own: SettledBody | LastState
    if isinstance(outcome, Settled):
        own, checks = outcome.bodies[0], outcome.checks
    elif outcome.reason is Reason.NO_EQUILIBRIUM and isinstance(outcome.evidence, LastState):
        own, checks = outcome.evidence, outcome.evidence.checks
    else:
        return None
    if checks is None or checks.foreseen_share is None or checks.foreseen_share.holds:
        return None
    x, y, z = own.position.tolist()
    a, b, c, d = own.quaternion.tolist()
    return EndPose((x, y, z), (a, b, c, d))


def lean_of(settled: Settled, particles: Particles, anchor: Anchor, config: DropConfig) -> LeanCheck | None:
    """Leaning at rest compared with the request; None without a request, or if the object stands by itself."""
    if anchor.lean is None or anchor.lean.angle == 0.0:
        return None
    after = Rotation.from_quat(settled.bodies[0].quaternion, scalar_first=True).apply(anchor.lean.axis)
    angle = angle_from_vertical(after)
    return LeanCheck(
        on=anchor.lean.on,
        asked_rad=anchor.lean.angle,
        rest_rad=angle,
        change_rad=CertificateRow.at_most(abs(angle - anchor.lean.angle), config.lean_angle),
        held_share=CertificateRow.at_least(held_share(settled, particles, anchor), config.held_share),
    )


def held_share(settled: Settled, particles: Particles, anchor: Anchor) -> float:
    """Normal force between the object and the thing that it leans on over the total normal force on it [-]; if that
    thing is a part of the base, which also carries the foot, the share of the contact points that are not at the
    foot."""
    assert anchor.lean is not None
    on = anchor.lean.on
    if on.startswith(PART):
        low, high = settled.bodies[0].surface.bounds[:, 2]
        points = settled.contact_points
        return float(np.mean(points[:, 2] > low + FOOT * (high - low))) if len(points) else 0.0
    return force_share(settled, {b.name for b in particles.bodies if b.instance == on})


def checks_of(settled: Settled) -> PlacementChecks:
    """Checks that `with_checks` added."""
    assert settled.checks is not None
    return settled.checks


def judge(settled: Settled, anchor: Anchor) -> Settled | Infeasible:
    """Refuse a rest state in which the base does not carry the object."""
    carried = checks_of(settled).carried_share
    if not carried.holds:
        message = f"the object rests, but {anchor.base_id} carries only {carried.value:.0%} of its weight"
        return Infeasible(Reason.LEFT_TARGET, message, last_state(settled))
    return settled


def toppling(settled: Settled, intent: Intent) -> Infeasible | None:
    """Infeasible if the object has tilted away from a requested pose, or turned away from a requested facing; else
    None."""
    checks = checks_of(settled)
    asked = intent.orientation.facing if intent.orientation.pose == "any" else intent.orientation.pose
    lean = None if checks.lean is None else checks.lean.change_rad
    for check, what, wanted in (
        (checks.tilt_rad, "fell over", asked),
        (checks.turn_rad, "turned away", intent.orientation.facing),
        (lean, "slid down or fell back", f"leaning on {intent.orientation.lean}"),
    ):
        if check is not None and not check.holds:
            angle, bound = np.degrees([check.value, check.threshold])
            message = f"the object {what}: {angle:.0f} degrees from the requested one ({wanted}; bound {bound:.0f})"
            return Infeasible(Reason.TOPPLED, message, last_state(settled))
    return None


def carried_share(settled: Settled, particles: Particles, base_id: str) -> float:
    """Normal force between the object and the base's bodies over the total normal force on the object [-]."""
    return force_share(settled, {b.name for b in particles.bodies if b.instance == base_id})


def turn_of(quaternion_wxyz: Array) -> float:
    """Angle [rad] of the turn about the vertical contained in a rotation (its twist)."""
    w, _, _, z = quaternion_wxyz
    return float(2.0 * np.arctan2(abs(z), abs(w)))


def last_state(settled: Settled) -> LastState:
    """Parts of the last state that an infeasible outcome keeps."""
    own = settled.bodies[0]
    assert settled.certificate is not None  # it was dropped
    return LastState(
        certificate=settled.certificate,
        contacts=settled.contacts,
        position=own.position,
        quaternion=own.quaternion,
        steps=settled.steps,
        simulated_s=settled.simulated_seconds,
        warnings=settled.warnings,
        checks=checks_of(settled),
    )


def _story(settled: Settled, particles: Particles) -> str:
    """One sentence about a drop that did not come to rest."""
    if settled.verdict is Verdict.LEFT_TARGET:
        touching = {name for row in settled.contacts for name in (row.a, row.b)}
        loose = [body.name for body in particles.bodies if not body.fixed and body.name not in touching]
        own = particles.bodies[0].name in loose or not loose
        left = "the object" if own else f"{' and '.join(loose)}, placed before,"
        return f"{left} left its support after {settled.simulated_seconds:.2f} s"
    assert settled.certificate is not None  # it was dropped
    rows = settled.certificate.signals.exceeded.items()
    moves = ", ".join(f"{name} {row.value:.2g} > {row.threshold:.2g}" for name, row in rows)
    proof = settled.certificate.proof
    why = moves or (refutation(proof) if proof else "") or "the kick moved it"
    return f"no equilibrium after {settled.steps} steps ({settled.simulated_seconds:.2f} s): {why}"


drop_task = stage(drop, process=True, simulates=True)


def refuse_coarse_layers(particles: Particles) -> None:
    """Raise GeometryError, with the remedy, if a soft object or a layer under the contact has too few particles through
    it."""
    for body in particles.bodies:
        if not isinstance(body, SoftSimulationBody):
            continue
        if body.instance == "object":
            profile = thin_profile(body.distance, 2, body.surface.bounds)
            through = PER_CELL * profile.thickness / interval_at(body.grid.z, profile.place)
            thinnest = int(through.argmin())
            refuse_few(float(through[thinnest]), "the object", float(profile.thickness[thinnest]), "object_cells")
        elif particles.foreseen is not None:
            points = body.surface.vertices
            below = points[within_any(points, particles.foreseen)]
            for layer in particles.column if len(below) else ():
                ends = below[:, 2].max() - np.array([layer.to_m, layer.from_m])
                cells = float(np.diff(np.interp(ends, body.grid.z, np.arange(len(body.grid.z))))[0])
                if layer.to_m > layer.from_m:
                    where = f"{layer.part} under the contact"
                    refuse_few(PER_CELL * cells, where, layer.to_m - layer.from_m, "base_cells")


def refuse_few(through: float, where: str, thickness: float, setting: str) -> None:
    """Raise GeometryError if there are too few particles through a thickness [m]."""
    if through < LEAST_PARTICLES:
        raise GeometryError(
            f"solver mls: {through:.1f} particles through {where} ({1e3 * thickness:.3g} mm thick), and explicit steps "
            f"need {LEAST_PARTICLES:.0f}: use --solver tl, or give --resolution "
            f"{PER_CELL * thickness / LEAST_PARTICLES:.2g} or finer and raise ParticlesConfig.{setting}, the budget of "
            f"cells, {(LEAST_PARTICLES / through) ** 3:.2g} times"
        )
