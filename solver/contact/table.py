"""Report of the contacts of a state: a row per pair of bodies, and every force."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from solver.certificate import ContactRow, PointForces
from solver.contact.active import Contacts, TouchingPoints
from solver.model.bodies import Body, Model

LOADED_SHARE = 0.01  # gap and penetration are judged over points that carry more than this share of the peak pressure


def contact_table(
    model: Model, touching: Sequence[TouchingPoints], surface: Callable[[int], NDArray[np.float64]]
) -> tuple[ContactRow, ...]:
    """One row per touching pair of bodies, both point sets together; forces on the first named body. `surface` gives
    the deformed surface points of a body [m], shape (n, 3)."""
    rows = []
    keys = sorted({(min(t.pair.a, t.pair.b), max(t.pair.a, t.pair.b)) for t in touching})
    for a, b in keys:
        sides = [t for t in touching if {t.pair.a, t.pair.b} == {a, b}]
        total = sum((s.force.sum(axis=0) * (1.0 if s.pair.a == a else -1.0) for s in sides), np.zeros(3))
        normal = sum((_normal_sum(s) * (1.0 if s.pair.a == a else -1.0) for s in sides), np.zeros(3))
        most = [s.normal_force.max() for s in sides]
        loaded = [s.normal_force >= min(LOADED_SHARE * n, n) for s, n in zip(sides, most, strict=True)]
        rows.append(
            ContactRow(
                a=model.bodies[a].name,
                b=model.bodies[b].name,
                area_m2=max(facing_area(model.bodies[s.pair.a], surface(s.pair.a), s.point, s.normal) for s in sides),
                normal_force_n=float(np.linalg.norm(normal)),
                tangential_force_n=float(np.linalg.norm(total - normal)),
                max_penetration_m=float(max(-s.gap[m].min() for s, m in zip(sides, loaded, strict=True))),
                max_gap_m=float(max(0.0, *(s.gap[m].max() for s, m in zip(sides, loaded, strict=True)))),
                points=int(sum(len(s.point) for s in sides)),
                sliding_points=int(sum(s.sliding.sum() for s in sides)),
            )
        )
    return tuple(rows)


def facing_area(
    body: Body, points: NDArray[np.float64], chosen: NDArray[np.int64], normal: NDArray[np.float64]
) -> float:
    """Area of a surface that some of its points (k,) stand for, seen along their normals (k, 3) [m^2]: a third of the
    adjacent faces' area vectors each. Points at an edge stand for the faces that look at the other body, not for
    adjacent ones."""
    corner = points[body.faces]
    vector = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]) / 6.0
    total = np.stack(
        [np.bincount(body.faces.ravel(), np.repeat(one, 3), minlength=len(points)) for one in vector.T], axis=1
    )
    return float(np.abs(np.einsum("ki,ki->k", total[chosen], normal)).sum())


def _normal_sum(side: TouchingPoints) -> NDArray[np.float64]:
    return np.asarray((side.normal_force[:, None] * side.normal).sum(axis=0))


def friction_margin(touching: Sequence[TouchingPoints]) -> float:
    """Smallest share of the static friction cone that is left over the touching pairs [-]; 0: at the cone."""
    margins = [1.0]
    for t in touching:
        normal = t.normal_force
        tangential = np.linalg.norm(t.force - normal[:, None] * t.normal, axis=1)
        limit = float(normal @ t.friction[:, 0])
        if limit > 0.0:
            margins.append(1.0 - float(tangential.sum()) / limit)
    return min(margins)


def point_forces(contacts: Contacts) -> PointForces:
    """The forces of contacts and bonds."""
    touching = sum(len(one.point) for one in contacts.active)  # bonds stand behind them
    bonded = np.arange(len(contacts.a)) >= touching
    return PointForces(contacts.a, contacts.b, contacts.position, contacts.force, bonded)
