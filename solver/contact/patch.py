"""Predicts the contact of two bodies before the simulation: contact of an elastic half-space.

The gap between them is known on a regular grid in plan. The solution is pressures p >= 0 that carry the load, with the
gap closed where p > 0 and open elsewhere, with the deflection of a half-space under uniform pressure on rectangles
[L29, Sec. 3.1; J85, Eq. 3.25]; a constrained conjugate gradient finds them [P99]. No shape is assumed: lines, edges,
rings and feet come out as they are.

[J85] K. L. Johnson, Contact Mechanics, Cambridge University Press, 1985.
[L29] A. E. H. Love, The stress produced in a semi-infinite solid by pressure on part of the boundary, Phil. Trans. R.
Soc. A 228, 1929.
[P99] I. A. Polonsky, L. M. Keer, A numerical method for solving rough contact problems based on the multi-level
multi-summation and conjugate gradient techniques, Wear 231, 1999.

Closed-form estimates that choose a resolution before the simulation.

[J85] K. L. Johnson, Contact Mechanics, Cambridge University Press, 1985.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import fft, ndimage

from solver.arrays import Array

TOLERANCE = 1e-3  # change of the pressures in an iteration over the load [-]: precise enough to choose a resolution
MOST_ITERATIONS = 200
NARROW = 0.25  # half the width of a gap that is filled, over the radius of a disc as large as the patch [-]
IDLE = 0.05  # load on a place over the largest: a smaller load does not affect the depth [-]
LOADED = 1e-3  # of the largest pressure: lower pressures do not count as contact


@dataclass(frozen=True, eq=False)
class Patch:
    """A predicted contact."""

    pressure: Array
    """Pressure on the cells of the grid in plan [Pa], shape (nx, ny)."""
    spacing: tuple[float, float]
    """Size of the cells along x and y [m]."""
    approach: float
    """Approach of the bodies from first contact to rest [m]."""

    @property
    def touching(self) -> NDArray[np.bool_]:
        """Cells in contact, shape (nx, ny)."""
        return np.asarray(self.pressure > LOADED * self.pressure.max())

    @cached_property
    def region(self) -> NDArray[np.bool_]:
        """Mask of the loaded region, shape (nx, ny): a rough surface touches with its crests first, but the places
        between them are under the same load; separate places with a negligible load are left out."""
        radius = float(np.sqrt(self.touching.sum() * self.spacing[0] * self.spacing[1] / np.pi))
        near = self.touching
        for axis, spacing in enumerate(self.spacing):
            near = near | without_gaps(self.touching, axis, int(2.0 * NARROW * radius / spacing))
        label, count = ndimage.label(near, np.ones((3, 3)))
        load = np.bincount(label.ravel(), self.pressure.ravel(), count + 1)
        return np.asarray(near & (load[label] >= IDLE * load.max()))

    def half_widths(self, axis: int) -> Array:
        """Half the length of the run of contact through each row of cells along `axis`, averaged over the load [m],
        shape (n,): half the width of the region there; nan without contact."""
        touching, pressure = (np.moveaxis(one, axis, 0) for one in (self.region, self.pressure))
        run = np.zeros(touching.shape)
        for row in range(touching.shape[1]):
            label, count = ndimage.label(touching[:, row])
            if count:
                run[:, row] = np.bincount(label, minlength=count + 1)[label]
        load = np.where(touching, pressure, 0.0)
        total = load.sum(axis=1)
        with np.errstate(invalid="ignore"):
            return np.asarray(0.5 * self.spacing[axis] * (load * run).sum(axis=1) / total)


def without_gaps(mask: NDArray[np.bool_], axis: int, cells: int) -> NDArray[np.bool_]:
    """A mask in which gaps of at most `cells` cells along an axis are filled; no run gets longer at its own ends."""
    if cells < 1:
        return mask
    room = [(cells, cells) if a == axis else (0, 0) for a in range(2)]
    line = np.ones([cells + 1 if a == axis else 1 for a in range(2)], dtype=bool)
    inner = tuple(slice(cells, -cells) if a == axis else slice(None) for a in range(2))
    return np.asarray(ndimage.binary_closing(np.pad(mask, room), line)[inner])


def elastic_patch(gap: Array, spacing: tuple[float, float], load: float, modulus: float) -> Patch:
    """The contact under a load [N] of two bodies whose initial gap [m] is known on a grid, shape (nx, ny).

    `spacing` [m] of the grid, `modulus` E* [Pa] with 1 / E* the sum of (1 - nu^2) / E of both bodies; the gap is
    infinite where they cannot meet. Pressure at the grid's border means that the grid is too small.
    """
    area = spacing[0] * spacing[1]
    kernel = _influence(gap.shape, spacing) / modulus
    open_ = ~np.isfinite(gap)
    height = np.where(open_, 0.0, gap - gap[~open_].min())
    pressure = np.where(open_, 0.0, load / (area * (~open_).sum()))
    direction, before, restart = np.zeros_like(gap), 1.0, 0.0
    for _ in range(MOST_ITERATIONS):
        touching = pressure > 0.0
        residual = _deflection(kernel, pressure) + height
        residual -= residual[touching].mean()
        squared = float((residual[touching] ** 2).sum())
        if squared == 0.0:
            break
        direction = np.where(touching, residual + restart * squared / before * direction, 0.0)
        before = squared
        bent = _deflection(kernel, direction)
        bent -= bent[touching].mean()
        step = float((residual[touching] * direction[touching]).sum() / (bent[touching] * direction[touching]).sum())
        old = pressure
        pressure = np.where(touching, np.maximum(pressure - step * direction, 0.0), 0.0)
        inside = (pressure == 0.0) & (residual < 0.0) & ~open_
        pressure[inside] -= step * residual[inside]
        restart = 0.0 if inside.any() else 1.0
        pressure *= load / (area * pressure.sum())
        if np.abs(pressure - old).sum() * area < TOLERANCE * load:
            break
    touching = pressure > 0.0
    return Patch(pressure, spacing, float((_deflection(kernel, pressure) + height)[touching].mean()))


def _influence(shape: tuple[int, ...], spacing: tuple[float, float]) -> NDArray[np.complex128]:
    """Fourier transform of the deflection of a half-space of E* = 1 at the middles of cells under unit pressure on one
    cell."""
    a, b = 0.5 * spacing[0], 0.5 * spacing[1]
    nx, ny = (2 * n for n in shape)
    x = spacing[0] * fft.fftfreq(nx, 1.0 / nx)[:, None]
    y = spacing[1] * fft.fftfreq(ny, 1.0 / ny)[None, :]

    def corner(u: Array, v: Array) -> Array:
        return np.asarray(u * np.arcsinh(v / np.abs(u)) + v * np.arcsinh(u / np.abs(v)))

    deflection = corner(x + a, y + b) - corner(x + a, y - b) - corner(x - a, y + b) + corner(x - a, y - b)
    return np.asarray(fft.rfft2(deflection / np.pi))


def _deflection(kernel: NDArray[np.complex128], pressure: Array) -> Array:
    """Deflection of the surface under pressures (nx, ny) [m]."""
    nx, ny = pressure.shape
    whole = fft.irfft2(kernel * fft.rfft2(pressure, (2 * nx, 2 * ny)), (2 * nx, 2 * ny))
    return np.asarray(whole[:nx, :ny])


def contact_radius(weight: float, radius: float, youngs_modulus: float, poisson_ratio: float) -> float:
    """Radius [m] of the contact of a rigid sphere on an elastic half-space, Hertz [J85, Eq. 4.22].

    weight [N], sphere radius [m], Young's modulus [Pa], Poisson ratio [-].
    a = (3 W R / (4 E*))^(1/3), E* = E / (1 - nu^2); never more than the radius itself.
    """
    effective = youngs_modulus / (1.0 - poisson_ratio**2)
    return float(min((0.75 * weight * radius / effective) ** (1.0 / 3.0), radius))


def contact_stiffness(weight: float, radius: float, youngs_modulus: float, poisson_ratio: float) -> float:
    """Tangent stiffness dW/d(depth) [N/m] of the same contact at equilibrium: 2 E* a [J85, Sec. 4.2]."""
    effective = youngs_modulus / (1.0 - poisson_ratio**2)
    return float(2.0 * effective * np.float64(contact_radius(weight, radius, youngs_modulus, poisson_ratio)))


def indentation(weight: float, radius: float, youngs_modulus: float, poisson_ratio: float) -> float:
    """Depth [m] to which a rigid sphere sinks into an elastic half-space, Hertz [J85, Eq. 4.23].

    Arguments as of contact_radius; d = (9 W^2 / (16 R E*^2))^(1/3). A flat underside of half width R sinks less,
    W / (2 E* R) [J85, Sec. 3.4].
    """
    effective = youngs_modulus / (1.0 - poisson_ratio**2)
    return float((9.0 * weight**2 / (16.0 * radius * effective**2)) ** (1.0 / 3.0))


def bending(weight: float, length: float, width: float, thickness: float, youngs_modulus: float) -> float:
    """Upper bound of the bending of a bar [m]: twice the tip deflection W l^3 / (3 E I) of a cantilever, I = b t^3 /
    12.

    Weight [N] at its tip, sides [m], Young's modulus [Pa]. Twice, because a round bar bends 1.7 times as much.
    """
    return 8.0 * weight * length**3 / (youngs_modulus * width * thickness**3)


def deflection(
    weight: float, radius: float, sides: tuple[float, float, float], youngs_modulus: float, poisson_ratio: float
) -> float:
    """The larger of indentation and bending [m]; `sides` are the bar's length, width and thickness [m]."""
    return max(indentation(weight, radius, youngs_modulus, poisson_ratio), bending(weight, *sides, youngs_modulus))
