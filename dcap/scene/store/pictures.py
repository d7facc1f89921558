"""Pictures of artifacts: lossless PNG, and nothing else is decoded as one.

An artifact may come from another machine, so the size in the header is compared before a pixel is decoded, as that of
foreign images is (dcap/scene/readers/files/image.py). A larger array is no picture to the store: `is_picture`.
"""

import io
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from dcap.scene.errors import StoreError
from dcap.scene.readers.files.image import MAX_PIXELS, UNREADABLE

SUFFIX = ".png"
"""End of a picture's name."""
FORMATS = ("PNG",)
"""By Pillow's names."""
MODES = {3: "RGB", 4: "RGBA"}
"""What pictures of so many channels are by Pillow's names."""


def is_picture(array: NDArray[np.generic]) -> bool:
    """Whether an array is stored as a picture: bytes (h, w, 3) or (h, w, 4), not too many of them to be read again."""
    shaped = array.ndim == 3 and array.shape[2] in MODES
    return shaped and array.dtype == np.uint8 and 0 < array.shape[0] * array.shape[1] <= MAX_PIXELS


def picture_to_png(picture: NDArray[np.generic]) -> bytes:
    """A lossless picture, (h, w, 3) or (h, w, 4) uint8."""
    buffer = io.BytesIO()
    # level 6, the usual one, takes two and a half times as long for 7 % fewer bytes
    Image.fromarray(np.ascontiguousarray(picture)).save(buffer, "PNG", compress_level=4)
    return buffer.getvalue()


def picture_from_png(data: bytes, name: str) -> NDArray[np.uint8]:
    """The picture that `picture_to_png` wrote; StoreError for anything else, by its header if that tells."""
    if not name.endswith(SUFFIX):  # `unfit_picture` has not seen it
        raise StoreError(f"{name} is no name of a picture")
    try:
        with opened(io.BytesIO(data), name) as image:
            return np.array(image)
    except UNREADABLE as error:
        raise StoreError(f"{name}: the picture cannot be decoded ({error})") from None


def unfit_picture(folder: Path) -> str:
    """Which picture of an artifact is none that the store writes, by their headers; empty if all are."""
    for path in sorted(folder.glob(f"*{SUFFIX}")):
        try:
            with path.open("rb") as file, opened(file, path.name):
                continue
        except (StoreError, OSError) as error:
            return str(error)
    return ""


def opened(file: BinaryIO, name: str) -> Image.Image:
    """A picture whose pixels have not been decoded yet; StoreError for one that the store would not have written."""
    try:
        image = Image.open(file, formats=FORMATS)
    except UnidentifiedImageError:  # its own words hold an address in memory
        raise StoreError(f"{name}: no PNG") from None
    except UNREADABLE as error:
        raise StoreError(f"{name}: the picture cannot be decoded ({error})") from None
    width, height = image.size
    if width * height > MAX_PIXELS or image.mode not in MODES.values():
        raise StoreError(
            f"{name}: {image.mode} of {width} x {height} pixels, expected RGB or RGBA, {MAX_PIXELS} at most"
        )
    return image
