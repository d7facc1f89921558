"""What the solver is given: bodies with surfaces, signed distances and, where soft, particles."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.scene.types.arrays import check_array
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.repair_report import BodyGeometry


@dataclass(frozen=True, eq=False, slots=True)
class DistanceGrid:
    """Signed distance (negative inside) sampled on a regular grid in the body's start pose (world frame)."""

    origin: NDArray[np.float64]
    """Position of sample (0, 0, 0) [m], shape (3,)."""
    spacing: float
    """Distance of neighbouring samples [m]."""
    values: NDArray[np.float32]
    """Signed distance [m], shape (nx, ny, nz)."""

    def __post_init__(self) -> None:
        check_array("origin of a distance grid", self.origin, 3)
        check_array("values of a distance grid", self.values, None, None, None)


@dataclass(frozen=True, eq=False, slots=True)
class SimulationBody:
    """One body at the start of the drop, in the world frame."""

    name: str
    """Unique: 'object', the base instance's id, 'ID/PART' for a further body of the same instance."""
    instance: str
    """'object' or the id of the scene instance that it is a piece of."""
    fixed: bool
    surface: Mesh
    """Contact and picture surface; faces near the contact are no larger than the contact spacing."""
    distance: DistanceGrid
    rigid: bool
    """True: one rigid body. False: soft; its particles carry their own material and may include rigid ones."""
    mass: float
    """Mass [kg]; for a fixed body informative."""
    center_of_mass: NDArray[np.float64]
    """[m], shape (3,)."""
    inertia: NDArray[np.float64]
    """About the centre of mass, world axes [kg m^2], shape (3, 3)."""
    static_friction: float
    dynamic_friction: float
    rolling_resistance: float
    particle_position: NDArray[np.float64]
    """Soft bodies: rest positions X_p [m], shape (p, 3); empty for rigid ones."""
    particle_volume: NDArray[np.float64]
    """[m^3], shape (p,)."""
    particle_density: NDArray[np.float64]
    """[kg/m^3], shape (p,)."""
    particle_youngs_modulus: NDArray[np.float64]
    """[Pa], shape (p,)."""
    particle_poisson_ratio: NDArray[np.float64]
    """[-], shape (p,)."""
    grid_x: NDArray[np.float64]
    """Node planes of the background grid along x [m], shape (kx,); empty for rigid ones. grid_y, grid_z likewise."""
    grid_y: NDArray[np.float64]
    grid_z: NDArray[np.float64]
    node_held: NDArray[np.int8]
    """0: free; 1: held by something fixed (frame below, crop cut); 2: belongs to the body's own rigid core (moves
    rigidly with the free body), shape (kx, ky, kz)."""

    def __post_init__(self) -> None:
        count = len(self.particle_position)
        check_array(f"center_of_mass of {self.name}", self.center_of_mass, 3)
        check_array(f"inertia of {self.name}", self.inertia, 3, 3)
        check_array(f"particle_position of {self.name}", self.particle_position, count, 3)
        check_array(f"particle_volume of {self.name}", self.particle_volume, count)
        check_array(f"particle_density of {self.name}", self.particle_density, count)
        check_array(f"particle_youngs_modulus of {self.name}", self.particle_youngs_modulus, count)
        check_array(f"particle_poisson_ratio of {self.name}", self.particle_poisson_ratio, count)
        check_array(f"grid_x of {self.name}", self.grid_x, None)
        check_array(f"grid_y of {self.name}", self.grid_y, None)
        check_array(f"grid_z of {self.name}", self.grid_z, None)
        check_array(f"node_held of {self.name}", self.node_held, len(self.grid_x), len(self.grid_y), len(self.grid_z))


@dataclass(frozen=True, eq=False, slots=True)
class Particles:
    """The whole simulation input."""

    bodies: tuple[SimulationBody, ...]
    """The object first."""
    friction_pairs: tuple[tuple[str, str, float, float], ...]
    """(body a, body b, mu_s, mu_d) where it differs from the geometric mean."""
    resolution: float
    """Cell size at the predicted contact [m]."""
    notes: tuple[str, ...]
    """Crops, caps and treatments, one sentence each."""
    geometry: tuple[BodyGeometry, ...] = ()
    """How the solid of each body was made of its faces, and how far that moved them."""
