"""A coarse space for the conjugate gradients, and the contact points' part of the linear system.

Smoothing alone is slow in exactly the modes that matter here: a stiff light body that moves as a whole, a slab that
deforms under a ball. The coarse space contains them: trilinear functions on a lattice of few cells per axis over each
body's grid (they contain every rigid and affine motion) and the six motions of every frame. It is added to a smoother S
as a second level [T05, Sec. 3]: z = S r + P (P^T A P)^-1 P^T r, with the exact Galerkin product, contacts included.

[T05] Toselli, Widlund: Domain Decomposition Methods. Springer 2005.

The contact points' part of the linear system: J^T T J by products with J, which is sparse.
"""

from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, sparse
from scipy import sparse as sparse_matrices

from solver.arrays import Array
from solver.contact.active import Contacts
from solver.errors import UnstableStep
from solver.kernels import sparse as products
from solver.kernels import tangents
from solver.model.soft import BodyGrid, SoftSystem, shape_values
from solver.model.state import cross_matrix

CELLS_PER_AXIS = 4  # 125 lattice nodes: the dense solve stays far below the cost of one fine product
CELLS_PER_GRADED_AXIS = 6  # along a graded grid's longer axes: halves the iterations
GRADED = 1.5  # ratio of largest to smallest cell from which a grid counts as graded
LIFTS = (0.0, 1e-5, 1e-4, 1e-3, 1e-2)
"""Relative additions to the stiffness of rigid motions tried in turn [-]: single precision leaves up to 1e-5."""
SHIFT = 1e-10  # relative diagonal shift that keeps lattice nodes with hardly any material solvable


@dataclass(frozen=True, eq=False, slots=True)
class ContactMap:
    """J: displacement of each point's body relative to the other body, from displacements of nodes and frames."""

    nodes: sparse_matrices.csr_matrix
    """The node weights, equal for each direction, shape (k, n)."""
    frames: Array
    """The frames' part of J, shape (k, 3, 6 b)."""
    tangent: Array
    """T, force per relative displacement at each point, shape (k, 3, 3)."""

    @classmethod
    def of(cls, contacts: Contacts, nodes: int, place: dict[int, int], center: Array) -> "ContactMap":
        """The map of the points, from their own weights for nodes; `place` gives the frame of each rigid body, `center`
        (b, 3) the reference points of the frames [m]."""
        count = len(contacts.a)
        frames = np.zeros((count, 3, len(center), 6))
        for body, f in place.items():
            for which, sign in ((contacts.a, 1.0), (contacts.b, -1.0)):
                points = np.flatnonzero(which == body)
                frames[points, :, f, :3] += sign * np.eye(3)
                frames[points, :, f, 3:] -= sign * cross_matrix(contacts.position[points] - center[f])
        return cls(contacts.gather[:, :nodes], frames.reshape(count, 3, 6 * len(center)), contacts.tangent)

    def add_forces(self, force: Array, nodes: Array, frames: Array) -> None:
        """Add J^T f for forces f (k, 3) to those on nodes (n, 3) and frames (b, 6)."""
        if nodes.size:
            nodes += self.nodes.T @ force
        if frames.size:
            frames += np.tensordot(force, self.frames, axes=((0, 1), (0, 1))).reshape(frames.shape)

    def add_product(self, move: tuple[Array, Array], out: tuple[Array, Array]) -> None:
        """Add J^T T J times a motion of nodes (n, 3) and frames (b, 6)."""
        nodes, frames = move
        relative = self.nodes @ nodes if nodes.size else np.zeros((len(self.tangent), 3))
        if frames.size:
            relative += self.frames @ frames.ravel()
        self.add_forces(np.einsum("kij,kj->ki", self.tangent, relative), *out)

    def node_blocks(self) -> Array:
        """Diagonal blocks of J^T T J for each node, shape (n, 9)."""
        return np.asarray(self.nodes.multiply(self.nodes).T @ self.tangent.reshape(-1, 9))

    def of_frames(self) -> tuple[Array, Array]:
        """T J of the frames, shape (k, 3, 6 b), and J^T T J between frames, shape (6 b, 6 b)."""
        pushed = np.asarray(self.tangent @ self.frames)
        return pushed, np.asarray(np.tensordot(self.frames, pushed, axes=((0, 1), (0, 1))))


@dataclass(eq=False, slots=True)
class CoarseSpace:
    """Constant part: lattices and interpolation, built once."""

    prolong: sparse.csr_matrix
    """Scalar interpolation P from lattice nodes to fine nodes, zero rows for held and core nodes, shape (n, m)."""
    corner: NDArray[np.int32]
    """Lattice nodes around each node, shape (n, 8)."""
    value: NDArray[np.float64]
    """Their weights, zero for held and core nodes, shape (n, 8)."""
    rows: tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.float64]]
    """P^T by rows: starts, nodes and weights."""
    every: dict[int, sparse.csr_matrix]
    """P for all unknowns (displacements and frames), by number of frames."""
    inertia: sparse.csr_matrix
    """P^T M P, shape (m, m)."""
    ghost: sparse.csr_matrix
    """P^T G P, shape (m, m)."""
    cell_node: NDArray[np.int64]
    """Lattice nodes of each coarse cell, shape (C, 8)."""
    start: NDArray[np.int32]
    member: NDArray[np.int32]
    weight: NDArray[np.float64]
    """Coarse shape values at each fine cell's nodes, shape (c, 8, 8)."""
    blocks: NDArray[np.float64]
    body_nodes: list[slice]
    """Lattice nodes of each soft body."""
    body_cells: list[slice]
    """Coarse cells of each soft body."""
    stiffness: NDArray[np.float64]
    """P^T K P of the elastic tangent, shape (3 m, 3 m)."""

    def restrict(self, nodes: NDArray[np.float64]) -> NDArray[np.float64]:
        """P^T of node forces (n, 3), shape (m, 3)."""
        out = np.empty((self.count, 3))
        products.restrict(*self.rows, nodes, out)
        return out

    def all_unknowns(self, frames: int) -> sparse.csr_matrix:
        """P for displacements and the motions of frames, which are their own coarse unknowns."""
        if frames not in self.every:
            parts = [sparse.kron(self.prolong, sparse.eye(3)), *([sparse.eye(6 * frames)] if frames else [])]
            self.every[frames] = sparse.block_diag(parts, format="csr")
        return self.every[frames]

    @property
    def count(self) -> int:
        """Number of lattice nodes."""
        return int(self.prolong.shape[1])

    def refresh(self, body: int, cell_tangent: NDArray[np.float32]) -> None:
        """Recompute the elastic Galerkin product of one soft body from the fine cells' tangents (c, 8, 8, 9)."""
        cells, nodes = self.body_cells[body], self.body_nodes[body]
        blocks = self.blocks[cells]
        start = self.start[cells.start : cells.stop + 1]
        tangents.coarse_tangents(start, self.member, cell_tangent, self.weight, blocks)
        unknowns = 3 * (nodes.stop - nodes.start)
        local = np.maximum(self.cell_node[cells] - nodes.start, 0)  # a node without material has no entries
        place = 3 * local[:, :, None] + np.arange(3)
        at = (unknowns * place[:, :, None, :, None] + place[:, None, :, None, :]).ravel()
        total = np.bincount(at, weights=blocks.ravel(), minlength=unknowns**2).astype(np.float64)
        inside = slice(3 * nodes.start, 3 * nodes.stop)
        self.stiffness[inside, inside] = total.reshape(unknowns, unknowns)

    def turn(self, body: int, rotation: NDArray[np.float64]) -> None:
        """Rotate the elastic product of one soft body as a whole: R K_ab R^T per pair of lattice nodes."""
        nodes = self.body_nodes[body]
        at = slice(3 * nodes.start, 3 * nodes.stop)
        count = nodes.stop - nodes.start
        blocks = self.stiffness[at, at].reshape(count, 3, count, 3)
        turned = np.einsum("ij,ajbk,lk->aibl", rotation, blocks, rotation, optimize=True)
        self.stiffness[at, at] = turned.reshape(3 * count, 3 * count)


def build_coarse(soft: SoftSystem, ghost: sparse.csr_matrix) -> CoarseSpace:
    """Lay a lattice over every soft body."""
    node_rows, node_columns, node_values = [], [], []
    cell_node, members, weights = [], [], np.zeros((len(soft.cell_node), 8, 8))
    offset, ends, cell_ends = 0, [0], [0]
    free = ~(soft.held | (soft.core >= 0))
    for body in soft.bodies:
        planes, lattice_shape = _lattice(body)
        nodes = np.arange(body.nodes.start, body.nodes.stop)
        corner, local = _position(planes, soft.rest[nodes])
        index = _corners(corner, lattice_shape) + offset
        values = shape_values(local) * free[nodes][:, None]
        node_rows.append(np.repeat(nodes, 8))
        node_columns.append(index.ravel())
        node_values.append(values.ravel())
        fine = body.cell_id[body.cell_id >= 0]
        middle = soft.rest[soft.cell_node[fine]].mean(axis=1)
        home, _ = _position(planes, middle)
        low = np.stack([p[home[:, a]] for a, p in enumerate(planes)], axis=1)
        size = np.stack([np.diff(p)[home[:, a]] for a, p in enumerate(planes)], axis=1)
        inside = (soft.rest[soft.cell_node[fine]] - low[:, None]) / size[:, None]
        weights[fine] = shape_values(inside.reshape(-1, 3)).reshape(-1, 8, 8) * free[soft.cell_node[fine]][:, :, None]
        used, group = np.unique(
            np.ravel_multi_index(tuple(home.T), tuple(s - 1 for s in lattice_shape)), return_inverse=True
        )
        cell_node.append(
            _corners(np.stack(np.unravel_index(used, tuple(s - 1 for s in lattice_shape)), axis=1), lattice_shape)
            + offset
        )
        members += [fine[group == g] for g in range(len(used))]
        offset += int(np.prod(lattice_shape))
        ends.append(offset)
        cell_ends.append(len(members))
    prolong = sparse.csr_matrix(
        (np.concatenate(node_values), (np.concatenate(node_rows), np.concatenate(node_columns))),
        shape=(len(soft.rest), offset),
    )
    keep = np.flatnonzero(np.asarray(abs(prolong).sum(axis=0)).ravel() > 0.0)
    number = np.full(offset, 0)
    corner, value = np.concatenate(node_columns).reshape(-1, 8), np.concatenate(node_values).reshape(-1, 8)
    number[keep] = np.arange(len(keep))
    ends = np.searchsorted(keep, ends).tolist()
    coarse_cells = number[np.concatenate(cell_node)]
    prolong = prolong[:, keep].tocsr()
    restrict = prolong.T.tocsr()
    restrict.sort_indices()
    inertia = (prolong.T @ sparse.diags(soft.mass) @ prolong).tocsr()
    counts = np.array([len(m) for m in members])
    return CoarseSpace(
        prolong,
        number[corner].astype(np.int32),
        value,
        (restrict.indptr.astype(np.int32), restrict.indices.astype(np.int32), restrict.data),
        {},
        inertia,
        (prolong.T @ ghost @ prolong).tocsr(),
        coarse_cells,
        np.concatenate([[0], np.cumsum(counts)]).astype(np.int32),
        np.concatenate(members).astype(np.int32),
        weights,
        np.zeros((len(members), 8, 8, 9)),
        [slice(a, b) for a, b in pairwise(ends)],
        [slice(a, b) for a, b in pairwise(cell_ends)],
        np.zeros((3 * len(keep), 3 * len(keep))),
    )


def _lattice(body: BodyGrid) -> tuple[list[NDArray[np.float64]], tuple[int, int, int]]:
    """Planes of the lattice over a body's grid, such that each fine cell lies in one coarse cell: equally spaced in the
    mean of plane index and position. By index alone the lattice would concentrate where cells are fine, by position
    alone where they are coarse; the slow modes are in between."""
    thin = int(np.argmin([p[-1] - p[0] for p in body.planes]))
    planes = []
    for axis, p in enumerate(body.planes):
        gaps = np.diff(p)
        cells = CELLS_PER_GRADED_AXIS if gaps.max() > GRADED * gaps.min() and axis != thin else CELLS_PER_AXIS
        where = 0.5 * np.linspace(0.0, 1.0, len(p)) + 0.5 * (p - p[0]) / (p[-1] - p[0])
        wanted = np.linspace(0.0, 1.0, min(len(gaps), cells) + 1)
        planes.append(p[np.unique(np.abs(where[:, None] - wanted).argmin(axis=0))])
    return planes, (len(planes[0]), len(planes[1]), len(planes[2]))


def _position(
    planes: list[NDArray[np.float64]], points: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Coarse cell (n, 3) and local coordinates (n, 3) of points."""
    index = np.stack(
        [np.clip(np.searchsorted(p, points[:, a], side="right") - 1, 0, len(p) - 2) for a, p in enumerate(planes)],
        axis=1,
    )
    low = np.stack([p[index[:, a]] for a, p in enumerate(planes)], axis=1)
    size = np.stack([np.diff(p)[index[:, a]] for a, p in enumerate(planes)], axis=1)
    return index, (points - low) / size


def _corners(index: NDArray[np.int64], shape: tuple[int, int, int]) -> NDArray[np.int64]:
    """Flat lattice nodes of coarse cells, local order 4 i + 2 j + k, shape (n, 8)."""
    return np.stack([np.ravel_multi_index(tuple((index + o).T), shape) for o in np.ndindex(2, 2, 2)], axis=1)


def factorised(matrix: NDArray[np.float64], frames: int) -> tuple[NDArray[np.float64], bool]:
    """Cholesky factor of a matrix given by its lower triangle, whose last 6 `frames` unknowns are rigid motions.

    Forces of a stiff core on the soft nodes around it come in single precision: cancellation between them and the
    core's own stiffness may leave a rigid motion slightly negative. Since the factor is only a preconditioner, such
    motions are then made stiffer, and if cells are so coarse that this does not help, everything. Raises UnstableStep
    if that does not help either.
    """
    split = len(matrix) - 6 * frames
    motions, everything = np.arange(split, len(matrix)), np.arange(len(matrix))
    for stiffened in (motions, everything):
        for lift in LIFTS:
            matrix[stiffened, stiffened] *= 1.0 + lift
            with suppress(linalg.LinAlgError):
                factor = linalg.cho_factor(matrix.T, lower=False, check_finite=False)
                return np.asarray(factor[0]), bool(factor[1])
    raise UnstableStep(
        f"the stiffness of the coarse lattice ({split // 3} nodes, {frames} moving frames) is not positive definite, "
        f"even after making all of it {LIFTS[-1]:.0%} larger"
    )


class CoarseSolve:
    """The factorised dense Galerkin matrix of one Newton step, stored as its lower triangle."""

    def __init__(
        self,
        space: CoarseSpace,
        contact: ContactMap,
        rolling: list[tuple[sparse.csr_matrix, NDArray[np.float64]]],
        frame_blocks: NDArray[np.float64],
        coupling: dict[int, NDArray[np.float64]],
        stiffness_scale: float,
        dt: float,
    ) -> None:
        """`rolling` (W, T): W^T T W over all unknowns is added to elasticity and inertia, like the contacts."""
        self.space = space
        m, frames = space.count, len(frame_blocks)
        matrix = np.zeros((3 * m + 6 * frames, 3 * m + 6 * frames))
        matrix[: 3 * m, : 3 * m] = stiffness_scale * space.stiffness
        inertia = (space.inertia / dt**2 + space.ghost).toarray()
        for axis in range(3):
            matrix[axis : 3 * m : 3, axis : 3 * m : 3] += inertia
        for f in range(frames):
            at = slice(3 * m + 6 * f, 3 * m + 6 * f + 6)
            matrix[at, at] += frame_blocks[f]
            if f in coupling:
                matrix[at, : 3 * m] += coupling[f].T
        self._add_contacts(contact, matrix)
        for jacobian, tangent in rolling:
            rows = (jacobian @ space.all_unknowns(frames)).toarray()
            matrix += rows.T @ tangent @ rows
        diagonal = np.diagonal(matrix)
        matrix[np.diag_indices(len(matrix))] += SHIFT * diagonal.max() + np.where(diagonal > 0.0, 0.0, 1.0)
        self.factor = factorised(matrix, frames)

    def _add_contacts(self, contact: ContactMap, matrix: NDArray[np.float64]) -> None:
        """Add P^T J^T T J P to the lower triangle."""
        if not len(contact.tangent):
            return
        rows = contact.nodes @ self.space.prolong
        columns = rows.T.tocsr()
        split = 3 * self.space.count
        products.add_contacts(
            columns.indptr, columns.indices, columns.data, rows.indptr, rows.indices, rows.data, contact.tangent, matrix
        )
        if contact.frames.size:
            pushed, own = contact.of_frames()
            matrix[split:, :split] += (columns @ pushed.reshape(len(pushed), -1)).reshape(split, -1).T
            matrix[split:, split:] += own

    def apply(
        self, nodes: NDArray[np.float64], frames: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(P^T A P)^-1 P^T of a residual: motions of the lattice nodes (m, 3) and of the frames (b, 6)."""
        right = np.concatenate([self.space.restrict(nodes).ravel(), frames.ravel()])
        y = linalg.cho_solve(self.factor, right, check_finite=False)
        split = 3 * self.space.count
        return y[:split].reshape(-1, 3), y[split:].reshape(-1, 6)
