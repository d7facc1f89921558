"""One soft body as particles on its own grid.

The grid has the planes of the body's background grid, extended on every side, and moves with a free body as a whole, so
that fine cells stay where they are needed. Particles are those of the body's interior. They are sorted by pencils of
the grid; the order, hence every sum, depends only on the state and not on the number of threads.

Inertia against strain is scaled up until waves are slow enough for the intended step (selective mass scaling [O05]). A
free body is scaled by the same factor throughout, and keeps its true mass and weight as a whole. In a held body each
particle outside a rigid core is scaled for the cells around it, so that the large motions of coarse parts do not wait
for fine parts. The rest state depends on neither.

[O05] Olovsson, Simonsson, Unosson: Selective mass scaling for explicit finite element analyses. Int. J. Numer. Meth.
Engng. 63, 2005.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.spatial import cKDTree

from solver.arrays import Array
from solver.errors import UnstableStep
from solver.kernels import mls as kernels
from solver.kernels.mls import (
    ANGULAR_MOMENTUM,
    ENERGY,
    FIRST_MOMENT,
    INVERSIONS,
    MASS,
    MOMENTUM,
    PENCIL,
    SECOND_MOMENT,
    SQUARED_SPEED,
    STRAYS,
    SUMS,
)
from solver.model.bodies import CORE, HELD, SoftBody
from solver.model.soft import BodyGrid, SoftSystem, constants, locate, shape_values
from solver.model.state import cross_matrix, rotate
from solver.model.stress import corotated_stress, rotations, voigt
from solver.motion import MaterialState

MARGIN = 4  # planes beyond the outermost particles: the stencil, a cell of motion, and one more
BLOCK = 128  # number of particles that are summed together
MOST_NODES = 30_000_000  # 1 GB of nodes: beyond it the body has come apart
LEAST_MASS = 1e-9  # nodes with less than this share of a particle's mass carry no material
NEAREST = 8  # number of particles that carry a point: those of the cell around it
TURNING = 3.0  # factor by which an impulse moves a point more than its particles' masses imply, as they also turn [-]
SOFT, RIGID_CORE = 0, 1  # groups of particles


@dataclass(frozen=True, eq=False, slots=True)
class RigidMotion:
    """Mass-weighted best-fit rigid motion of some particles."""

    mass: float
    """Mass [kg]."""
    center: Array
    """Centre of mass [m], shape (3,)."""
    velocity: Array
    """Velocity of the centre of mass [m/s], shape (3,)."""
    spin: Array
    """Angular velocity [rad/s], shape (3,)."""
    inertia: Array
    """Inertia about the centre, including the particles' spread [kg m^2], shape (3, 3)."""
    strain_motion_energy: float
    """Kinetic energy of the non-rigid motion [J]."""

    @property
    def angular_momentum(self) -> Array:
        """Angular momentum about the centre [kg m^2/s], shape (3,)."""
        return np.asarray(self.inertia @ self.spin)

    @classmethod
    def of(cls, sums: Array) -> "RigidMotion":
        """The motion from the moments that kernels sum up."""
        mass = float(sums[MASS])
        first, momentum, spin_momentum = (sums[k : k + 3] for k in (FIRST_MOMENT, MOMENTUM, ANGULAR_MOMENTUM))
        center, velocity = first / mass, momentum / mass
        xx, yy, zz, yz, zx, xy = sums[SECOND_MOMENT : SECOND_MOMENT + 6]
        second = np.array([[xx, xy, zx], [xy, yy, yz], [zx, yz, zz]]) - mass * np.outer(center, center)
        inertia = np.trace(second) * np.eye(3) - second
        angular = spin_momentum - np.cross(center, momentum)
        spin = np.linalg.solve(inertia, angular)
        rest = float(sums[ENERGY] - 0.5 * mass * velocity @ velocity - 0.5 * spin @ angular)
        return cls(mass, center, velocity, spin, inertia, rest)


class SoftParticles:
    """The particles of one soft body, and the nodes of its background grid as points carried by them."""

    def __init__(self, index: int, body: SoftBody, system: SoftSystem, grid: BodyGrid, crossing: float) -> None:
        """`crossing` is the shortest time in which waves may cross a cell [s]."""
        self.index, self.body, self.grid = index, body, grid
        soft = body.interior
        count = len(soft.position)
        mu, lam, self.added, self.layers = constants(soft)
        core = state_at(body, soft.position, CORE) > 0.5
        stiffness = lam + 2.0 * mu + np.abs(self.added).max(axis=1)
        speed = np.sqrt(stiffness / soft.density)
        self.cell = min(float(np.diff(p).min()) for p in soft.planes)
        """Smallest side of a cell [m]."""
        size = np.min([sizes(p, soft.position[:, a]) for a, p in enumerate(soft.planes)], axis=0)
        scale = np.maximum(1.0, (crossing * speed / size) ** 2)
        self.scale = float(scale[~core].max(initial=1.0))
        """Largest ratio of scaled to true inertia against strain [-]."""
        scale[core | (not body.fixed)] = self.scale
        self.wave_speed = float((speed / np.sqrt(scale))[~core].max(initial=0.0))
        mass = scale * soft.volume * soft.density
        share = np.zeros(count) if soft.loaded else 1.0 / scale
        filled = np.where(core, 0.0, soft.volume)
        self.layered = bool(self.added.any())
        self.constant = np.column_stack([mass, filled * mu, filled * lam, share, soft.volume])
        self.group = np.where(core, RIGID_CORE, SOFT).astype(np.int32)
        self.start, self.volume, self.mu, self.lam = soft.position.copy(), soft.volume, filled * mu, filled * lam
        arm = soft.position - mass @ soft.position / mass.sum()
        self.x = self.start.copy()
        self.u = np.zeros((count, 3)) if body.fixed else body.velocity + np.cross(body.angular_velocity, arm)
        spin = np.zeros((3, 3)) if body.fixed else cross_matrix(body.angular_velocity[None])[0]
        self.C = np.tile(spin, (count, 1, 1))
        self.F = np.tile(np.eye(3), (count, 1, 1))
        self.order = np.arange(count)
        self.center, self.start_center, self.rotation = body.center_of_mass.copy(), body.center_of_mass, np.eye(3)
        self.mass = float(soft.volume @ soft.density)
        self.least_mass = LEAST_MASS * float(np.median(mass))
        self.peak = 0.0
        """Largest kinetic energy of the strain motion since that motion was last removed [J], with scaled inertia."""
        self.highest = 0.0
        """The same since the last call of `highest_energy`."""
        self.pushed = np.zeros(6)
        """Impulse and its moment about the centre of mass in this step [N s], [N m s]."""
        self.lay_out()
        self._bind(system.rest[grid.nodes], soft.volume * soft.density)
        self.mobility, self.crowded_mobility = self._mobility(mass)

    @property
    def frame(self) -> Array:
        """Place of the grid in the form that kernels expect, shape (5, 3)."""
        return np.concatenate([np.stack([self.center, self.start_center]), self.rotation])

    def lay_out(self) -> None:
        """Extend the grid to contain the particles, sort them, and update everything that depends on it."""
        in_frame = (self.x - self.center) @ self.rotation + self.start_center
        planes = self.body.interior.planes
        ends = [
            extension(p, float(in_frame[:, axis].min()), float(in_frame[:, axis].max()))
            for axis, p in enumerate(planes)
        ]
        self.planes = [extended(p, *end) for p, end in zip(planes, ends, strict=True)]
        shape = tuple(len(p) for p in self.planes)
        if (nodes := int(np.prod(shape))) > MOST_NODES:
            raise UnstableStep(f"body {self.body.name!r} has come apart: {nodes} nodes > {MOST_NODES}")
        self.nodes = np.zeros((nodes, 4))
        state = np.pad(self.body.interior.node_state, ends, mode="edge")
        self.held = (state == HELD).ravel().astype(np.uint8)
        base = np.stack([numbers(p, in_frame[:, a]) - 0.5 for a, p in enumerate(self.planes)], axis=1).astype(np.int64)
        columns = base[:, :2] // PENCIL
        wide = int(columns[:, 1].max()) + 1
        pencil = columns[:, 0] * wide + columns[:, 1]
        cell = np.ravel_multi_index(tuple(base.T), shape)
        order = np.lexsort((self.order, cell, self.group, pencil))
        for name in ("x", "u", "C", "F", "constant", "added", "layers", "group", "order"):
            setattr(self, name, np.ascontiguousarray(getattr(self, name)[order]))
        self.place = np.empty(len(order), dtype=np.int32)
        self.place[self.order] = np.arange(len(order), dtype=np.int32)
        self._divide(pencil[order], wide)
        self.sums = np.zeros((len(self.block), SUMS))
        self.move(-1, keep=1.0)  # computes the sums

    def _divide(self, pencil: NDArray[np.int64], wide: int) -> None:
        """Determine the pencils, their colours, and blocks of at most BLOCK particles of one group and pencil."""
        used, start = np.unique(pencil, return_index=True)
        self.pencil_start = np.append(start, len(pencil)).astype(np.int32)
        colour = 2 * ((used // wide) % 2) + (used % wide) % 2
        self.colours = [np.flatnonzero(colour == c).astype(np.int32) for c in range(4)]
        new = np.flatnonzero(np.diff(pencil, prepend=-1) | np.diff(self.group, prepend=-1))
        ends = np.append(new[1:], len(pencil))
        begin = np.concatenate([np.arange(a, b, BLOCK) for a, b in zip(new, ends, strict=True)])
        end = np.minimum(begin + BLOCK, ends[np.searchsorted(new, begin, side="right") - 1])
        corner = PENCIL * np.stack([pencil[begin] // wide, pencil[begin] % wide], axis=1)
        self.block = np.column_stack([begin, end, corner]).astype(np.int32)
        self.block_group = self.group[begin]

    def _bind(self, points: Array, mass: Array) -> None:
        """Determine the particles and weights that carry the nodes of the background grid (n, 3): the nearest
        particles, by their mass over the squared distance."""
        gap, near = cKDTree(self.start).query(points, k=min(NEAREST, len(mass)))
        gap, near = gap.reshape(len(points), -1), near.reshape(len(points), -1)
        weight = mass[near] / (gap**2 + 1e-4 * gap.max(axis=1, keepdims=True) ** 2)
        self.points, self.near = points, near.astype(np.int32)
        self.weight = weight / weight.sum(axis=1, keepdims=True)

    def _mobility(self, mass: Array) -> tuple[Array, Array]:
        """Velocity of each surface point [m/s] for an impulse of 1 N s at that point, and for one at every surface
        point at once, shape (n,) each: contact is stable if stiffness times these times the squared step is small
        enough."""
        rows = np.repeat(np.arange(len(self.points)), self.near.shape[1])
        carried = sparse.csr_matrix(
            (self.weight.ravel(), (rows, self.near.ravel())), shape=(len(self.points), len(mass))
        )
        nodes = self.grid.surface_node - self.grid.nodes.start
        rows = np.repeat(np.arange(len(nodes)), nodes.shape[1])
        moved = sparse.csr_matrix(
            (self.grid.surface_weight.ravel(), (rows, nodes.ravel())), shape=(len(nodes), len(self.points))
        )
        shares = moved @ carried
        alone = np.asarray(shares.power(2) @ (1.0 / mass)).ravel()
        together = np.asarray(shares @ (np.asarray(shares.sum(axis=0)).ravel() / mass)).ravel()
        return TURNING * alone, TURNING * together

    def given(self, values: Array) -> Array:
        """Values per particle in the start order."""
        return np.asarray(values[self.place])

    @property
    def fastest(self) -> float:
        """Largest speed of any particle [m/s]."""
        return float(np.sqrt(self.sums[:, SQUARED_SPEED].max()))

    @property
    def inverted(self) -> int:
        """Number of particles with det F <= 0."""
        return int(self.sums[:, INVERSIONS].sum())

    def check(self, where: str) -> None:
        """Raise UnstableStep for a state that cannot be continued; sort again if particles have left their pencils."""
        total = self.sums.sum(axis=0)
        name = self.body.name
        if not np.isfinite(total).all():
            raise UnstableStep(f"{where}: body {name!r} holds values that are not finite; lower mls_cfl")
        if not self.body.fixed:
            motion = self.motion()
            speed = float(np.linalg.norm(motion.velocity) + 0.5 * self.body.size * np.linalg.norm(motion.spin))
        else:
            speed = 0.0
        if self.fastest > self.wave_speed + speed:
            raise UnstableStep(
                f"{where}: a particle of body {name!r} moves at {self.fastest:.3g} m/s, faster than its waves "
                f"({self.wave_speed:.3g} m/s); lower mls_cfl"
            )
        if total[STRAYS] > 0.0:
            self.lay_out()

    def step(self, dt: float, gravity: Array) -> None:
        """Advance velocities, positions and deformation by dt [s]."""
        if not self.body.fixed and self.scale > 1.0:
            motion = self.motion()
            weight = 0.0 if self.body.interior.loaded else dt * self.mass
            whole = np.concatenate(
                [(self.pushed[:3] + weight * gravity) / motion.mass, np.linalg.solve(motion.inertia, self.pushed[3:])]
            )
            self.add_rigid_motion((1.0 - 1.0 / self.scale) * whole)  # the particles will lack this share
        self.pushed[:] = 0.0
        kernels.clear(self.nodes)
        for pencils in self.colours:
            if len(pencils):
                kernels.particles_to_grid(
                    self.layered, dt, self.frame, *self.planes, pencils, self.pencil_start, self.x, self.u, self.C,
                    self.F, self.constant, self.added, self.layers, gravity, self.nodes,
                )  # fmt: skip
        kernels.momentum_to_velocity(self.least_mass, self.held, self.nodes)
        kernels.grid_to_particles(
            dt, self.frame, *self.planes, self.nodes, self.block, self.x, self.u, self.C, self.F, self.constant,
            self.sums,
        )  # fmt: skip
        if not self.body.fixed:
            motion = self.motion()
            self.center = self.center + dt * (motion.velocity + np.cross(motion.spin, self.center - motion.center))
            self.rotation = rotate(self.rotation, dt * motion.spin)

    def carry(self, chosen: NDArray[np.int32], out: Array) -> None:
        """Write the current positions of chosen nodes of the background grid into `out` [m], shape (n, 3)."""
        kernels.carry_points(chosen, self.near, self.weight, self.points, self.start, self.place, self.x, self.F, out)

    def push(self, chosen: NDArray[np.int32], impulse: Array, at: Array) -> None:
        """Distribute impulses [N s] (k, 3) to the particles that carry chosen nodes (k,), which are now at `at` (k,
        3)."""
        middle = self.sums[:, FIRST_MOMENT : FIRST_MOMENT + 3].sum(axis=0) / self.sums[:, MASS].sum()
        self.pushed += np.concatenate([impulse.sum(axis=0), np.cross(at - middle, impulse).sum(axis=0)])
        kernels.push_points(
            chosen, impulse, at, self.near, self.weight, self.place, self.frame, *self.planes, self.x, self.u, self.C,
            self.constant,
        )  # fmt: skip

    def motion(self, group: int | None = None) -> RigidMotion:
        """Rigid motion of a free body, or of one group of particles."""
        chosen = slice(None) if group is None else self.block_group == group
        return RigidMotion.of(self.sums[chosen].sum(axis=0) / self.scale)

    def move(
        self, group: int, *, keep: float, old: RigidMotion | None = None, velocity: Array | None = None,
        spin: Array | None = None,
    ) -> None:  # fmt: skip
        """Keep a share of a group's motion (-1: of all particles) relative to the rigid motion `old` (None: rest) and
        add a new rigid motion."""
        rows = np.zeros((5, 3))
        if old is not None:
            rows[0], rows[1], rows[2] = old.center, old.velocity, old.spin
            rows[3] = old.velocity if velocity is None else velocity
            rows[4] = old.spin if spin is None else spin
        kernels.move_group(
            group, keep, rows, self.frame, *self.planes, self.block, self.block_group, self.x, self.u, self.C,
            self.constant, self.sums,
        )  # fmt: skip

    def damp_strain(self, drop: float) -> None:
        """Kinetic damping: once the energy of the non-rigid motion is a share `drop` below its peak, the body has
        passed its equilibrium, and that motion is removed."""
        motion = None if self.body.fixed else self.motion()
        energy = float(self.sums[:, ENERGY].sum()) if motion is None else self.scale * motion.strain_motion_energy
        self.highest = max(self.highest, energy)
        if energy < (1.0 - drop) * self.peak:
            self.move(-1, keep=0.0, old=motion)
            self.peak = 0.0
        else:
            self.peak = max(self.peak, energy)

    def stiffen_core(self) -> None:
        """Make a rigid core move as a whole: its particles take their common rigid motion."""
        if (self.group == RIGID_CORE).any():
            self.move(RIGID_CORE, keep=0.0, old=self.motion(RIGID_CORE))

    def highest_energy(self) -> float:
        """Largest kinetic energy of the strain motion since the previous call [J], with scaled inertia."""
        highest, self.highest = self.highest, 0.0
        return highest

    def add_rigid_motion(self, increment: Array) -> None:
        """Add (V, w) increments about the centre of mass, shape (6,)."""
        motion = self.motion()
        self.move(-1, keep=1.0, old=motion, velocity=motion.velocity + increment[:3], spin=motion.spin + increment[3:])

    def material(self) -> MaterialState:
        """Displacement and stress at the end; the unknown stress of a rigid core is given as zero."""
        x, F = self.given(self.x), self.given(self.F)
        J = np.linalg.det(F)
        sigma = voigt(corotated_stress(F, rotations(F), J, self.mu / self.volume, self.lam / self.volume))
        return MaterialState(self.start, x - self.start, self.volume, J, sigma)


def state_at(body: SoftBody, point: Array, state: int) -> Array:
    """1 where all nodes around a point have `state`, 0 where none has, trilinear in between, shape (n,)."""
    soft = body.interior
    mark = soft.node_state == state
    if not mark.any():
        return np.zeros(len(point))
    flat, local = locate(soft.planes, point)
    corner = np.stack(np.unravel_index(flat, tuple(len(p) - 1 for p in soft.planes)), axis=1)
    around = np.stack([mark[tuple((corner + o).T)] for o in np.ndindex(2, 2, 2)], axis=1)
    return np.asarray((around * shape_values(local)).sum(axis=1), dtype=np.float64)


def extension(planes: Array, low: float, high: float) -> tuple[int, int]:
    """Number of planes to add in front and behind, so that low and high lie MARGIN cells inside."""
    before = np.ceil(max(planes[0] - low, 0.0) / (planes[1] - planes[0]))
    behind = np.ceil(max(high - planes[-1], 0.0) / (planes[-1] - planes[-2]))
    return MARGIN + int(before), MARGIN + int(behind)


def extended(planes: Array, before: int, behind: int) -> Array:
    """Node planes with additional planes on both sides, at the spacing of the outermost ones."""
    low = planes[0] - (planes[1] - planes[0]) * np.arange(before, 0, -1)
    high = planes[-1] + (planes[-1] - planes[-2]) * np.arange(1, behind + 1)
    return np.concatenate([low, planes, high])


def numbers(planes: Array, place: Array) -> Array:
    """Plane indices of some places, linear between two planes."""
    return np.interp(place, planes, np.arange(len(planes)))


def sizes(planes: Array, place: Array) -> Array:
    """Smallest size among the cell at each place and its neighbours [m], within reach of a particle's stencil."""
    side = np.diff(planes)
    least = np.minimum(side, np.minimum(np.append(side[1:], np.inf), np.insert(side[:-1], 0, np.inf)))
    return np.asarray(least[np.clip(np.searchsorted(planes, place, side="right") - 1, 0, len(planes) - 2)])
