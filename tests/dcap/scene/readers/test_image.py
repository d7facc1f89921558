"""Images: as large as promised, refused in one line beyond, by what their header says."""

import io
import struct
import warnings
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from dcap.scene.errors import FormatError, InputError
from dcap.scene.readers.files import MAX_TOGETHER, PixelBudget, read_image
from flows.extra_output import read_photo


def png_of_nothing(side: int) -> bytes:
    """A PNG that promises side x side pixels and ends after its header."""
    body = b"IHDR" + struct.pack(">IIBBBBB", side, side, 8, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + body + struct.pack(">I", zlib.crc32(body)) + b"\0\0\0\0IDAT"


@pytest.mark.parametrize(
    ("side", "words"), [(7071, "truncated"), (8192, "truncated"), (8193, "8193 x 8193 pixels.*reduce it first")]
)
def test_a_texture_may_have_as_many_pixels_as_promised(side: int, words: str) -> None:
    """Up to 8192 x 8192 pixels the size is no reason to refuse or warn; beyond, it is said before any is decoded."""
    with warnings.catch_warnings(record=True) as caught, pytest.raises(FormatError, match=words):
        read_image(png_of_nothing(side), "here")
    assert caught == []


def test_an_image_of_a_format_that_runs_a_program_is_none() -> None:
    """PostScript is drawn by Ghostscript: not here."""
    file = io.BytesIO()
    Image.new("RGB", (4, 4)).save(file, "EPS")
    with pytest.raises(FormatError, match="none of the known formats"):
        read_image(file.getvalue(), "here")


def test_images_of_one_file_are_counted_together() -> None:
    """As many as four of the largest; views of the same memory stand for them."""
    budget = PixelBudget(Path("a.glb"))
    largest = np.broadcast_to(np.zeros(3, np.uint8), (8192, 8192, 3))
    for _ in range(MAX_TOGETHER // (8192 * 8192)):
        assert budget.spend(largest) is largest
    with pytest.raises(FormatError, match=r"a\.glb: its images have more than"):
        budget.spend(largest[:1, :1])


def test_a_photograph_is_a_plain_file_of_measure(tmp_path: Path) -> None:
    """What has no end, or too many pixels, is refused before it is read."""
    (tmp_path / "p.png").write_bytes(png_of_nothing(8193))
    with pytest.raises(FormatError, match="reduce it first"):
        read_photo(tmp_path / "p.png")
    with pytest.raises(InputError, match="no such file"):
        read_photo(Path("/dev/zero"))
