"""Images of foreign files: decoded to sRGB bytes, with a limit on the size of each and of all of one file.

The size is read from the header and compared before a pixel is decoded: a PNG of one colour packs a thousand pixels
into a byte. Only formats that textures and photographs have are decoded, none by another program (PostScript).
"""

import io
import struct
import zlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from dcap.scene.errors import FormatError

LONGEST_SIDE = 8192
MAX_PIXELS = LONGEST_SIDE * LONGEST_SIDE
"""Largest image [pixels]: 200 MB decoded; a texture of SuGaR's has 7071 x 7071."""
MAX_TOGETHER = 4 * MAX_PIXELS
"""Pixels of all images of one file [-]."""
FORMATS = ("PNG", "JPEG", "WEBP", "TIFF", "TGA", "BMP", "DDS", "GIF", "PPM")
"""Formats that are decoded, by Pillow's names; a file that a camera makes of several JPEGs counts as one too."""

UNREADABLE = (OSError, SyntaxError, ValueError, LookupError, EOFError, struct.error, zlib.error)
"""Errors that decoding can raise on bytes that are no image, or only the beginning of one."""

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


class PixelBudget:
    """Pixels that the images of one file may have together."""

    def __init__(self, path: Path) -> None:
        self._path, self._left = path, MAX_TOGETHER

    def spend(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """The image; FormatError where it is one too many."""
        self._left -= image.shape[0] * image.shape[1]
        if self._left < 0:
            raise FormatError(
                f"{self._path}: its images have more than {MAX_TOGETHER} pixels together; reduce them first"
            )
        return image


def check_size(size: tuple[int, int], where: str, most: int = MAX_PIXELS) -> None:
    """FormatError for an image of more than `most` pixels, by its width and height [pixel]."""
    width, height = size
    if width * height > most:
        raise FormatError(f"{where}: an image of {width} x {height} pixels, more than {most}; reduce it first")


def _decoded(data: bytes, where: str, mode: str, most: int) -> NDArray[np.uint8]:
    try:
        with Image.open(io.BytesIO(data), formats=FORMATS) as image:
            check_size(image.size, where, most)
            if mode == "L" and image.mode.startswith(("I", "F")):  # conversion would cut its values, not scale them
                raise FormatError(f"{where}: an image with more than 8 bits per pixel; convert it to grey of 8 bits")
            return np.asarray(image.convert(mode), dtype=np.uint8)
    except UnidentifiedImageError:  # its own words hold an address in memory
        raise FormatError(f"{where}: the image cannot be decoded (none of the known formats)") from None
    except UNREADABLE as error:
        raise FormatError(f"{where}: the image cannot be decoded ({error})") from None
