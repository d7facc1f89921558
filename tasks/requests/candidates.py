"""One picture of all possible supports of the object: numbered on a plan and a view, with a list.

In: a scene. Out: an sRGB picture with a number, name, certainty, id and size for each thing, so that a person can
choose one.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from dcap.scene.types.segmentation import Segmentation
from tasks.requests.badges import INK, PAPER, badge_size, paint
from tasks.requests.marks import marked, numbers_of, plan_picture, room_pictures

Line = tuple[int, str, str]
"""Number, name and size."""

LETTERS, ROW, GAP = 17, 27, 14
"""Height of the letters, of a row of the list, and of the gap between pictures [pixels]."""
COLUMN = 400
"""Width of a column of the list [pixels]."""
BACKGROUND, TEXT, FAINT = (250, 250, 248), (24, 24, 28), (110, 110, 116)


def candidates_picture(scene: Segmentation) -> NDArray[np.uint8]:
    """Plan and view side by side, the list below, shape (h, w, 3)."""
    pictures = marked(scene)
    shots = [Image.fromarray(plan_picture(pictures)), Image.fromarray(room_pictures(pictures, 1)[0])]
    return np.asarray(composed(shots, listed(scene)), dtype=np.uint8).copy()


def listed(scene: Segmentation) -> list[Line]:
    """A line for each number."""
    found = []
    for index, number in numbers_of(scene).items():
        one = scene.instances[index]
        size = " x ".join(f"{2.0 * half:.2f}" for half in one.box.half_extents)
        found.append((number, f"{one.label} {one.confidence:.0%}", f"{one.id}, {size} m"))
    return found


def composed(shots: Sequence[Image.Image], lines: Sequence[Line]) -> Image.Image:
    """Pictures in a row and a list in columns below."""
    width = sum(shot.width for shot in shots) + GAP * (len(shots) + 1)
    columns = max(1, (width - GAP) // COLUMN)
    rows = -(-len(lines) // columns)
    top = max(shot.height for shot in shots) + 2 * GAP
    image = Image.new("RGB", (width, top + rows * ROW + GAP), BACKGROUND)
    left = GAP
    for shot in shots:
        image.paste(shot, (left, GAP))
        left += shot.width + GAP
    draw, font, small = ImageDraw.Draw(image), ImageFont.load_default(LETTERS), ImageFont.load_default(LETTERS - 4)
    for k, (number, name, about) in enumerate(lines):
        x, y = GAP + (k // rows) * COLUMN, top + (k % rows) * ROW
        breadth, height = badge_size(draw, str(number), font)
        box = (x, y, x + max(breadth, 34), y + height)
        draw.rounded_rectangle(box, 5, PAPER, tuple(int(c) for c in paint(number)), 2)
        draw.text((0.5 * (box[0] + box[2]), 0.5 * (box[1] + box[3])), str(number), INK, font, "mm")
        draw.text((x + 42, y + 0.5 * height), name, TEXT, font, "lm")
        after = draw.textlength(name, font)
        draw.text(
            (x + 50 + after, y + 0.5 * height), shortened(draw, about, small, COLUMN - 64 - after), FAINT, small, "lm"
        )
    return image


def shortened(
    draw: ImageDraw.ImageDraw, text: str, font: ImageFont.ImageFont | ImageFont.FreeTypeFont, width: float
) -> str:
    """A text cut to fit the width."""
    while text and draw.textlength(text, font) > width:
        text = text[:-2].rstrip(" .") + "." if len(text) > 2 else ""
    return text
