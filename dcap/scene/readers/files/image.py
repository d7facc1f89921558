"""Texture images: decoded to sRGB bytes, with a limit on their size."""

import io
import struct
import zlib

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from dcap.scene.errors import FormatError

MAX_PIXELS = 16384 * 16384
"""Largest texture [pixels]: the largest that graphics hardware accepts."""

UNREADABLE = (OSError, SyntaxError, ValueError, LookupError, EOFError, struct.error, zlib.error)
"""What decoding can raise on bytes that are no image, or only the beginning of one."""

# Pillow's own limit is lower and warns in several lines; ours is checked between the header and the pixels.
Image.MAX_IMAGE_PIXELS = None


def read_image(data: bytes, where: str) -> NDArray[np.uint8]:
    """An encoded image as RGB bytes, first row on top, shape (h, w, 3); transparency is ignored."""
    return _decoded(data, where, "RGB", MAX_PIXELS)


def read_transparent(data: bytes, where: str) -> NDArray[np.uint8]:
    """An encoded image with its transparency, (h, w, 4), and as RGB bytes, (h, w, 3), where every pixel is opaque."""
    image = _decoded(data, where, "RGBA", MAX_PIXELS)
    return image if (image[..., 3] < 255).any() else np.ascontiguousarray(image[..., :3])


def read_gray(data: bytes, where: str, most: int) -> NDArray[np.uint8]:
    """An encoded image of at most `most` pixels as grey bytes, first row on top, shape (h, w)."""
    return _decoded(data, where, "L", most)


def read_rgba(data: bytes, where: str, most: int) -> NDArray[np.uint8]:
    """An encoded image of at most `most` pixels with its transparency as it is, first row on top, shape (h, w, 4)."""
    return _decoded(data, where, "RGBA", most)


def _decoded(data: bytes, where: str, mode: str, most: int) -> NDArray[np.uint8]:
    try:
        with Image.open(io.BytesIO(data)) as image:
            if image.width * image.height > most:
                raise FormatError(f"{where}: an image of {image.width} x {image.height} pixels; reduce it first")
            if mode == "L" and image.mode.startswith(("I", "F")):  # conversion would cut its values, not scale them
                raise FormatError(f"{where}: an image with more than 8 bits per pixel; convert it to grey of 8 bits")
            return np.asarray(image.convert(mode), dtype=np.uint8)
    except UnidentifiedImageError:  # its own words hold an address in memory
        raise FormatError(f"{where}: the image cannot be decoded (none of the known formats)") from None
    except UNREADABLE as error:
        raise FormatError(f"{where}: the image cannot be decoded ({error})") from None
