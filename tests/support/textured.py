"""Textured surfaces made by formula: a square plate with one colour in each quarter of its texture."""

import numpy as np

from dcap.scene.types.mesh import Mesh, Paint, SourceSurface

QUARTERS = ((230, 20, 30), (20, 200, 40), (30, 60, 220), (240, 220, 40))
"""Colours of the lower left, lower right, upper left and upper right quarter."""


def quarters(side: int = 64) -> np.ndarray:
    """The texture, first row on top."""
    image = np.zeros((side, side, 3), dtype=np.uint8)
    half = side // 2
    image[half:, :half], image[half:, half:], image[:half, :half], image[:half, half:] = QUARTERS
    return image


def plate(half: float = 1.0, height: float = 0.0, repeat: float = 1.0) -> SourceSurface:
    """A level plate of two triangles whose texture coordinates run from 0 to `repeat` along x and y."""
    corner = np.array([[-half, -half, height], [half, -half, height], [half, half, height], [-half, half, height]])
    faces = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32)
    uv = (corner[:, :2] / (2 * half) + 0.5) * repeat
    paint = Paint(np.full((2, 3), 255, np.uint8), np.zeros(2, np.int32), uv[faces], (quarters(),))
    return SourceSurface(Mesh.of(corner, faces, (255, 255, 255)), paint)
