"""All soft bodies of a model as one set of cells, nodes and particles.

Cells without material near a body's surface are filled with a very weak fictitious material (finite cell method [P07]):
it carries the displacement field smoothly past the surface, so that surface points and contact queries always lie in a
valid cell, and it gives nodes with only a sliver of material a bounded stiffness.

[P07] Parvizian, Duester, Rank: Finite cell method. Computational Mechanics 41, 2007.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from solver.errors import ModelError
from solver.model.bending import bending_relief, layered_relief
from solver.model.bodies import CORE, FREE, HELD, Interior, Model, SoftBody
from solver.model.layers import frames, split

FICTITIOUS_STIFFNESS = 1e-3  # alpha: adds less than 0.1 % to a body's stiffness, keeps the tangent's condition bounded
EXTENSION_CELLS = (
    1  # rings of fictitious cells around the surface: a point of another body is at most a few millimetres away
)
FULL_OCTANT = 0.999  # a particle with this share of its octant needs no fictitious partner


@dataclass(frozen=True, eq=False, slots=True)
class BodyGrid:
    """Position of one body's grid in the common arrays."""

    index: int
    """Index of the body in the model."""
    planes: tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]
    cell_id: NDArray[np.int32]
    """Global cell for each grid cell, -1 if there is none, shape (kx - 1, ky - 1, kz - 1)."""
    nodes: slice
    """Its nodes in the common arrays."""
    particles: slice
    """Its particles in the common arrays."""
    surface_node: NDArray[np.int32]
    """Nodes of the cell that contains each surface vertex, shape (n, 8)."""
    surface_weight: NDArray[np.float64]
    """Shape values of these nodes, shape (n, 8)."""
    near_surface: NDArray[np.int32]
    """Nodes of the cells at most one cell away from a surface vertex, where contact queries end, shape (k,)."""


@dataclass(frozen=True, eq=False, slots=True)
class SoftSystem:
    """Common arrays; cells c, nodes n, particles p (sorted by cell)."""

    bodies: tuple[BodyGrid, ...]
    rest: NDArray[np.float64]
    """Node reference positions [m], shape (n, 3)."""
    mass: NDArray[np.float64]
    """Lumped node masses [kg], shape (n,)."""
    held: NDArray[np.bool_]
    """Mask of the fixed nodes, shape (n,)."""
    core: NDArray[np.int32]
    """Model index of the body whose rigid core the node belongs to, -1 for none, shape (n,)."""
    gravity_share: NDArray[np.float64]
    """1 if the node's weight acts on the field, 0 for a loaded body, shape (n,)."""
    cell_node: NDArray[np.int32]
    """Nodes of each cell, local index 4 i + 2 j + k, shape (c, 8)."""
    cell_size: NDArray[np.float64]
    """Edge lengths [m], shape (c, 3)."""
    cell_start: NDArray[np.int32]
    """First particle of each cell, shape (c + 1,)."""
    node_cell: NDArray[np.int32]
    """Cells around each node by octant, -1 for none, shape (n, 8)."""
    neighbour: NDArray[np.int32]
    """27-point stencil, -1 for none, shape (n, 27)."""
    local: NDArray[np.float64]
    """Particle positions in their cell, 0..1, shape (p, 3)."""
    volume: NDArray[np.float64]
    """Effective volumes [m^3] (fictitious ones scaled by alpha), shape (p,)."""
    mu: NDArray[np.float64]
    """Shear modulus [Pa], of the isotropic part of a layered material, shape (p,)."""
    lam: NDArray[np.float64]
    """First Lame parameter [Pa], of the isotropic part of a layered material, shape (p,)."""
    added: NDArray[np.float64]
    """Additional constants of layers [Pa], solver/model/layers.py, shape (p, 5)."""
    frame: NDArray[np.float64]
    """Directions of the layers and their normal as columns of a rotation, stored by rows, shape (p, 9)."""
    layered: NDArray[np.int32]
    """Cells with layers, shape (k,)."""
    real: NDArray[np.bool_]
    """True for particles of material, False for fictitious ones, shape (p,)."""
    relief: NDArray[np.float64]
    """Relief of each cell in plate-like bending [N/m], solver/model/bending.py, shape (c, 9)."""


def lame(
    youngs_modulus: NDArray[np.float64], poisson_ratio: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lame parameters (mu, lambda) [Pa] from E [Pa] and nu."""
    mu = youngs_modulus / (2.0 * (1.0 + poisson_ratio))
    lam = youngs_modulus * poisson_ratio / ((1.0 + poisson_ratio) * (1.0 - 2.0 * poisson_ratio))
    return mu, lam


def build(model: Model) -> SoftSystem:
    """Lay out the cells, nodes and particles of all soft bodies of the model."""
    grids = [_LocalGrid.of(i, body, _padded(body.interior)) for i, body in model.soft_bodies]
    return _join(grids)


def _padded(soft: Interior) -> Interior:
    """Add planes beyond every side of the grid that is not entirely held, so that the field can extend past the
    surface."""
    planes, before, after = [], [], []
    for axis, p in enumerate(soft.planes):
        sides = [np.take(soft.node_state, end, axis=axis) for end in (0, -1)]
        low, high = (0 if (side == HELD).all() else EXTENSION_CELLS for side in sides)
        below = p[0] - (p[1] - p[0]) * np.arange(low, 0, -1)
        above = p[-1] + (p[-1] - p[-2]) * np.arange(1, high + 1)
        planes.append(np.concatenate([below, p, above]))
        before.append(low)
        after.append(high)
    state = np.pad(soft.node_state, list(zip(before, after, strict=True)), constant_values=FREE)
    return replace(soft, planes=(planes[0], planes[1], planes[2]), node_state=state)


@dataclass(frozen=True, eq=False, slots=True)
class _LocalGrid:
    """One body's arrays with local numbering."""

    index: int
    interior: Interior
    cell_id: NDArray[np.int32]
    cells: NDArray[np.int64]
    node_grid: NDArray[np.int64]
    node_id: NDArray[np.int32]
    particle_cell: NDArray[np.int64]
    local: NDArray[np.float64]
    volume: NDArray[np.float64]
    mu: NDArray[np.float64]
    lam: NDArray[np.float64]
    added: NDArray[np.float64]
    frame: NDArray[np.float64]
    mass: NDArray[np.float64]
    real: NDArray[np.bool_]
    surface_cell: NDArray[np.int64]
    surface_local: NDArray[np.float64]
    near_surface_cell: NDArray[np.int64]

    @classmethod
    def of(cls, index: int, body: SoftBody, soft: Interior) -> "_LocalGrid":
        shape = tuple(len(p) - 1 for p in soft.planes)
        flat, local = locate(soft.planes, soft.position)
        surface_flat, surface_local = locate(soft.planes, body.vertices)
        active = np.zeros(int(np.prod(shape)), dtype=bool)
        active[surface_flat] = True
        active = ndimage.binary_dilation(
            active.reshape(shape), structure=np.ones((3, 3, 3), dtype=bool), iterations=EXTENSION_CELLS
        ).ravel()
        near_surface = np.flatnonzero(active)
        active[flat] = True
        cells = np.flatnonzero(active)
        cell_id = np.full(len(active), -1, dtype=np.int32)
        cell_id[cells] = np.arange(len(cells), dtype=np.int32)
        node_grid, node_id = _nodes(cells, shape)
        mu, lam, added, frame = constants(soft)
        ghost_cell, ghost_local, ghost_volume = _fictitious(soft, cells, shape, flat, local)
        reference = int(np.argmin(soft.youngs_modulus))
        count = len(ghost_cell)
        return cls(
            index, soft, cell_id.reshape(shape), cells, node_grid, node_id,
            cell_id[np.concatenate([flat, ghost_cell])].astype(np.int64),
            np.concatenate([local, ghost_local]),
            np.concatenate([soft.volume, FICTITIOUS_STIFFNESS * ghost_volume]),
            np.concatenate([mu, np.full(count, mu[reference])]),
            np.concatenate([lam, np.full(count, lam[reference])]),
            np.concatenate([added, np.zeros((count, 5))]),
            np.concatenate([frame, np.tile(np.eye(3).ravel(), (count, 1))]),
            np.concatenate([soft.volume * soft.density, np.zeros(count)]),
            np.concatenate([np.ones(len(flat), dtype=bool), np.zeros(count, dtype=bool)]),
            cell_id[surface_flat].astype(np.int64), surface_local, cell_id[near_surface].astype(np.int64),
        )  # fmt: skip


def constants(
    soft: Interior,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """mu, lambda [Pa] (p,), additional constants of layers [Pa] (p, 5) and layer frames (p, 9) of the material
    points."""
    if soft.layers is None:
        count = len(soft.position)
        mu, lam = lame(soft.youngs_modulus, soft.poisson_ratio)
        return mu, lam, np.zeros((count, 5)), np.tile(np.eye(3).ravel(), (count, 1))
    mu, lam, added = split(soft.youngs_modulus, soft.poisson_ratio, soft.layers)
    return mu, lam, added, frames(soft.layers.normal).reshape(-1, 9)


def locate(
    planes: tuple[NDArray[np.float64], ...], points: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Flat grid cell and local coordinates (0..1) of points (n, 3); raises ModelError for a point outside the grid."""
    index = np.empty(points.shape, dtype=np.int64)
    local = np.empty(points.shape)
    for axis, p in enumerate(planes):
        slack = 1e-6 * (p[-1] - p[0])
        outside = (points[:, axis] < p[0] - slack) | (points[:, axis] > p[-1] + slack)
        if outside.any():
            worst = points[np.flatnonzero(outside)[0]]
            raise ModelError(f"point {worst.tolist()} lies outside of the grid [{p[0]}, {p[-1]}] on axis {axis}")
        index[:, axis] = np.clip(np.searchsorted(p, points[:, axis], side="right") - 1, 0, len(p) - 2)
        local[:, axis] = (points[:, axis] - p[index[:, axis]]) / np.diff(p)[index[:, axis]]
    shape = tuple(len(p) - 1 for p in planes)
    return np.ravel_multi_index(tuple(index.T), shape), np.clip(local, 0.0, 1.0)


def shape_values(local: NDArray[np.float64]) -> NDArray[np.float64]:
    """Trilinear shape values at local coordinates (n, 3), local node order 4 i + 2 j + k, shape (n, 8)."""
    low_high = np.stack([1.0 - local, local], axis=2)
    product = np.einsum("ni,nj,nk->nijk", low_high[:, 0], low_high[:, 1], low_high[:, 2])
    return np.asarray(product, dtype=np.float64).reshape(-1, 8)


def _nodes(cells: NDArray[np.int64], shape: tuple[int, ...]) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """Grid indices (n, 3) of the nodes that the cells use, and the node number per grid node (-1: unused)."""
    corner = np.stack(np.unravel_index(cells, shape), axis=1)
    node_shape = tuple(s + 1 for s in shape)
    used = np.zeros(node_shape, dtype=bool)
    for offset in np.ndindex(2, 2, 2):
        used[tuple((corner + offset).T)] = True
    grid = np.argwhere(used)
    number = np.full(node_shape, -1, dtype=np.int32)
    number[tuple(grid.T)] = np.arange(len(grid), dtype=np.int32)
    return grid, number


def _fictitious(
    soft: Interior,
    cells: NDArray[np.int64],
    shape: tuple[int, ...],
    flat: NDArray[np.int64],
    local: NDArray[np.float64],
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """Cell, local position and missing volume of the octants that are not filled by material."""
    sizes = np.stack(np.meshgrid(*[np.diff(p) for p in soft.planes], indexing="ij"), axis=-1).reshape(-1, 3)
    octant_volume = sizes.prod(axis=1) / 8.0
    octant = (local >= 0.5) @ np.array([4, 2, 1])
    filled = np.bincount(flat * 8 + octant, weights=soft.volume, minlength=8 * int(np.prod(shape)))
    every = (cells[:, None] * 8 + np.arange(8)).ravel()
    missing = octant_volume[every // 8] - filled[every]
    keep = missing > (1.0 - FULL_OCTANT) * octant_volume[every // 8]
    every, missing = every[keep], missing[keep]
    position = 0.25 + 0.5 * np.stack([(every % 8) // 4, (every % 4) // 2, every % 2], axis=1)
    return every // 8, position, missing


def _join(grids: list[_LocalGrid]) -> SoftSystem:
    """Number cells, nodes and particles consecutively; particles are sorted by cell (stable, so the order is
    reproducible)."""
    bodies, parts = [], []
    cell_offset = node_offset = particle_offset = 0
    for grid in grids:
        shape = grid.cell_id.shape
        corner = np.stack(np.unravel_index(grid.cells, shape), axis=1)
        cell_node = np.stack([grid.node_id[tuple((corner + o).T)] for o in np.ndindex(2, 2, 2)], axis=1) + node_offset
        order = np.argsort(grid.particle_cell, kind="stable")
        counts = np.bincount(grid.particle_cell, minlength=len(grid.cells))
        sizes = np.stack([np.diff(p)[corner[:, a]] for a, p in enumerate(grid.interior.planes)], axis=1)
        rest = np.stack([p[grid.node_grid[:, a]] for a, p in enumerate(grid.interior.planes)], axis=1)
        weights = shape_values(grid.local)
        node_of_particle = cell_node[grid.particle_cell] - node_offset
        mass = np.bincount(
            node_of_particle.ravel(), weights=(weights * grid.mass[:, None]).ravel(), minlength=len(rest)
        )
        state = grid.interior.node_state[tuple(grid.node_grid.T)]
        parts.append(
            {
                "rest": rest,
                "mass": mass,
                "held": state == HELD,
                "core": np.where(state == CORE, grid.index, -1).astype(np.int32),
                "gravity_share": np.full(len(rest), 0.0 if grid.interior.loaded else 1.0),
                "cell_node": cell_node.astype(np.int32),
                "cell_size": sizes,
                "count": counts,
                "node_cell": _around(grid.node_grid, grid.cell_id, np.ndindex(2, 2, 2), -1, cell_offset),
                "neighbour": _around(grid.node_grid, grid.node_id, np.ndindex(3, 3, 3), -1, node_offset),
                "local": grid.local[order],
                "volume": grid.volume[order],
                "mu": grid.mu[order],
                "lam": grid.lam[order],
                "added": grid.added[order],
                "frame": grid.frame[order],
                "real": grid.real[order],
            }
        )
        bodies.append(
            BodyGrid(
                grid.index,
                grid.interior.planes,
                np.where(grid.cell_id >= 0, grid.cell_id + cell_offset, -1).astype(np.int32),
                slice(node_offset, node_offset + len(rest)),
                slice(particle_offset, particle_offset + len(order)),
                cell_node[grid.surface_cell].astype(np.int32),
                shape_values(grid.surface_local),
                np.unique(cell_node[grid.near_surface_cell]).astype(np.int32),
            )
        )
        cell_offset += len(grid.cells)
        node_offset += len(rest)
        particle_offset += len(order)
    if not parts:
        return empty()
    joined = {k: np.concatenate([p[k] for p in parts]) for k in parts[0]}
    start = np.concatenate([[0], np.cumsum(joined.pop("count"))]).astype(np.int32)
    relief = bending_relief(
        joined["cell_size"], start, joined["local"], joined["volume"], joined["mu"], joined["lam"]
    )  # fmt: skip
    cell = np.repeat(np.arange(len(joined["cell_size"])), np.diff(start))
    layered = np.unique(cell[joined["added"].any(axis=1)]).astype(np.int32)
    if len(layered):
        relief[layered] = layered_relief(
            layered, joined["cell_size"], start, joined["local"], joined["volume"], joined["mu"], joined["lam"],
            joined["added"], joined["frame"],
        )  # fmt: skip
    return SoftSystem(bodies=tuple(bodies), cell_start=start, relief=relief, layered=layered, **joined)


def _around(
    grid: NDArray[np.int64], number: NDArray[np.int32], offsets: np.ndindex, shift: int, base: int
) -> NDArray[np.int32]:
    """Numbers found at grid + offset + shift, plus `base`; -1 outside or if there is none."""
    columns = []
    for offset in offsets:
        at = grid + offset + shift
        inside = np.asarray(((at >= 0) & (at < np.array(number.shape))).all(axis=1))
        found = np.where(inside, number[tuple(np.where(inside[:, None], at, 0).T)], -1)
        columns.append(np.where(found >= 0, found + base, -1))
    return np.stack(columns, axis=1).astype(np.int32)


def empty() -> SoftSystem:
    """A system without soft bodies."""
    none = np.zeros(0)
    return SoftSystem(
        bodies=(), rest=np.zeros((0, 3)), mass=none, held=none.astype(bool), core=none.astype(np.int32),
        gravity_share=none,
        cell_node=np.zeros((0, 8), np.int32), cell_size=np.zeros((0, 3)), cell_start=np.zeros(1, np.int32),
        node_cell=np.zeros((0, 8), np.int32), neighbour=np.zeros((0, 27), np.int32), local=np.zeros((0, 3)),
        volume=none, mu=none, lam=none, added=np.zeros((0, 5)), frame=np.zeros((0, 9)),
        layered=np.zeros(0, np.int32), real=none.astype(bool), relief=np.zeros((0, 9)),
    )  # fmt: skip
