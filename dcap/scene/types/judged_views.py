"""The pictures of a final state for judges and raters, and the data that determines their cameras."""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

Picture = NDArray[np.uint8]
Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, slots=True)
class JudgedViews:
    """Square RGB images of one placement, each (h, w, 3)."""

    overview: Picture
    """The requested support and the object, from one camera for all methods of a sample."""
    closeup: Picture
    """The contact at a grazing angle, from the same direction and distance for all methods."""


@dataclass(frozen=True, eq=False, slots=True)
class SceneBefore:
    """Square RGB images shared by all methods of a sample, each (h, w, 3)."""

    clean: Picture
    """The scene before, as in `overview`."""
    asset: Picture
    """The object alone, in its input state."""


BEFORE = tuple(one.name for one in fields(SceneBefore))
"""Names of the pictures of the scene before and of the object alone."""
PLACED = tuple(one.name for one in fields(JudgedViews))
"""Names of the pictures of a placement, in the order in which judges and people see them."""


@dataclass(frozen=True, eq=False, slots=True)
class Sights:
    """Visibility of one placement from each possible direction of the cameras."""

    overview: Array
    """Share of the object's surface that the scene does not hide, by direction of the overview [-], shape (n,)."""
    closeup: Array
    """Share of the object's lower edge that nothing hides, by direction of the close-up [-], shape (m,)."""
    contact: Array
    """Its contact point, or the point nearest to the surface below, seen from there [m], shape (m, 3)."""
    bounds: Array
    """Bounds of the object [m], shape (2, 3)."""
    support: Array
    """Corners of the box of the requested support [m], shape (8, 3)."""
    ahead_deg: float
    """Azimuth from that support to the middle of the scene [degrees]."""


@dataclass(frozen=True, slots=True)
class Viewpoint:
    """A camera of a square picture, in plain numbers."""

    position: tuple[float, float, float]
    """[m]."""
    target: tuple[float, float, float]
    """Point in the middle of the picture [m]."""
    fov_deg: float
    """Field of view across the picture [degrees]."""
