"""Mass, centre of mass and inertia of bodies: of a solid, of the points that fill it, of a shell."""

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.solid.repair import mass_properties
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.particles import InertialProperties, MaterialPoints

Array = NDArray[np.float64]

SHELL = 0.01  # thickness of what stands fixed [m]: its mass informs, nothing moves by it
LEAST_AREA = 1e-12  # of a face [m^2]: a surface of slivers still has a centre


def inertial_of_points(position: Array, mass: Array) -> InertialProperties:
    """Of point masses [kg] at positions (n, 3) [m]."""
    total = float(mass.sum())
    center = mass @ position / total
    arm = position - center
    second = np.einsum("i,ij,ik->jk", mass, arm, arm)
    return InertialProperties(total, center, np.trace(second) * np.eye(3) - second)


def inertial_of_material(points: MaterialPoints) -> InertialProperties:
    """Of a soft body's material."""
    return inertial_of_points(points.position, points.volume * points.density)


def inertial_of_solid(mesh: Mesh, density: float) -> InertialProperties:
    """Of what a surface encloses, at a density [kg/m^3]; raises GeometryError where that is nothing."""
    return InertialProperties(*mass_properties(mesh, density))


def inertial_of_shell(surface: Mesh, density: float) -> InertialProperties:
    """Of a surface as a SHELL of a density [kg/m^3]."""
    area = np.maximum(surface.face_areas, LEAST_AREA)
    return inertial_of_points(surface.triangles.mean(axis=1), area * density * SHELL)
