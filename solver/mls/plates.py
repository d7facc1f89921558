"""Thin rigid bodies: material on one side does not feel what lies on the other (CPIC [H18, Sec. 5]).

Near a part of a body that is thinner than THIN cells every node and every particle is on one of its sides, the one
that its outward normal points to; a particle keeps its side as long as it is near. Beyond a rim there are no sides.
Between a particle and a node on opposite sides nothing is transferred; coming back from such a node the particle sees
its own velocity after an impact on the body, and the body takes the opposite impulse. Nodes on the particle's own side
touch the body as in coupling.py.

[H18] Hu et al.: A moving least squares material point method ... SIGGRAPH 2018.
"""

import numpy as np
from numpy.typing import NDArray

from solver.kernels.mls_distance import OPPOSED, PROBES, sides_at_nodes, sides_of_particles
from solver.mls.bodies import SoftBodies
from solver.mls.coupling import Coupling
from solver.mls.rigid import RigidBodies
from solver.model.bodies import Body, Model

Array = NDArray[np.float64]

THIN = 2.0  # cells; a thicker part keeps the supports of particles on its two sides, 1.5 cells each, nearly apart
ROUNDING = 1e-3  # of a spacing: distances are sampled in single precision
NEAR = 2.0  # cells around such a part where sides are told apart: more than a particle's support


def thin_bodies(model: Model, cell: float) -> list[int]:
    """Rigid bodies that meet a soft one and of which some part is thinner than THIN cells."""
    return [i for i, _ in model.rigid_bodies if meets_soft(model, i, cell) and has_thin_part(model.bodies[i], cell)]


def meets_soft(model: Model, index: int, cell: float) -> bool:
    """Whether a rigid body can touch something soft: one of the two moves, or they lie within NEAR cells."""
    body = model.bodies[index]
    low, high = body.vertices.min(axis=0), body.vertices.max(axis=0)
    for _, soft in model.soft_bodies:
        gap = np.maximum(soft.vertices.min(axis=0) - high, low - soft.vertices.max(axis=0)).max()
        if not (body.fixed and soft.fixed) or gap < NEAR * cell:
            return True
    return False


def has_thin_part(body: Body, cell: float) -> bool:
    """Whether the body ends within THIN cells beneath its surface, in a face opposite to that one: the rule by which
    the kernels tell where it has sides (lies_over_thin_part).

    Asked where its distance was sampled within half a spacing of the surface, so that every face answers, however few
    its triangles are: at a corner or an edge, where its points may all be, the normal leads aslant into the body.
    """
    grid = body.distance
    near = np.argwhere(np.abs(grid.values) <= (0.5 + ROUNDING) * grid.spacing)
    sample = grid.origin + grid.spacing * near
    normal = grid.outward(sample)
    surface = sample - grid.at(sample)[:, None] * normal
    thin, inside = np.zeros(len(normal), np.bool_), normal.any(axis=1)
    for k in range(PROBES):
        at = surface - (k + 1) / PROBES * THIN * cell * normal
        ends = inside & (body.distance.at(at) > 0.0)
        thin |= ends & ((body.distance.outward(at) * normal).sum(axis=1) < OPPOSED)
        inside &= ~ends
    return bool(thin.any())


class Plates:
    """The thin rigid bodies of a model; does nothing where the soft bodies are told that there are none."""

    def __init__(
        self, model: Model, soft: SoftBodies, rigid: RigidBodies, coupling: Coupling, index: list[int]
    ) -> None:
        self.model, self.soft, self.rigid, self.coupling = model, soft, rigid, coupling
        self.index = index if soft.thin else []
        count = max(len(self.index), 1)
        self.friction = np.zeros((count, len(soft.index), 2))
        for t, i in enumerate(self.index):
            self.friction[t] = coupling.friction[i]
        self.rows = np.zeros((count, 9))
        self.impulse = np.zeros((1, 6 * count))
        # 1 where material has been near both of two thin bodies
        self.met = np.zeros((count, count), dtype=np.int32)

    def find_sides(self) -> None:
        """Sides of all nodes and particles near thin bodies."""
        g, p = self.soft.grid, self.soft.particles
        self.soft.node_side[:] = 0.0
        for t, i in enumerate(self.index):
            frame, grid = self.coupling.frame(i), self.model.bodies[i].distance
            span = self.coupling.span(i, NEAR)
            if span is None:
                continue
            sides_at_nodes(
                t + 1.0, THIN * g.cell, g.cell, int(g.shape[1]), int(g.shape[2]), NEAR * g.cell, frame, span,
                grid.spacing, grid.values, self.soft.material, self.soft.node_side, self.met,
            )  # fmt: skip
            sides_of_particles(
                t + 1.0, THIN * g.cell, NEAR * g.cell, frame, grid.spacing, grid.values, p.x, p.side, self.met
            )

    def warnings(self) -> list[str]:
        """Pairs of thin bodies between which sides were mixed up."""
        names = [self.model.bodies[i].name for i in self.index]
        return [
            f"mls: {names[a]!r} and {names[b]!r}: material was within {NEAR:.0f} cells of thin parts of both, where "
            f"only the sides of {names[b]!r} are told apart: it may leak through {names[a]!r}; lower mls_cell"
            for a, b in np.argwhere(self.met).tolist()
        ]

    def motion(self) -> tuple[Array, Array, Array]:
        """Centres and velocities, friction, and an empty account of impulses per block of particles."""
        for t, i in enumerate(self.index):
            self.rows[t] = np.concatenate([self.rigid.state.center[i], self.rigid.velocity(i)])
        blocks = len(self.soft.grid.block) if self.index else 1
        self.impulse = np.zeros((blocks, 6 * len(self.rows)))
        return self.rows, self.friction, self.impulse

    def take_impulses(self) -> None:
        """Give the free thin bodies what particles behind them lost."""
        for t, i in enumerate(self.index):
            if not self.model.bodies[i].fixed:
                total = self.impulse[:, 6 * t : 6 * t + 6].sum(axis=0)
                change = np.linalg.solve(self.rigid.mass_matrix(i), total)
                self.rigid.set_velocity(i, self.rigid.velocity(i) + change)
