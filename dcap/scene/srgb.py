"""Between linear light and sRGB bytes (IEC 61966-2-1), and images read in linear light."""

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


LINEAR = linear_from_srgb(np.arange(256)).astype(np.float32)
"""Linear light of each sRGB byte."""


def sampled(image: NDArray[np.uint8], uv: NDArray[np.floating]) -> NDArray[np.float64]:
    """Bilinear samples of a repeating image in linear light at texture coordinates (..., 2), shape (..., 3)."""
    height, width = image.shape[:2]
    x = (uv[..., 0] % 1.0) * width - 0.5
    y = ((1.0 - uv[..., 1]) % 1.0) * height - 0.5
    x0, y0 = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    fx, fy = (x - x0)[..., None], (y - y0)[..., None]
    rows, columns = (y0 % height, (y0 + 1) % height), (x0 % width, (x0 + 1) % width)
    top = LINEAR[image[rows[0], columns[0]]] * (1 - fx) + LINEAR[image[rows[0], columns[1]]] * fx
    low = LINEAR[image[rows[1], columns[0]]] * (1 - fx) + LINEAR[image[rows[1], columns[1]]] * fx
    return np.asarray(top * (1 - fy) + low * fy, dtype=np.float64)
