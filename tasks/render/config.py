"""Settings of pictures."""

from pydantic import BaseModel, NonNegativeFloat, PositiveFloat, PositiveInt


class RenderConfig(BaseModel, frozen=True, extra="forbid"):
    """Settings of the pictures."""

    size: PositiveInt = 1024
    """Side of each picture [pixels]."""
    fov_deg: PositiveFloat = 55.0
    """Field of view [degrees]."""
    distance_factor: PositiveFloat = 1.5
    """Camera distance over the diagonal of the base part's box [-]."""
    nearest: PositiveFloat = 2.2
    """Smallest camera distance over the object's diagonal [-]."""
    farthest: PositiveFloat = 14.0
    """Largest camera distance over the object's diagonal [-]."""
    closeup_factor: PositiveFloat = 1.35
    """Camera distance of the close-up over the object's diagonal [-]."""
    elevations_deg: tuple[float, ...] = (27.0, 14.0, 45.0)
    """Elevations of the camera to try [degrees], the preferred one first."""
    samples: PositiveInt = 2
    """Rays across a pixel at edges."""
    least_visible: NonNegativeFloat = 0.02
    """Share of the object's pixels below which it is buried [-]."""
