"""The surface that a thing carries with: the level at which most of it looks up."""

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.segmentation.faces import level_of
from dcap.scene.types.mesh import Mesh

UPWARD = 0.8
"""Cosine to the vertical from which a face looks up [-]."""
BAND = 0.03
"""Faces within this height are one level [m]."""


def main_level(mesh: Mesh, faces: NDArray[np.integer]) -> float:
    """Height of the main upward surface of some faces [m]; nan where nothing looks up."""
    corner = mesh.corners(faces)
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    length = np.linalg.norm(normal, axis=1)
    up = normal[:, 2] > UPWARD * np.maximum(length, 1e-30)
    return level_of(corner[up, :, 2].mean(axis=1), length[up], BAND)
