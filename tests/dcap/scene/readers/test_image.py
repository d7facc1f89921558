"""Textures: as large as graphics hardware allows, and refused in one line beyond."""

import struct
import warnings
import zlib

import pytest

from dcap.scene.errors import FormatError
from dcap.scene.readers.files.image import read_image


def png_of_nothing(side: int) -> bytes:
    """A PNG that promises side x side pixels and ends after its header."""
    body = b"IHDR" + struct.pack(">IIBBBBB", side, side, 8, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + body + struct.pack(">I", zlib.crc32(body)) + b"\0\0\0\0IDAT"


@pytest.mark.parametrize(("side", "words"), [(10000, "truncated"), (16384, "truncated"), (16385, "reduce it first")])
def test_a_texture_may_have_as_many_pixels_as_promised(side: int, words: str) -> None:
    """Up to 16384 x 16384 pixels the size is no reason to refuse or warn; beyond, it is said before any is decoded."""
    with warnings.catch_warnings(record=True) as caught, pytest.raises(FormatError, match=words):
        read_image(png_of_nothing(side), "here")
    assert caught == []
