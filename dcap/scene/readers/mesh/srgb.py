"""Between linear light and sRGB bytes (IEC 61966-2-1)."""

import numpy as np
from numpy.typing import NDArray


def srgb_from_linear(linear: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Linear 0..1 to sRGB 0..255, any shape."""
    clipped = np.clip(linear, 0.0, 1.0)
    encoded = np.where(clipped <= 0.0031308, 12.92 * clipped, 1.055 * clipped ** (1 / 2.4) - 0.055)
    return np.rint(encoded * 255.0).astype(np.uint8)


def linear_from_srgb(srgb: NDArray[np.generic]) -> NDArray[np.float64]:
    """sRGB 0..255 to linear 0..1, any shape."""
    value = np.asarray(srgb, dtype=np.float64) / 255.0
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)
