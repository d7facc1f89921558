"""Discretization of bodies: material points, signed distances, mass properties, layer normals.

Normals of the layers of cloth: the direction across the thin dimension, place by place.

In: a signed distance of the body in its rest shape. Out: a unit vector for each point. A stack of cloth, a pillow or a
duvet lies in layers along its two large faces, so the normal is the direction in which the distance to the surface
grows: it points up below the upper face and down above the lower face, and both are the same axis. The axis is the
first principal direction of g g^T, the products of that gradient, averaged over about half the body's thickness [B87],
so that a rim or a crease of the surface does not turn the layers next to it.

[B87] Bigun, Granlund: Optimal orientation detection of linear symmetry. ICCV 1987.
"""

from collections.abc import Callable
from dataclasses import replace
from math import cbrt, inf
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, map_coordinates

from dcap.arrays import Array
from dcap.geometry.distance import Distance, sampled
from dcap.geometry.solid.fill import fill
from dcap.geometry.solid.repair import mass_properties
from dcap.scene.errors import GeometryError
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.particles import DistanceGrid, InertialProperties, LayeredPoints, MaterialPoints
from tasks.bodies.soft_cells import Planes

SHELL = 0.01  # thickness of fixed surfaces [m]: their mass is for information only, it moves nothing
LEAST_AREA = 1e-12  # area of a face [m^2]: so that even a surface of slivers has a centre
DEPTHS = 2.0  # of the mean depth, a quarter of a sheet's thickness, that the average reaches [-]
SAMPLES = 4.0  # of the gradient within that reach
CLIPPED = 3.0  # reaches at which the weights end: e^-4.5
UPPER = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))


class MaterialConstants(NamedTuple):
    """Material constants of n points."""

    density: Array
    """Density [kg/m^3], shape (n,)."""
    youngs_modulus: Array
    """Young's modulus [Pa], shape (n,)."""
    poisson_ratio: Array
    """Poisson ratio [-], shape (n,)."""
    layers: LayeredPoints | None = None
    """Layers of n points, if some of the points are layered."""


def material_points(
    planes: Planes, solid: Distance, constants: Callable[[Array], MaterialConstants], *, if_empty: str
) -> MaterialPoints:
    """Fill a solid with points; `constants` gives the material at positions (n, 3).

    Raises GeometryError with the message `if_empty` if no cell of the grid lies inside the solid.
    """
    position, volume = fill(planes, solid)
    if len(position) == 0:
        raise GeometryError(if_empty)
    return MaterialPoints(position, volume, *constants(position))


def with_mass(points: MaterialPoints, mass: float) -> MaterialPoints:
    """The same material with its density scaled so that it weighs `mass` [kg] in total."""
    return replace(points, density=points.density * (mass / float((points.volume * points.density).sum())))


def distance_samples(
    distance: Distance, box: NDArray[np.float64], spacing: float, *, margin: float, most: float = inf
) -> DistanceGrid:
    """Samples over a box (2, 3) and a margin [m] around it, at the spacing of `affordable_spacing`.

    `distance` is the signed distance of the solid: exact for a primitive, otherwise measured to its mesh.
    """
    return sampled(distance, box[0] - margin, box[1] + margin, affordable_spacing(box, spacing, margin, most))


def affordable_spacing(box: NDArray[np.float64], spacing: float, margin: float, most: float) -> float:
    """Spacing of samples over a box (2, 3) and a margin [m] around it: `spacing` [m], or more if that would take more
    than `most` samples."""
    volume = float(np.prod(np.ptp(box, axis=0) + 2.0 * margin))
    return max(spacing, cbrt(volume / most))


def inertial_of_points(position: Array, mass: Array) -> InertialProperties:
    """Mass properties of point masses [kg] at positions (n, 3) [m]."""
    total = float(mass.sum())
    center = mass @ position / total
    arm = position - center
    second = np.einsum("i,ij,ik->jk", mass, arm, arm)
    return InertialProperties(total, center, np.trace(second) * np.eye(3) - second)


def inertial_of_material(points: MaterialPoints) -> InertialProperties:
    """Mass properties of a soft body's material."""
    return inertial_of_points(points.position, points.volume * points.density)


def inertial_of_solid(mesh: Mesh, density: float) -> InertialProperties:
    """Mass properties of the solid that a surface encloses, for a density [kg/m^3]; raises GeometryError if it encloses
    nothing."""
    return InertialProperties(*mass_properties(mesh, density))


def inertial_of_shell(surface: Mesh, density: float) -> InertialProperties:
    """Mass properties of a surface as a SHELL of a density [kg/m^3]."""
    area = np.maximum(surface.face_areas, LEAST_AREA)
    return inertial_of_points(surface.triangles.mean(axis=1), area * density * SHELL)


def layer_normals(grid: DistanceGrid, points: Array) -> Array:
    """Unit normals, of either sign, at points (n, 3) of the solid that `grid` samples, shape (n, 3)."""
    reach = DEPTHS * mean_depth(grid)
    stride = max(1, int(reach / SAMPLES / grid.spacing))
    values = grid.values[::stride, ::stride, ::stride].astype(np.float64)
    spacing = stride * grid.spacing
    if min(values.shape) < 2:
        return np.tile([0.0, 0.0, 1.0], (len(points), 1))
    gradient = np.gradient(values, spacing) * (values < 0.0)
    at = ((points - grid.origin) / spacing).T
    tensor = np.empty((len(points), 3, 3))
    for i, j in UPPER:
        mean = gaussian_filter(gradient[i] * gradient[j], reach / spacing, mode="constant", truncate=CLIPPED)
        tensor[:, i, j] = tensor[:, j, i] = map_coordinates(mean, at, order=1, mode="nearest")
    return np.asarray(np.linalg.eigh(tensor)[1][:, :, 2])


def mean_depth(grid: DistanceGrid) -> float:
    """Mean distance of the solid's points to its surface [m], at least one spacing of the samples."""
    inside = grid.values[grid.values < 0.0]
    return max(float(-inside.mean()) if len(inside) else 0.0, 0.5 * grid.spacing)
