"""Measurements after every implicit step, and the table of rolling resistance at the end."""

import numpy as np
from numpy.typing import NDArray

from solver.box import bounds
from solver.certificate import RollingRow
from solver.contact.active import Contacts
from solver.contact.query import ContactQuery
from solver.kernels.query import largest_particle_speed
from solver.model.bodies import Model, free_motions
from solver.model.soft import SoftSystem
from solver.model.state import State
from solver.rest import Signals
from solver.tl.step import StepReport, carried_weights


def measure(
    model: Model,
    soft: SoftSystem,
    query: ContactQuery,
    watched: list[int],
    mass: dict[int, float],
    weights: NDArray[np.float64],
    state: State,
    report: StepReport,
) -> Signals:
    """All signals of one accepted step; `watched` are the free bodies, or the soft ones where nothing is free."""
    gravity = model.gravity
    soft_of = query.soft_of
    linear = angular = force_worst = torque_worst = 0.0
    scale = carried_weights(weights, report.contacts)
    centers, surfaces = [], []
    for i in watched:
        if i in soft_of:
            nodes = soft_of[i].nodes
            m = soft.mass[nodes]
            center, velocity = m @ state.x[nodes] / m.sum(), m @ state.v[nodes] / m.sum()
        else:
            center, velocity = state.center[i], state.velocity[i]
            angular = max(angular, float(np.linalg.norm(state.angular_velocity[i])))
        linear = max(linear, float(np.linalg.norm(velocity)))
        centers.append(mass[i] * center)
        surfaces.append(query.surface(state, i))
        if model.bodies[i].fixed:
            continue
        force, torque = total_wrench(report.contacts, i, center)
        movable = free_motions(model.bodies[i])  # what is held is in balance with what holds it
        force, torque = (force + mass[i] * gravity) * movable[:3], torque * movable[3:]
        force_worst = max(force_worst, float(np.linalg.norm(force)) / scale[i])
        torque_worst = max(torque_worst, float(np.linalg.norm(torque)) / (scale[i] * 0.5 * model.bodies[i].size))
    points = np.concatenate(surfaces) if surfaces else np.zeros((1, 3))
    return Signals(
        state.time,
        linear,
        angular,
        particle_speed(soft, state),
        np.sum(centers, axis=0) / sum(mass.values()) if centers else np.zeros(3),
        np.concatenate(bounds(points)),
        force_worst,
        torque_worst,
        report.newton,
        report.linear,
    )


def particle_speed(soft: SoftSystem, state: State) -> float:
    """Largest speed of a particle of material [m/s], 0 without soft bodies."""
    if not len(soft.cell_node):
        return 0.0
    real = soft.real.astype(np.int32)
    return float(largest_particle_speed(soft.cell_node, soft.cell_start, soft.local, real, state.v))


def total_wrench(
    contacts: Contacts, index: int, center: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Sum of the contact forces [N] and torques about `center` [N m] on a body."""
    force, torque = np.zeros(3), np.zeros(3)
    for which, sign in ((contacts.a, 1.0), (contacts.b, -1.0)):
        points = which == index
        f = sign * contacts.force[points]
        force += f.sum(axis=0)
        torque += np.cross(contacts.position[points] - center, f).sum(axis=0)
    for r in contacts.rolling:
        torque += r.torque if r.a == index else (-r.torque if r.b == index else 0.0)
    return force, torque


def rolling_table(model: Model, contacts: Contacts) -> tuple[RollingRow, ...]:
    """One row per pair of bodies with rolling resistance."""
    rows = []
    for r in contacts.rolling:
        a, b = model.bodies[r.a], model.bodies[r.b]
        rows.append(RollingRow(a.name, b.name, float(np.linalg.norm(r.torque)), r.length))
    return tuple(rows)
