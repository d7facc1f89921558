"""Particles on a uniform lattice, two per cell and axis, sorted into pencils of the grid.

In: soft bodies with any particles of their own. Out: new particles at half the cell size with the same mass and the
nearest given material, because a uniform grid with coarser particles than cells would tear.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from solver.errors import ModelError
from solver.model.bodies import CORE, HELD, Interior, SoftBody
from solver.model.soft import lame, locate, shape_values

PER_AXIS = 2  # particles per cell and axis: the least that quadratic B-splines integrate without gaps
LEAST_SHARE = 0.1  # parts of a lattice cell smaller than this share of it are left to their neighbours


@dataclass(frozen=True, eq=False, slots=True)
class BodyParticles:
    """One soft body as lattice particles in its start pose."""

    position: NDArray[np.float64]
    """[m], shape (p, 3)."""
    volume: NDArray[np.float64]
    """[m^3], shape (p,)."""
    mass: NDArray[np.float64]
    """[kg], shape (p,)."""
    mu: NDArray[np.float64]
    """Shear modulus [Pa], shape (p,); zero in a rigid core."""
    lam: NDArray[np.float64]
    """First Lame parameter [Pa], shape (p,); zero in a rigid core."""
    wave_speed: float
    """Largest speed of pressure waves [m/s]."""
    core: NDArray[np.bool_]
    """Particles of the rigid core, shape (p,)."""


def lattice_particles(body: SoftBody, cell: float, origin: NDArray[np.float64]) -> BodyParticles:
    """Lattice particles of a soft body, grid nodes at `origin` + multiples of `cell`.

    Raises ModelError where the cell is too large for it.

    A lattice cell that the surface cuts carries its inner share at that share's centroid; all volumes are then
    scaled to the volume of the given particles, and densities to their mass.
    """
    soft = body.interior
    spacing = cell / PER_AXIS
    # of a base, the surface may be the top alone
    low = np.minimum(body.vertices.min(axis=0), [planes[0] for planes in soft.planes])
    high = np.maximum(body.vertices.max(axis=0), [planes[-1] for planes in soft.planes])
    axes = [
        o + spacing * (np.arange(np.floor((a - o) / spacing), np.ceil((b - o) / spacing)) + 0.5)
        for a, b, o in zip(low, high, origin, strict=True)
    ]
    point = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    depth = -body.distance.at(point) / spacing
    share = np.clip(0.5 + depth, 0.0, 1.0)
    keep = share > LEAST_SHARE
    if not keep.any():
        raise ModelError(f"body {body.name!r}: no particle fits at a spacing of {1e3 * spacing:.3g} mm; lower mls_cell")
    point, share = point[keep], share[keep]
    point = point - 0.5 * spacing * (1.0 - share)[:, None] * body.distance.outward(point)
    volume = share * (soft.volume.sum() / share.sum())
    nearest = cKDTree(soft.position).query(point)[1]
    density, young, poisson = soft.density[nearest], soft.youngs_modulus[nearest], soft.poisson_ratio[nearest]
    mass = volume * density
    mass *= (soft.volume * soft.density).sum() / mass.sum()
    mu, lam = lame(young, poisson)
    core = indicator(soft, point, CORE) > 0.5
    speed = float(np.sqrt(((lam + 2.0 * mu) * volume / mass)[~core].max())) if not core.all() else 0.0
    return BodyParticles(point, volume, mass, np.where(core, 0.0, mu), np.where(core, 0.0, lam), speed, core)


def indicator(soft: Interior, point: NDArray[np.float64], state: int) -> NDArray[np.float64]:
    """1 where all nodes around a point have `state`, 0 where none has, trilinear between, shape (n,)."""
    mark = soft.node_state == state
    if not mark.any():
        return np.zeros(len(point))
    low, high = np.array([p[0] for p in soft.planes]), np.array([p[-1] for p in soft.planes])
    flat, local = locate(soft.planes, np.clip(point, low, high))
    corner = np.stack(np.unravel_index(flat, tuple(len(p) - 1 for p in soft.planes)), axis=1)
    around = np.stack([mark[tuple((corner + o).T)] for o in np.ndindex(2, 2, 2)], axis=1)
    return np.asarray((around * shape_values(local)).sum(axis=1), dtype=np.float64)


def held(soft: Interior, point: NDArray[np.float64], cell: float) -> NDArray[np.bool_]:
    """Points within half a cell of the held planes, or beyond them, shape (n,)."""
    shifts = 0.499 * cell * np.concatenate([np.zeros((1, 3)), np.eye(3), -np.eye(3)])
    full = 1.0 - 1e-6
    found = np.array([indicator(soft, point + shift, HELD) >= full for shift in shifts])
    return np.asarray(found.any(axis=0), dtype=np.bool_)
