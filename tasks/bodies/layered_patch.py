"""The patch of a contact between stacks of layers: what it feels of the deeper ones depends on how wide it is.

The patch is that of an elastic half-space whose compliance weighs each layer by its share of the indentation; width of
the patch and weights decide each other.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from solver.contact.patch import Patch, elastic_patch

Array = NDArray[np.float64]
Layer = tuple[float, float]
"""Thickness [m] and compliance (1 - nu^2) / E [1/Pa], 0 if rigid."""
Stack = Sequence[Layer]
"""Layers from the contact inwards; the last one goes on for ever."""

LAYER_ROUNDS = 4  # of compliance and width


def layered_patch(gap: Array, spacing: tuple[float, float], load: float, stacks: Sequence[Stack]) -> Patch:
    """The contact under a load [N] of two stacks whose gap [m] is known on a grid, shape (nx, ny), nan where they
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
    """1 / E* that a contact of a radius [m] feels of layers: each weighted by its share of the indentation of a uniform
    half-space under uniform pressure, 1 - F(depth / radius) [J85, Eq. 3.32b]; the last one reaches down for ever.

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
