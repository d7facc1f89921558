"""Elastic forces of all soft bodies, and their tangent on the 27-point stencil and its coarse product.

A cell's stiffness turns with the rotation of its particles, K = R K_rest R^T [M04]; strain is neglected except where it
is large in a held body. It is rebuilt only when strain has changed visibly. A turn of a free body as a whole is
followed closely: a tangent that lags by an angle t resists the next turn with a stiffness of about E V t^2, which costs
iterations.

[M04] Mueller, Gross: Interactive virtual materials. Graphics Interface 2004.

Elastic forces of all soft bodies and the drag of material damping, with the intermediate results of the kernels.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse as sparse_matrices

from solver.kernels import damping, elastic, layers, sparse, tangents
from solver.model.soft import BodyGrid, SoftSystem
from solver.model.state import State, best_rigid_motion, turn_between
from solver.tl.coarse import build_coarse

COARSE = 4.0  # the coarse product is only a preconditioner: it may lag more than the tangent by this factor
ORDINARY_RATIO = 1.5  # lambda / mu at nu = 0.3
STRAINED = 0.1  # a cell strained by more has its own tangent: the rotated rest tangent would be wrong by as much
NEARLY = 0.5  # of the limit of change: cells that have changed by this much are rebuilt together with others
TURN_REFRESH = 1e-3  # turn of a free body [rad] after which its tangent is rebuilt: E V t^2 is far below its weight


@dataclass(eq=False, slots=True)
class BodyTangent:
    """One soft body's part of the work arrays, and the state to which it belongs."""

    grid: BodyGrid
    cells: slice
    layered: NDArray[np.int32]
    """Its cells with layers."""
    movable: bool
    strain_refresh: float
    """Change of an entry of a deformation gradient after which the tangent is rebuilt [-]."""
    built: NDArray[np.float64] | None = None
    """Rotation (3, 3) at the last rebuild."""
    coarse_built: NDArray[np.float64] | None = None
    """Rotation at the last rebuild of its coarse product."""
    turned: NDArray[np.float64] | None = None
    """Current rotation of the coarse product."""

    @classmethod
    def of(cls, soft: SoftSystem, grid: BodyGrid, strain_refresh: float) -> "BodyTangent":
        """The part of a body that is rebuilt at a change of strain [-] of an ordinary material."""
        inside = grid.cell_id[grid.cell_id >= 0]
        cells = slice(int(inside.min()), int(inside.max()) + 1)
        layered = soft.layered[(soft.layered >= cells.start) & (soft.layered < cells.stop)]
        mu, at = soft.mu[grid.particles], grid.particles
        # for a lag in strain, the error of the volumetric part is lambda / mu times that of the shear part
        stiffest = float((soft.lam[at] / mu).max())
        limit = strain_refresh * min(1.0, ORDINARY_RATIO / max(stiffest, 1e-30))
        # for a lag by an angle t, layers of stiffness k resist their slip with k t^2 in addition to mu
        slip = float((soft.added[at].max(axis=1) / mu).max(initial=1.0))
        movable = not soft.held[grid.nodes].any()
        return cls(grid, cells, layered, movable, min(limit, strain_refresh / np.sqrt(slip)))


class ElasticTangent:
    """Work arrays of the tangent; `refresh` updates them to a state."""

    def __init__(self, soft: SoftSystem, ghost: sparse_matrices.csr_matrix, strain_refresh: float) -> None:
        self.soft = soft
        self.ghost = ghost
        """Ghost penalty [N/m], ghost.py, shape (n, n)."""
        self.bodies = [BodyTangent.of(soft, grid, strain_refresh) for grid in soft.bodies]
        cells = len(soft.cell_node)
        self.cells = np.zeros((cells, 8, 8, 3, 3), dtype=np.float32)
        self.rest_cells = np.zeros((cells, 8, 8, 3, 3), dtype=np.float32)
        if cells:
            tangents.rest_tangents(
                soft.cell_size, soft.cell_start, soft.local, soft.volume, soft.mu, soft.lam, soft.relief,
                np.zeros((cells, 8, 3)), self.rest_cells,
            )  # fmt: skip
        self.stencil = np.zeros((len(soft.rest), 27, 3, 4), dtype=np.float32)
        """Rows of K on the 27 nodes around each node, by columns padded to four [N/m]."""
        self.half = np.zeros(self.stencil.shape, dtype=np.float16)
        self.unit = np.ones(len(soft.rest), dtype=np.float32)
        """The same in half precision, divided by a power of two for each row, near its own block, that keeps it in
        range."""
        self.sweep = np.zeros((len(soft.rest), 3), dtype=np.float32)
        """Buffer for the preconditioner's sweeps."""
        self.coarse = build_coarse(soft, ghost) if len(soft.bodies) else None
        self.built = np.zeros((len(soft.volume), 9))
        """Deformation gradients at the last rebuild of the bodies' tangents."""
        self.coarse_built = np.zeros((len(soft.volume), 9))
        """Deformation gradients at the last rebuild of their coarse products."""

    def refresh(self, state: State, deformation: NDArray[np.float64]) -> None:
        """Follow strains and turns that have changed enough; `deformation` (p, 9) belongs to the state."""
        for number, body in enumerate(self.bodies):
            self._follow(number, body, state, deformation)

    def _follow(self, number: int, body: BodyTangent, state: State, deformation: NDArray[np.float64]) -> None:
        assert self.coarse is not None
        now, limit = self._turn(state, body), body.strain_refresh
        turned = body.turned is not None and np.linalg.norm(turn_between(body.turned, now)) > TURN_REFRESH
        change = self._change(body, self.built, body.built, deformation, now)
        strained = change.max() >= limit
        if not turned and not strained:
            return
        late = np.full(len(change), True) if body.movable else change >= NEARLY * limit
        self._turn_cells(body, late, state, deformation)
        if strained:
            self._note(self.built, body, late, deformation)
            body.built = now
            if self._change(body, self.coarse_built, body.coarse_built, deformation, now).max() >= COARSE * limit:
                self.coarse.refresh(number, self.cells.reshape(-1, 8, 8, 9))
                self._note(self.coarse_built, body, np.full(len(change), True), deformation)
                body.coarse_built = body.turned = now
                return
        if turned and body.turned is not None:
            self.coarse.turn(number, now @ body.turned.T)
            body.turned = now

    def _turn(self, state: State, body: BodyTangent) -> NDArray[np.float64]:
        if not body.movable:
            return np.eye(3)
        nodes = body.grid.nodes
        return best_rigid_motion(self.soft.rest[nodes], state.x[nodes], self.soft.mass[nodes])[0]

    def _starts(self, body: BodyTangent) -> NDArray[np.int32]:
        """First particle of each of the body's cells, and one past the last."""
        return self.soft.cell_start[body.cells.start : body.cells.stop + 1]

    def _change(
        self,
        body: BodyTangent,
        built: NDArray[np.float64],
        before: NDArray[np.float64] | None,
        deformation: NDArray[np.float64],
        now: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        """Largest change of an entry of a deformation gradient in each of the body's cells since `built`, when the body
        had turned by `before`, with its turn since then removed; infinite before the first build."""
        change = np.full(body.cells.stop - body.cells.start, np.inf)
        if before is not None:
            sparse.changes(self._starts(body), now @ before.T, built, deformation, change)
        return change

    def _note(
        self, built: NDArray[np.float64], body: BodyTangent, late: NDArray[np.bool_], deformation: NDArray[np.float64]
    ) -> None:
        """Record the deformation for which the cells that were `late` have been rebuilt."""
        at = body.grid.particles
        particles = np.repeat(late, np.diff(self._starts(body)))
        built[at][particles] = deformation[at][particles]

    def _turn_cells(
        self, body: BodyTangent, late: NDArray[np.bool_], state: State, deformation: NDArray[np.float64]
    ) -> None:
        """Rebuild the tangents of those of the body's cells that are `late`, and the rows of their nodes."""
        s, cells, nodes = self.soft, body.cells, body.grid.nodes
        flag = late.astype(np.int32)
        tangents.turn_tangents(
            flag, self._starts(body), s.volume, state.polar, self.rest_cells[cells], self.cells[cells]
        )
        if not body.movable:  # stress that turns with a free body would resist its spin in the cells' own tangents
            tangents.strained_tangents(
                STRAINED, cells.start, flag, s.cell_size, s.cell_start, s.local, s.volume, s.mu, s.lam,
                deformation, state.polar, self.cells,
            )  # fmt: skip
        layered = body.layered[late[body.layered - cells.start]]
        if len(layered):
            layers.add_layer_tangents(
                layered, s.cell_size, s.cell_start, s.local, s.volume, s.added, s.frame, deformation, self.cells
            )
        around = s.node_cell[nodes]
        row = np.zeros(len(around), dtype=np.int32)
        changed = np.unique(s.cell_node[cells][late]) - nodes.start
        row[changed] = 1
        tangents.gather_tangents(row, around, self.cells, self.stencil[nodes])
        diagonal = self.stencil[nodes, 13][changed]
        self.unit[nodes][changed] = np.ldexp(1.0, np.frexp(np.abs(diagonal).max(axis=(1, 2)))[1])
        sparse.halve(row, self.stencil[nodes], self.unit[nodes], self.half[nodes])


@dataclass(frozen=True, eq=False, slots=True)
class StepStrain:
    """Strains at the start of a step, the reference for material damping."""

    rate: float
    """Damping beta over the step's length [-]."""
    stretch: NDArray[np.float64]
    """Stretch S of each particle, F = R S, shape (p, 9)."""
    modes: NDArray[np.float64]
    """Bending amplitudes of each cell, shape (c, 6)."""
    layers: NDArray[np.float64]
    """Measures of the layers at each particle, shape (p, 6)."""


class ElasticForces:
    """Forces in a state; keeps the particles' deformation of the last state."""

    def __init__(self, soft: SoftSystem, ghost: sparse_matrices.csr_matrix, material_damping: float) -> None:
        self.soft = soft
        self.ghost = ghost
        """Ghost penalty [N/m], ghost.py; it is not damped, as its drag would slow rotations, shape (n, n)."""
        self.damping = material_damping
        """Stiffness-proportional damping beta [s]."""
        cells, particles = len(soft.cell_node), len(soft.volume)
        self.cell_force = np.zeros((cells, 8, 3))
        self.place = np.zeros((0, 3))
        """Node positions to which the other arrays belong [m]."""
        self.polar = np.zeros((0, 9))
        """Rotations of the particles' polar decompositions."""
        self.deformation = np.zeros((particles, 9))
        self.volume_ratio = np.ones(particles)
        self.energy = np.zeros(particles)

    def forces(self, state: State, since: StepStrain | None = None) -> NDArray[np.float64]:
        """Elastic node forces [N], shape (n, 3), with the drag of material damping `since` the start of a step; updates
        the particles' deformation, rotation and energy."""
        f = np.zeros_like(state.x)
        if len(f):
            s = self.soft
            elastic.cell_forces(
                state.x, s.cell_node, s.cell_size, s.cell_start, s.local, s.volume, s.mu, s.lam, s.relief,
                state.polar,
                self.deformation, self.volume_ratio, self.energy, self.cell_force,
            )  # fmt: skip
            self.place, self.polar = state.x.copy(), state.polar
            if len(s.layered):
                layers.add_layer_forces(
                    s.layered, s.cell_size, s.cell_start, s.local, s.volume, s.added, s.frame, self.deformation,
                    self.energy, self.cell_force,
                )  # fmt: skip
            if since is not None:
                damping.add_drag(
                    since.rate, state.x, s.cell_node, s.cell_size, s.cell_start, s.local, s.volume, s.mu, s.lam,
                    s.relief, self.deformation, state.polar, since.stretch, since.modes, self.cell_force,
                )  # fmt: skip
            if since is not None and len(s.layered):
                layers.add_layer_drag(
                    since.rate, s.layered, s.cell_size, s.cell_start, s.local, s.volume, s.added, s.frame,
                    self.deformation, since.layers, self.cell_force,
                )  # fmt: skip
            elastic.gather_forces(s.node_cell, self.cell_force, f)
            f -= self.ghost @ state.x
        return f

    def evaluate(self, state: State) -> None:
        """Set the particles' deformation to that of a state, and the state's rotations to theirs."""
        if not np.array_equal(state.x, self.place):
            self.forces(state)
        elif state.polar is not self.polar:
            state.polar[:] = self.polar

    def strain(self, state: State, dt: float) -> StepStrain | None:
        """Reference for material damping in a step from this state; None without damping."""
        if self.damping == 0.0 or not len(state.x):
            return None
        self.evaluate(state)
        s = self.soft
        stretch, modes = np.empty_like(self.deformation), np.empty((len(s.cell_node), 6))
        damping.start_strains(state.x, s.cell_node, s.cell_size, self.deformation, state.polar, stretch, modes)
        measures = np.zeros((len(stretch), 6))
        layers.start_layers(s.layered, s.cell_start, s.frame, self.deformation, measures)
        return StepStrain(self.damping / dt, stretch, modes, measures)
