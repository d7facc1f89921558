"""The elastic tangent of all soft bodies: warped cell stiffnesses on the 27-point stencil and their coarse product.

A cell's stiffness turns with the rotation of its particles, K = R K_rest R^T [M04]; strain is left out of it but where
it is large in a body that is held. It is rebuilt only when strain has changed visibly. A turn of a free body as a whole
is followed closely: a tangent that is late by an angle t resists the next turn with a stiffness of about E V t^2, which
costs iterations.

[M04] Mueller, Gross: Interactive virtual materials. Graphics Interface 2004.
"""

import numpy as np
from numpy.typing import NDArray

from solver.kernels import layers, sparse, tangents
from solver.model.soft import SoftSystem
from solver.model.state import State, best_rigid_motion, turn_between
from solver.tl.coarse import build_coarse

COARSE_REFRESH = 4.0  # the coarse product only preconditions: it may be later than the tangent by this factor
ORDINARY_RATIO = 1.5  # lambda / mu at nu = 0.3
STRAINED = 0.1  # a cell strained by more has its own tangent: the one at rest, turned, is then off by as much
TURN_REFRESH = 1e-3  # turn of a free body [rad] after which its tangent follows: E V t^2 is then far below its weight

Built = tuple[NDArray[np.float64], list[NDArray[np.float64]]]
"""Deformation gradients (p, 9) and rotations of the movable bodies at a rebuild."""


class ElasticTangent:
    """Work arrays of the tangent; `refresh` brings them up to a state."""

    def __init__(self, soft: SoftSystem, strain_refresh: float) -> None:
        self.soft = soft
        # late by a strain, the volumetric part is off by lambda / mu times as much as the shear part
        stiffest = float((soft.lam / soft.mu).max(initial=0.0))
        self.strain_refresh = strain_refresh * min(1.0, ORDINARY_RATIO / max(stiffest, 1e-30))
        # late by an angle t, layers of stiffness k resist their slip with k t^2 beside mu
        slip = float((soft.added.max(axis=1, initial=0.0) / soft.mu).max(initial=1.0))
        self.strain_refresh = min(self.strain_refresh, strain_refresh / np.sqrt(slip))
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
        """The same in half precision over a power of two for each row, near its own block, that keeps it in range."""
        self.sweep = np.zeros((len(soft.rest), 3), dtype=np.float32)
        """Room for the preconditioner's sweeps."""
        self.coarse = build_coarse(soft) if len(soft.bodies) else None
        self.movable = [k for k, b in enumerate(soft.bodies) if not soft.held[b.nodes].any()]
        self.clamped = [
            (int(b.cell_id[b.cell_id >= 0].min()), int(b.cell_id.max()) + 1)
            for k, b in enumerate(soft.bodies)
            if k not in self.movable
        ]
        """Cells of the bodies that cannot turn: only they get their own tangents where they are strained. A stress that
        turns with a body resists its spin in them."""
        self.built: Built | None = None
        """What the tangent was last rebuilt for."""
        self.coarse_built: Built | None = None
        self.turned: list[NDArray[np.float64]] = []
        """Rotations of the movable bodies that both have now."""

    def refresh(self, state: State, deformation: NDArray[np.float64]) -> None:
        """Follow strains and turns that have changed enough; `deformation` (p, 9) belongs to the state."""
        if len(deformation) == 0:
            return
        now = [self._turn(state, k) for k in self.movable]
        if self.built is None or self._strained(self.built, deformation, now) >= self.strain_refresh:
            self._turn_cells(state, deformation)
            self.built = deformation.copy(), now
            assert self.coarse is not None
            most = COARSE_REFRESH * self.strain_refresh
            if self.coarse_built is None or self._strained(self.coarse_built, deformation, now) >= most:
                self.coarse.refresh(self.cells.reshape(-1, 8, 8, 9))
                self.coarse_built, self.turned = self.built, now
        late = max((np.linalg.norm(turn_between(a, b)) for a, b in zip(self.turned, now, strict=True)), default=0.0)
        if late > TURN_REFRESH:
            self._turn_cells(state, deformation)
            assert self.coarse is not None
            for k, before, after in zip(self.movable, self.turned, now, strict=True):
                self.coarse.turn(k, after @ before.T)
            self.turned = now

    def _turn(self, state: State, body: int) -> NDArray[np.float64]:
        nodes = self.soft.bodies[body].nodes
        return best_rigid_motion(self.soft.rest[nodes], state.x[nodes], self.soft.mass[nodes])[0]

    def _strained(self, built: Built, deformation: NDArray[np.float64], now: list[NDArray[np.float64]]) -> float:
        """Largest change of an entry of a deformation gradient since then, turns of movable bodies taken out."""
        turns = dict(zip(self.movable, (b @ a.T for a, b in zip(built[1], now, strict=True)), strict=True))
        return max(
            float(
                sparse.largest_change(
                    b.particles.start, b.particles.stop, turns.get(k, np.eye(3)), built[0], deformation
                )
            )
            for k, b in enumerate(self.soft.bodies)
        )

    def _turn_cells(self, state: State, deformation: NDArray[np.float64]) -> None:
        s = self.soft
        tangents.turn_tangents(s.cell_start, s.volume, state.polar, self.rest_cells, self.cells)
        for first, last in self.clamped:
            tangents.strained_tangents(
                STRAINED, first, last, s.cell_size, s.cell_start, s.local, s.volume, s.mu, s.lam, deformation,
                state.polar, self.cells,
            )  # fmt: skip
        if len(s.layered):
            layers.add_layer_tangents(
                s.layered, s.cell_size, s.cell_start, s.local, s.volume, s.added, s.frame, deformation, self.cells
            )
        tangents.gather_tangents(s.node_cell, self.cells, self.stencil)
        self.unit[:] = np.ldexp(1.0, np.frexp(np.abs(self.stencil[:, 13]).max(axis=(1, 2)))[1])
        sparse.halve(self.stencil, self.unit, self.half)
