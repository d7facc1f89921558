"""Where the object was when a drop ended, from which a second drop learns where its cells must be fine."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class EndPose:
    """The object's pose, as in SettledBody."""

    position: tuple[float, float, float]
    """[m]."""
    quaternion: tuple[float, float, float, float]
