"""The pictures of one placement."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False, slots=True)
class Visibility:
    """Visibility of the object at rest."""

    views: NDArray[np.float64]
    """Per view around the object: azimuth off the base's front and elevation [degrees], visible share of the
    silhouette and of its outline [-], shape (n, 4)."""
    from_the_room: float
    """Mean visible share of the surface that faces people standing around it [-]."""


@dataclass(frozen=True, eq=False, slots=True)
class Renders:
    """RGB images of a placement, with visibility and camera."""

    clean: NDArray[np.uint8]
    """The scene before, (h, w, 3)."""
    settled: NDArray[np.uint8]
    """The scene with the object at rest, same camera, (h, w, 3)."""
    closeup: NDArray[np.uint8]
    """The object at rest from nearby, (h, w, 3)."""
    visible_fraction: float
    """Share of the object's pixels not hidden by the scene in the settled view, 0..1."""
    camera_position: NDArray[np.float64]
    camera_target: NDArray[np.float64]
    before_after: NDArray[np.uint8]
    """The place from nearby without the object, and next to it with the object at rest, (h, w, 3)."""
    contact: NDArray[np.uint8]
    """The dent and the contact patch with the object lifted away, and a legend, (h, w, 3)."""
    profile: NDArray[np.uint8]
    """A vertical cut through the contact, before and after, (h, w, 3)."""
    visibility: Visibility


@dataclass(frozen=True, eq=False, slots=True)
class Overview:
    """Pictures of an infeasible placement: the scene, and the object at its intended place if that is known."""

    clean: NDArray[np.uint8]
    """The scene, (h, w, 3)."""
    asked: NDArray[np.uint8] | None
    """The scene with the object at its pre-drop pose, same camera, (h, w, 3); None if no stage got that far."""
    candidates: NDArray[np.uint8] | None = None
    """All possible supports of the object, numbered and listed, (h, w, 3); None if a support was found."""
    hole: NDArray[np.uint8] | None = None
    """The object with the rims of its holes in red if its surface cannot be closed, (h, w, 3); else None."""
