"""Balls, a dumbbell and toys to place, standing on z = 0 [m], their front towards +y."""

import numpy as np

from dcap.arrays import Array
from dcap.scene.types.mesh import Mesh
from dcap.synthetic.paint import blend, painted
from dcap.synthetic.shapes import Assembly, assembly, columns, lathe, moved, rounded_box, sphere, turned, union


def toy_ball() -> Assembly:
    """A rubber ball with a coloured belt, 20 cm."""

    def paint(points: Array) -> Array:
        height = points[:, 2] / 0.1
        belt = (0.34 - np.abs(height)) / 0.05 + 0.5
        rim = (0.06 - np.abs(np.abs(height) - 0.40)) / 0.04
        return blend(rim, blend(belt, (214, 52, 46), (250, 210, 70)), (245, 245, 240))

    return assembly("ball", body=moved(painted(sphere(0.10, 0.006), paint, variation=0.01), z=0.10))


def basketball() -> Assembly:
    """An orange ball with black seams, 24 cm."""

    def paint(points: Array) -> Array:
        x, y, z = (points / 0.12).T
        side = np.abs(np.abs(y) - 0.62 * np.sqrt(np.clip(1 - 0.75 * z**2, 0, 1)))
        seam = np.minimum.reduce([np.abs(x), np.abs(z), side])
        return blend((0.03 - seam) / 0.03 + 0.5, (216, 110, 44), (44, 34, 30))

    return assembly("basketball", body=moved(painted(sphere(0.12, 0.0055), paint, variation=0.03), z=0.12))


def soccer_ball() -> Assembly:
    """A white ball with twelve black pentagons, 22 cm."""
    golden = (1 + 5**0.5) / 2
    corners = np.array([[0, a, b * golden] for a in (-1, 1) for b in (-1, 1)], float)
    axes = np.concatenate([np.roll(corners, k, axis=1) for k in range(3)]) / np.hypot(1, golden)

    def paint(points: Array) -> Array:
        closeness = np.sort(points / 0.11 @ axes.T, axis=1)[:, ::-1]
        black = np.clip((closeness[:, 0] - 0.935) / 0.02 + 0.5, 0, 1)
        seam = np.clip((0.025 - (closeness[:, 0] - closeness[:, 1])) / 0.03, 0, 1) * (1 - black)
        return blend(np.maximum(black, 0.7 * seam), (244, 244, 240), (30, 30, 34))

    return assembly("soccer ball", body=moved(painted(sphere(0.11, 0.005), paint, variation=0.01), z=0.11))


def tennis_ball() -> Assembly:
    """A yellow felt ball with its curved white line, 6.7 cm."""

    def paint(points: Array) -> Array:
        x, y, z = (points / 0.0335).T
        line = np.abs(z - 0.9 * (x**2 - y**2))
        return blend((0.16 - line) / 0.12, (206, 222, 66), (240, 242, 232))

    return assembly("tennis ball", body=moved(painted(sphere(0.0335, 0.0022), paint, variation=0.03), z=0.0335))


def dumbbell() -> Assembly:
    """A lying dumbbell, 26 cm long: two rounded heads and a bulging steel handle."""
    outline = [(0, -0.04), (0.044, -0.04), (0.052, -0.032), (0.052, 0.032), (0.044, 0.04), (0, 0.04)]
    cap_height = 0.0385
    head = lathe(outline, 0.006)

    def paint(points: Array) -> Array:
        cap = np.clip((0.024 - np.hypot(points[:, 0], points[:, 1])) / 0.003, 0, 1) * (
            np.abs(points[:, 2]) > cap_height
        )
        return blend(cap, (46, 48, 54), (196, 60, 48))

    heads = [moved(turned(painted(head, paint, variation=0.04), "y", 90), x=s * 0.09, z=0.052) for s in (-1, 1)]
    grip = [(0, -0.075), (0.013, -0.075), (0.0145, -0.045), (0.0175, 0), (0.0145, 0.045), (0.013, 0.075), (0, 0.075)]
    handle = painted(lathe(grip, 0.005, smooth=1), (182, 186, 192), variation=0.02)
    return assembly("dumbbell", head=heads, handle=moved(turned(handle, "y", 90), z=0.052))


def toy_block() -> Assembly:
    """A painted wooden cube, 6 cm."""

    def paint(points: Array) -> Array:
        local = np.abs(points - (0, 0, 0.03)) / 0.03
        frame = np.sort(local, axis=1)[:, 1]
        axis = np.argmax(local, axis=1)
        fill = np.array([(208, 62, 54), (58, 122, 190), (244, 196, 64)], float)[axis]
        return np.where((frame > 0.72)[:, None], (232, 208, 166), fill)

    return assembly(
        "toy block", body=painted(moved(rounded_box((0.06, 0.06, 0.06), 0.005, 0.0028), z=0.03), paint, variation=0.01)
    )


def toy_car() -> Assembly:
    """A small car: a red body with windows, four black wheels."""
    low = car_body((0.14, 0.066, 0.030), 0.012)
    cabin = moved(rounded_box((0.078, 0.058, 0.036), 0.014, 0.004), x=-0.006, z=0.050)

    def paint(points: Array) -> Array:
        x, y, z = points.T
        glass = (z > 0.048) & (z < 0.063) & ((np.abs(y) > 0.024) | (np.abs(x + 0.006) > 0.03))
        lamp = (np.abs(x) > 0.064) & (np.abs(np.abs(y) - 0.022) < 0.007) & (np.abs(z - 0.032) < 0.006)
        color = np.where(glass[:, None], (150, 196, 220), (202, 44, 42))
        return np.where(lamp[:, None], (250, 240, 180), color)

    body = painted(union([moved(low, z=0.031), cabin]), paint, variation=0.01)
    tyre = lathe([(0, -0.008), (0.012, -0.008), (0.0165, -0.006), (0.0165, 0.006), (0.012, 0.008), (0, 0.008)], 0.003)

    def rubber(points: Array) -> Array:
        hub = np.hypot(points[:, 0], points[:, 1]) < 0.008
        return np.where(hub[:, None], (200, 202, 206), (36, 36, 38))

    wheel = turned(painted(tyre, rubber), "x", 90)
    wheels = [moved(wheel, x=a * 0.042, y=b * 0.030, z=0.0165) for a in (-1, 1) for b in (-1, 1)]
    return assembly("toy car", body=body, wheel=wheels)


def car_body(size: tuple[float, float, float], radius: float) -> Mesh:
    """A rounded box whose top narrows a little."""
    box = rounded_box(size, radius, 0.004)
    narrow = 1 - 0.10 * (box.vertices[:, 2:] / size[2] + 0.5)
    return Mesh(box.vertices * columns(narrow, narrow, np.ones_like(narrow)), box.faces, box.colors)
