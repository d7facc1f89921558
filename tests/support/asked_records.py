"""Values to store about what was asked of an object and why it was refused."""

import numpy as np

from dcap.scene.types.outcome import ObjectHole, OpenObject
from dcap.scene.types.rotation import AskedPose
from dcap.scene.types.settled import PoseCheck


def asked_and_refused() -> tuple[object, ...]:
    """One of each type."""
    hole, up, front = ObjectHole((0.0, 0.1, 0.2), (0.3, 0.2)), np.array([0.0, 0, 1]), np.array([0.0, -1, 0])
    return (
        OpenObject(2, (hole,)), hole, AskedPose("upright", up, None, up, front, "lies"),
        PoseCheck("upright", "on_back", 1.57, 0.78, met=False, doubt="lies"),
    )  # fmt: skip
