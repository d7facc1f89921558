"""Contact between the surface points of one body and the signed distance of another.

Normal force: a penalty spring per point; taken implicitly on both sides. Friction: a tangential spring whose anchor
is remembered from step to step, with a Coulomb return map (mu_s to break, mu_d while sliding) [W06, Ch. 5]. Rolling
and torsional resistance: the same with the relative rotation of a pair, limited by b * N.

[W06] Wriggers: Computational Contact Mechanics, 2nd ed., Springer 2006.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from solver.box import bounds, inside
from solver.contact.bonds import Bond
from solver.contact.rolling import Law, Rolling, Spin, resist
from solver.kernels import query
from solver.model.bodies import Body, Model
from solver.model.soft import SoftBody, SoftSystem
from solver.model.state import State, best_rigid_motion, turn_between

STICK_SPEED = 1e-4  # a point at its friction limit that moves slower than this [m/s] has stopped: mu_s holds again
# tangential over normal stiffness: Mindlin's ratio 2 (1 - nu) / (2 - nu) lies between 0.67 and 1; softer is safe
TANGENTIAL_SHARE = 0.5


@dataclass(eq=False, slots=True)
class Pair:
    """Points of body `a` against the field of body `b`, with what the points remember."""

    a: int
    b: int
    static_friction: float
    dynamic_friction: float
    stiffness: NDArray[np.float64]
    """Normal stiffness per point [N/m], shape (n,)."""
    area: NDArray[np.float64]
    """Surface area that a point stands for [m^2], shape (n,)."""
    anchor: NDArray[np.float64]
    """Elastic tangential displacement of each point [m], world axes, shape (n, 3)."""
    sliding: NDArray[np.bool_]
    """Points that slid at the end of the last step, shape (n,)."""
    guess: NDArray[np.float64]
    """Material point of a soft b at each point at the last query [m], NaN where there was none, shape (n, 3)."""


@dataclass(eq=False, slots=True)
class Touching:
    """The active points of one pair at one state."""

    pair: Pair
    point: NDArray[np.int64]
    """Indices of the active points of body a, shape (k,)."""
    position: NDArray[np.float64]
    """[m], shape (k, 3)."""
    gap: NDArray[np.float64]
    """[m], negative: penetration, shape (k,)."""
    normal: NDArray[np.float64]
    """Out of b, shape (k, 3)."""
    force: NDArray[np.float64]
    """On a [N], shape (k, 3)."""
    tangent: NDArray[np.float64]
    """-d force / d relative displacement [N/m] at constant friction limits: symmetric, shape (k, 3, 3)."""
    coupling: NDArray[np.float64]
    """What the limits, which follow the normal force, add to it for sliding points [N/m], shape (k, 3, 3)."""
    anchor: NDArray[np.float64]
    """New anchors, shape (k, 3)."""
    sliding: NDArray[np.bool_]
    node: NDArray[np.int64]
    """Nodes that move the point minus nodes that move the material point of b, shape (k, 16)."""
    weight: NDArray[np.float64]
    """Signed shape values, zero for rigid sides, shape (k, 16)."""

    @property
    def normal_force(self) -> NDArray[np.float64]:
        """Normal part [N], shape (k,)."""
        return np.asarray(np.einsum("ki,ki->k", self.force, self.normal))


@dataclass(eq=False, slots=True)
class Contacts:
    """All active points of all pairs, and the bonded points, as linear maps."""

    touching: list[Touching]
    gather: sparse.csr_matrix
    """Relative displacement per point from node displacements, shape (k, n)."""
    force: NDArray[np.float64]
    tangent: NDArray[np.float64]
    coupling: NDArray[np.float64]
    position: NDArray[np.float64]
    a: NDArray[np.int64]
    b: NDArray[np.int64]
    rolling: list[Rolling] = field(default_factory=list)
    spins: dict[int, Spin] = field(default_factory=dict)
    """Spins of the free soft bodies in contact, by model index."""
    unlocated: int = 0
    """Points that are in a soft body's cells while no place in its start pose was found for them; no contact there."""

    def burden(self, bodies: int) -> NDArray[np.float64]:
        """What each body carries from one side to another [N], shape (bodies,): half of what the sizes of its contact
        forces add up to beyond the size of their sum; nothing for a body that only stands or hits."""
        size, total = np.zeros(bodies), np.zeros((bodies, 3))
        for which, sign in ((self.a, 1.0), (self.b, -1.0)):
            size += np.bincount(which, np.linalg.norm(self.force, axis=1), bodies)
            for axis in range(3):
                total[:, axis] += sign * np.bincount(which, self.force[:, axis], bodies)
        return np.asarray(0.5 * (size - np.linalg.norm(total, axis=1)), dtype=np.float64)


def vertex_areas(body: Body) -> NDArray[np.float64]:
    """A third of the adjacent triangle areas per vertex [m^2], shape (n,)."""
    corner = body.vertices[body.faces]
    area = 0.5 * np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1)
    weights = np.repeat(area / 3.0, 3)
    return np.bincount(body.faces.ravel(), weights=weights, minlength=len(body.vertices)).astype(np.float64)


def _interpolation(body: SoftBody, nodes: int) -> sparse.csr_matrix:
    rows = np.arange(0, body.surface_node.size + 1, 8)
    return sparse.csr_matrix(
        (body.surface_weight.ravel(), body.surface_node.ravel(), rows), shape=(len(rows) - 1, nodes)
    )


class ContactQuery:
    """Finds the active contacts of a state; owns the pairs and their memory."""

    def __init__(self, model: Model, soft: SoftSystem, pairs: list[Pair], bonds: Sequence[Bond] = ()) -> None:
        self.model = model
        self.soft = soft
        self.pairs = pairs
        self.bonds = bonds
        self.soft_of: dict[int, SoftBody] = {s.index: s for s in soft.bodies}
        self.rolling_torque: dict[tuple[int, int], NDArray[np.float64]] = {}
        self.gentle = False
        """Rolling resistance as in a trial of stability (rolling.py)."""
        self.seconds = 1.0
        """Length of the step that is being solved [s]."""
        self.smooth = np.zeros((len(soft.rest), 9))
        self.interpolation = {s.index: _interpolation(s, len(soft.rest)) for s in soft.bodies}
        """Surface points from nodes, shape (points, n)."""
        self.unlocated = 0
        """As in Contacts, of the query that is going on."""
        self._earlier: tuple[State | None, dict[int, NDArray[np.float64]]] = (None, {})
        """The last step's start and the surfaces there."""

    def surface(self, state: State, index: int) -> NDArray[np.float64]:
        """World positions of the body's surface points [m], shape (n, 3)."""
        body = self.model.bodies[index]
        if index in self.soft_of:
            return np.asarray(self.interpolation[index] @ state.x)
        return np.asarray((body.vertices - body.center_of_mass) @ state.rotation[index].T + state.center[index])

    def find(self, state: State, before: State) -> Contacts:
        """Active points, forces and tangents at `state`, with friction measured from the start of the step `before`."""
        self.unlocated = 0
        surfaces = {i: self.surface(state, i) for i in {p.a for p in self.pairs}}
        if self._earlier[0] is not before:
            self._earlier = before, {i: self.surface(before, i) for i in {p.a for p in self.pairs}}
        earlier = self._earlier[1]
        for index in sorted({p.b for p in self.pairs} & set(self.soft_of)):
            query.average_deformation(
                self.soft_of[index].near_surface, state.x, self.soft.cell_node, self.soft.cell_size,
                self.soft.node_cell,
                self.smooth,
            )  # fmt: skip
        touching = [t for p in self.pairs if (t := self._touch(p, state, before, surfaces, earlier)) is not None]
        return self._collect(touching, state, before)

    def _touch(
        self,
        pair: Pair,
        state: State,
        before: State,
        surfaces: dict[int, NDArray[np.float64]],
        earlier: dict[int, NDArray[np.float64]],
    ) -> Touching | None:
        points = surfaces[pair.a]
        near = inside(points, *self._solid_box(state, pair.b)).astype(np.int32)
        if len(near) == 0:
            return None
        material, gap, normal, node, weight = self._query(pair, state, points, near)
        active = np.flatnonzero(gap < 0.0)
        if len(active) == 0:
            return None
        index = near[active].astype(np.int64)
        slip = (points[index] - earlier[pair.a][index]) - self._motion(
            pair.b, material[active], node[active], weight[active], state, before
        )
        force, tangent, coupling, anchor, sliding = point_forces(pair, index, gap[active], normal[active], slip)
        sliding &= np.linalg.norm(slip, axis=1) > STICK_SPEED * self.seconds
        nodes = np.zeros((len(active), 16), dtype=np.int64)
        weights = np.zeros((len(active), 16))
        if pair.a in self.soft_of:
            nodes[:, :8] = self.soft_of[pair.a].surface_node[index]
            weights[:, :8] = self.soft_of[pair.a].surface_weight[index]
        nodes[:, 8:], weights[:, 8:] = node[active], -weight[active]
        return Touching(
            pair, index, points[index], gap[active], normal[active], force, tangent, coupling, anchor, sliding, nodes,
            weights,
        )  # fmt: skip

    def _solid_box(self, state: State, index: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """World box outside of which no point can be inside a body [m]: of a soft body's cells, or of the samples of a
        rigid one's distance. Its surface may be a part of that of the solid, such as the top of a cut-out slab."""
        if index in self.soft_of:
            return bounds(state.x[self.soft_of[index].nodes])
        body = self.model.bodies[index]
        end = np.array(body.distance.values.shape) - 1
        corner = body.distance.origin + body.distance.spacing * end * np.array(list(np.ndindex(2, 2, 2)))
        return bounds((corner - body.center_of_mass) @ state.rotation[index].T + state.center[index])

    def _query(
        self, pair: Pair, state: State, points: NDArray[np.float64], near: NDArray[np.int32]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.int64], NDArray[np.float64]]:
        body = self.model.bodies[pair.b]
        count = len(near)
        gap, normal = np.full(count, query.FAR), np.zeros((count, 3))
        node, weight = np.zeros((count, 8), dtype=np.int64), np.zeros((count, 8))
        grid = body.distance
        if pair.b not in self.soft_of:
            material = np.zeros((count, 3))
            query.query_rigid(
                points, near, state.rotation[pair.b], state.center[pair.b], body.center_of_mass, grid.origin,
                grid.spacing, grid.values, material, gap, normal,
            )  # fmt: skip
            return material, gap, normal, node, weight
        one = self.soft_of[pair.b]
        material = pair.guess[near].copy()
        cell = np.full(count, -1, dtype=np.int32)
        query.query_soft(
            points, near, state.x, *one.planes, one.cell_id, self.soft.cell_node, self.smooth,
            grid.origin, grid.spacing, grid.values, self._undeformed(pair.b, state, points[near]), material, gap,
            normal, cell, weight,
        )  # fmt: skip
        found = cell >= 0
        self.unlocated += int((cell == query.UNLOCATED).sum())
        pair.guess[near] = np.where(found[:, None], material, np.nan)
        node[found] = self.soft.cell_node[cell[found]]
        weight[~found] = 0.0
        return material, gap, normal, node, weight

    def _undeformed(self, index: int, state: State, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Where points (k, 3) would be in a soft body's start pose, had it only moved rigidly [m]."""
        if self.model.bodies[index].fixed:
            return points
        nodes = self.soft_of[index].nodes
        rotation, translation = best_rigid_motion(self.soft.rest[nodes], state.x[nodes], self.soft.mass[nodes])
        return np.asarray((points - translation) @ rotation)

    def _motion(
        self,
        index: int,
        material: NDArray[np.float64],
        node: NDArray[np.int64],
        weight: NDArray[np.float64],
        state: State,
        before: State,
    ) -> NDArray[np.float64]:
        """Displacement since the start of the step of the given material points of a body, shape (k, 3)."""
        if index in self.soft_of:
            return np.asarray(np.einsum("ka,kai->ki", weight, state.x[node] - before.x[node]))
        arm = material - self.model.bodies[index].center_of_mass
        now = arm @ state.rotation[index].T + state.center[index]
        return np.asarray(now - arm @ before.rotation[index].T - before.center[index])

    def _collect(self, touching: list[Touching], state: State, before: State) -> Contacts:
        count = len(self.soft.rest)
        rows = [
            (t.pair.a, t.pair.b, t.position, t.force, t.tangent, t.coupling, t.node, t.weight) for t in touching
        ] + [self._bonded(bond, state) for bond in self.bonds]  # fmt: skip
        if not rows:
            none = np.zeros(0, dtype=np.int64)
            place, matrix = np.zeros((0, 3)), np.zeros((0, 3, 3))
            return Contacts(
                [], sparse.csr_matrix((0, count)), place, matrix, matrix, place, none, none, unlocated=self.unlocated
            )
        a, b, position, force, tangent, coupling, nodes, weights = zip(*rows, strict=True)
        spins = self._spins({*a, *b}, state)
        node, weight = np.concatenate(nodes), np.concatenate(weights)
        point = np.repeat(np.arange(len(node)), 16)
        used = weight.ravel() != 0.0
        gather = sparse.csr_matrix(
            (weight.ravel()[used], (point[used], node.ravel()[used])), shape=(len(node), max(count, 1))
        )
        sizes = [len(f) for f in force]
        return Contacts(
            touching,
            gather,
            np.concatenate(force),
            np.concatenate(tangent),
            np.concatenate(coupling),
            np.concatenate(position),
            np.repeat(np.array(a, dtype=np.int64), sizes),
            np.repeat(np.array(b, dtype=np.int64), sizes),
            self._rolling(touching, state, before, spins),
            spins,
            self.unlocated,
        )

    def _rolling(self, touching: list[Touching], state: State, before: State, spins: dict[int, Spin]) -> list[Rolling]:
        """One torque per touching pair of bodies with rolling resistance."""
        load: dict[tuple[int, int], float] = {}
        for t in touching:
            key = (min(t.pair.a, t.pair.b), max(t.pair.a, t.pair.b))
            load[key] = load.get(key, 0.0) + float(t.normal_force.sum())
        out = []
        for (a, b), normal_force in load.items():
            one, two = self.model.bodies[a], self.model.bodies[b]
            length = float(np.sqrt(one.rolling_resistance * two.rolling_resistance))
            if length > 0.0:
                turn = self._turn(a, state, before, spins) - self._turn(b, state, before, spins)
                moving = min((x for x in (one, two) if not x.fixed), key=lambda body: body.size)
                start = self.rolling_torque.get((a, b), np.zeros(3))
                law = Law.of(length, normal_force, 0.5 * moving.size, moving.mass, gentle=self.gentle)
                out.append(resist(a, b, law, start, turn, self.seconds))
        return out

    def _turn(self, index: int, state: State, before: State, spins: dict[int, Spin]) -> NDArray[np.float64]:
        """Rotation vector of a body since the start of the step [rad], shape (3,)."""
        if index in spins:
            nodes = spins[index].nodes
            return spins[index].turn(state.x[nodes] - before.x[nodes])
        if index in self.soft_of:
            return np.zeros(3)
        return turn_between(before.rotation[index], state.rotation[index])

    def _bonded(self, bond: Bond, state: State) -> tuple[Any, ...]:
        """The points of a bond in the form of a pair's active points."""
        count = len(bond.stiffness)
        return (
            bond.a.body, bond.b.body, bond.a.position(self.model, state), bond.force(self.model, state),
            bond.stiffness[:, None, None] * np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3, 3)),
            np.concatenate([bond.a.node, bond.b.node], axis=1),
            np.concatenate([bond.a.weight, -bond.b.weight], axis=1),
        )  # fmt: skip

    def _spins(self, involved: set[int], state: State) -> dict[int, Spin]:
        """Spins of the free soft bodies among those that touch or are bonded."""
        out = {}
        for index, one in self.soft_of.items():
            if index in involved and not self.model.bodies[index].fixed:
                out[index] = Spin.of(one.nodes, self.soft.mass[one.nodes], state.x[one.nodes])
        return out

    def remember(self, contacts: Contacts) -> None:
        """Accept a step: store anchors of touching points, forget the others."""
        for pair in self.pairs:
            pair_points = [t for t in contacts.touching if t.pair is pair]
            anchor, sliding = np.zeros_like(pair.anchor), np.zeros_like(pair.sliding)
            for t in pair_points:
                anchor[t.point], sliding[t.point] = t.anchor, t.sliding
            pair.anchor, pair.sliding = anchor, sliding
        self.rolling_torque = {(r.a, r.b): r.elastic for r in contacts.rolling}


def point_forces(
    pair: Pair,
    index: NDArray[np.int64],
    gap: NDArray[np.float64],
    normal: NDArray[np.float64],
    slip: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
    """Force on a (k, 3), its negative derivative in two parts (k, 3, 3), the symmetric one and that of the friction
    limits, new anchors (k, 3) and sliding flags (k,) of penetrating points.

    A point that slid at the end of the last step feels mu_d, any other mu_s; the choice is fixed within a step,
    so that the force
    is a continuous function of the step's motion and Newton can converge.
    """
    stiffness = pair.stiffness[index]
    load = -stiffness * gap
    outer = normal[:, :, None] * normal[:, None, :]
    plane = np.eye(3) - outer
    trial = np.einsum("kij,kj->ki", plane, pair.anchor[index] + slip)
    size = np.linalg.norm(trial, axis=1)
    tangential = TANGENTIAL_SHARE * stiffness
    coefficient = np.where(pair.sliding[index], pair.dynamic_friction, pair.static_friction)
    limit = coefficient * load
    slides = tangential * size > limit
    direction = np.divide(trial, size[:, None], out=np.zeros_like(trial), where=size[:, None] > 0.0)
    reach = np.where(slides, limit / tangential, size)
    force = load[:, None] * normal - (tangential * reach)[:, None] * direction
    ratio = np.where(slides, np.divide(reach, size, out=np.ones_like(size), where=size > 0.0), 1.0)
    stuck = plane - np.where(slides, 1.0, 0.0)[:, None, None] * direction[:, :, None] * direction[:, None, :]
    tangent = stiffness[:, None, None] * outer + (tangential * ratio)[:, None, None] * stuck
    follows = np.where(slides, coefficient * stiffness, 0.0)
    coupling = -follows[:, None, None] * direction[:, :, None] * normal[:, None, :]
    return force, tangent, coupling, reach[:, None] * direction, slides
