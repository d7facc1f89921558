"""Rulers next to a plan: coordinates of its points in the file's own frame, for typing them elsewhere.

In: a picture straight down, its camera and its extent. Out: the picture with a ruler below and one at its left.
"""

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from dcap.geometry.camera import Camera

Array = NDArray[np.float64]

MARGIN = 46
"""Width of a ruler [pixels]."""
LETTERS = 15
"""[pixels]."""
MOST_TICKS = 10
"""Most numbers on a ruler; their distance is 1, 2 or 5 times a power of ten [-]."""
INK, PAPER = (40, 40, 44), (244, 244, 242)


def with_rulers(
    rgb: NDArray[np.uint8], camera: Camera, frame: tuple[Array, Array], file_from_world: Array
) -> NDArray[np.uint8]:  # fmt: skip
    """The picture with rulers; `frame` are the lowest and highest corner of its content [m], each of shape (3,)."""
    height, width, _ = rgb.shape
    image = Image.new("RGB", (width + MARGIN, height + MARGIN), PAPER)
    image.paste(Image.fromarray(rgb), (MARGIN, 0))
    draw, font = ImageDraw.Draw(image), ImageFont.load_default(size=LETTERS)
    low, high = frame
    ground = low[2]
    for axis in (0, 1):
        name, ends = file_axis(axis, low, high, file_from_world)
        for value in ticks(*ends):
            share = (value - ends[0]) / (ends[1] - ends[0])
            point = np.array([0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1]), ground])
            point[axis] = low[axis] + share * (high[axis] - low[axis])
            column, row, _ = camera.project(point[None])[0]
            text = f"{value:g}"
            if axis == 0:
                draw.line([(MARGIN + column, height), (MARGIN + column, height + 7)], INK, 2)
                draw.text((MARGIN + column, height + 10), text, INK, font, "ma")
            else:
                draw.line([(MARGIN - 7, row), (MARGIN, row)], INK, 2)
                draw.text((MARGIN - 10, row), text, INK, font, "rm")
        place = (image.width - 6, height + 28) if axis == 0 else (4, 4)
        draw.text(place, name, INK, font, "ra" if axis == 0 else "la")
    return np.asarray(image, dtype=np.uint8).copy()


def file_axis(axis: int, low: Array, high: Array, file_from_world: Array) -> tuple[str, tuple[float, float]]:
    """The file's axis along a level world axis, and its values at the two ends of the picture."""
    column = file_from_world[:3, axis]
    own = int(np.argmax(np.abs(column)))
    first, last = (file_from_world[own, :3] @ end + file_from_world[own, 3] for end in (low, high))
    return "xyz"[own], (float(first), float(last))


def ticks(first: float, last: float) -> list[float]:
    """Round numbers between two, in either order."""
    low, high = min(first, last), max(first, last)
    step = 10.0 ** np.floor(np.log10(max(high - low, 1e-9) / MOST_TICKS))
    step *= next(factor for factor in (1, 2, 5, 10) if (high - low) / (factor * step) <= MOST_TICKS)
    return [float(round(k * step, 9)) for k in range(int(np.ceil(low / step)), int(np.floor(high / step)) + 1)]
