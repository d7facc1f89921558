"""The soft bodies on the grid: particles by group, their rigid motion, their surfaces."""

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from solver.kernels.mls_moments import (
    ANGULAR_MOMENTUM,
    ENERGY,
    FIRST_MOMENT,
    MASS,
    MOMENTUM,
    SECOND_MOMENT,
    SQUARED_SPEED,
    SUMS,
    move_group,
)
from solver.kernels.mls_transfers import material_at_nodes
from solver.mls.grid import Grid, ParticleArrays
from solver.mls.particles import BodyParticles, held, lattice_particles
from solver.model.bodies import Model
from solver.model.state import cross_matrix

Array = NDArray[np.float64]

NEAREST = 8  # particles whose affine maps carry a surface point: those of the cell around it
LEAST_MASS = 1e-9  # nodes with less than this share of a particle's mass carry no material


@dataclass(frozen=True, eq=False, slots=True)
class RigidMotion:
    """Mass-weighted best-fit rigid motion of some particles."""

    mass: float
    """[kg]."""
    center: Array
    """Centre of mass [m], shape (3,)."""
    velocity: Array
    """[m/s], shape (3,)."""
    spin: Array
    """Angular velocity [rad/s], shape (3,)."""
    inertia: Array
    """About the centre, the particles' affine part included [kg m^2], shape (3, 3)."""
    strain_motion_energy: float
    """Kinetic energy of the motion that is not rigid [J]."""

    @property
    def angular_momentum(self) -> Array:
        """About the centre [kg m^2/s], shape (3,)."""
        return np.asarray(self.inertia @ self.spin)


def motion_of(sums: Array, cell: float) -> RigidMotion:
    """Rigid motion from the moments of mls_moments.py; a rigid field has C = [w]x, which adds m h^2 / 2 to each
    principal inertia."""
    mass = float(sums[MASS])
    first, momentum, spin_momentum = (sums[k : k + 3] for k in (FIRST_MOMENT, MOMENTUM, ANGULAR_MOMENTUM))
    center, velocity = first / mass, momentum / mass
    xx, yy, zz, yz, zx, xy = sums[SECOND_MOMENT : SECOND_MOMENT + 6]
    second = np.array([[xx, xy, zx], [xy, yy, yz], [zx, yz, zz]])
    second -= mass * np.outer(center, center)
    inertia = (np.trace(second) + 0.5 * mass * cell**2) * np.eye(3) - second
    angular = spin_momentum - np.cross(center, momentum)
    spin = np.linalg.solve(inertia, angular)
    rest = float(sums[ENERGY] - 0.5 * mass * velocity @ velocity - 0.5 * spin @ angular)
    return RigidMotion(mass, center, velocity, spin, inertia, rest)


class SoftBodies:
    """All soft bodies of a model as particles on one grid; group 2 s is the soft part of the s-th one, 2 s + 1 its
    rigid core."""

    def __init__(self, model: Model, cell: float, *, thin: bool = False) -> None:
        self.model = model
        self.thin = thin
        self.bodies = dict(model.soft_bodies)
        self.index = list(self.bodies)
        clamped = [i for i in self.index if model.bodies[i].fixed]
        origin = model.bodies[clamped[0]].vertices.min(axis=0) if clamped else np.zeros(3)
        self.samples = [lattice_particles(self.bodies[i], cell, origin) for i in self.index]
        self.particles = _particles(model, self.samples)
        self.grid = Grid(cell, np.asarray(origin, dtype=np.float64))
        self.start = self.particles.x.copy()
        self.mass = self.particles.constant[:, 0].copy()
        self.part = self.particles.group // 2
        self.cores = [s for s, one in enumerate(self.samples) if one.core.any()]
        self.wave_speed = max(s.wave_speed for s in self.samples)
        self.least_mass = LEAST_MASS * float(np.median(self.mass))
        self._bind_surfaces()
        self.lay_out()

    def lay_out(self) -> None:
        """Fit the grid to the particles and renew everything that depends on it."""
        self.grid.lay_out(self.particles)
        self.sums = np.zeros((len(self.grid.block), SUMS))
        self.held = np.zeros(len(self.grid.node), dtype=np.uint8)
        self.node_side = np.zeros((len(self.grid.node) if self.thin else 1, 4))
        self.locate_material()
        points = None
        for i in self.index:
            soft = self.bodies[i].interior
            if not self.bodies[i].fixed:
                continue
            points = self.grid.points() if points is None else points
            reach = 2.0 * self.grid.cell
            low, high = (np.array([p[end] for p in soft.planes]) for end in (0, -1))
            near = np.flatnonzero(((points > low - reach) & (points < high + reach)).all(axis=1))
            self.held[near[held(soft, points[near], self.grid.cell)]] = 1
        for group in np.unique(self.grid.block_group):
            self.move(int(group), keep=1.0)  # fills the sums

    @property
    def fastest(self) -> float:
        """Largest speed of a particle [m/s]."""
        return float(np.sqrt(self.sums[:, SQUARED_SPEED].max()))

    def group_sums(self, group: int) -> Array:
        """Moments of one group, shape (20,); added block by block in their order."""
        return np.asarray(self.sums[self.grid.block_group == group].sum(axis=0))

    def motion(self, part: int) -> RigidMotion:
        """Rigid motion of the s-th soft body, core included."""
        return motion_of(self.group_sums(2 * part) + self.group_sums(2 * part + 1), self.grid.cell)

    def is_fixed(self, part: int) -> bool:
        """Whether the s-th soft body is clamped."""
        return self.model.bodies[self.index[part]].fixed

    def move(
        self, group: int, *, keep: float, old: RigidMotion | None = None, velocity: Array | None = None,
        spin: Array | None = None,
    ) -> None:  # fmt: skip
        """Keep a share of a group's motion relative to the rigid motion `old` (None: rest) and give it a new one."""
        rows = np.zeros((5, 3))
        if old is not None:
            rows[0], rows[1], rows[2] = old.center, old.velocity, old.spin
            rows[3] = old.velocity if velocity is None else velocity
            rows[4] = old.spin if spin is None else spin
        p, g = self.particles, self.grid
        move_group(
            group, g.cell, keep, rows, g.block, g.block_group, p.x, p.v, p.C, p.constant, self.sums
        )  # fmt: skip

    def make_rigid(self, group: int) -> None:
        """Replace a group's motion by its rigid part; momentum and angular momentum stay."""
        self.move(group, keep=0.0, old=motion_of(self.group_sums(group), self.grid.cell))

    def node_material(self, part: int) -> Array:
        """First moment [kg m] and mass [kg] that the s-th soft body brings to each node, shape (n, 4)."""
        p, g = self.particles, self.grid
        material = np.zeros((len(g.node), 4))
        for pencils in g.colours:
            material_at_nodes(
                self.thin,
                p.side,
                self.node_side,
                part,
                *g.box,
                pencils,
                g.pencil_start,
                p.x,
                p.group,
                p.constant,
                material,
            )
        return material

    def locate_material(self) -> None:
        """Renew which soft body owns each node (the one with most mass there) and where its material lies."""
        self.owner = np.zeros(len(self.grid.node), dtype=np.int32)
        # first moment and mass per node of each soft body, shape (n, 4)
        self.shares = [self.node_material(part) for part in range(len(self.index))]
        self.material = self.shares[0].copy()
        for part, other in enumerate(self.shares[1:], start=1):
            more = other[:, 3] > self.material[:, 3]
            self.owner[more] = part
            self.material[more] = other[more]

    def touching_parts(self) -> set[tuple[int, int]]:
        """Pairs of soft bodies that share a node: they feel each other through the grid."""
        if len(self.index) < 2:
            return set()
        there = [share[:, 3] > self.least_mass for share in self.shares]
        return {(a, b) for a, b in combinations(range(len(there)), 2) if (there[a] & there[b]).any()}

    def add_rigid_motion(self, part: int, impulse: Array) -> None:
        """Add (V, w) increments, shape (6,), to the s-th soft body as a whole."""
        motion = self.motion(part)
        for group in (2 * part, 2 * part + 1):
            if (self.grid.block_group == group).any():
                self.move(group, keep=1.0, old=motion, velocity=motion.velocity + impulse[:3],
                          spin=motion.spin + impulse[3:])  # fmt: skip

    def inverse_mass(self, part: int, point: Array) -> Array:
        """(V, w) increments per impulse and moment, both at `point`, shape (6, 6); zero for a clamped body."""
        if self.is_fixed(part):
            return np.zeros((6, 6))
        motion = self.motion(part)
        shift = np.eye(6)
        shift[:3, 3:] = -cross_matrix((point - motion.center)[None])[0]
        local = np.zeros((6, 6))
        local[:3, :3] = np.eye(3) / motion.mass
        local[3:, 3:] = np.linalg.inv(motion.inertia)
        return np.asarray(shift @ local @ shift.T)

    def velocity(self, part: int, point: Array) -> Array:
        """Rigid motion (V, w) as felt at `point`, shape (6,); zero for a clamped body."""
        if self.is_fixed(part):
            return np.zeros(6)
        motion = self.motion(part)
        return np.concatenate([motion.velocity + np.cross(motion.spin, point - motion.center), motion.spin])

    def _bind_surfaces(self) -> None:
        """Nearest particles and weights of every surface point, by inverse square of the distance."""
        self.bound = []
        for part, i in enumerate(self.index):
            mine = np.flatnonzero(self.part == part)
            count = min(NEAREST, len(mine))
            vertices = self.model.bodies[i].vertices
            gap, near = cKDTree(self.start[mine]).query(vertices, k=count)
            gap, near = gap.reshape(-1, count), near.reshape(-1, count)
            weight = 1.0 / (gap**2 + 1e-6 * self.grid.cell**2)
            arm = vertices[:, None] - self.start[mine][near]
            self.bound.append((mine[near], weight / weight.sum(axis=1, keepdims=True), arm))

    def surface(self, part: int) -> Array:
        """Deformed surface points x = sum_p w_p (x_p + F_p (X - X_p)) [m], shape (n, 3)."""
        near, weight, arm = self.bound[part]
        x = self.particles.given(self.particles.x)[near]
        F = self.particles.given(self.particles.F)[near].reshape(*near.shape, 3, 3)
        return np.asarray(np.einsum("vk,vki->vi", weight, x + np.einsum("vkij,vkj->vki", F, arm)))


def _particles(model: Model, samples: list[BodyParticles]) -> ParticleArrays:
    """Start state of all soft bodies."""
    x = np.concatenate([s.position for s in samples])
    v, C, group, constant = np.zeros_like(x), np.zeros((len(x), 9)), [], []
    first = 0
    for part, ((_, body), one) in enumerate(zip(model.soft_bodies, samples, strict=True)):
        count = len(one.position)
        mine = slice(first, first + count)
        if not body.fixed:
            center = one.mass @ one.position / one.mass.sum()
            v[mine] = body.velocity + np.cross(body.angular_velocity, one.position - center)
            C[mine] = cross_matrix(body.angular_velocity[None])[0].ravel()
        group.append(2 * part + one.core.astype(np.int32))
        share = np.full(count, 0.0 if body.interior.loaded else 1.0)
        constant.append(np.column_stack([one.mass, one.volume * one.mu, one.volume * one.lam, share]))
        first += count
    return ParticleArrays(
        x, v, C, np.tile(np.eye(3).ravel(), (len(x), 1)), np.concatenate(constant),
        np.concatenate(group).astype(np.int32), np.zeros((len(x), 5)), np.arange(len(x)),
    )  # fmt: skip
