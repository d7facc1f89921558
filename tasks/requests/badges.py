"""Numbers and rulers on pictures: each number on the widest place of its thing, coordinates along a plan.

In: a picture and the thing in each pixel; for a plan, its camera and its extent. Out: the picture with things tinted,
outlined and numbered; with rulers below and on the left, in the file's own frame, so that points can be typed.
"""

import colorsys
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont
from scipy.ndimage import binary_erosion, distance_transform_edt

from dcap.arrays import Array
from dcap.geometry.camera import Camera

Place = tuple[float, float]
Box = tuple[float, float, float, float]
"""Left, top, right and bottom of a rectangle [pixels]."""

HUE_STEP = 0.381966
"""Step around the colour wheel between numbers [-]: with the golden section, similar hues have distant numbers."""
TINT, LINE = 0.22, 0.85
"""Opacity of a thing's colour on its surface and on its outline [-]."""
LETTERS = 0.026
"""Height of the numbers over the picture's width [-]: 20 pixels at 768."""
LEAST_LETTERS = 13
"""Least height of the numbers [pixels]."""
LEAST_SEEN = 12
"""Least number of pixels of a numbered thing: a smaller thing could not be identified."""
STEPS, TURNS = 14, 16
"""Number of distances and of directions that are tried for a badge next to its thing."""
INK, PAPER = (255, 255, 255), (20, 20, 24)
MARGIN = 46
"""Width of a ruler [pixels]."""
RULER_LETTERS = 15
"""Height of the numbers on a ruler [pixels]."""
MOST_TICKS = 10
"""Maximum number of numbers on a ruler; their spacing is 1, 2 or 5 times a power of ten [-]."""
RULER_INK, RULER_PAPER = (40, 40, 44), (244, 244, 242)


def paint(number: int) -> NDArray[np.float64]:
    """The colour of a number, sRGB 0..255, shape (3,)."""
    return 255.0 * np.array(colorsys.hsv_to_rgb((number * HUE_STEP) % 1.0, 0.85, 1.0))


def numbered(rgb: NDArray[np.uint8], seen: NDArray[np.integer], numbers: Mapping[int, int]) -> NDArray[np.uint8]:
    """The picture (h, w, 3) with badges; `seen` (h, w) names the thing of each pixel, `numbers` gives its number.

    Things that are not in `numbers`, or hardly visible, get no badge.
    """
    shown = rgb.astype(np.float64)
    image_width = rgb.shape[1]
    aims: list[tuple[float, int, Place]] = []
    for thing, number in numbers.items():
        mask = seen == thing
        if int(mask.sum()) < LEAST_SEEN:
            continue
        line = mask & ~binary_erosion(mask, iterations=max(1, image_width // 512))
        share = np.where(line, LINE, np.where(mask, TINT, 0.0))[..., None]
        shown = shown * (1.0 - share) + paint(number) * share
        depth = distance_transform_edt(np.pad(mask, 1))[1:-1, 1:-1]
        row, column = np.unravel_index(int(np.argmax(depth)), depth.shape)
        aims.append((float(depth.max()), number, (float(column), float(row))))
    image = Image.fromarray(np.rint(shown).astype(np.uint8))
    # the thing with the least room chooses first: a large thing has other places
    draw_badges(image, [(number, place) for _, number, place in sorted(aims)])
    return np.asarray(image, dtype=np.uint8).copy()


def draw_badges(image: Image.Image, aims: Sequence[tuple[int, Place]]) -> None:
    """Draw a badge for each number at its place, moved aside with a line to it if another badge is already there."""
    draw = ImageDraw.Draw(image)
    font = ImageFont.load_default(size=max(LEAST_LETTERS, round(LETTERS * image.width)))
    taken: list[Box] = []
    placed: list[tuple[int, Place, Box]] = []
    for number, aim in aims:
        box = free_box(aim, badge_size(draw, str(number), font), image.size, taken)
        taken.append(box)
        placed.append((number, aim, box))
    for number, aim, box in placed:  # lines first: no line crosses a number
        middle = (0.5 * (box[0] + box[2]), 0.5 * (box[1] + box[3]))
        if not (box[0] <= aim[0] <= box[2] and box[1] <= aim[1] <= box[3]):
            color = tuple(int(c) for c in paint(number))
            draw.line([aim, middle], fill=PAPER, width=4)
            draw.line([aim, middle], fill=color, width=2)
            draw.ellipse([aim[0] - 3, aim[1] - 3, aim[0] + 3, aim[1] + 3], fill=color, outline=PAPER)
    for number, _, box in placed:
        color = tuple(int(c) for c in paint(number))
        draw.rounded_rectangle(box, radius=0.3 * (box[3] - box[1]), fill=PAPER, outline=color, width=2)
        draw.text((0.5 * (box[0] + box[2]), 0.5 * (box[1] + box[3])), str(number), INK, font, "mm")


def badge_size(
    draw: ImageDraw.ImageDraw, text: str, font: ImageFont.ImageFont | ImageFont.FreeTypeFont
) -> tuple[float, float]:
    """Width and height of a badge [pixels]."""
    left, _, right, _ = draw.textbbox((0, 0), text, font)
    _, top, _, bottom = draw.textbbox((0, 0), "0123456789", font)
    height = 1.55 * (bottom - top)
    return max(right - left + 0.7 * height, height), height


def free_box(aim: Place, size: tuple[float, float], limits: tuple[int, int], taken: Sequence[Box]) -> Box:
    """The free rectangle for a badge nearest to its place, inside the picture."""
    boxes = [box_at(aim, size, limits)]
    for ring in range(1, STEPS + 1):
        for angle in np.linspace(0.0, 2.0 * np.pi, TURNS, endpoint=False):
            reach = 0.55 * ring
            moved = (aim[0] + reach * size[0] * float(np.cos(angle)), aim[1] + reach * size[1] * float(np.sin(angle)))
            boxes.append(box_at(moved, size, limits))
    return next((box for box in boxes if not any(meet(box, other) for other in taken)), boxes[0])


def box_at(middle: Place, size: tuple[float, float], limits: tuple[int, int]) -> Box:
    """A rectangle about a point, shifted into the picture."""
    left, top = (
        float(np.clip(c - 0.5 * s, 1.0, limit - s - 2.0)) for c, s, limit in zip(middle, size, limits, strict=True)
    )
    return left, top, left + size[0], top + size[1]


def meet(a: Box, b: Box) -> bool:
    """Return whether two rectangles overlap or nearly touch."""
    return a[0] < b[2] + 1 and b[0] < a[2] + 1 and a[1] < b[3] + 1 and b[1] < a[3] + 1


def with_rulers(
    rgb: NDArray[np.uint8], camera: Camera, frame: tuple[Array, Array], file_from_world: Array
) -> NDArray[np.uint8]:  # fmt: skip
    """The picture with rulers; `frame` are the lowest and highest corner of its content [m], each of shape (3,)."""
    height, width, _ = rgb.shape
    image = Image.new("RGB", (width + MARGIN, height + MARGIN), RULER_PAPER)
    image.paste(Image.fromarray(rgb), (MARGIN, 0))
    draw, font = ImageDraw.Draw(image), ImageFont.load_default(size=RULER_LETTERS)
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
                draw.line([(MARGIN + column, height), (MARGIN + column, height + 7)], RULER_INK, 2)
                draw.text((MARGIN + column, height + 10), text, RULER_INK, font, "ma")
            else:
                draw.line([(MARGIN - 7, row), (MARGIN, row)], RULER_INK, 2)
                draw.text((MARGIN - 10, row), text, RULER_INK, font, "rm")
        place = (image.width - 6, height + 28) if axis == 0 else (4, 4)
        draw.text(place, name, RULER_INK, font, "ra" if axis == 0 else "la")
    return np.asarray(image, dtype=np.uint8).copy()


def file_axis(axis: int, low: Array, high: Array, file_from_world: Array) -> tuple[str, tuple[float, float]]:
    """The file's axis along a horizontal world axis, and its values at the two ends of the picture."""
    column = file_from_world[:3, axis]
    own = int(np.argmax(np.abs(column)))
    first, last = (file_from_world[own, :3] @ end + file_from_world[own, 3] for end in (low, high))
    return "xyz"[own], (float(first), float(last))


def ticks(first: float, last: float) -> list[float]:
    """Round numbers between two numbers, in either order."""
    low, high = min(first, last), max(first, last)
    step = 10.0 ** np.floor(np.log10(max(high - low, 1e-9) / MOST_TICKS))
    step *= next(factor for factor in (1, 2, 5, 10) if (high - low) / (factor * step) <= MOST_TICKS)
    return [float(round(k * step, 9)) for k in range(int(np.ceil(low / step)), int(np.floor(high / step)) + 1)]
