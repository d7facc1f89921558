"""Household things to place, standing on z = 0 [m], their front towards +y."""

import numpy as np

from dcap.arrays import Array
from dcap.synthetic.paint import blend, gradient, painted, wood
from dcap.synthetic.shapes import (
    Assembly,
    assembly,
    columns,
    lathe,
    loft,
    moved,
    rounded_box,
    rounded_rings,
    tube,
    turned,
    union,
)


def mug() -> Assembly:
    """A hollow mug with a handle wide enough for a finger: one closed body of genus one."""
    outline = [
        (0, 0),
        (0.034, 0),
        (0.040, 0.006),
        (0.041, 0.09),
        (0.0388, 0.095),
        (0.0365, 0.09),
        (0.0355, 0.012),
        (0.030, 0.008),
        (0, 0.008),
    ]
    angle = np.radians(np.linspace(-78, 78, 17))
    handle = tube(columns(0.036 + 0.034 * np.cos(angle), np.zeros(17), 0.048 + 0.030 * np.sin(angle)), 0.006, 0.004)

    def paint(points: Array) -> Array:
        inside = (np.hypot(points[:, 0], points[:, 1]) < 0.0372) & (points[:, 2] > 0.007)
        outside = blend((0.012 - np.abs(points[:, 2] - 0.066)) / 0.003, (52, 110, 152), (238, 228, 204))
        return np.where(inside[:, None], (242, 238, 228), outside)

    return assembly("mug", body=painted(union([lathe(outline, 0.0042), handle]), paint, variation=0.015))


def cup() -> Assembly:
    """A hollow paper cup without a handle, 10 cm high."""
    outline = [
        (0, 0.004),
        (0.026, 0.004),
        (0.027, 0),
        (0.030, 0),
        (0.0395, 0.092),
        (0.0415, 0.0955),
        (0.040, 0.099),
        (0.0375, 0.095),
        (0.0278, 0.008),
        (0, 0.008),
    ]

    def paint(points: Array) -> Array:
        wave = points[:, 2] + 0.006 * np.sin(6 * np.arctan2(points[:, 1], points[:, 0]))
        inside = np.hypot(points[:, 0], points[:, 1]) < 0.0272 + 0.108 * points[:, 2] + 0.0007
        outside = blend((0.012 - np.abs(wave - 0.05)) / 0.004 + 0.5, (246, 242, 232), (206, 92, 70))
        return np.where((inside & (points[:, 2] > 0.0045))[:, None], (250, 248, 242), outside)

    return assembly("cup", body=painted(lathe(outline, 0.005), paint, variation=0.01))


def book() -> Assembly:
    """A hardcover lying flat: two boards and a rounded spine around a block of pages."""

    def cover(points: Array) -> Array:
        frame = np.maximum(np.abs(points[:, 0]) / 0.062, np.abs(points[:, 1]) / 0.096)
        return blend((0.06 - np.abs(frame - 1)) / 0.04, (34, 70, 118), (222, 188, 110))

    def pages(points: Array) -> Array:
        shade: Array = np.asarray((240, 232, 210)) * (1 - 0.06 * (np.mod(points[:, 2] / 0.006, 1) > 0.5))[:, None]
        return shade

    board = painted(rounded_box((0.16, 0.23, 0.004), 0.0015, 0.006), cover, variation=0.015)
    spine = painted(rounded_box((0.012, 0.23, 0.032), 0.0055, 0.006), (28, 58, 100), variation=0.01)
    block = painted(rounded_box((0.151, 0.22, 0.026), 0.001, 0.008), pages, variation=0.0)
    solids = [
        moved(board, z=0.002),
        moved(board, z=0.030),
        moved(spine, x=-0.0765, z=0.016),
        moved(block, x=-0.001, z=0.016),
    ]
    return assembly("book", body=union(solids))


def laptop() -> Assembly:
    """A base with keyboard and a screen opened by 110 degrees that faces +y."""
    base = moved(rounded_box((0.32, 0.22, 0.016), 0.006, 0.006), z=0.008)
    lid = moved(rounded_box((0.32, 0.215, 0.009), 0.004, 0.008), y=0.1075)
    screen = moved(turned(painted(lid, _display, variation=0.0), "x", 110), y=-0.105, z=0.015)
    return assembly("laptop", base=painted(base, _keyboard, variation=0.01), screen=screen)


def _keyboard(points: Array) -> Array:
    x, y, z = points.T
    top = z > 0.012
    keys = top & (np.abs(x) < 0.14) & (y > -0.085) & (y < 0.02)
    gaps = np.maximum(np.abs(np.mod(x / 0.022, 1) - 0.5), np.abs(np.mod(y / 0.021, 1) - 0.5)) > 0.30
    color = np.where(keys[:, None], np.where(gaps[:, None], (120, 122, 128), (44, 46, 50)), (178, 181, 186))
    pad = top & (np.abs(x) < 0.05) & (y > 0.035) & (y < 0.095)
    return np.where(pad[:, None], (148, 151, 158), color)


def _display(points: Array) -> Array:
    x, y, z = points.T
    inside = (z < -0.003) & (np.abs(x) < 0.148) & (y > 0.015) & (y < 0.203)
    hill = y < 0.075 + 0.022 * np.sin(28 * x) + 0.012 * np.sin(61 * x + 1)
    sky = blend((y - 0.05) / 0.15, (150, 196, 226), (52, 104, 176))
    picture = np.where(hill[:, None], (58, 122, 84), sky)
    return np.where(inside[:, None], picture, (56, 58, 64))


def vase() -> Assembly:
    """A hollow glazed vase with a narrow neck, 26 cm high."""
    outer = [
        (0, 0),
        (0.045, 0),
        (0.062, 0.05),
        (0.072, 0.11),
        (0.050, 0.18),
        (0.028, 0.215),
        (0.032, 0.245),
        (0.041, 0.26),
    ]
    inner = [
        (0.036, 0.257),
        (0.026, 0.242),
        (0.022, 0.215),
        (0.044, 0.178),
        (0.066, 0.11),
        (0.056, 0.05),
        (0.04, 0.008),
        (0, 0.008),
    ]

    def paint(points: Array) -> Array:
        glaze = points[:, 2] + 0.008 * np.sin(5 * np.arctan2(points[:, 1], points[:, 0]))
        return blend((glaze - 0.12) / 0.03 + 0.5, (214, 196, 164), (40, 108, 112))

    return assembly("vase", body=painted(lathe(outer + inner, 0.007, smooth=2), paint, variation=0.03))


def bowl() -> Assembly:
    """A hollow ceramic bowl, 17 cm wide."""
    outline = [
        (0, 0.003),
        (0.034, 0.003),
        (0.036, 0),
        (0.042, 0),
        (0.045, 0.006),
        (0.068, 0.028),
        (0.084, 0.064),
        (0.0835, 0.067),
        (0.081, 0.066),
        (0.063, 0.031),
        (0.040, 0.011),
        (0, 0.008),
    ]

    def paint(points: Array) -> Array:
        stripe = (0.004 - np.abs(points[:, 2] - 0.052)) / 0.003
        return blend(stripe, (236, 230, 218), (186, 84, 58))

    return assembly("bowl", body=painted(lathe(outline, 0.006, smooth=1), paint, variation=0.02))


def plate() -> Assembly:
    """A flat plate, 24 cm wide."""
    outline = [
        (0, 0.003),
        (0.060, 0.003),
        (0.063, 0),
        (0.070, 0),
        (0.075, 0.004),
        (0.118, 0.018),
        (0.120, 0.0205),
        (0.117, 0.022),
        (0.078, 0.010),
        (0.070, 0.0075),
        (0, 0.0075),
    ]

    def paint(points: Array) -> Array:
        return blend(
            (0.004 - np.abs(np.hypot(points[:, 0], points[:, 1]) - 0.108)) / 0.003, (246, 245, 240), (64, 92, 150)
        )

    return assembly("plate", body=painted(lathe(outline, 0.006), paint, variation=0.01))


def apple() -> Assembly:
    """A red apple with a dimple and a stem, 8 cm."""
    outline = [
        (0, 0.006),
        (0.010, 0.002),
        (0.020, 0.0),
        (0.034, 0.016),
        (0.041, 0.042),
        (0.037, 0.064),
        (0.024, 0.076),
        (0.010, 0.073),
        (0, 0.062),
    ]

    def paint(points: Array) -> Array:
        angle = np.arctan2(points[:, 1], points[:, 0])
        streak = (
            0.25 * np.sin(9 * angle)
            + 0.2 * np.sin(23 * angle + 1)
            + (points[:, 2] - 0.045) / 0.05
            + 0.4 * np.sin(angle)
        )
        skin = blend(0.45 + 0.5 * streak, (196, 34, 38), (222, 150, 62))
        dimple = (np.hypot(points[:, 0], points[:, 1]) < 0.008) & (points[:, 2] > 0.05)
        return np.where(dimple[:, None], (128, 120, 52), skin)

    stem = tube([(0, 0, 0.058), (0.001, 0, 0.072), (0.004, 0.001, 0.086)], np.array([0.0016, 0.0014, 0.002]), 0.003)
    solids = [painted(lathe(outline, 0.0035, smooth=3), paint, variation=0.02), painted(stem, (92, 64, 38))]
    return assembly("apple", body=union(solids))


def tray() -> Assembly:
    """A wooden serving tray with a raised rim, 42 by 28 cm."""
    levels = [
        (0.19, 0.12, 0),
        (0.198, 0.128, 0.003),
        (0.209, 0.139, 0.038),
        (0.2065, 0.1365, 0.0405),
        (0.203, 0.133, 0.038),
        (0.194, 0.124, 0.012),
        (0.188, 0.118, 0.009),
    ]
    inside = [(f * 0.188, f * 0.118, 0.009) for f in (0.85, 0.7, 0.5, 0.3, 0.12)]
    under = [(f * 0.19, f * 0.12, 0.0) for f in (0.12, 0.3, 0.5, 0.7, 0.85)]
    rings = rounded_rings([*under, *levels, *inside], 96, exponent=7.0)
    solid = loft(rings, np.zeros(3), np.array([0, 0, 0.009]))
    return assembly("tray", body=painted(solid, wood((178, 124, 74), "x", 3), variation=0.03))


def bottle() -> Assembly:
    """A filled water bottle with a cap, 24 cm high."""
    outline = [
        (0, 0.004),
        (0.020, 0),
        (0.032, 0),
        (0.034, 0.006),
        (0.034, 0.15),
        (0.028, 0.18),
        (0.0145, 0.205),
        (0.0145, 0.216),
        (0.0165, 0.217),
        (0.0165, 0.236),
        (0.014, 0.239),
        (0, 0.239),
    ]

    def paint(points: Array) -> Array:
        z = points[:, 2]
        label = np.where(((z > 0.06) & (z < 0.125))[:, None], (60, 140, 90), (150, 196, 214))
        stripe = np.where((np.abs(z - 0.092) < 0.008)[:, None], (246, 244, 236), label)
        return np.where((z > 0.2165)[:, None], (36, 92, 164), stripe)

    return assembly("bottle", body=painted(lathe(outline, 0.006), paint, variation=0.02))


def remote() -> Assembly:
    """A remote control with buttons, lying flat, 18 cm long."""

    def paint(points: Array) -> Array:
        x, y, z = points.T
        grid = (np.hypot(np.mod(x + 0.007, 0.014) - 0.007, np.mod(y, 0.016) - 0.008) < 0.0052) & (np.abs(x) < 0.018)
        top = (z > 0.015) & (np.abs(y) < 0.075)
        color = np.where((grid & top)[:, None], (206, 208, 212), (42, 43, 48))
        return np.where((top & (np.hypot(x, y - 0.072) < 0.007))[:, None], (206, 44, 44), color)

    body = moved(rounded_box((0.046, 0.18, 0.02), 0.008, 0.0035), z=0.01)
    return assembly("remote control", body=painted(body, paint, variation=0.01))


def pencil() -> Assembly:
    """A wooden pencil standing on its flat end, 18 cm."""
    outline = [(0, 0), (0.0038, 0), (0.0038, 0.158), (0.0008, 0.176), (0, 0.177)]

    def paint(points: Array) -> Array:
        z = points[:, 2]
        color = np.where((z > 0.158)[:, None], (222, 186, 136), (240, 180, 40))
        color = np.where((z > 0.172)[:, None], (50, 50, 54), color)
        return np.where((z < 0.012)[:, None], (226, 128, 132), color)

    return assembly("pencil", body=painted(lathe(outline, 0.004, segments=16), paint, variation=0.01))


def pole() -> Assembly:
    """A slim wooden rod standing on its flat end, 60 cm."""
    outline = [(0, 0), (0.0105, 0), (0.012, 0.0015), (0.012, 0.5985), (0.0105, 0.6), (0, 0.6)]
    return assembly(
        "pole", body=painted(lathe(outline, 0.008, segments=20), wood((196, 146, 92), "z", 5), variation=0.03)
    )


def candle() -> Assembly:
    """A pillar candle with a wick, 10 cm."""
    wax = lathe(
        [(0, 0), (0.033, 0), (0.035, 0.002), (0.035, 0.096), (0.032, 0.100), (0.012, 0.0965), (0, 0.096)], 0.005
    )
    wick = tube([(0, 0, 0.094), (0, 0.0005, 0.103), (0.002, 0, 0.110)], 0.0014, 0.002)
    solids = [painted(wax, gradient((216, 170, 130), (248, 230, 204)), variation=0.015), painted(wick, (52, 46, 42))]
    return assembly("candle", body=union(solids))
