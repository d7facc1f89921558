"""Removes energy from pairs of bodies that touch or are bonded, by exchanges between their rigid motions.

A dashpot along the contact's normals critically damps the bounce of one body on the other, and rolling resistance is a
torque of at most b N. Both vanish at rest.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from solver.arrays import Array
from solver.config import SolverConfig
from solver.contact.active import Pair
from solver.contact.bonds import BondedPair
from solver.contact.patch import contact_stiffness
from solver.mls.body import RigidMotion, SoftParticles
from solver.mls.rigid import RigidBodies
from solver.model.bodies import Body, Model, SoftBody
from solver.model.state import cross_matrix


@dataclass(frozen=True, eq=False, slots=True)
class Acting:
    """Interaction of two bodies, touching or bonded, in this step."""

    a: int
    b: int
    position: Array
    """Positions of the points [m], shape (k, 3)."""
    force: Array
    """Forces on a [N], shape (k, 3)."""
    direction: Array
    """Directions in which motion is damped: G^T n n^T G is summed over these unit vectors (k, j, 3) of each point."""
    load: Array
    """Weights of the points [N], shape (k,)."""
    rolling: float = 0.0
    """Length of the resisting torque [m]."""


class PairDamping:
    """Dashpots and rolling resistance of all pairs of bodies, taken implicitly."""

    def __init__(
        self, model: Model, soft: Mapping[int, SoftParticles], rigid: RigidBodies, pairs: Sequence[Pair],
        bonds: Sequence[BondedPair], config: SolverConfig,
    ) -> None:  # fmt: skip
        self.model, self.soft, self.rigid = model, soft, rigid
        self.coefficient = {
            (a, b): dashpot_coefficient(model, a, b, config) for a, b in {(min(p.key), max(p.key)) for p in pairs}
        }
        """Dashpot coefficient of a pair, lower index first [N s/m]."""
        for bond in bonds:
            key = min(bond.a.body, bond.b.body), max(bond.a.body, bond.b.body)
            self.coefficient[key] = bond_damping(bond, model, config)

    def damp(self, acting: Sequence[Acting], dt: float) -> None:
        """Apply dashpots and rolling resistance over dt [s] where bodies act on each other."""
        by_pair: dict[tuple[int, int], list[Acting]] = {}
        for one in acting:
            by_pair.setdefault((min(one.a, one.b), max(one.a, one.b)), []).append(one)
        for (a, b), some in by_pair.items():
            self._damp_pair(a, b, some, dt)

    def _motion(self, index: int) -> tuple[Array, Array, Array]:
        """Centre [m], velocity (V, w) and inverse mass (6, 6) of the rigid motion of a body; zero inverse mass for a
        fixed body."""
        if self.model.bodies[index].fixed:
            return np.zeros(3), np.zeros(6), np.zeros((6, 6))
        if index in self.rigid.index:
            inverse = np.asarray(np.linalg.inv(self.rigid.mass_matrix(index)), dtype=np.float64)
            return self.rigid.state.center[index], self.rigid.velocity(index), inverse
        motion: RigidMotion = self.soft[index].motion()
        inverse = np.zeros((6, 6))
        inverse[:3, :3] = np.eye(3) / motion.mass
        inverse[3:, 3:] = np.linalg.inv(motion.inertia)
        return motion.center, np.concatenate([motion.velocity, motion.spin]), inverse

    def _damp_pair(self, a: int, b: int, acting: list[Acting], dt: float) -> None:
        if self.model.bodies[a].fixed and self.model.bodies[b].fixed:
            return
        position = np.concatenate([one.position for one in acting])
        middle = position.mean(axis=0)
        drag = np.zeros((6, 6))
        load = rolling = 0.0
        for one in acting:
            G = np.concatenate(
                [np.tile(np.eye(3), (len(one.position), 1, 1)), -cross_matrix(one.position - middle)], axis=2
            )
            Gn = np.einsum("kjd,kde->kje", one.direction, G)
            drag += np.einsum("k,kja,kjb->ab", one.load, Gn, Gn)
            load += float(one.load.sum())
            rolling += float(one.load.sum()) * one.rolling
        if load <= 0.0:
            return
        drag *= dt * self.coefficient[a, b] / load
        mobility, before, moves = np.zeros((6, 6)), np.zeros(6), []
        for index, sign in ((a, 1.0), (b, -1.0)):
            center, velocity, inverse = self._motion(index)
            shift = np.eye(6)  # motion at the middle from the motion at the centre
            shift[:3, 3:] = -cross_matrix((middle - center)[None])[0]
            mobility += shift @ inverse @ shift.T
            before += sign * shift @ velocity
            moves.append((index, sign * inverse @ shift.T))
        after = np.linalg.solve(np.eye(6) + mobility @ drag, before)
        impulse = -drag @ after
        length = rolling / load
        spin = float(np.linalg.norm(after[3:]))
        if length > 0.0 and spin > 0.0:
            axis = after[3:] / spin
            stopping = spin / float(axis @ mobility[3:, 3:] @ axis)
            impulse[3:] -= min(dt * rolling, stopping) * axis
        for index, response in moves:
            if self.model.bodies[index].fixed:
                continue
            change = response @ impulse
            if index in self.rigid.index:
                self.rigid.set_velocity(index, self.rigid.velocity(index) + change)
            else:
                self.soft[index].add_rigid_motion(change)


def bond_damping(bond: BondedPair, model: Model, config: SolverConfig) -> float:
    """Critical damping [N s/m] of the lighter free body on the bond's springs."""
    free = [model.bodies[side.body].mass for side in (bond.a, bond.b) if not model.bodies[side.body].fixed]
    return 2.0 * config.damping_ratio * float(np.sqrt(bond.stiffness.sum() * min(free)))


def dashpot_coefficient(model: Model, first: int, second: int, config: SolverConfig) -> float:
    """Critical damping [N s/m] of a pair's bounce: 2 zeta sqrt(k m), k the Hertz stiffness of the lighter moving body
    on the softer of the two."""
    pair = model.bodies[first], model.bodies[second]
    free = [b for b in pair if not b.fixed]
    if not free:
        return 0.0
    mass = 1.0 / sum(1.0 / b.mass for b in free)
    lighter = min(free, key=lambda b: b.mass)
    young, poisson = min(softness(b) for b in pair if isinstance(b, SoftBody))
    stiffness = contact_stiffness(lighter.mass * model.gravity_strength, footprint_radius(lighter), young, poisson)
    return 2.0 * config.damping_ratio * float(np.sqrt(stiffness * mass))


def footprint_radius(body: Body) -> float:
    """A quarter of the sum of the horizontal sides [m]: the radius of a ball."""
    extent = np.ptp(body.vertices, axis=0)
    return 0.25 * float(extent[0] + extent[1])


def softness(body: SoftBody) -> tuple[float, float]:
    """Smallest Young's modulus [Pa] of a soft body and the Poisson ratio there."""
    at = int(np.argmin(body.interior.youngs_modulus))
    return float(body.interior.youngs_modulus[at]), float(min(body.interior.poisson_ratio[at], 0.49))
