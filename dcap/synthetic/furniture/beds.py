"""Beds: frame, mattress, headboard, pillows and a draped blanket; head at -y, foot at +y, origin on the floor."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from dcap.arrays import Array
from dcap.scene.types.mesh import Mesh
from dcap.synthetic.paint import Finish, Painter, Rgb, painted, smooth_noise, wood
from dcap.synthetic.shapes import (
    Assembly,
    assembly,
    bar,
    columns,
    cushioned,
    grid_surface,
    lens,
    moved,
    outward,
    rounded_box,
    rounded_nodes,
    turned,
    warped,
)

SINK = 0.002
"""Depth to which soft things press into their support [m]: they touch, and a scan has no gap."""
FRAME_TOP = 0.29
"""Height of the frame's upper face [m]."""
MATTRESS_RADIUS = 0.05
"""Rounding of the mattress [m]."""


@dataclass(frozen=True, slots=True)
class BedStyle:
    """Sizes [m] and colours of a bed."""

    width: float
    length: float
    frame: Rgb
    headboard: Literal["panel", "channels", "bars"]
    """A wooden panel, upholstered channels or wooden bars."""
    sheet: Rgb
    blanket: Painter
    fold: Rgb
    """Colour of the blanket's turned-back strip."""
    pillow: Finish
    fabric: Rgb = (0, 0, 0)
    """Colour of an upholstered headboard; wooden headboards have the colour of the frame."""
    pillow_count: int = 2
    mattress: float = 0.24
    """Thickness of the mattress [m]."""
    blanket_start: float = 0.42
    """Start of the blanket, as a share of the length from the head."""


def bed(style: BedStyle, seed: int, label: str = "bed") -> Assembly:
    """The whole bed."""
    top = FRAME_TOP - SINK + style.mattress
    mattress = moved(
        rounded_box((style.width, style.length, style.mattress), MATTRESS_RADIUS, 0.028),
        z=FRAME_TOP - SINK + style.mattress / 2,
    )
    return assembly(
        label,
        frame=_frame(style, seed),
        mattress=painted(cushioned(mattress, 0.006), style.sheet, variation=0.02, seed=seed),
        headboard=_headboard(style, seed),
        pillow=_pillows(style, top, seed),
        blanket=_blanket(style, top, seed),
    )


def _frame(style: BedStyle, seed: int) -> list[Mesh]:
    timber = wood(style.frame, "y", seed)
    width, length = style.width + 0.01, style.length + 0.02
    platform = moved(rounded_box((width, length, 0.17), 0.012, 0.04), z=FRAME_TOP - 0.085)
    legs = [
        bar(
            (x * (width / 2 - 0.09), y * (length / 2 - 0.09), 0.0),
            (x * (width / 2 - 0.09), y * (length / 2 - 0.09), 0.135),
            0.022,
            taper=1.45,
        )
        for x in (-1, 1)
        for y in (-1, 1)
    ]
    return [painted(solid, timber, seed=seed) for solid in (platform, *legs)]


def _headboard(style: BedStyle, seed: int) -> list[Mesh]:
    width, y = style.width + 0.06, -style.length / 2 - 0.035
    if style.headboard == "bars":
        return _bars(style, width, y, seed)
    board = rounded_box((width, 0.07, 1.02), 0.03 if style.headboard == "channels" else 0.015, 0.028)
    if style.headboard == "channels":
        board = painted(warped(board, _channels(width)), style.fabric, variation=0.04, seed=seed)
    else:
        board = painted(board, wood(style.frame, "x", seed + 3), seed=seed)
    return [moved(board, y=y, z=0.51)]


def _channels(width: float) -> Callable[[Array], Array]:
    """Vertical padded channels on the side towards the bed."""
    count = max(4, round(width / 0.2))

    def change(points: Array) -> Array:
        wave = np.abs(np.sin(np.pi * count * (points[:, 0] / width + 0.5)))
        front = np.clip(points[:, 1] / 0.035, 0, 1)
        return points + columns(np.zeros_like(wave), front * (wave - 1.0) * 0.022, np.zeros_like(wave))

    return change


def _bars(style: BedStyle, width: float, y: float, seed: int) -> list[Mesh]:
    posts = [bar((s * (width / 2 - 0.03), y, 0.0), (s * (width / 2 - 0.03), y, 0.95), 0.03) for s in (-1, 1)]
    rails = [
        moved(rounded_box((width - 0.03, 0.035, h), 0.01, 0.03), y=y, z=z)
        for z, h in ((0.30, 0.14), (0.62, 0.05), (0.86, 0.09))
    ]
    sticks = [
        bar((x, y, 0.32), (x, y, 0.86), 0.012)
        for x in np.linspace(-width / 2 + 0.14, width / 2 - 0.14, max(5, round(width / 0.14)))
    ]
    return [painted(m, wood(style.frame, "x", seed), seed=seed) for m in (*posts, *rails, *sticks)]


def _pillows(style: BedStyle, top: float, seed: int) -> list[Mesh]:
    rng = np.random.default_rng(seed)
    half_x = min(0.34, (style.width - 0.10) / 2 / style.pillow_count - 0.01)
    pillows = []
    for index in range(style.pillow_count):
        x = (index - (style.pillow_count - 1) / 2) * (style.width - 0.06) / style.pillow_count
        body = painted(lens(half_x, 0.22, 0.115, 0.035, edge=0.022), style.pillow, variation=0.03, seed=seed + index)
        body = turned(body, "z", float(rng.uniform(-4, 4)))
        low = float(body.bounds[0, 2])
        pillows.append(moved(body, x, -style.length / 2 + 0.29, top + 0.006 - SINK - low))
    return pillows


def _blanket(style: BedStyle, top: float, seed: int) -> Mesh:
    """A duvet over the foot half that hangs over both sides and the foot end; it follows the mattress."""
    hang, thickness = 0.20 + MATTRESS_RADIUS, 0.030
    flat_x, flat_y = style.width / 2 - MATTRESS_RADIUS, style.length / 2 - MATTRESS_RADIUS
    start = -style.length / 2 + style.blanket_start * style.length
    x = _sheet_nodes(-flat_x - hang, flat_x + hang)
    y = _sheet_nodes(start, flat_y + hang)
    flat = grid_surface(x, y, np.array([0.0, 0.5, 1.0]))
    sheet = flat.vertices[:, :2]

    def change(points: Array) -> Array:
        return _draped(points, (flat_x, flat_y), top, thickness, start, seed)

    def paint(_: Array) -> Array:
        strip = sheet[:, 1] < start + 0.22
        colors = style.blanket(columns(sheet, np.zeros(len(sheet))))
        return np.where(strip[:, None], np.asarray(style.fold, float), colors)

    return painted(outward(warped(flat, change)), paint, variation=0.04, seed=seed)


def _sheet_nodes(low: float, high: float) -> Array:
    half = (high - low) / 2
    return rounded_nodes(half, 0.02, 0.026) + (low + high) / 2


def _draped(points: Array, flat: tuple[float, float], top: float, thickness: float, start: float, seed: int) -> Array:
    """Sheet coordinates (x, y, layer 0..1) to space: flat on top, a quarter circle at the edge, then hanging.

    Where both overhangs meet, the cloth turns around the corner of the mattress; a higher norm keeps the hem level.
    """
    x, y, layer = points.T
    over_x, over_y = np.maximum(np.abs(x) - flat[0], 0.0), np.maximum(y - flat[1], 0.0)
    over = (over_x**6 + over_y**6) ** (1 / 6)
    length = np.maximum(np.hypot(over_x, over_y), 1e-12)
    toward = columns(np.sign(x) * over_x / length, over_y / length)
    radius = MATTRESS_RADIUS
    angle = np.minimum(over / radius, np.pi / 2)
    down = np.maximum(over - radius * np.pi / 2, 0.0)
    strip = np.exp(-(np.clip((y - start - 0.20) / 0.03, 0, None) ** 2))
    rim = np.clip(np.minimum(y - start, 0.02) / 0.02, 0.0, 1.0)
    wrinkle = 0.004 * (1 + smooth_noise(columns(x, y, 0 * x), seed + 9, 0.32)) * (over <= 0)
    height = thickness * (1 + 0.45 * strip) * (0.35 + 0.65 * np.sqrt(rim)) + np.maximum(wrinkle, 0.0)
    folds = np.clip(down / 0.12, 0, 1) * (0.5 + 0.5 * smooth_noise(columns(x + 3 * y, 3 * x - y, 0 * x), seed + 5, 0.7))
    offset = -SINK + layer * height + 0.022 * np.maximum(folds, 0.0)
    reach = (radius + offset) * np.sin(angle)
    hem = 0.008 * smooth_noise(columns(x, y, 0 * x), seed + 6, 0.5) * np.clip(down / 0.1, 0, 1)
    base = columns(np.clip(x, -flat[0], flat[0]), np.minimum(y, flat[1]))
    z = top + 0.004 - radius + (radius + offset) * np.cos(angle) - down + hem
    return columns(base + toward * reach[:, None], z)
