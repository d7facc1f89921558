"""Simple drawings (bars, lines, words) that are saved as a picture (PNG) or as vectors (SVG), alike in both."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal
from xml.sax.saxutils import escape

from PIL import Image, ImageDraw, ImageFont

from dcap.scene.errors import InputError

Anchor = Literal["start", "middle", "end"]

PIXELS = 2
"""Pixels per unit of the drawing in a picture [-]."""
FAMILY = "Aileron, 'Helvetica Neue', Helvetica, Arial, sans-serif"
"""Pillow's own font, and what comes near to it."""
SUFFIXES = (".png", ".svg")


@dataclass(frozen=True, slots=True)
class Bar:
    """A filled rectangle."""

    box: tuple[float, float, float, float]
    """Left, top, right, bottom."""
    color: str
    radius: float = 0.0


@dataclass(frozen=True, slots=True)
class Line:
    """A straight line."""

    ends: tuple[float, float, float, float]
    """x, y of one end, then of the other."""
    color: str
    width: float = 1.0


@dataclass(frozen=True, slots=True)
class Words:
    """One line of text; `at` is on its baseline."""

    at: tuple[float, float]
    text: str
    size: float = 12.0
    color: str = "#222222"
    anchor: Anchor = "start"
    upright: bool = True
    """False: read from below, turned by a quarter."""


def drawing_suffix(path: Path) -> str:
    """The suffix that a drawing is saved by; InputError for one that none is."""
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(f"{path}: a drawing is saved as {' or '.join(SUFFIXES)}, not as {suffix or 'no suffix'}")
    return suffix


@dataclass(slots=True)
class Drawing:
    """Shapes on a white sheet; x to the right, y down, later ones on top."""

    width: int
    height: int
    shapes: list[Bar | Line | Words] = field(default_factory=list)

    def save(self, path: Path) -> None:
        """Write a PNG or an SVG by the path's suffix; InputError for another or where nothing can be written."""
        suffix = drawing_suffix(path)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            if suffix == ".png":
                self.picture().save(path)
            else:
                path.write_text(self.svg(), encoding="utf-8")
        except OSError as error:
            raise InputError(f"{path}: cannot be written: {error.strerror}") from None

    def picture(self) -> Image.Image:
        """The drawing in pixels."""
        image = Image.new("RGB", (self.width * PIXELS, self.height * PIXELS), "white")
        draw = ImageDraw.Draw(image)
        for one in self.shapes:
            if isinstance(one, Bar):
                left, top, right, bottom = (round(PIXELS * value) for value in one.box)
                if right > left and bottom > top:
                    draw.rounded_rectangle((left, top, right - 1, bottom - 1), PIXELS * one.radius, one.color)
            elif isinstance(one, Line):
                draw.line([PIXELS * value for value in one.ends], one.color, round(PIXELS * one.width))
            else:
                _write(image, draw, one)
        return image

    def svg(self) -> str:
        """The drawing as SVG text."""
        head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {self.width} {self.height}" width="{self.width}"'
        body = [
            head + f' height="{self.height}" font-family="{FAMILY}">',
            '<rect width="100%" height="100%" fill="#fff"/>',
        ]
        return "\n".join([*body, *(_tag(one) for one in self.shapes), "</svg>\n"])


def font(size: float) -> ImageFont.FreeTypeFont:
    """The font that comes with Pillow."""
    found = ImageFont.load_default(size)
    assert isinstance(found, ImageFont.FreeTypeFont)
    return found


def text_width(text: str, size: float) -> float:
    """Length of a line of text in units of the drawing."""
    return font(size * PIXELS).getlength(text) / PIXELS


def _write(image: Image.Image, draw: ImageDraw.ImageDraw, one: Words) -> None:
    x, y = (PIXELS * value for value in one.at)
    face, anchor = font(PIXELS * one.size), {"start": "ls", "middle": "ms", "end": "rs"}[one.anchor]
    if one.upright:
        draw.text((x, y), one.text, one.color, face, anchor)
        return
    length, height = round(face.getlength(one.text)) + 2, round(1.5 * PIXELS * one.size)
    strip = Image.new("L", (length, height), 0)
    ImageDraw.Draw(strip).text((0, round(PIXELS * one.size * 1.1)), one.text, 255, face, "ls")
    turned = strip.transpose(Image.Transpose.ROTATE_90)
    above = {"start": length, "middle": length / 2, "end": 0}[one.anchor]
    corner = (round(x - 1.1 * PIXELS * one.size), round(y - above))
    image.paste(Image.new("RGB", turned.size, one.color), corner, turned)


def _tag(one: Bar | Line | Words) -> str:
    if isinstance(one, Bar):
        left, top, right, bottom = one.box
        size = f'width="{max(right - left, 0):.2f}" height="{max(bottom - top, 0):.2f}" rx="{one.radius:g}"'
        return f'<rect x="{left:.2f}" y="{top:.2f}" {size} fill="{one.color}"/>'
    if isinstance(one, Line):
        x1, y1, x2, y2 = one.ends
        ends = f'x1="{x1:.2f}" y1="{y1:.2f}" x2="{x2:.2f}" y2="{y2:.2f}"'
        return f'<line {ends} stroke="{one.color}" stroke-width="{one.width:g}"/>'
    x, y = one.at
    turn = "" if one.upright else f' transform="rotate(-90 {x:.2f} {y:.2f})"'
    style = f'font-size="{one.size:g}" fill="{one.color}" text-anchor="{one.anchor}"{turn}'
    return f'<text x="{x:.2f}" y="{y:.2f}" {style}>{escape(one.text)}</text>'
