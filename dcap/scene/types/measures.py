"""Measurements of a placement by any method, without a judge and without knowledge of the intended outcome."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.scene.types.arrays import check_array


@dataclass(frozen=True, eq=False, slots=True)
class Measures:
    """Measurements on the final meshes alone."""

    support_id: str
    """Instance nearest below the object, or in which it is deepest; empty if nothing is below."""
    support_label: str
    support_part: str
    """Part of that instance under most of the touching surface, or under the nearest line."""
    middle: NDArray[np.float64]
    """Middle of the touching surface, or of the object if nothing touches [m], shape (3,)."""
    front: NDArray[np.float64]
    """Direction of the object's front according to its shape, a unit vector in the world, shape (3,)."""
    penetration_m: float
    """Largest depth inside the final scene."""
    penetration_given_m: float
    """Largest depth inside the input scene: the actual or required depth of a dent."""
    gap_m: float
    """Distance by which the object could come down before it touches; inf over nothing."""
    contact_area_m2: float
    """Area of the object's surface within a millimetre of the scene."""
    com_margin_m: float
    """Distance in plan of the centre of mass inside the convex hull of the carrying surface (after coming down by the
    gap), negative outside; -inf over nothing."""

    def __post_init__(self) -> None:
        check_array("middle", self.middle, 3)
        check_array("front", self.front, 3)


@dataclass(frozen=True, slots=True)
class Indentation:
    """Depth of the object in its soft support, and the reference depth."""

    found_m: float | None = None
    """Depth of its lowest point below the undeformed surface."""
    reference_m: float | None = None
    """Approach of the frictionless elastic contact of the same shapes, layers and weight, quasi-static."""
    reason: str = ""
    """Reason why there are no such depths; empty if there are."""


@dataclass(frozen=True, slots=True)
class RefereeMeasures:
    """Verdict of the independent referee on the final state (dcap/evaluation/referee); None if it cannot judge."""

    drift_m: float | None = None
    """Largest distance of the centre of mass from its start within `seconds`."""
    drift_deg: float | None = None
    """Largest rotation [degrees]."""
    supported: bool | None = None
    """Whether the thing over which the object was placed still carries it at the end."""
    carrier_id: str = ""
    """Instance that carries most of the object at the end; empty if nothing does."""
    penetration_m: float | None = None
    """Overlap with the final scene, by Open3D's distances."""
    seconds: float | None = None
    """Simulated time."""
    deviation_m: float | None = None
    """Largest distance of the collision shapes from the surfaces near the contact."""
    reason: str = ""
    """Reason why it cannot judge; empty if it can."""


@dataclass(frozen=True, slots=True)
class Drift:
    """Motion during a continued simulation of the final state."""

    seconds: float
    """Simulated time; 0 if it could not be simulated."""
    steps: int
    distance_m: float
    """Largest distance of the centre of mass of a free body from its start; inf if it could not be simulated."""
    angle_rad: float
    """Largest rotation of a free body; inf if it could not be simulated."""
    force_residual: float
    """Unbalanced force over the weight, averaged over the requested second [-], 0 for time that was not simulated; inf
    if it could not be simulated."""
    reason: str = ""
    """Reason why it could not be simulated."""
    broken: bool = False
    """Whether the reason is a broken step, which depends on the cells; otherwise the object starts too deep inside a
    body, or the method kept no displacements."""
