"""Contact of soft bodies with each other and with rigid bodies, at their true surfaces; and bonds.

The contact law is that of the implicit method (solver/contact): points of one surface feel the signed distance of the
other body through a normal spring and Coulomb friction. A soft body's surface follows the nodes of its background grid,
which its particles carry; the particles take the forces in the same shares. Near rest springs are stiffened until the
mean penetration reaches its target. Explicit steps limit the stiffness, and the missing part acts with a delay: a point
is pushed as if it were deeper, by an offset that grows over CLOSING_SECONDS. This is an augmented Lagrangian [A91]
whose multipliers follow the relaxation. A point that comes out loses its offset faster than it grew, or it would push a
rolling body from behind.

The set of points near another body is updated once bodies have moved by SLACK.

[A91] Alart, Curnier: A mixed formulation for frictional contact problems prone to Newton like solution methods. Comput.
Methods Appl. Mech. Engng. 92, 1991.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from solver.arrays import Array, IntArray
from solver.box import bounds
from solver.config import SolverConfig
from solver.contact.active import STIFFENED, Pair, TouchingPoints, contact_pairs
from solver.contact.bonds import BondedPair, build_bonds
from solver.contact.friction import point_forces
from solver.contact.query import ContactQuery
from solver.kernels import query
from solver.mls.body import SoftParticles
from solver.mls.damping import Acting
from solver.mls.rigid import ContactReport, RigidBodies
from solver.model.bodies import Model
from solver.model.soft import SoftSystem
from solver.model.state import PointMemory, State, start_state

STABLE = 0.5  # contact stiffness times squared step times mobility of the point that it acts on [-]; 4 is the limit
CLOSING_SECONDS = 0.04  # time in which excess penetration fades by e; coming to rest takes ten times as long
FADING_SECONDS = 0.4  # time constant with which the largest stiffness of a contact fades
SLACK = 0.5  # motion of bodies after which near points are searched again [smallest cells]
RELEASE = 3.0  # offset that a point loses per distance by which it comes out [-]
AROUND = 4.0  # cells around near points whose nodes are updated in each step
STICK_SPEED = 1e-4  # a point at its friction limit that moves slower than this [m/s] has stopped: mu_s holds again


@dataclass(eq=False, slots=True)
class PairTouch:
    """One ordered pair of bodies: points of the first body that are near the second, and their forces."""

    pair: Pair
    memory: PointMemory
    near: IntArray
    """Points that may touch, shape (k,)."""
    counts: NDArray[np.bool_]
    """Points whose contact counts, shape (n,)."""
    allowed: Array
    """Largest stable stiffness of each point's spring [N/m], shape (n,)."""
    stiffness: Array
    """Intended normal stiffness of each point [N/m], shape (n,)."""
    offset: Array
    """Depth added to each point's penetration [m], shape (n,)."""
    impulse: Array
    """Impulse on each point since the last call of `hand_over` [N s], shape (n, 3)."""
    load: Array
    """Normal part of the impulse [N s], shape (n,)."""
    normal: Array
    """Last contact normal of each point, shape (n, 3)."""
    gap: Array
    """Last gap of each point [m], shape (n,)."""
    friction: Array
    """Last friction coefficients of each point, shape (n, 3)."""
    position: Array
    """Last position of each point [m], shape (n, 3)."""
    touched: NDArray[np.bool_]
    """Points that touched in the last step, shape (n,)."""
    most: float = 0.0
    """Largest stiffness of all points that touched at once, fading over time [N/m]."""

    @classmethod
    def of(cls, pair: Pair, allowed: Array) -> "PairTouch":
        """A pair without near points."""
        count = len(pair.area)
        none = np.zeros(0, dtype=np.int64)
        memory = replace(pair.fresh_memory(), stiffness=np.minimum(pair.stiffness, allowed))
        return cls(
            pair, memory, none, np.ones(count, bool), allowed, pair.stiffness.copy(), np.zeros(count),
            np.zeros((count, 3)), np.zeros(count), np.zeros((count, 3)), np.zeros(count), np.zeros((count, 3)),
            np.zeros((count, 3)), np.zeros(count, bool),
        )  # fmt: skip

    def stiffen(self, target: float, share: float) -> None:
        """Stiffen the pair if its mean penetration exceeds `target` [m], by a share of the necessary factor."""
        on = self.load > 0.0
        if not on.any():
            return
        depth = float(-np.average(self.gap[on], weights=self.load[on]))
        if depth > STIFFENED * target:
            self.stiffness *= (depth / target) ** share
            self.memory = replace(self.memory, stiffness=np.minimum(self.stiffness, self.allowed))

    def follow(self, gap: Array, dt: float) -> None:
        """Advance the offsets of the near points by dt [s] to replace the missing stiffness; `gap` (k,) are their
        current gaps [m]."""
        near, spring = self.near, self.memory.stiffness
        lacking = (self.stiffness / spring - 1.0)[near] * np.maximum(-gap, 0.0)
        before = self.offset[near]
        after = before + dt / CLOSING_SECONDS * (lacking - before)
        came_out = np.where(self.touched[near], np.maximum(gap - self.gap[near], 0.0), 0.0)
        after = np.maximum(np.minimum(after, before - RELEASE * came_out), np.minimum(lacking, after))
        after[gap >= query.FAR] = before[gap >= query.FAR]  # no place was found for the point in this step
        after[~self.counts[near]] = 0.0
        self.offset[near] = after


@dataclass(eq=False, slots=True)
class BondTouch:
    """A bond and its transmitted impulse."""

    bond: BondedPair
    """The bond, with springs that are stable for the steps."""
    offset: Array
    """Displacement added to the stretch to pull the ends together [m], shape (k, 3)."""
    impulse: Array = field(default_factory=lambda: np.zeros((0, 3)))
    """Impulse on the first body since the last call of `hand_over`, point by point [N s], shape (k, 3)."""


class SurfaceContacts:
    """All pairs of bodies with at least one soft body."""

    def __init__(
        self, model: Model, system: SoftSystem, soft: Mapping[int, SoftParticles], rigid: RigidBodies,
        config: SolverConfig,
    ) -> None:  # fmt: skip
        self.model, self.system, self.soft, self.rigid = model, system, soft, rigid
        every = contact_pairs(model, system, config, model.gravity_strength)
        pairs = [p for p in every if p.a in soft or p.b in soft]
        self.query = ContactQuery(model, system, pairs)
        self.touches = [PairTouch.of(pair, self._allowed(pair, config)) for pair in pairs]
        self.bonds = [self._explicit(bond, config) for bond in build_bonds(model, system, config.penetration_target)]
        self.target = config.penetration_target
        self.slack = SLACK * min(one.cell for one in soft.values())
        self.state: State = start_state(model, system)
        self.state.rotation, self.state.center = rigid.state.rotation, rigid.state.center
        self.before = self.state.x.copy()
        self.start = {i: (rigid.state.rotation[i].copy(), rigid.state.center[i].copy()) for i in rigid.index}
        self.carried: dict[int, NDArray[np.int32]] = {}
        self.smoothed: dict[int, NDArray[np.int32]] = {}
        self.moved = np.inf
        self.acting: list[Acting] = []

    def _allowed(self, pair: Pair, config: SolverConfig) -> Array:
        """Largest normal stiffness of each point of a pair [N/m] that is stable for steps of this length, shape
        (n,)."""
        own = self.soft[pair.a].crowded_mobility if pair.a in self.soft else np.zeros(len(pair.area))
        crowded = own + self._crowded(pair.b, self.model.bodies[pair.a].vertices)
        return np.asarray(STABLE / config.mls_step_seconds**2 / crowded)

    def _crowded(self, index: int, points: Array) -> Array:
        """Velocity of a body's surface at points (n, 3) for an impulse of 1 N s at each point within a cell [m/s],
        shape (n,)."""
        if index not in self.soft:
            return np.full(len(points), 1e-12)
        one = self.soft[index]
        crowd = cKDTree(points).query_ball_point(points, one.cell / np.sqrt(np.pi), return_length=True)
        return np.asarray(crowd * one.mobility.max())

    def _explicit(self, bond: BondedPair, config: SolverConfig) -> BondTouch:
        """A bond whose stiffness per point is limited to the stable one."""
        dt = config.mls_step_seconds
        mobility = sum(self._crowded(side.body, bond.a.rest) for side in (bond.a, bond.b))
        stiffness = np.minimum(bond.stiffness, STABLE / dt**2 / mobility)
        share = self._share(bond.a.body, bond.b.body, float(stiffness.sum()), dt)
        return BondTouch(replace(bond, stiffness=share * stiffness), np.zeros((len(stiffness), 3)))

    def act(self, dt: float) -> None:
        """Find the contacts and apply the impulses of dt [s] to the bodies."""
        self._carry(dt)
        self.acting = [*self._touching(dt), *self._bonded(dt)]
        for one in self.acting:
            for index, sign in ((one.a, 1.0), (one.b, -1.0)):
                if index in self.rigid.index:
                    self._push_rigid(index, one.position, sign * dt * one.force)
        self.before[:] = self.state.x
        for i in self.rigid.index:
            self.start[i] = (self.rigid.state.rotation[i].copy(), self.rigid.state.center[i].copy())

    def deepest(self) -> tuple[tuple[int, int], float]:
        """The pair of bodies with the smallest gap, and that gap [m], among points that are near another body."""
        self._look_up()
        found = [(t.pair.key, float(t.gap[t.near].min())) for t in self.touches if len(t.near)]
        return min(found, key=lambda one: one[1], default=((0, 0), np.inf))

    def surface(self, index: int) -> Array:
        """Deformed surface points of a body [m], shape (n, 3)."""
        if index in self.soft:
            self._carry_all(index)
        return self.query.surface(self.state, index)

    def speed(self) -> float:
        """Bound of the speed at which any two bodies approach each other [m/s]."""
        speeds = [one.fastest for one in self.soft.values()]
        speeds += [
            float(np.linalg.norm(self.rigid.state.velocity[i]))
            + self.rigid.radius[i] * float(np.linalg.norm(self.rigid.state.angular_velocity[i]))
            for i in self.rigid.free
        ]
        return 2.0 * max(speeds, default=0.0)

    # positions of the bodies

    def _carry(self, dt: float) -> None:
        """Update the positions of the nodes near contacts, and from time to time the sets of near points."""
        self.moved += dt * self.speed()
        if self.moved > self.slack:
            self._look_up()
            self.moved = 0.0
        for index, one in self.soft.items():
            if index in self.carried:
                one.carry(self.carried[index], self.state.x[self.query.soft_of[index].nodes])
        for nodes in self.smoothed.values():
            self._smooth(nodes)

    def _carry_all(self, index: int) -> None:
        nodes = self.query.soft_of[index].nodes
        every = np.arange(nodes.stop - nodes.start, dtype=np.int32)
        self.soft[index].carry(every, self.state.x[nodes])

    def _smooth(self, nodes: NDArray[np.int32]) -> None:
        s = self.system
        query.average_deformation(nodes, self.state.x, s.cell_node, s.cell_size, s.node_cell, self.query.smooth)

    def _look_up(self) -> None:
        """Find the points that are near another body, and the nodes around them."""
        stale = np.ones(len(self.before), dtype=bool)
        for index, nodes in self.carried.items():
            stale[self.query.soft_of[index].nodes.start + nodes] = False
        for index in self.soft:
            self._carry_all(index)
            self._smooth(self.query.soft_of[index].near_surface)
        self.before[stale] = self.state.x[stale]  # nothing slides where nothing touched
        surfaces = {i: self.query.surface(self.state, i) for i in {t.pair.a for t in self.touches}}
        places: dict[int, list[Array]] = {index: [] for index in self.soft}
        chosen: dict[int, list[NDArray[np.integer]]] = {index: [] for index in self.soft}
        for touch in self.touches:
            points = surfaces[touch.pair.a]
            low, high = self.query._solid_box(self.state, touch.pair.b)
            inside = ((points > low - self.slack) & (points < high + self.slack)).all(axis=1)
            candidates = np.flatnonzero(inside)
            gap = self._gaps(touch, points[candidates], candidates)
            touch.near = candidates[gap < self.slack]
            touch.gap[candidates] = gap
            away = np.ones(len(points), dtype=bool)
            away[touch.near] = False
            touch.offset[away] = 0.0
            if touch.pair.flat is not None:
                known = {**self.state.memory.points, touch.pair.key: touch.memory}
                self.state.memory = replace(self.state.memory, points=known)
                hidden = self.query._superfluous(touch.pair, touch.pair.flat, self.state, points)
                touch.memory = replace(touch.memory, superfluous=hidden)
                touch.counts = ~hidden
            for index in touch.pair.key:
                if index in self.soft:
                    places[index].append(points[touch.near])
            if touch.pair.a in self.soft:
                chosen[touch.pair.a].append(self.query.soft_of[touch.pair.a].surface_node[touch.near].ravel())
        for one in self.bonds:
            for side in (one.bond.a, one.bond.b):
                if side.body in self.soft:
                    chosen[side.body].append(side.node.ravel())
        self.carried, self.smoothed = {}, {}
        for index in self.soft:
            self._choose_nodes(index, np.concatenate([np.zeros((0, 3)), *places[index]]), chosen[index])

    def _choose_nodes(self, index: int, places: Array, chosen: list[NDArray[np.integer]]) -> None:
        """Choose the nodes of a body that every step updates: those around `places`, and `chosen`."""
        grid = self.query.soft_of[index]
        first = grid.nodes.start
        every = [np.asarray(one, dtype=np.int64) - first for one in chosen]
        if len(places):
            x = self.state.x[grid.nodes]
            cell = self._cell_at(index, places)
            low, high = bounds(places)
            away = np.maximum(low - x, x - high).max(axis=1) / cell
            every.append(np.flatnonzero(away < AROUND))
            close = np.flatnonzero(away < 0.5 * AROUND)
            self.smoothed[index] = np.intersect1d(close + first, grid.near_surface).astype(np.int32)
        if every:
            self.carried[index] = np.unique(np.concatenate(every)).astype(np.int32)

    def _cell_at(self, index: int, places: Array) -> float:
        """Largest side of a cell at some places of the start pose [m]."""
        here = self.query._undeformed(index, self.state, places)
        sides = [
            np.diff(p)[np.clip(np.searchsorted(p, here[:, a], side="right") - 1, 0, len(p) - 2)].max()
            for a, p in enumerate(self.query.soft_of[index].planes)
        ]
        return float(max(sides))

    def _gaps(self, touch: PairTouch, points: Array, index: IntArray) -> Array:
        """Gaps of some points [m]; 0 where the samples of a rigid body end."""
        if not len(points):
            return np.zeros(0)
        gap, *_ = self._locate(touch, points, index)
        far = gap >= query.FAR
        return np.where(far, np.inf if touch.pair.b in self.soft else 0.0, gap)

    def _locate(self, touch: PairTouch, points: Array, index: IntArray) -> tuple[Array, Array, Array, IntArray, Array]:
        """Gap, normal and material point of points (k, 3) in body b, and the nodes and weights of the places that they
        push."""
        b, count = touch.pair.b, len(points)
        body, state, grid = self.model.bodies[b], self.state, self.model.bodies[b].distance
        every = np.arange(count, dtype=np.int32)
        gap, normal, material = np.full(count, query.FAR), np.zeros((count, 3)), np.zeros((count, 3))
        node, weight = np.zeros((count, 8), dtype=np.int64), np.zeros((count, 8))
        if b not in self.soft:
            query.query_rigid(
                points, every, state.rotation[b], state.center[b], body.center_of_mass, grid.origin, grid.spacing,
                grid.values, material, gap, normal,
            )  # fmt: skip
            return gap, normal, material, node, weight
        one = self.query.soft_of[b]
        material = touch.memory.material_point[index]
        cell = np.full(count, -1, dtype=np.int32)
        query.query_soft(
            points, every, state.x, *one.planes, one.cell_id, self.system.cell_node, self.query.smooth, grid.origin,
            grid.spacing, grid.values, self._undeformed(b, points), material, gap, normal, cell, weight,
        )  # fmt: skip
        found = cell >= 0
        node[found] = self.system.cell_node[cell[found]]
        weight[~found] = 0.0
        touch.memory.material_point[index] = np.where(found[:, None], material, np.nan)
        return gap, normal, material, node, weight

    def _undeformed(self, index: int, points: Array) -> Array:
        """Places of points in a soft body's start pose, assuming that the body has only moved rigidly [m]."""
        one = self.soft[index]
        return points if one.body.fixed else (points - one.center) @ one.rotation + one.start_center

    # interaction of the bodies

    def _touching(self, dt: float) -> Iterator[Acting]:
        for touch in self.touches:
            if len(touch.near):
                found = self._touch(touch, dt)
                if found is not None:
                    yield found

    def _points(self, index: int, chosen: IntArray, x: Array, pose: tuple[Array, Array] | None) -> Array:
        """Surface points of a body by index [m], shape (k, 3)."""
        if index in self.soft:
            grid = self.query.soft_of[index]
            return np.asarray(np.einsum("ka,kai->ki", grid.surface_weight[chosen], x[grid.surface_node[chosen]]))
        body, (rotation, center) = self.model.bodies[index], pose or (np.eye(3), np.zeros(3))
        return np.asarray((body.vertices[chosen] - body.center_of_mass) @ rotation.T + center)

    def _pose(self, index: int) -> tuple[Array, Array] | None:
        return None if index in self.soft else (self.state.rotation[index], self.state.center[index])

    def _touch(self, touch: PairTouch, dt: float) -> Acting | None:
        a, b = touch.pair.key
        points = self._points(a, touch.near, self.state.x, self._pose(a))
        gap, normal, material, node, weight = self._locate(touch, points, touch.near)
        slip = points - self._points(a, touch.near, self.before, self.start.get(a))
        slip -= self._moved(b, material, node, weight)
        self._keep_sides(touch, gap, normal, slip)
        touch.follow(gap, dt)
        pushed = gap - touch.offset[touch.near]
        on = np.flatnonzero((pushed < 0.0) & touch.counts[touch.near])
        touched = np.zeros(len(touch.counts), dtype=bool)
        touched[touch.near[on]] = True
        touch.memory.anchor[~touched] = 0.0
        touch.memory.sliding[~touched] = False
        touch.touched = touched
        if not len(on):
            return None
        index, points, gap, normal, slip = touch.near[on], points[on], gap[on], normal[on], slip[on]
        pushed = pushed[on]
        node, weight, material = node[on], weight[on], material[on]
        friction = touch.pair.friction.at(index, material)
        force, _, anchor, sliding = point_forces(friction, touch.memory, index, pushed, normal, slip)
        # if the share changed with each point that comes or goes, a body on a slope would creep
        touch.most = max(float(touch.memory.stiffness[index].sum()), touch.most * (1.0 - dt / FADING_SECONDS))
        force *= self._share(a, b, touch.most, dt)
        touch.memory.anchor[index] = anchor
        touch.memory.sliding[index] = sliding & (np.linalg.norm(slip, axis=1) > STICK_SPEED * dt)
        load = np.einsum("ki,ki->k", force, normal)
        touch.impulse[index] += dt * force
        touch.load[index] += dt * load
        touch.normal[index], touch.gap[index], touch.friction[index], touch.position[index] = (
            normal, gap, friction, points
        )  # fmt: skip
        if a in self.soft:
            grid = self.query.soft_of[a]
            self._push_soft(a, grid.surface_node[index], grid.surface_weight[index], dt * force)
        if b in self.soft:
            self._push_soft(b, node, weight, -dt * force)
        rolling = float(load @ friction[:, 2] / max(load.sum(), 1e-300))
        return Acting(a, b, points, force, normal[:, None], load, rolling)

    def _share(self, a: int, b: int, stiffness: float, dt: float) -> float:
        """Share of a pair's total stiffness [N/m] that a step of dt [s] allows: more would throw a body. As a whole, a
        soft body moves with its true mass, not its inertia against strain."""
        mobility = sum(1.0 / self.model.bodies[i].mass for i in (a, b) if not self.model.bodies[i].fixed)
        return min(1.0, STABLE / max(dt**2 * stiffness * mobility, 1e-300))

    def _keep_sides(self, touch: PairTouch, gap: Array, normal: Array, slip: Array) -> None:
        """Treat points that have passed the middle of a thin body since the last step as still on the side where they
        entered; modifies `gap` (k,) and `normal` (k, 3) of the near points in place."""
        before = touch.normal[touch.near]
        passed = touch.touched[touch.near] & (np.einsum("ki,ki->k", normal, before) < 0.0)
        gap[passed] = (touch.gap[touch.near] + np.einsum("ki,ki->k", slip, before))[passed]
        normal[passed] = before[passed]

    def _moved(self, index: int, material: Array, node: IntArray, weight: Array) -> Array:
        """Displacement of material points of a body since the last step [m], shape (k, 3)."""
        if index in self.soft:
            return np.asarray(np.einsum("ka,kai->ki", weight, self.state.x[node] - self.before[node]))
        arm = material - self.model.bodies[index].center_of_mass
        rotation, center = self.start[index]
        now = arm @ self.state.rotation[index].T + self.state.center[index]
        return np.asarray(now - arm @ rotation.T - center)

    def _push_soft(self, index: int, node: NDArray[np.integer], weight: Array, impulse: Array) -> None:
        """Apply impulses (k, 3) at points to the nodes (k, 8) that move them, in the shares `weight` (k, 8)."""
        nodes = self.query.soft_of[index].nodes
        chosen, at = np.unique(node, return_inverse=True)
        given = (weight[:, :, None] * impulse[:, None, :]).reshape(-1, 3)
        total = np.stack([np.bincount(at.ravel(), given[:, k], len(chosen)) for k in range(3)], axis=1)
        chosen = chosen.astype(np.int32)
        self.soft[index].push(chosen - np.int32(nodes.start), np.asarray(total, np.float64), self.state.x[chosen])

    def _push_rigid(self, index: int, position: Array, impulse: Array) -> None:
        if self.model.bodies[index].fixed:
            return
        arm = position - self.rigid.state.center[index]
        total = np.concatenate([impulse.sum(axis=0), np.cross(arm, impulse).sum(axis=0)])
        change = np.linalg.solve(self.rigid.mass_matrix(index), total)
        self.rigid.set_velocity(index, self.rigid.velocity(index) + change)

    def _bonded(self, dt: float) -> Iterator[Acting]:
        for one in self.bonds:
            bond = one.bond
            position, stretch = bond.a.position(self.model, self.state), bond.stretch(self.model, self.state)
            # the offset grows until the stretch vanishes: a spring that is soft enough for a step would leave
            # millimetres if few of many points carry the load
            one.offset += dt / CLOSING_SECONDS * stretch
            force = -bond.stiffness[:, None] * (stretch + one.offset)
            one.impulse = one.impulse + dt * force if len(one.impulse) else dt * force
            for side, sign in ((bond.a, 1.0), (bond.b, -1.0)):
                if side.body in self.soft:
                    self._push_soft(side.body, side.node, side.weight, sign * dt * force)
            every = np.tile(np.eye(3), (len(force), 1, 1))
            yield Acting(bond.a.body, bond.b.body, position, force, every, np.ones(len(force)))

    def stiffen(self, moving: bool, seconds: float) -> None:
        """Stiffen pairs whose mean penetration in the last `seconds` exceeded its target; while a body is `moving`,
        only pairs whose penetration exceeded the safe depth."""
        for touch in self.touches:
            target = max(touch.pair.safe_depth, self.target) if moving else self.target
            touch.stiffen(target, seconds / CLOSING_SECONDS)

    # report

    def hand_over(self, seconds: float) -> ContactReport:
        """Mean forces since the last call; resets the sums."""
        report = ContactReport([], [])
        for touch in self.touches:
            on = np.flatnonzero(touch.load > 0.0)
            if len(on):
                report.touching.append(
                    TouchingPoints(
                        touch.pair, on, touch.position[on], touch.gap[on], touch.normal[on],
                        touch.impulse[on] / seconds, touch.friction[on], touch.memory.sliding[on],
                    )
                )  # fmt: skip
            touch.impulse[:], touch.load[:] = 0.0, 0.0
        for one in self.bonds:
            if len(one.impulse):
                position = one.bond.a.position(self.model, self.state)
                stretch = one.bond.stretch(self.model, self.state)
                report.bonded.append((one.bond, position, one.impulse / seconds, stretch))
            one.impulse = np.zeros((0, 3))
        return report
