"""Material points of soft bodies: a solid filled within a background grid, with the material of each place."""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.distance import Distance
from dcap.geometry.solid.fill import fill
from dcap.scene.errors import GeometryError
from dcap.scene.types.particles import LayeredPoints, MaterialPoints
from tasks.bodies.soft_cells import Planes

Array = NDArray[np.float64]


class MaterialConstants(NamedTuple):
    """Of each of n points."""

    density: Array
    """[kg/m^3], shape (n,)."""
    youngs_modulus: Array
    """[Pa], shape (n,)."""
    poisson_ratio: Array
    """[-], shape (n,)."""
    layers: LayeredPoints | None = None
    """Of n points, where some are of layers."""


def material_points(
    planes: Planes, solid: Distance, constants: Callable[[Array], MaterialConstants], *, if_empty: str
) -> MaterialPoints:
    """Fill a solid with points; `constants` gives the material at positions (n, 3).

    Raises GeometryError with the message `if_empty` where the grid's cells find nothing inside.
    """
    position, volume = fill(planes, solid)
    if len(position) == 0:
        raise GeometryError(if_empty)
    return MaterialPoints(position, volume, *constants(position))


def with_mass(points: MaterialPoints, mass: float) -> MaterialPoints:
    """The same material, denser or lighter by one factor, so that all of it weighs `mass` [kg]."""
    return replace(points, density=points.density * (mass / float((points.volume * points.density).sum())))
