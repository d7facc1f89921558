"""Pictures that the store would not write, under an artifact's right digest."""

import io
import struct
import zlib
from collections.abc import Callable

import numpy as np
from PIL import Image

from dcap.scene.store.codec import encode
from dcap.scene.store.digest import digest_of_bytes
from dcap.scene.store.ref import Ref
from dcap.scene.types.renders import Overview

PICTURE = np.random.default_rng(0).integers(0, 256, (12, 9, 3), np.uint8)


def chunk(kind: bytes, data: bytes) -> bytes:
    """A part of a PNG."""
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def huge() -> bytes:
    """A PNG that says 60000 x 60000 pixels: 10.8 GB."""
    header = chunk(b"IHDR", struct.pack(">IIBBBBB", 60000, 60000, 8, 2, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + header + chunk(b"IDAT", zlib.compress(bytes(1000))) + chunk(b"IEND", b"")


def saved_as(kind: str, mode: str = "RGB") -> bytes:
    """A sound picture in another format or mode."""
    buffer = io.BytesIO()
    Image.fromarray(PICTURE).convert(mode).save(buffer, kind)
    return buffer.getvalue()


FORGED: dict[str, Callable[[], bytes]] = {
    "60000 x 60000 pixels": huge,
    "no PNG": lambda: saved_as("EPS"),  # which Pillow has Ghostscript draw
    "no PNG, but JPEG": lambda: saved_as("JPEG"),
    "nothing": lambda: b"",
    "another mode": lambda: saved_as("PNG", "P"),
}


def forged(data: bytes, name: str = "clean.png") -> tuple[Ref[Overview], dict[str, bytes]]:
    """An artifact with other bytes as its picture, and the reference that fits it."""
    files = encode(Overview(PICTURE, None))
    files["value.json"] = files["value.json"].replace(b"clean.png", name.encode())
    files = {**{key: one for key, one in files.items() if key != "clean.png"}, name: data}
    return Ref("Overview", digest_of_bytes(files)), files
