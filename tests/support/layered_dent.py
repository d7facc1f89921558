"""Depth to which a ball or a disc presses flat bonded layers, by axisymmetric finite elements of its own.

A static solution that shares nothing with the drop but the law of its materials (docs/physics.md): bilinear rings with
2 x 2 points, the whole of the deformation gradient, Newton's method on the total energy. Layers lie level, are held at
the bottom and, where asked, around, and weigh nothing, as the scan of a bed at rest. The ball is smooth; friction
changes depths by less than 1 %. Under a disc displacements are small: linear elasticity.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csr_matrix
from scipy.sparse.linalg import spsolve

from dcap.arrays import Array
from solver.model.layers import Layers, split

GAUSS = 0.5 + np.array([-0.5, 0.5]) / 3.0**0.5
CONTACT = 1e9  # stiffness of the contact [Pa/m]: 10 kPa are 0.01 mm
STEP = 1e-30  # of complex differentiation
LARGER = 1e-6  # of central differences of exact first derivatives
STEPS, ITERATIONS, DONE = 4, 60, 1e-8
SECANTS = 12


@dataclass(frozen=True, slots=True)
class Layer:
    """One layer, with E and nu across it; isotropic where the others are None."""

    thickness: float
    """[m]."""
    youngs_modulus: float
    """[Pa]."""
    poisson_ratio: float
    along: tuple[float, float, float] | None = None
    """E_p [Pa], nu_p and G_t [Pa]."""


def constants(layer: Layer) -> Array:
    """mu, lambda, K_aa, K_aw, K_ww, k_d, k_s [Pa], shape (7,)."""
    e, nu = layer.youngs_modulus, layer.poisson_ratio
    along = layer.along or (e, nu, e / (2.0 * (1.0 + nu)))
    in_layers, in_plane, shear = (np.array([value]) for value in along)
    rest = Layers(in_layers, in_plane, shear, np.array([[0.0, 0.0, 1.0]]))
    mu, lam, added = split(np.array([e]), np.array([nu]), rest)
    return np.concatenate([mu, lam, added[0]])


def energy(f: Array, c: Array) -> Array:
    """Energy density of [dr'/dr, dr'/dz, dz'/dr, dz'/dz, r'/r] (n, 5) with constants (n, 7), shape (n,).

    R turns in the plane of r and z, so that tr(R^T F) there is the hypotenuse of the traces; layers lie level.
    """
    rr, rz, zr, zz, hoop = f.T
    plane = rr * zz - rz * zr
    turned = np.sqrt((rr + zz) ** 2 + (zr - rz) ** 2)
    apart = rr**2 + rz**2 + zr**2 + zz**2 - 2.0 * turned + 2.0 + (hoop - 1.0) ** 2
    along = np.sqrt(rr**2 + zr**2)
    area, wide = along + hoop - 2.0, plane / along - 1.0
    slip = (rr * rz + zr * zz) / along
    mu, lam, k_aa, k_aw, k_ww, k_d, k_s = c.T
    layers = k_aa * area**2 + 2.0 * k_aw * area * wide + k_ww * wide**2 + k_d * (along - hoop) ** 2 + k_s * slip**2
    return np.asarray(mu * apart + 0.5 * lam * (plane * hoop - 1.0) ** 2 + 0.5 * layers)


def slope(f: Array, c: Array) -> Array:
    """Derivative of the energy by complex steps, exact to rounding, shape (n, 5)."""
    columns = [energy(f + 1j * STEP * np.eye(5)[k], c).imag / STEP for k in range(5)]
    return np.stack(columns, axis=1)


def curvature(f: Array, c: Array) -> Array:
    """Second derivative, without its negative part, shape (n, 5, 5)."""
    found = np.stack([slope(f + LARGER * e, c) - slope(f - LARGER * e, c) for e in np.eye(5)], axis=2) / (2.0 * LARGER)
    value, vector = np.linalg.eigh(0.5 * (found + found.transpose(0, 2, 1)))
    return np.asarray(np.einsum("nij,nj,nkj->nik", vector, np.maximum(value, 0.0), vector))


class Rings:
    """A mesh of rings under the ball and its gradients at the Gauss points."""

    def __init__(self, layers: list[Layer], r: Array, fine: float, cell: float, *, held: bool) -> None:
        """`layers` from the top down, cut at the radii `r` [m]; cells of `cell` [m] down to a depth of `fine` [m];
        `held` also around."""
        self.r, radius = r, r[-1]
        depths = [0.0]
        for layer in layers:
            depths += (depths[-1] + layered_spacing(depths[-1], layer.thickness, fine, cell)).tolist()
        self.z = -np.array(depths)
        count = len(self.z)
        corner = np.array([[0, 0], [0, 1], [1, 0], [1, 1]])
        i, j = (a.ravel() for a in np.meshgrid(range(len(self.r) - 1), range(count - 1), indexing="ij"))
        self.cell = (i[:, None] + corner[:, 0]) * count + j[:, None] + corner[:, 1]
        bottoms = -np.cumsum([layer.thickness for layer in layers])
        middle = 0.5 * (self.z[j] + self.z[j + 1])
        owner = (middle[:, None] < bottoms).sum(axis=1)
        self.constants = np.repeat(np.stack([constants(layer) for layer in layers])[owner], 4, axis=0)
        self.place = np.stack(np.meshgrid(self.r, self.z, indexing="ij"), axis=-1).reshape(-1, 2)
        self.weight, self.gradient = self.at_points(i, j)
        fixed = (self.place[:, 1] <= self.z[-1] + 1e-12) | (held & (self.place[:, 0] >= radius - 1e-12))
        self.free = np.ones((len(self.place), 2), dtype=bool)
        self.free[fixed] = False
        self.free[self.place[:, 0] == 0.0, 0] = False
        self.top = np.flatnonzero(self.place[:, 1] == 0.0)
        edge = np.concatenate([[0.0], 0.5 * (self.r[1:] + self.r[:-1]), [radius]])
        self.top_area = np.pi * np.diff(edge**2)

    def at_points(self, i: NDArray[np.int64], j: NDArray[np.int64]) -> tuple[Array, csr_matrix]:
        """Volumes [m^3] (p,) of the points and the matrix (5 p, 2 n) from displacements to their gradients."""
        rows, columns, values, weights = [], [], [], []
        r0, dr, dz = self.r[i], self.r[i + 1] - self.r[i], self.z[j + 1] - self.z[j]
        for q, (s, t) in enumerate((s, t) for s in GAUSS for t in GAUSS):
            shape = np.array([(1 - s) * (1 - t), (1 - s) * t, s * (1 - t), s * t])
            by_s, by_t = np.array([t - 1, -t, 1 - t, t]), np.array([s - 1, 1 - s, -s, s])
            radius = r0 + s * dr
            weights.append(2.0 * np.pi * radius * dr * np.abs(dz) / 4.0)
            point = 4 * np.arange(len(i)) + q
            for k in range(4):
                node = self.cell[:, k]
                across = ((0, 0, by_s[k] / dr), (1, 0, by_t[k] / dz), (2, 1, by_s[k] / dr), (3, 1, by_t[k] / dz),
                          (4, 0, shape[k] / radius))  # fmt: skip
                for component, axis, value in across:
                    rows.append(5 * point + component)
                    columns.append(2 * node + axis)
                    values.append(value)
        entries = np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))
        shape_of = (20 * len(i), 2 * (len(self.r) * len(self.z)))
        return np.stack(weights, axis=1).ravel(), coo_matrix(entries, shape=shape_of).tocsr()

    def deformation(self, u: Array) -> Array:
        """At the points, shape (p, 5)."""
        return np.asarray((self.gradient @ u.ravel()).reshape(-1, 5) + np.array([1.0, 0.0, 0.0, 1.0, 1.0]))


def spaced(length: float, fine: float, cell: float, growth: float = 1.15) -> Array:
    """Planes from 0 to a length [m], `cell` apart up to `fine`, then growing."""
    places = [0.0]
    while places[-1] < length:
        step = cell if places[-1] < fine else (places[-1] - places[-2]) * growth
        places.append(places[-1] + step)
    return np.array(places) * (length / places[-1])


def layered_spacing(start: float, thickness: float, fine: float, cell: float) -> Array:
    """Planes through a layer that begins at a depth [m], without its top."""
    if start >= fine:
        return np.linspace(0.0, thickness, max(4, round(thickness / (8.0 * cell))) + 1)[1:]
    return spaced(thickness, fine - start, cell)[1:]


def relaxed(rings: Rings, u: Array, radius: float, lowest: float) -> tuple[Array, float]:
    """Displacement (n, 2) in balance under a ball [m] whose lowest point is at a height, and the load on it [N]."""
    middle = np.array([0.0, lowest + radius])

    def contact(u: Array) -> tuple[Array, Array]:
        away = rings.place[rings.top] + u[rings.top] - middle
        far = np.linalg.norm(away, axis=1)
        return np.maximum(radius - far, 0.0), away / far[:, None]

    def total(u: Array) -> float:
        gap, _ = contact(u)
        return float(rings.weight @ energy(rings.deformation(u), rings.constants)) + 0.5 * CONTACT * float(
            rings.top_area @ gap**2
        )

    free = np.flatnonzero(rings.free.ravel())
    carried = 0.0
    for _ in range(ITERATIONS):
        f = rings.deformation(u)
        gap, normal = contact(u)
        push = CONTACT * rings.top_area * gap
        force = rings.gradient.T @ (rings.weight[:, None] * slope(f, rings.constants)).ravel()
        at = (2 * rings.top[:, None] + [0, 1]).ravel()
        force[at] -= (push[:, None] * normal).ravel()
        carried = float(-(push * normal[:, 1]).sum())
        tangent = rings.weight[:, None, None] * curvature(f, rings.constants)
        p = np.arange(5 * len(f)).reshape(-1, 5)
        blocks = coo_matrix((tangent.ravel(), (np.repeat(p, 5, 1).ravel(), np.tile(p, (1, 5)).ravel()))).tocsr()
        matrix = rings.gradient.T @ blocks @ rings.gradient
        springs = CONTACT * (rings.top_area * (gap > 0.0))[:, None, None] * normal[:, :, None] * normal[:, None, :]
        n = 2 * rings.top[:, None] + [0, 1]
        matrix = (
            matrix
            + coo_matrix(
                (springs.ravel(), (np.repeat(n, 2, 1).ravel(), np.tile(n, (1, 2)).ravel())), shape=matrix.shape
            ).tocsr()
        )
        move = np.zeros(u.size)
        move[free] = -spsolve(matrix[free][:, free].tocsc(), force[free])
        if np.abs(move).max() < DONE:
            return u, carried
        share, before, fall = 1.0, total(u), float(force[free] @ move[free])
        while total(u + share * move.reshape(u.shape)) > before + 1e-4 * share * fall and share > 1e-4:
            share *= 0.5
        u = u + share * move.reshape(u.shape)
    raise AssertionError(f"not in balance after {ITERATIONS} iterations; last move {np.abs(move).max():g} m")


def dent(
    layers: list[Layer], outer: float, ball: float, load: float, *, guess: float, cell: float, held: bool
) -> float:
    """How deep a ball of a radius [m] goes under a load [N] into layers (top down) of an outer radius [m]: undeformed
    top minus its lowest point [m], by the secant method from about `guess` [m]."""
    fine = 2.0 * (ball * guess) ** 0.5
    rings = Rings(layers, spaced(outer, fine, cell), fine, cell, held=held)
    u = np.zeros((len(rings.place), 2))
    for share in np.linspace(0.0, 1.0, STEPS + 1)[1:]:
        u, carried = relaxed(rings, u, ball, -share * guess)
    deep, other = guess, (0.0, -load)
    for _ in range(SECANTS):
        off = carried - load
        if abs(off) < 1e-4 * load:
            return deep
        if off == other[1]:
            raise AssertionError(f"the ball carries {carried:g} N at {deep:g} m and at {other[0]:g} m")
        deep, other = deep - off * (deep - other[0]) / (off - other[1]), (deep, off)
        u, carried = relaxed(rings, u, ball, -deep)
    raise AssertionError(f"the ball carries {carried:g} of {load:g} N at {deep:g} m after {SECANTS} steps")


def disc_sink(
    layers: list[Layer], outer: float, disc: float, load: float, *, across: int, held: bool, stiff: bool
) -> float:
    """Mean depth [m] to which a disc of a radius [m] sinks under a load [N] into layers (top down) of about an outer
    radius [m], with `across` cells along its radius: it stays flat if it is `stiff`, else it presses evenly."""
    cell = disc / across
    r = [cell * step for step in range(2 * across + 1)]  # so that a node lies at its rim
    while r[-1] < outer:
        r.append(r[-1] + 1.15 * (r[-1] - r[-2]))
    rings = Rings(layers, np.array(r), 2.0 * disc, cell, held=held)
    f = rings.deformation(np.zeros((len(rings.place), 2)))
    tangent = rings.weight[:, None, None] * curvature(f, rings.constants)
    p = np.arange(5 * len(f)).reshape(-1, 5)
    blocks = coo_matrix((tangent.ravel(), (np.repeat(p, 5, 1).ravel(), np.tile(p, (1, 5)).ravel()))).tocsr()
    matrix = (rings.gradient.T @ blocks @ rings.gradient).tocsc()
    under = rings.top[rings.place[rings.top, 0] < disc + 0.5 * cell]
    z, free = 2 * under + 1, rings.free.copy()
    u = np.zeros(rings.place.size)
    if stiff:
        free[under, 1] = False
        u[z] = -1.0
        at = np.flatnonzero(free.ravel())
        u[at] = spsolve(matrix[at][:, at], -(matrix @ u)[at])
        return load / -float((matrix @ u)[z].sum())
    # an even pressure on hat functions of the radius: consistent nodal forces
    force, radius, step = np.zeros(u.size), rings.place[under, 0], np.diff(rings.place[under, 0])
    force[z[:-1]] -= step * (2.0 * radius[:-1] + radius[1:]) * load / (3.0 * disc**2)
    force[z[1:]] -= step * (radius[:-1] + 2.0 * radius[1:]) * load / (3.0 * disc**2)
    at = np.flatnonzero(free.ravel())
    u[at] = spsolve(matrix[at][:, at], force[at])
    return float(force @ u) / load
