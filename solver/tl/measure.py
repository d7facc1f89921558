"""What is measured after every implicit step, and the tables of contacts at the end."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from solver.box import bounds
from solver.certificate import ContactRow, RollingRow
from solver.contact.active import ActiveContacts, Contacts
from solver.contact.query import ContactQuery
from solver.kernels.query import largest_particle_speed
from solver.model.bodies import Body, Model, free_motions
from solver.model.soft import SoftSystem
from solver.model.state import State
from solver.rest import Signals
from solver.tl.step import StepReport, carried_weights

LOADED_SHARE = 0.01  # gap and penetration are judged over points that carry more than this share of the peak pressure


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


def contact_table(
    model: Model, contacts: Contacts, surface: Callable[[int], NDArray[np.float64]]
) -> tuple[ContactRow, ...]:
    """One row per touching pair of bodies, both point sets together; forces on the first named body. `surface` gives
    the deformed surface points of a body [m], shape (n, 3)."""
    rows = []
    keys = sorted({(min(t.pair.a, t.pair.b), max(t.pair.a, t.pair.b)) for t in contacts.active})
    for a, b in keys:
        sides = [t for t in contacts.active if {t.pair.a, t.pair.b} == {a, b}]
        total = sum((s.force.sum(axis=0) * (1.0 if s.pair.a == a else -1.0) for s in sides), np.zeros(3))
        normal = sum((_normal_sum(s) * (1.0 if s.pair.a == a else -1.0) for s in sides), np.zeros(3))
        loaded = [s.normal_force > LOADED_SHARE * s.normal_force.max() for s in sides]
        rows.append(
            ContactRow(
                a=model.bodies[a].name,
                b=model.bodies[b].name,
                area_m2=max(facing_area(model.bodies[s.pair.a], surface(s.pair.a), s) for s in sides),
                normal_force_n=float(np.linalg.norm(normal)),
                tangential_force_n=float(np.linalg.norm(total - normal)),
                max_penetration_m=float(max(-s.gap[m].min() for s, m in zip(sides, loaded, strict=True))),
                max_gap_m=float(max(0.0, *(s.gap[m].max() for s, m in zip(sides, loaded, strict=True)))),
                points=int(sum(len(s.point) for s in sides)),
                sliding_points=int(sum(s.sliding.sum() for s in sides)),
            )
        )
    return tuple(rows)


def facing_area(body: Body, points: NDArray[np.float64], side: ActiveContacts) -> float:
    """Area of a surface that its contact points stand for, seen along their normals [m^2]: a third of the adjacent
    faces' area vectors each. Points at an edge stand for the faces that look at the other body, not for those beside
    them."""
    corner = points[body.faces]
    vector = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]) / 6.0
    total = np.stack(
        [np.bincount(body.faces.ravel(), np.repeat(one, 3), minlength=len(points)) for one in vector.T], axis=1
    )
    return float(np.abs(np.einsum("ki,ki->k", total[side.point], side.normal)).sum())


def _normal_sum(side: ActiveContacts) -> NDArray[np.float64]:
    return np.asarray((side.normal_force[:, None] * side.normal).sum(axis=0))


def friction_margin(contacts: Contacts) -> float:
    """Smallest share of the static friction cone that is left over the touching pairs [-]; 0: at the cone."""
    margins = [1.0]
    for t in contacts.active:
        normal = t.normal_force
        tangential = np.linalg.norm(t.force - normal[:, None] * t.normal, axis=1)
        limit = float(normal @ t.friction[:, 0])
        if limit > 0.0:
            margins.append(1.0 - float(tangential.sum()) / limit)
    return min(margins)


def rolling_table(model: Model, contacts: Contacts) -> tuple[RollingRow, ...]:
    """One row per pair of bodies with rolling resistance."""
    rows = []
    for r in contacts.rolling:
        a, b = model.bodies[r.a], model.bodies[r.b]
        rows.append(RollingRow(a.name, b.name, float(np.linalg.norm(r.torque)), r.length))
    return tuple(rows)
