"""The fixed pictures of a final state that judges see."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Picture = NDArray[np.uint8]


@dataclass(frozen=True, eq=False, slots=True)
class JudgedViews:
    """Square RGB images, each (h, w, 3); cameras stand where the scene and the object's size and place say."""

    clean: Picture
    """The scene before, as in `room`."""
    asset: Picture
    """The object alone, at its final orientation."""
    room: Picture
    """From a corner of the room, with the object in the middle."""
    front: Picture
    """The object from nearby: from -y, a little above it."""
    right: Picture
    """From +x."""
    back: Picture
    """From +y."""
    left: Picture
    """From -x."""
    top: Picture
    """From steeply above."""
    low: Picture
    """From -y and just above the level of what it stands on, where gaps and dents show."""
