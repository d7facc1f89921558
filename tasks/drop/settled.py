"""The solver's result in the words of the pipeline."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from dcap.scene.types.certificate import (
    SettledBodyStability,
    SettledCertificate,
    SettledContact,
    SettledKick,
    SettledKickRow,
    SettledPush,
    SettledPushBounds,
    SettledRolling,
    SettledRow,
    SettledSignals,
    SettledStability,
    SkippedCheck,
)
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.particles import Particles, SimulationBody
from dcap.scene.types.settled import Settled, SettledBody, SettledHistory, SettledVerdict
from solver.certificate import (
    Certificate,
    CertificateRow,
    ContactRow,
    KickCheck,
    KickRow,
    NotDone,
    PushRow,
    SignalRows,
    StabilityGrade,
)
from solver.rest import History
from solver.result import RestBody, SettledModel

Array = NDArray[np.float64]


def settled_of(particles: Particles, result: SettledModel) -> Settled:
    """The solver's result as the pipeline stores it, not yet compared with what was asked."""
    bodies = [_body(body, rest) for body, rest in zip(particles.bodies, result.bodies, strict=True)]
    return Settled(
        verdict=SettledVerdict(result.verdict.value),
        bodies=tuple(bodies),
        contacts=tuple(contact_of(row) for row in result.contacts),
        contact_points=result.contact_points[particles.bodies[0].name],
        certificate=certificate_of(result.certificate),
        history=history_of(result.history),
        steps=result.steps,
        simulated_seconds=result.simulated_seconds,
        warnings=result.warnings + particles.notes,
    )


def quaternion(rotation: Array) -> Array:
    """(w, x, y, z) of a rotation matrix, w >= 0."""
    return np.asarray(Rotation.from_matrix(rotation).as_quat(canonical=True, scalar_first=True))


def _body(body: SimulationBody, rest: RestBody) -> SettledBody:
    surface = Mesh(rest.vertices, body.surface.faces, body.surface.colors)
    moved = rest.vertices - body.surface.vertices
    return SettledBody(body.name, surface, rest.translation, quaternion(rest.rotation), moved)


def contact_of(row: ContactRow) -> SettledContact:
    """Two touching bodies."""
    return SettledContact(
        a=row.a,
        b=row.b,
        area_m2=row.area_m2,
        normal_force_n=row.normal_force_n,
        tangential_force_n=row.tangential_force_n,
        max_penetration_m=row.max_penetration_m,
        max_gap_m=row.max_gap_m,
        points=row.points,
        sliding_points=row.sliding_points,
    )


def certificate_of(one: Certificate) -> SettledCertificate:
    """The certificate without bonds: the bodies of a placement have none."""
    rolling = one.rolling_resistance
    return SettledCertificate(
        arch=one.arch,
        method=one.method,
        signals=_signals(one.signals),
        kick=_kick(one.kick),
        free_weight_n=one.free_weight_n,
        length_m=one.length_m,
        newton_residual=one.newton_residual,
        friction_cone_margin=one.friction_cone_margin,
        inverted_particles=one.inverted_particles,
        unlocated_points=one.unlocated_points,
        material_damping_s=one.material_damping_s,
        rolling_resistance=None
        if rolling is None
        else tuple(SettledRolling(r.a, r.b, r.torque_n_m, r.limit_length_m) for r in rolling),
        stability=None if one.stability is None else _stability(one.stability),
        cell_m=one.cell_m,
        substeps=one.substeps,
        interval_s=one.interval_s,
    )


def _row(row: CertificateRow) -> SettledRow:
    return SettledRow(row.value, row.threshold, row.margin)


def _signals(rows: SignalRows) -> SettledSignals:
    return SettledSignals(
        linear_speed=_row(rows.linear_speed),
        angular_speed=_row(rows.angular_speed),
        particle_speed=_row(rows.particle_speed),
        center_drift=_row(rows.center_drift),
        box_change=_row(rows.box_change),
        force_residual=_row(rows.force_residual),
        torque_residual=_row(rows.torque_residual),
    )


def _kick(kick: KickCheck | NotDone) -> SettledKick | SkippedCheck:
    if isinstance(kick, NotDone):
        return SkippedCheck(reason=kick.reason)
    return SettledKick(
        stable=kick.stable,
        speed_m_s=kick.speed_m_s,
        angular_speed_rad_s=kick.angular_speed_rad_s,
        seconds=kick.seconds,
        steps=kick.steps,
        growing=kick.growing,
        speed_left=_kick_row(kick.speed_left),
        distance_m=_kick_row(kick.distance_m),
        angle_rad=_kick_row(kick.angle_rad),
    )


def _kick_row(row: KickRow) -> SettledKickRow:
    return SettledKickRow(row.value, row.threshold, row.largest)


def _stability(found: StabilityGrade | NotDone) -> SettledStability | SkippedCheck:
    if isinstance(found, NotDone):
        return SkippedCheck(reason=found.reason)
    bodies = {
        name: SettledBodyStability(body.grade, tuple(_push(row) for row in body.directions))
        for name, body in found.bodies.items()
    }
    bounds = SettledPushBounds(found.bounds.distance_share, found.bounds.angle_rad, found.bounds.step)
    return SettledStability(grade=found.grade, bodies=bodies, trials=found.trials, steps=found.steps, bounds=bounds)


def _push(row: PushRow) -> SettledPush:
    return SettledPush(row.direction, row.held, row.lost, row.trials, row.lost_moved_m, row.lost_turned_rad)


def history_of(history: History) -> SettledHistory:
    """Signals over the run."""
    return SettledHistory(
        time=history.time,
        linear_speed=history.linear_speed,
        angular_speed=history.angular_speed,
        particle_speed=history.particle_speed,
        force_residual=history.force_residual,
        torque_residual=history.torque_residual,
        newton=history.newton,
        linear=history.linear,
    )
