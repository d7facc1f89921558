"""The background grid around all soft bodies, and the order of the particles on it.

The grid is a box of nodes at `origin` + multiples of the cell. It follows the particles: whenever one has left its
pencil by more than a cell, the box is drawn anew and the particles are sorted again, by pencil, group and cell. The
order, hence every sum, depends on the state alone and not on the number of threads.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from solver.errors import UnstableStep
from solver.kernels.mls_transfers import PENCIL

MARGIN = 4  # nodes around the particles' box: the stencil, a cell of motion, and one for the next
BLOCK = 128  # particles that are summed together
MOST_NODES = 30_000_000  # 1 GB of nodes; bodies so far apart no longer meet
COLOURS = 4


@dataclass(eq=False, slots=True)
class ParticleArrays:
    """All soft bodies' particles in the order of the grid."""

    x: NDArray[np.float64]
    """[m], shape (p, 3)."""
    v: NDArray[np.float64]
    """[m/s], shape (p, 3)."""
    C: NDArray[np.float64]
    """Affine velocity [1/s], row-major, shape (p, 9)."""
    F: NDArray[np.float64]
    """Deformation gradient, row-major, shape (p, 9)."""
    constant: NDArray[np.float64]
    """Mass [kg], V mu and V lambda [J], share of gravity that acts [-], shape (p, 4)."""
    group: NDArray[np.int32]
    """Group of each, shape (p,)."""
    side: NDArray[np.float64]
    """Side of a thin rigid body it is on: normal (3), the body's mark (0: none is near), distance, shape (p, 5)."""
    id: NDArray[np.int64]
    """Number of each in the start order, shape (p,)."""

    def sort(self, order: NDArray[np.int64]) -> None:
        """Reorder everything."""
        for name in ("x", "v", "C", "F", "constant", "group", "side", "id"):
            setattr(self, name, np.ascontiguousarray(getattr(self, name)[order]))

    def given(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Per-particle values in the start order."""
        out = np.empty_like(values)
        out[self.id] = values
        return out


@dataclass(eq=False, slots=True)
class Grid:
    """Nodes, and the particles' pencils and blocks on them."""

    cell: float
    """h [m]."""
    origin: NDArray[np.float64]
    """A node's position that all nodes are multiples of h away from [m], shape (3,)."""
    first: NDArray[np.int64] = field(default_factory=lambda: np.zeros(3, np.int64))
    """Index of node (0, 0, 0) in cells from the origin, shape (3,)."""
    shape: NDArray[np.int64] = field(default_factory=lambda: np.zeros(3, np.int64))
    """Nodes along x, y, z."""
    node: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 4)))
    """Velocity [m/s] (momentum before the update) and mass [kg], shape (n, 4), z fastest."""
    colours: list[NDArray[np.int32]] = field(default_factory=list)
    """Pencils of each colour."""
    pencil_start: NDArray[np.int32] = field(default_factory=lambda: np.zeros(1, np.int32))
    """First particle of each pencil, shape (q + 1,)."""
    block: NDArray[np.int32] = field(default_factory=lambda: np.zeros((0, 4), np.int32))
    """First particle, one past the last, first column along x and y, shape (b, 4)."""
    block_group: NDArray[np.int32] = field(default_factory=lambda: np.zeros(0, np.int32))
    """Group of each block, shape (b,)."""

    @property
    def low(self) -> NDArray[np.float64]:
        """Position of node (0, 0, 0) [m], shape (3,)."""
        return np.asarray(self.origin + self.cell * self.first)

    @property
    def box(self) -> tuple[float, float, float, float, int, int]:
        """h, position of node (0, 0, 0), nodes along y and z: what every kernel asks for."""
        x, y, z = (float(value) for value in self.low)
        return self.cell, x, y, z, int(self.shape[1]), int(self.shape[2])

    def points(self) -> NDArray[np.float64]:
        """Node positions [m], shape (n, 3)."""
        index = np.indices(tuple(self.shape)).reshape(3, -1).T
        return np.asarray(self.low + self.cell * index)

    def lay_out(self, particles: ParticleArrays) -> None:
        """Draw the box around the particles and sort them; raises UnstableStep for a box beyond all bounds."""
        base = np.floor((particles.x - self.origin) / self.cell - 0.5).astype(np.int64)
        self.first = base.min(axis=0) - MARGIN
        self.shape = base.max(axis=0) + 2 + MARGIN - self.first + 1
        count = int(self.shape.prod())
        if count > MOST_NODES:
            raise UnstableStep(
                f"the soft bodies have spread over {(self.cell * self.shape).round(2).tolist()} m: {count} nodes > "
                f"{MOST_NODES} at cells of {1e3 * self.cell:.3g} mm"
            )
        self.node = np.zeros((count, 4))
        base -= self.first
        columns = base[:, :2] // PENCIL
        wide = int(columns[:, 1].max()) + 1
        pencil = columns[:, 0] * wide + columns[:, 1]
        cell = (base[:, 0] * self.shape[1] + base[:, 1]) * self.shape[2] + base[:, 2]
        order = np.lexsort((particles.id, cell, particles.group, pencil))
        particles.sort(order)
        self._divide(pencil[order], particles.group, wide)

    def _divide(self, pencil: NDArray[np.int64], group: NDArray[np.int32], wide: int) -> None:
        """Pencils, their colours, and blocks of at most BLOCK particles of one group and pencil."""
        used, start = np.unique(pencil, return_index=True)
        self.pencil_start = np.append(start, len(pencil)).astype(np.int32)
        colour = 2 * ((used // wide) % 2) + (used % wide) % 2
        self.colours = [np.flatnonzero(colour == c).astype(np.int32) for c in range(COLOURS)]
        new = np.flatnonzero(np.diff(pencil, prepend=-1) | np.diff(group, prepend=-1))
        ends = np.append(new[1:], len(pencil))
        begin = np.concatenate([np.arange(a, b, BLOCK) for a, b in zip(new, ends, strict=True)])
        end = np.minimum(begin + BLOCK, ends[np.searchsorted(new, begin, side="right") - 1])
        corner = PENCIL * np.stack([pencil[begin] // wide, pencil[begin] % wide], axis=1)
        self.block = np.column_stack([begin, end, corner]).astype(np.int32)
        self.block_group = group[begin].astype(np.int32)
