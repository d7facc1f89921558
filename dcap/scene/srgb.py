"""Conversion between linear light and sRGB bytes (IEC 61966-2-1), and sampling of images in linear light."""

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


Wrap = tuple[str, str]
"""Wrapping of an image along u and v beyond 0..1: REPEAT, MIRROR or CLAMP."""
REPEAT, MIRROR, CLAMP = "repeat", "mirror", "clamp"
REPEATING: Wrap = (REPEAT, REPEAT)


def sampled(image: NDArray[np.uint8], uv: NDArray[np.floating], wrap: Wrap = REPEATING) -> NDArray[np.float64]:
    """Bilinear samples of an image in linear light at texture coordinates (..., 2), shape (..., 3); alpha is
    ignored."""
    height, width = image.shape[:2]
    image = image[..., :3]
    left, right, fx = texels(uv[..., 0], width, wrap[0])
    low, high, fy = texels(1.0 - uv[..., 1], height, wrap[1])
    top = LINEAR[image[low, left]] * (1 - fx) + LINEAR[image[low, right]] * fx
    bottom = LINEAR[image[high, left]] * (1 - fx) + LINEAR[image[high, right]] * fx
    return np.asarray(top * (1 - fy) + bottom * fy, dtype=np.float64)


def texels(
    place: NDArray[np.floating], count: int, wrap: str
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """The two pixels on either side of a coordinate, and the share of the second, shape (..., 1)."""
    inside = place % 1.0
    if wrap == MIRROR:
        inside = 1.0 - np.abs(1.0 - place % 2.0)
    elif wrap == CLAMP:
        inside = np.clip(place, 0.0, 1.0)
    x = inside * count - 0.5
    first = np.floor(x).astype(np.int64)
    share = (x - first)[..., None]
    if wrap == REPEAT:
        return first % count, (first + 1) % count, share
    return np.clip(first, 0, count - 1), np.clip(first + 1, 0, count - 1), share
