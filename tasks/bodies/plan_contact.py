"""Contact patch of one body on another in plan: layered half-spaces pressed together across the true gap.

In: the gap between the upper body's underside and the surface below it, at any points in plan. Out: the patch on a grid
that is finer for a smaller patch. No shape is assumed: a line of contact, an edge, a ring and feet come out as they
are.

The patch of a contact between stacks of layers: the wider the patch, the more it feels of the deeper layers.

The patch is that of an elastic half-space whose compliance weighs each layer by its share of the indentation; width of
the patch and weights decide each other.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from dcap.arrays import Array
from solver.contact.patch import Patch, elastic_patch

Layer = tuple[float, float]
"""Thickness [m] and compliance (1 - nu^2) / E [1/Pa], 0 if rigid."""
Stack = Sequence[Layer]
"""Layers from the contact inwards; the last layer is infinitely thick."""

LAYER_ROUNDS = 4  # of compliance and width
Heights = Callable[[Array], tuple[Array, Array]]
"""Function of points in plan (n, 2): heights of the upper body's underside and of the top of the body below [m], each
(n,), nan where there is no surface."""

SAMPLES = 128  # samples of the gap along each side of a box in plan
ZOOMED = 0.4  # a patch that fills less of the box along both sides is sampled again in a smaller box [-]
BORDER = 0.25  # margin on each side of the patch's box, over its size [-]
MOST_ZOOMS = 6
BESIDE = 0.3  # of its half width: cells stay fine this far outside a contact


def layered_patch(gap: Array, spacing: tuple[float, float], load: float, stacks: Sequence[Stack]) -> Patch:
    """The contact under a load [N] between two stacks whose gap [m] is known on a grid, shape (nx, ny), nan where they
    cannot meet; `spacing` [m] of the grid."""
    gap = np.where(np.isfinite(gap), gap, np.inf)
    radius = 0.0
    for _ in range(LAYER_ROUNDS):
        compliance = sum(felt_compliance(stack, radius) for stack in stacks)
        patch = elastic_patch(gap, spacing, load, 1.0 / max(compliance, 1e-30))
        radius = float(np.sqrt(patch.touching.sum() * spacing[0] * spacing[1] / np.pi))
        if all(len(stack) == 1 for stack in stacks):
            break
    return patch


def felt_compliance(stack: Stack, radius: float) -> float:
    """1 / E* that a contact of a radius [m] feels: each layer is weighted by its share of the indentation of a uniform
    half-space under uniform pressure, 1 - F(depth / radius) [J85, Eq. 3.32b]; the last layer is infinitely thick.

    [J85] K. L. Johnson, Contact Mechanics, Cambridge University Press, 1985.
    """
    depth, felt, total = 0.0, 1.0, 0.0
    for k, (thickness, compliance) in enumerate(stack):
        depth += thickness
        left = 0.0 if k == len(stack) - 1 or radius == 0.0 else below(depth / radius)
        total += (felt - left) * compliance
        felt = left
    return total


def below(depth: float) -> float:
    """Share of the indentation that comes from deeper than `depth` radii, nu = 0.3: vertical displacement on the axis
    of a uniformly loaded circle over that at the surface."""
    if np.isinf(depth):
        return 0.0
    root = np.sqrt(1.0 + depth**2)
    return float((1.0 + depth / (2.0 * (1.0 - 0.3) * root)) / (root + depth))


@dataclass(frozen=True, eq=False)
class PlanContact:
    """A patch and its place in plan."""

    x: Array
    """Middles of the patch's cells [m], shape (nx,)."""
    y: Array
    """[m], shape (ny,)."""
    top: Array
    """Heights of the lower body there [m], nan where there is no surface, shape (nx, ny)."""
    closest: tuple[int, int]
    """The cell that touches first."""
    patch: Patch

    @property
    def height(self) -> float:
        """Height of the first contact on the lower body [m]."""
        return float(self.top[self.closest])

    @property
    def touched_heights(self) -> tuple[float, float]:
        """Lowest and highest place of the lower body within the patch [m]."""
        touched = self.top[self.patch.region]
        return float(np.nanmin(touched)), float(np.nanmax(touched))

    @property
    def boxes(self) -> Array:
        """Boxes in plan around each place of the patch, with a small margin [m], shape (k, 2, 2)."""
        label, count = ndimage.label(self.patch.region, np.ones((3, 3)))
        margin, found = BESIDE * self.half_width, []
        for one in range(1, count + 1):
            ends = [axis[(label == one).any(axis=1 - a)] for a, axis in enumerate((self.x, self.y))]
            found.append([[e.min() - margin for e in ends], [e.max() + margin for e in ends]])
        return np.array(found)

    def across(self, axis: int) -> tuple[Array, Array]:
        """Coordinates along an axis at which there is contact [m], and half the patch's width along the axis there
        [m]."""
        half = self.patch.half_widths(axis)
        touching = np.isfinite(half)
        return (self.x, self.y)[axis][touching], half[touching]

    def edges(self, axis: int) -> Array:
        """Return the coordinates along an axis at which the contact ends at an edge of a body [m], shape (k,): pressure
        is above its mean there, while under a round body it falls to zero at the border."""
        region, pressure = (np.moveaxis(one, axis, 0) for one in (self.patch.region, self.patch.pressure))
        around = [(1, 1), (0, 0)]
        inside, on = np.pad(region, around), np.pad(np.where(region, pressure, 0.0), around)
        sharp = (inside[1:] != inside[:-1]) & (on[1:] + on[:-1] > pressure[region].mean())
        place, half = (self.x, self.y)[axis], 0.5 * self.patch.spacing[axis]
        return np.asarray(np.append(place - half, place[-1] + half)[sharp.any(axis=1)])

    @cached_property
    def half_width(self) -> float:
        """Half the width of the patch along its narrower side, averaged over its load [m]."""
        means = []
        for axis in range(2):
            load = self.patch.pressure.sum(axis=1 - axis)
            half = self.patch.half_widths(axis)
            touching = np.isfinite(half)
            means.append(float(np.average(half[touching], weights=load[touching])))
        return min(means)


def plan_contact(heights: Heights, box: Array, load: float, stacks: Sequence[Stack]) -> PlanContact | None:
    """The contact under a load [N] within a box in plan [m], shape (2, 2); None if nowhere one body lies above the
    other."""
    region = box
    for _ in range(MOST_ZOOMS):
        x, y, gap, top = gap_map(heights, region)
        if not np.isfinite(gap).any():
            return None
        spacing = (float(x[1] - x[0]), float(y[1] - y[0]))
        patch = layered_patch(gap, spacing, load, stacks)
        first = int(np.nanargmin(gap))
        contact = PlanContact(x, y, top, (first // SAMPLES, first % SAMPLES), patch)
        touched = patch.region
        ends = [axis[touched.any(axis=1 - a)] for a, axis in enumerate((x, y))]
        if (np.array([np.ptp(e) for e in ends]) >= ZOOMED * (region[1] - region[0])).any():
            break
        near = np.array([[e.min() for e in ends], [e.max() for e in ends]])
        margin = BORDER * (near[1] - near[0]) + 2.0 * np.array(spacing)
        region = np.stack([np.maximum(near[0] - margin, box[0]), np.minimum(near[1] + margin, box[1])])
    return contact


def gap_map(heights: Heights, region: Array) -> tuple[Array, Array, Array, Array]:
    """Cell middles of a grid over a box in plan [m], shapes (k,) and (k,), the gap and the height of the surface below
    [m], nan where there is no surface, shapes (k, k), with k = SAMPLES."""
    width = (region[1] - region[0]) / SAMPLES
    x, y = (region[0, a] + width[a] * (np.arange(SAMPLES) + 0.5) for a in range(2))
    under, top = heights(np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2))
    return x, y, (under - top).reshape(SAMPLES, SAMPLES), top.reshape(SAMPLES, SAMPLES)


def share_within(points: Array, boxes: Array) -> float:
    """Share of points (n, 3) within any of some boxes in plan, shape (k, 2, 2) [m]."""
    return float(within_any(points, boxes).mean())


def within_any(points: Array, boxes: Array) -> NDArray[np.bool_]:
    """Mask of the points (n, 3) that lie within any of some boxes in plan, shape (k, 2, 2) [m]."""
    point = points[:, None, :2]
    within = ((point >= boxes[:, 0]) & (point <= boxes[:, 1])).all(axis=2)
    return np.asarray(np.any(within, axis=1))
