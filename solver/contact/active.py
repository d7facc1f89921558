"""Pairs of bodies that can touch, their active points, and the report of contacts.

`contact_pairs` selects the pairs and their initial contact stiffness. Active points carry forces and derivatives.
`contact_table` has a row per touching pair; `point_forces` has every force.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from solver.certificate import ContactRow, PointForces
from solver.config import SolverConfig
from solver.contact.flatness import FlatRegions, flat_regions
from solver.contact.friction import PairFriction, RollingTorque, Spin
from solver.model.bodies import Body, Model, RigidBody, SoftBody
from solver.model.soft import SoftSystem
from solver.model.state import ContactMemory, PointMemory

CELL_STIFFNESS = 4.0  # first guess of the contact stiffness per area, in E / cell size; adapted to the target near rest
STIFFENED = 1.25  # penetration over its target, above which a pair is stiffened [-]
SAFE_DEPTH = 0.125  # share of half the other body's largest thickness [-]; past that half, the far side is nearest
LOADED_SHARE = 0.01  # gap and penetration are judged at points with more than this share of the peak pressure


@dataclass(frozen=True, eq=False, slots=True)
class Pair:
    """Points of body `a` against the distance field of body `b`."""

    a: int
    b: int
    friction: PairFriction
    stiffness: NDArray[np.float64]
    """Initial normal stiffness per point [N/m], shape (n,)."""
    area: NDArray[np.float64]
    """Surface area represented by each point [m^2], shape (n,)."""
    safe_depth: float = np.inf
    """Mean penetration during motion above which points might come out on the far side of the other body [m]."""
    flat: FlatRegions | None = None
    """Flat regions of a rigid body facing a soft one: points whose region is covered by the other body's own points do
    not count."""

    @property
    def key(self) -> tuple[int, int]:
        """Key of the pair in ContactMemory.points."""
        return self.a, self.b

    def fresh_memory(self) -> PointMemory:
        """Memory before the first step."""
        count = len(self.area)
        nowhere = np.full((count, 3), np.nan)
        none = np.zeros(count, dtype=bool)
        return PointMemory(self.stiffness.copy(), np.zeros((count, 3)), none.copy(), nowhere, none.copy())


@dataclass(frozen=True, eq=False, slots=True)
class TouchingPoints:
    """The points of one pair that touch in one state, or over an interval with mean forces."""

    pair: Pair
    point: NDArray[np.int64]
    """Indices of the touching points of body a, shape (k,)."""
    position: NDArray[np.float64]
    """Positions [m], shape (k, 3)."""
    gap: NDArray[np.float64]
    """Gaps [m], negative: penetration, shape (k,)."""
    normal: NDArray[np.float64]
    """Normals out of b, shape (k, 3)."""
    force: NDArray[np.float64]
    """Forces on a [N], shape (k, 3)."""
    friction: NDArray[np.float64]
    """Static and dynamic friction coefficient [-] and rolling resistance length [m], shape (k, 3)."""
    sliding: NDArray[np.bool_]

    @property
    def normal_force(self) -> NDArray[np.float64]:
        """Normal part of the forces [N], shape (k,)."""
        return np.asarray(np.einsum("ki,ki->k", self.force, self.normal))


@dataclass(frozen=True, eq=False, slots=True)
class ActiveContacts(TouchingPoints):
    """The active points of one pair in one state, with the data for the implicit step."""

    tangent: NDArray[np.float64]
    """-d force / d relative displacement [N/m] at constant friction limits: symmetric, shape (k, 3, 3)."""
    anchor: NDArray[np.float64]
    """New anchors, shape (k, 3)."""
    node: NDArray[np.int64]
    """Nodes that move the point, and nodes that move the place of b that it pushes (negative `weight`), shape (k,
    16)."""
    weight: NDArray[np.float64]
    """Signed shape values, zero for rigid sides, shape (k, 16)."""


@dataclass(frozen=True, eq=False, slots=True)
class PairPoints:
    """Points of body `a` that body `b` pushes or holds, touching or bonded, as they enter the linear maps."""

    a: int
    b: int
    position: NDArray[np.float64]
    """Positions [m], shape (k, 3)."""
    force: NDArray[np.float64]
    """Forces on a [N], shape (k, 3)."""
    tangent: NDArray[np.float64]
    """As in ActiveContacts, shape (k, 3, 3)."""
    node: NDArray[np.int64]
    """Nodes that move the points, and nodes that move the places of b that they push (negative `weight`), shape (k,
    16)."""
    weight: NDArray[np.float64]
    """Signed shape values, zero for rigid sides, shape (k, 16)."""

    @classmethod
    def of(cls, t: ActiveContacts) -> "PairPoints":
        """The points of a touching pair."""
        return cls(t.pair.a, t.pair.b, t.position, t.force, t.tangent, t.node, t.weight)


@dataclass(frozen=True, eq=False, slots=True)
class Contacts:
    """All active points of all pairs, and the bonded points, as linear maps."""

    active: tuple[ActiveContacts, ...]
    gather: sparse.csr_matrix
    """Relative displacement per point from node displacements, shape (k, n)."""
    force: NDArray[np.float64]
    tangent: NDArray[np.float64]
    position: NDArray[np.float64]
    a: NDArray[np.int64]
    b: NDArray[np.int64]
    rolling: tuple[RollingTorque, ...]
    spins: Mapping[int, Spin]
    """Spins of the free soft bodies in contact, by model index."""
    unlocated: int
    """Points that lie in the cells of a soft body but could not be located in its start pose; they have no contact."""
    memory: ContactMemory
    """Contact memory after a step that ends here: the anchors of touching points; other points lose their anchors."""

    def carried_load(self, bodies: int) -> NDArray[np.float64]:
        """Load that each body transmits from one side to another [N], shape (bodies,): half of the difference between
        the sum of the magnitudes of its contact forces and the magnitude of their sum; 0 for a body that only stands or
        impacts."""
        size, total = np.zeros(bodies), np.zeros((bodies, 3))
        for which, sign in ((self.a, 1.0), (self.b, -1.0)):
            size += np.bincount(which, np.linalg.norm(self.force, axis=1), bodies)
            for axis in range(3):
                total[:, axis] += sign * np.bincount(which, self.force[:, axis], bodies)
        return np.asarray(0.5 * (size - np.linalg.norm(total, axis=1)), dtype=np.float64)


def vertex_areas(body: Body) -> NDArray[np.float64]:
    """A third of the adjacent triangle areas for each vertex [m^2], shape (n,)."""
    corner = body.vertices[body.faces]
    area = 0.5 * np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1)
    weights = np.repeat(area / 3.0, 3)
    return np.bincount(body.faces.ravel(), weights=weights, minlength=len(body.vertices)).astype(np.float64)


def contact_pairs(model: Model, soft: SoftSystem, config: SolverConfig, gravity: float) -> list[Pair]:
    """All ordered pairs of bodies that can push each other, with the initial contact stiffness per point."""
    pairs = []
    for a, one in enumerate(model.bodies):
        for b, two in enumerate(model.bodies):
            if a == b or (one.fixed and two.fixed) or model.bonded(one, two):
                continue
            area = vertex_areas(one)
            stiffness = np.full(len(area), most_stiffness(one, two, config, gravity))
            safe_depth, flat = np.inf, None
            if isinstance(one, SoftBody) or isinstance(two, SoftBody):
                cell, modulus = softest(one, two)
                stiffness = np.minimum(stiffness, CELL_STIFFNESS * modulus / cell * np.minimum(area, cell**2))
                safe_depth = -SAFE_DEPTH * float(two.distance.values.min())
                if isinstance(one, RigidBody):
                    flat = flat_regions(one, two, cell)
            pairs.append(Pair(a, b, PairFriction.of(model, one, two), stiffness, area, safe_depth, flat))
    return pairs


def most_stiffness(one: Body, two: Body, config: SolverConfig, gravity: float) -> float:
    """Stiffness with which three points carry the load at the target penetration [N/m]: a larger one only makes impacts
    hard."""
    load = max(body.mass for body in (one, two) if not body.fixed) * max(gravity, 1.0)
    return load / (3.0 * config.penetration_target)


def softest(one: Body, two: Body) -> tuple[float, float]:
    """Cell under the contact [m] and smallest Young's modulus [Pa] of a pair with at least one soft body."""
    parts = [b.interior for b in (one, two) if isinstance(b, SoftBody)]
    cell = min(max(float(np.diff(p).min()) for p in s.planes) for s in parts)
    return cell, min(float(s.youngs_modulus.min()) for s in parts)


def contact_table(
    model: Model, touching: Sequence[TouchingPoints], surface: Callable[[int], NDArray[np.float64]]
) -> tuple[ContactRow, ...]:
    """One row per touching pair of bodies, with the points of both; forces act on the first named body. `surface`
    gives the deformed surface points of a body [m], shape (n, 3)."""
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
    """Area of the surface represented by some of its points (k,), seen along their normals (k, 3) [m^2]: a third of the
    area vectors of the faces adjacent to each point. At an edge only the faces towards the other body count."""
    corner = points[body.faces]
    vector = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]) / 6.0
    total = np.stack(
        [np.bincount(body.faces.ravel(), np.repeat(one, 3), minlength=len(points)) for one in vector.T], axis=1
    )
    return float(np.abs(np.einsum("ki,ki->k", total[chosen], normal)).sum())


def _normal_sum(side: TouchingPoints) -> NDArray[np.float64]:
    return np.asarray((side.normal_force[:, None] * side.normal).sum(axis=0))


def friction_margin(touching: Sequence[TouchingPoints]) -> float:
    """Smallest remaining share of the static friction cone over the touching pairs [-]; 0: at the cone."""
    margins = [1.0]
    for t in touching:
        normal = t.normal_force
        tangential = np.linalg.norm(t.force - normal[:, None] * t.normal, axis=1)
        limit = float(normal @ t.friction[:, 0])
        if limit > 0.0:
            margins.append(1.0 - float(tangential.sum()) / limit)
    return min(margins)


def point_forces(contacts: Contacts) -> PointForces:
    """All forces of contacts and bonds."""
    touching = sum(len(one.point) for one in contacts.active)  # bonds follow them
    bonded = np.arange(len(contacts.a)) >= touching
    return PointForces(contacts.a, contacts.b, contacts.position, contacts.force, bonded)
