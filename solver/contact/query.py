"""Contact between the surface points of one body and the signed distance of another.

friction.py computes normal force, friction, and rolling and torsional resistance of pairs. All are springs, implicit on
both sides; the state keeps their anchors from step to step.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from solver.box import bounds, inside
from solver.contact.active import ActiveContacts, Contacts, Pair, PairPoints
from solver.contact.bonds import BondedPair
from solver.contact.flatness import FlatRegions
from solver.contact.friction import RollingLaw, RollingTorque, Spin, law_stiff, point_forces, resisting_torque
from solver.kernels import query
from solver.model.bodies import Model
from solver.model.soft import BodyGrid, SoftSystem
from solver.model.state import ContactMemory, PointMemory, State, best_rigid_motion, turn_between

STICK_SPEED = 1e-4  # a point at its friction limit that moves slower than this [m/s] has stopped: mu_s holds again


@dataclass(frozen=True, eq=False, slots=True)
class StepStart:
    """Start of a step, from which friction and rolling resistance are measured."""

    state: State
    seconds: float
    """Length of the step [s]."""
    rolling: RollingLaw
    surfaces: dict[int, NDArray[np.float64]]
    """World positions of the surface points of each body that has contact points [m], shape (n, 3)."""
    superfluous: Mapping[tuple[int, int], NDArray[np.bool_]] = field(default_factory=dict)
    """For each pair of a rigid and a soft body, the mask of the rigid body's points that the soft body's points
    replace, shape (n,). It is fixed at the start of the step, so that forces are continuous within it."""


@dataclass(frozen=True, eq=False, slots=True)
class Located:
    """Positions of k points in the start pose of a body, and their distances from its surface."""

    point: NDArray[np.int64]
    """Indices of the points, shape (k,)."""
    material: NDArray[np.float64]
    """Material points [m], shape (k, 3)."""
    gap: NDArray[np.float64]
    """Gaps [m], shape (k,)."""
    normal: NDArray[np.float64]
    """Outward world normals, shape (k, 3)."""
    node: NDArray[np.int64]
    """Nodes of the cell that contains the pushed place of the surface, per point, shape (k, 8)."""
    weight: NDArray[np.float64]
    """Shape values of these nodes, zero for a rigid body and for a point in no cell, shape (k, 8)."""
    found: NDArray[np.bool_]
    """Points that lie in a cell of a soft body, shape (k,)."""
    unlocated: int = 0
    """As in Contacts."""
    cell: NDArray[np.int32] | None = None
    """Cell that contains the pushed place of the surface, negative without one, shape (k,); None if rigid."""


def _interpolation(body: BodyGrid, nodes: int) -> sparse.csr_matrix:
    rows = np.arange(0, body.surface_node.size + 1, 8)
    return sparse.csr_matrix(
        (body.surface_weight.ravel(), body.surface_node.ravel(), rows), shape=(len(rows) - 1, nodes)
    )


class ContactQuery:
    """Finds the active contacts of a state. Holds constant data; the memory of contacts is in the state."""

    def __init__(self, model: Model, soft: SoftSystem, pairs: list[Pair], bonds: Sequence[BondedPair] = ()) -> None:
        self.model = model
        self.soft = soft
        self.pairs = pairs
        self.bonds = bonds
        self.soft_of: dict[int, BodyGrid] = {s.index: s for s in soft.bodies}
        self.smooth = np.zeros((len(soft.rest), 9))
        """Buffer for the deformation at the nodes, averaged again in every query."""
        self.interpolation = {s.index: _interpolation(s, len(soft.rest)) for s in soft.bodies}
        """Interpolation of surface points from nodes, shape (points, n)."""

    def fresh_memory(self) -> ContactMemory:
        """Contact memory before the first step."""
        return ContactMemory({pair.key: pair.fresh_memory() for pair in self.pairs})

    def surface(self, state: State, index: int) -> NDArray[np.float64]:
        """World positions of the body's surface points [m], shape (n, 3)."""
        body = self.model.bodies[index]
        if index in self.soft_of:
            return np.asarray(self.interpolation[index] @ state.x)
        return np.asarray((body.vertices - body.center_of_mass) @ state.rotation[index].T + state.center[index])

    def begin(self, state: State, seconds: float, rolling: RollingLaw = law_stiff) -> StepStart:
        """The start of a step of `seconds` from `state`, which must not change until the step is finished."""
        surfaces = self._surfaces(state)
        flat = [(p, p.flat) for p in self.pairs if p.flat is not None]
        if flat:
            self._average_deformation(state)
        superfluous = {p.key: self._superfluous(p, regions, state, surfaces[p.a]) for p, regions in flat}
        return StepStart(state, seconds, rolling, surfaces, superfluous)

    def _surfaces(self, state: State) -> dict[int, NDArray[np.float64]]:
        """World positions of the surface points of each body that has contact points [m]."""
        return {i: self.surface(state, i) for i in {p.a for p in self.pairs}}

    def _average_deformation(self, state: State) -> None:
        for index in sorted({p.b for p in self.pairs} & set(self.soft_of)):
            query.average_deformation(
                self.soft_of[index].near_surface, state.x, self.soft.cell_node, self.soft.cell_size,
                self.soft.node_cell,
                self.smooth,
            )  # fmt: skip

    def find(self, state: State, start: StepStart) -> Contacts:
        """Active points, forces and tangents at `state`, with friction measured from the start of the step.

        The search for material points starts at those that `state` remembers.
        """
        surfaces = self._surfaces(state)
        self._average_deformation(state)
        found = {
            p.key: self._locate(p.b, state, surfaces[p.a], state.memory.points[p.key].material_point)
            for p in self.pairs
        }
        touching = [t for p in self.pairs if (t := self._touch(p, state, surfaces[p.a], found[p.key], start))]
        return self._collect(touching, found, state, start)

    def _touch(
        self, pair: Pair, state: State, points: NDArray[np.float64], found: Located, start: StepStart
    ) -> ActiveContacts | None:
        counts = found.gap < 0.0
        if pair.key in start.superfluous:
            counts &= ~start.superfluous[pair.key][found.point]
        active = np.flatnonzero(counts)
        if len(active) == 0:
            return None
        index = found.point[active]
        gap, normal, node, weight = found.gap[active], found.normal[active], found.node[active], found.weight[active]
        slip = (points[index] - start.surfaces[pair.a][index]) - self._motion(
            pair.b, found.material[active], node, weight, state, start.state
        )
        memory = start.state.memory.points[pair.key]
        friction = pair.friction.at(index, found.material[active])
        force, tangent, anchor, sliding = point_forces(friction, memory, index, gap, normal, slip)
        sliding &= np.linalg.norm(slip, axis=1) > STICK_SPEED * start.seconds
        nodes = np.zeros((len(active), 16), dtype=np.int64)
        weights = np.zeros((len(active), 16))
        if pair.a in self.soft_of:
            nodes[:, :8] = self.soft_of[pair.a].surface_node[index]
            weights[:, :8] = self.soft_of[pair.a].surface_weight[index]
        nodes[:, 8:], weights[:, 8:] = node, -weight
        return ActiveContacts(
            pair, index, points[index], gap, normal, force, friction, sliding, tangent, anchor, nodes, weights
        )

    def _solid_box(self, state: State, index: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """World box outside of which no point can be inside a body [m]: the box of a soft body's cells, or of the
        samples of a rigid body's distance. The body's surface may be only a part of the solid's surface, such as the
        top of a cut-out slab."""
        if index in self.soft_of:
            return bounds(state.x[self.soft_of[index].nodes])
        body = self.model.bodies[index]
        end = np.array(body.distance.values.shape) - 1
        corner = body.distance.origin + body.distance.spacing * end * np.array(list(np.ndindex(2, 2, 2)))
        return bounds((corner - body.center_of_mass) @ state.rotation[index].T + state.center[index])

    def _locate(self, index: int, state: State, points: NDArray[np.float64], guess: NDArray[np.float64]) -> Located:
        """Locate the points (n, 3) that can be in a body. In a soft body the search starts at the material points
        `guess` (n, 3), unless they are NaN."""
        body = self.model.bodies[index]
        point = inside(points, *self._solid_box(state, index))
        near, count = point.astype(np.int32), len(point)
        gap, normal = np.full(count, query.FAR), np.zeros((count, 3))
        node, weight = np.zeros((count, 8), dtype=np.int64), np.zeros((count, 8))
        grid, material = body.distance, np.zeros((count, 3))
        if count == 0:
            return Located(point, material, gap, normal, node, weight, np.zeros(0, dtype=bool))
        if index not in self.soft_of:
            query.query_rigid(
                points, near, state.rotation[index], state.center[index], body.center_of_mass, grid.origin,
                grid.spacing, grid.values, material, gap, normal,
            )  # fmt: skip
            return Located(point, material, gap, normal, node, weight, np.zeros(count, dtype=bool))
        one = self.soft_of[index]
        material = guess[near]
        cell = np.full(count, -1, dtype=np.int32)
        query.query_soft(
            points, near, state.x, *one.planes, one.cell_id, self.soft.cell_node, self.smooth,
            grid.origin, grid.spacing, grid.values, self._undeformed(index, state, points[near]), material, gap,
            normal, cell, weight,
        )  # fmt: skip
        found = cell >= 0
        node[found] = self.soft.cell_node[cell[found]]
        weight[~found] = 0.0
        return Located(point, material, gap, normal, node, weight, found, int((cell == query.UNLOCATED).sum()), cell)

    def _superfluous(
        self, pair: Pair, flat: FlatRegions, state: State, points: NDArray[np.float64]
    ) -> NDArray[np.bool_]:
        """Mask of the points (n, 3) of a rigid body that its soft partner's own points make superfluous, shape (n,)."""
        memory = state.memory.points[pair.key]
        found = self._locate(pair.b, state, points, memory.material_point)
        out = np.zeros(len(points), dtype=bool)
        if found.cell is not None:
            at = np.flatnonzero(found.found & (found.gap < query.FAR))
            size = self.soft.cell_size[found.cell[at]].max(axis=1)
            point = found.point[at]
            before = memory.superfluous[point]
            turn = state.rotation[pair.a]
            out[point] = flat.superfluous(point, turn, found.material[at], found.normal[at], size, before)
        return out

    def _undeformed(self, index: int, state: State, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Places of points (k, 3) in a soft body's start pose, assuming that the body has only moved rigidly [m]."""
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
        """Displacement of material points of a body since the start of the step [m], shape (k, 3)."""
        if index in self.soft_of:
            return np.asarray(np.einsum("ka,kai->ki", weight, state.x[node] - before.x[node]))
        arm = material - self.model.bodies[index].center_of_mass
        now = arm @ state.rotation[index].T + state.center[index]
        return np.asarray(now - arm @ before.rotation[index].T - before.center[index])

    def _collect(
        self,
        touching: Sequence[ActiveContacts],
        found: Mapping[tuple[int, int], Located],
        state: State,
        start: StepStart,
    ) -> Contacts:
        rows = [*(PairPoints.of(t) for t in touching), *(self._bonded(bond, state) for bond in self.bonds)]
        involved = frozenset(i for row in rows for i in (row.a, row.b))
        spins = self._spins(involved, state)
        rolling = self._rolling(touching, state, start, spins)
        sizes = np.array([len(row.force) for row in rows], dtype=np.int64)
        return Contacts(
            active=tuple(touching),
            gather=self._gather(rows),
            force=np.concatenate([np.zeros((0, 3)), *(row.force for row in rows)]),
            tangent=np.concatenate([np.zeros((0, 3, 3)), *(row.tangent for row in rows)]),
            position=np.concatenate([np.zeros((0, 3)), *(row.position for row in rows)]),
            a=np.repeat(np.array([row.a for row in rows], dtype=np.int64), sizes),
            b=np.repeat(np.array([row.b for row in rows], dtype=np.int64), sizes),
            rolling=rolling,
            spins=spins,
            unlocated=sum(one.unlocated for one in found.values()),
            memory=self._memory(touching, involved, rolling, state, start, found),
        )

    def _gather(self, rows: Sequence[PairPoints]) -> sparse.csr_matrix:
        """Map from node displacements to the relative displacement per point, shape (k, n); one column if there is no
        node."""
        node = np.concatenate([np.zeros((0, 16), dtype=np.int64), *(row.node for row in rows)])
        weight = np.concatenate([np.zeros((0, 16)), *(row.weight for row in rows)])
        point = np.repeat(np.arange(len(node)), 16)
        used = weight.ravel() != 0.0
        return sparse.csr_matrix(
            (weight.ravel()[used], (point[used], node.ravel()[used])), shape=(len(node), max(len(self.soft.rest), 1))
        )

    def _memory(
        self,
        touching: Sequence[ActiveContacts],
        touched: frozenset[int],
        rolling: Sequence[RollingTorque],
        state: State,
        start: StepStart,
        found: Mapping[tuple[int, int], Located],
    ) -> ContactMemory:
        """Contact memory after a step that ends at `state`."""
        points = {}
        for key, old in start.state.memory.points.items():
            material_point, here = state.memory.points[key].material_point, found[key]
            if len(here.point) and key[1] in self.soft_of:
                material_point = material_point.copy()
                material_point[here.point] = np.where(here.found[:, None], here.material, np.nan)
            anchor, sliding = np.zeros(old.anchor.shape), np.zeros(len(old.sliding), dtype=bool)
            superfluous = start.superfluous.get(key, old.superfluous)
            points[key] = PointMemory(old.stiffness, anchor, sliding, material_point, superfluous)
        for t in touching:
            points[t.pair.key].anchor[t.point] = t.anchor
            points[t.pair.key].sliding[t.point] = t.sliding
        return ContactMemory(points, {(r.a, r.b): r.elastic for r in rolling}, touched)

    def _rolling(
        self, touching: Sequence[ActiveContacts], state: State, start: StepStart, spins: Mapping[int, Spin]
    ) -> tuple[RollingTorque, ...]:
        """One torque per touching pair of bodies with rolling resistance."""
        load: dict[tuple[int, int], NDArray[np.float64]] = {}
        for t in touching:
            key = (min(t.pair.a, t.pair.b), max(t.pair.a, t.pair.b))
            force = t.normal_force
            load[key] = load.get(key, np.zeros(2)) + np.array([force.sum(), force @ t.friction[:, 2]])
        out = []
        for (a, b), (normal_force, limit) in load.items():
            one, two = self.model.bodies[a], self.model.bodies[b]
            if limit > 0.0:
                length = float(limit / normal_force)
                turn = self._turn(a, state, start.state, spins) - self._turn(b, state, start.state, spins)
                moving = min((x for x in (one, two) if not x.fixed), key=lambda body: body.size)
                torque = start.state.memory.rolling_torque.get((a, b), np.zeros(3))
                law = start.rolling(length, normal_force, 0.5 * moving.size, moving.mass)
                out.append(resisting_torque((a, b), length, law, torque, turn, start.seconds))
        return tuple(out)

    def _turn(self, index: int, state: State, before: State, spins: Mapping[int, Spin]) -> NDArray[np.float64]:
        """Rotation vector of a body since the start of the step [rad], shape (3,)."""
        if index in spins:
            nodes = spins[index].nodes
            return spins[index].turn(state.x[nodes] - before.x[nodes])
        if index in self.soft_of:
            return np.zeros(3)
        return turn_between(before.rotation[index], state.rotation[index])

    def _bonded(self, bond: BondedPair, state: State) -> PairPoints:
        """The points of a bond in the form of a pair's active points."""
        count = len(bond.stiffness)
        return PairPoints(
            a=bond.a.body,
            b=bond.b.body,
            position=bond.a.position(self.model, state),
            force=bond.force(self.model, state),
            tangent=bond.stiffness[:, None, None] * np.tile(np.eye(3), (count, 1, 1)),
            node=np.concatenate([bond.a.node, bond.b.node], axis=1),
            weight=np.concatenate([bond.a.weight, -bond.b.weight], axis=1),
        )

    def _spins(self, involved: frozenset[int], state: State) -> dict[int, Spin]:
        """Spins of the free soft bodies that touch or are bonded."""
        out = {}
        for index, one in self.soft_of.items():
            if index in involved and not self.model.bodies[index].fixed:
                out[index] = Spin.of(one.nodes, self.soft.mass[one.nodes], state.x[one.nodes])
        return out
