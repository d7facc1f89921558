"""What is measured of a placement, whoever made it, without a judge and without knowing what was meant."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.scene.types.arrays import check_array


@dataclass(frozen=True, eq=False, slots=True)
class Measures:
    """Of the final meshes alone."""

    support_id: str
    """Instance over which the object is least far, or in which it is deepest; empty where nothing is beneath."""
    support_label: str
    support_part: str
    """Part of it under most of what touches, or under the nearest line."""
    middle: NDArray[np.float64]
    """Middle of the touching surface, or of the object where nothing touches [m], shape (3,)."""
    front: NDArray[np.float64]
    """Where the object's front points, as its shape tells, a unit vector in the world, shape (3,)."""
    penetration_m: float
    """Largest depth inside the scene as it was left."""
    penetration_given_m: float
    """Largest depth inside the scene as it was given: what a dent is, and what one would have to be."""
    gap_m: float
    """How far the object could come down before it touches; inf over nothing."""
    contact_area_m2: float
    """Of the object's surface within a millimetre of the scene."""
    com_margin_m: float
    """How far inside the convex hull of what carries it, or would once it has come down by the gap, the centre of mass
    is in plan, negative outside; -inf over nothing."""

    def __post_init__(self) -> None:
        check_array("middle", self.middle, 3)
        check_array("front", self.front, 3)


@dataclass(frozen=True, slots=True)
class Indentation:
    """How deep the object is in its soft support, and how deep it ought to be."""

    found_m: float | None = None
    """Of its lowest place below the surface as it was given."""
    reference_m: float | None = None
    """Approach of the frictionless elastic contact of the same shapes, layers and weight, quasi-static."""
    reason: str = ""
    """Why there are no such depths; empty where there are."""


@dataclass(frozen=True, slots=True)
class RefereeMeasures:
    """What the independent referee says of the final state (dcap/evaluation/referee): None where it cannot judge."""

    drift_m: float | None = None
    """Largest distance of the centre of mass from where it was within `seconds`."""
    drift_deg: float | None = None
    """Largest turn [degrees]."""
    supported: bool | None = None
    """Whether the thing over which it was placed still carries it at the end."""
    carrier_id: str = ""
    """Instance that carries most of it at the end; empty where nothing does."""
    penetration_m: float | None = None
    """Overlap with the scene as it was left, by Open3D's distances."""
    seconds: float | None = None
    """That were simulated."""
    deviation_m: float | None = None
    """How far what collides is from the surfaces near the contact at most."""
    reason: str = ""
    """Why it cannot judge; empty where it does."""


@dataclass(frozen=True, slots=True)
class Drift:
    """What became of the final state when it was simulated on."""

    seconds: float
    """True time that was simulated; 0 where it could not be."""
    steps: int
    distance_m: float
    """Largest distance of the centre of mass of a free body from where it was; inf where it could not be simulated."""
    angle_rad: float
    """Largest turn of a free body; inf likewise."""
    force_residual: float
    """Mean over the second that was asked of the unbalanced force over the weight [-], 0 in what was not simulated; inf
    likewise."""
    reason: str = ""
    """Why it could not be simulated."""
    broken: bool = False
    """Whether that is because a step broke, which says something of the cells. Else it begins too deep inside
    something, or the method kept no displacements."""
