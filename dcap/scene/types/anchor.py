"""Place of the drop: part, region, surface point and pre-drop pose."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.scene.types.arrays import check_array
from dcap.scene.types.rotation import AskedPose


@dataclass(frozen=True, eq=False, slots=True)
class Lean:
    """How an object leans before the drop."""

    on: str
    """Instance id, or 'part:NAME' of the base, that it leans on."""
    angle: float
    """Tilt of its own upright axis from the vertical [rad]."""
    axis: NDArray[np.float64]
    """That axis at the start, a unit vector in the world, shape (3,)."""

    def __post_init__(self) -> None:
        check_array("axis", self.axis, 3)


@dataclass(frozen=True, eq=False, slots=True)
class Anchor:
    """The pre-drop pose."""

    base_id: str
    part: str
    """Name of the part hit."""
    part_index: int
    """Index into the base instance's parts."""
    region: str
    """Canonical region words joined by spaces, 'center' if none was requested."""
    local: NDArray[np.float64]
    """Anchor in the part's box frame, -1..1 along its axes, shape (2,)."""
    surface_point: NDArray[np.float64]
    """x_s: hit of the ray along gravity on the part [m], shape (3,)."""
    world_from_object: NDArray[np.float64]
    """Pre-drop pose: object mesh (as read) to world: translation @ R* @ scale, shape (4, 4)."""
    clearance: float
    """Smallest vertical gap between the object and the surfaces beneath it at the start [m]."""
    region_polygon: NDArray[np.float64]
    """Requested region on the part, world xy [m], shape (k, 2), counter-clockwise; used only for `region_missed`."""
    reason: str
    lean: Lean | None = None
    """None if it stands by itself."""
    notes: tuple[str, ...] = ()
    """Readings of the place that deviate from the literal words."""
    pose: AskedPose | None = None
    """Requested orientation; None: none, or leaning."""

    def __post_init__(self) -> None:
        check_array("local", self.local, 2)
        check_array("surface_point", self.surface_point, 3)
        check_array("world_from_object", self.world_from_object, 4, 4)
        check_array("region_polygon", self.region_polygon, None, 2)
