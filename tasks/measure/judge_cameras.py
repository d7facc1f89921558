"""Where the cameras of judged pictures stand: no method has a say in it.

Those named in SHARED look at the support that was asked for, from one place for all methods; the others look at the
object wherever a method put it, from the same directions and the same distance.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, PositiveFloat, PositiveInt

from dcap.geometry.camera import Camera, looking_at

Array = NDArray[np.float64]

SIDES = {"front": 0.0, "right": 90.0, "back": 180.0, "left": -90.0}
"""Azimuths off the way from the support to the middle of the scene, counterclockwise from above [degrees]."""
TOWARDS = -90.0
"""That way in the world, off +x, where the support is in the middle [degrees]."""
NEARBY, ABOVE, LEVEL, CORNER = 25.0, 70.0, 6.0, 30.0
"""Elevations of the side views, of the view from above, of the low one and of that of the room [degrees]."""
SHARED = {"clean": CORNER, "room": CORNER, "top": ABOVE}
"""Views of the support, and their elevations [degrees]."""
OFF_MIDDLE = 0.1
"""A support this far from the middle of the scene has a side towards it [m]."""


class ViewsConfig(BaseModel, frozen=True, extra="forbid"):
    """How large the pictures are and what they cover."""

    size: PositiveInt = 320
    """Width and height [pixel]."""
    fov_deg: PositiveFloat = 40.0
    """Field of view [degrees]."""
    near: PositiveFloat = 3.2
    """Distance of the cameras near the object over its diagonal [-]."""
    far: PositiveFloat = 2.4
    """Least distance of the cameras that look at the support [m], or six times the object's diagonal."""
    margin: PositiveFloat = 1.25
    """Angle that their pictures cover over that of the support [-]."""
    samples: PositiveInt = 2
    """Rays along each side of a pixel at edges [-]."""


@dataclass(frozen=True, eq=False, slots=True)
class JudgeCameras:
    """The cameras of one sample."""

    support: Array
    """Middle of the box of the support that was asked for [m], shape (3,)."""
    support_diagonal: float
    """Of that box [m]."""
    scene: Array
    """Middle of the scene's bounds [m], shape (3,)."""
    size: float
    """Diagonal of the object as it was given, at its scale [m]."""
    config: ViewsConfig

    @property
    def ahead(self) -> float:
        """Azimuth from the support to the middle of the scene [degrees]."""
        way = (self.scene - self.support)[:2]
        return float(np.degrees(np.arctan2(way[1], way[0]))) if np.linalg.norm(way) > OFF_MIDDLE else TOWARDS

    def of(self, name: str, middle: Array) -> Camera:
        """The camera of a view, the object's middle (3,) being at a place [m]."""
        config = self.config
        if name in SHARED:
            covers = 0.5 * self.support_diagonal / np.sin(0.5 * np.radians(config.fov_deg) / config.margin)
            distance = max(config.far, 6.0 * self.size, float(covers))
            return seen_from(self.support, self.ahead, SHARED[name], distance, config)
        elevation = LEVEL if name == "low" else NEARBY
        return seen_from(middle, self.ahead + SIDES.get(name, 0.0), elevation, config.near * self.size, config)


def seen_from(middle: Array, azimuth_deg: float, elevation_deg: float, distance: float, config: ViewsConfig) -> Camera:
    """A camera that looks at a point."""
    a, e = np.radians(azimuth_deg), np.radians(elevation_deg)
    way = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    return looking_at(middle + distance * way, middle, config.size, config.size, fov_deg=config.fov_deg)
