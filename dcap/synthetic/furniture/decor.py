"""Lamps, plants, books, rugs, curtains, pictures, television, toys; origin below, front towards +y."""

import numpy as np

from dcap.arrays import Array
from dcap.scene.types.mesh import Mesh
from dcap.synthetic.paint import Finish, Painter, Rgb, blend, gradient, painted, smooth_noise, wood
from dcap.synthetic.shapes import (
    Assembly,
    assembly,
    bar,
    columns,
    ellipsoid,
    grid_surface,
    lathe,
    lens,
    line,
    moved,
    outward,
    rounded_box,
    sphere,
    tube,
    turned,
    warped,
)


def _shade(top: float, bottom: float, height: float, fabric: Rgb, seed: int) -> Mesh:
    """A hollow truncated cone, open above and below, its lower rim at z = 0 [m]."""
    wall = 0.006
    outline = [(bottom - wall, 0), (bottom, 0), (top, height), (top - wall, height), (bottom - wall, 0)]
    low = np.asarray(fabric, float)
    return painted(lathe(outline, 0.02), gradient(low * 1.02, low * 0.95), variation=0.02, seed=seed)


def floor_lamp(fabric: Rgb, metal: Rgb, seed: int) -> Assembly:
    """A standing lamp: disc, pole and a conical shade with a closed cap, so that a thing can be placed on its slope."""
    base = lathe([(0, 0), (0.15, 0), (0.155, 0.008), (0.15, 0.018), (0.03, 0.03), (0, 0.03)], 0.02)
    pole = bar((0, 0, 0.025), (0, 0, 1.36), 0.012)
    shade = moved(_shade(0.06, 0.23, 0.30, fabric, seed), z=1.24)
    spokes = [bar((0, 0, 1.5), (0.057 * np.cos(a), 0.057 * np.sin(a), 1.532), 0.004) for a in np.arange(3) * 2.094]
    stem = bar((0, 0, 1.34), (0, 0, 1.51), 0.008)
    return assembly(
        "floor lamp", base=painted(base, metal), pole=[painted(m, metal) for m in (pole, stem, *spokes)], shade=shade
    )


def table_lamp(fabric: Rgb, glaze: Rgb, seed: int) -> Assembly:
    """A lamp with a turned ceramic foot and a conical shade."""
    base = lathe(
        [
            (0, 0),
            (0.065, 0),
            (0.068, 0.012),
            (0.045, 0.03),
            (0.075, 0.09),
            (0.06, 0.15),
            (0.022, 0.19),
            (0.018, 0.21),
            (0, 0.21),
        ],
        0.014,
        smooth=1,
    )
    pole = bar((0, 0, 0.20), (0, 0, 0.40), 0.007)
    spokes = [bar((0, 0, 0.395), (0.058 * np.cos(a), 0.058 * np.sin(a), 0.408), 0.0035) for a in np.arange(3) * 2.094]
    shade = moved(_shade(0.06, 0.145, 0.20, fabric, seed), z=0.215)
    return assembly(
        "table lamp",
        base=painted(base, glaze, variation=0.05, seed=seed),
        pole=[painted(m, (190, 170, 120)) for m in (pole, *spokes)],
        shade=shade,
    )


def ceiling_lamp(height: float) -> Assembly:
    """A round dome below a ceiling of the given height [m]."""
    dome = lathe([(0, -0.10), (0.10, -0.092), (0.18, -0.055), (0.20, 0.0), (0, 0.0)], 0.03, smooth=1)
    return assembly("ceiling lamp", body=moved(painted(dome, (250, 244, 226), variation=0.01), z=height + 0.004))


def plant(seed: int, height: float = 1.1, pot: Rgb = (190, 112, 78)) -> Assembly:
    """A potted plant with long bending leaves."""
    rng = np.random.default_rng(seed)
    s = height / 1.1
    body = lathe(
        [
            (0, 0),
            (0.10 * s, 0),
            (0.145 * s, 0.26 * s),
            (0.15 * s, 0.28 * s),
            (0.135 * s, 0.28 * s),
            (0.125 * s, 0.24 * s),
            (0, 0.24 * s),
        ],
        0.022,
    )
    soil = (74, 54, 40)

    def paint(points: Array) -> Array:
        inner = (points[:, 2] > 0.235 * s) & (np.hypot(points[:, 0], points[:, 1]) < 0.127 * s)
        return np.where(inner[:, None], soil, pot)

    leaves: list[Mesh] = []
    for k in range(22):
        angle, lean = 2.4 * k + rng.uniform(-0.3, 0.3), rng.uniform(0.15, 0.75)
        leaves.append(_leaf(angle, lean, s * rng.uniform(0.5, 0.95), s * rng.uniform(0.03, 0.05), 0.23 * s, rng))
    return assembly("plant", body=painted(body, paint, variation=0.05, seed=seed), leaves=leaves)


def _leaf(angle: float, lean: float, length: float, width: float, start: float, rng: np.random.Generator) -> Mesh:
    """A closed thin blade that rises and bends outwards."""
    flat = grid_surface(line(-1, 1, 0.5), line(0, 1, 0.085), np.array([-1.0, 1.0]))
    green = np.array([62, 118, 58]) * rng.uniform(0.8, 1.2) + rng.uniform(-8, 8, 3)

    def change(points: Array) -> Array:
        u, t, side = points.T
        shape = width * np.sin(np.pi * np.clip(0.04 + 0.95 * t, 0, 1)) ** 0.8
        out = length * lean * (0.45 * t + 0.35 * t**3)
        up = length * (t * np.sqrt(max(1 - lean**2, 0.2)) - 0.55 * lean * t**3)
        x, y, z = out, shape * u, start + up + 0.3 * shape * u**2 + 0.0025 * side
        return columns(x * np.cos(angle) - y * np.sin(angle), x * np.sin(angle) + y * np.cos(angle), z)

    return painted(outward(warped(flat, change)), green, variation=0.08, seed=int(rng.integers(1 << 30)))


BOOK_COLORS = (
    (168, 52, 50),
    (42, 84, 130),
    (58, 112, 84),
    (212, 172, 84),
    (92, 62, 104),
    (222, 216, 200),
    (60, 62, 70),
    (200, 112, 60),
)


def book_row(length: float, depth: float, room: float, seed: int) -> Assembly:
    """Upright books side by side along x, spines towards +y; `room` is the height available [m]."""
    rng = np.random.default_rng(seed)
    books: list[Mesh] = []
    x = -length / 2
    while True:
        thickness = float(rng.uniform(0.022, 0.05))
        if x + thickness > length / 2:
            return assembly("book", body=books)
        size = (thickness, depth * float(rng.uniform(0.6, 0.8)), room * float(rng.uniform(0.62, 0.85)))
        color = np.array(BOOK_COLORS[int(rng.integers(len(BOOK_COLORS)))], float)
        solid = rounded_box(size, 0.004, 0.035)
        books.append(
            moved(
                painted(solid, _spine(color, size[2]), seed=seed),
                x + thickness / 2,
                (0.8 * depth - size[1]) / 2,
                size[2] / 2 - 0.001,
            )
        )
        x += thickness + 0.0015


def _spine(color: Array, height: float) -> Painter:
    def paint(points: Array) -> Array:
        paper = (points[:, 2] > 0.495 * height) | (points[:, 1] < points[:, 1].min() + 0.002)
        band = np.abs(points[:, 2] - 0.28 * height) < 0.022
        return np.where(paper[:, None], (232, 224, 204), np.where(band[:, None], 0.6 * color + 90, color))

    return paint


def book_stack(count: int, seed: int) -> Assembly:
    """Books lying on top of each other, slightly turned."""
    rng = np.random.default_rng(seed)
    books: list[Mesh] = []
    z = -0.001
    for k in range(count):
        thickness = float(rng.uniform(0.022, 0.04))
        color = BOOK_COLORS[int(rng.integers(len(BOOK_COLORS)))]
        solid = painted(rounded_box((0.21 - 0.012 * k, 0.15 - 0.01 * k, thickness), 0.004, 0.02), color, seed=seed + k)
        books.append(moved(turned(solid, "z", float(rng.uniform(-14, 14))), z=z + thickness / 2))
        z += thickness - 0.001
    return assembly("book", body=books)


def rug(width: float, depth: float, pattern: Painter, seed: int) -> Assembly:
    """A woven rug, 12 mm thick, pressed 3 mm into the floor so that it touches it all over."""
    body = moved(rounded_box((width, depth, 0.015), 0.005, 0.034), z=0.0045)
    return assembly("rug", body=painted(body, pattern, variation=0.04, seed=seed))


def round_rug(radius: float, inner: Rgb, outer: Rgb, seed: int) -> Assembly:
    """A round rug with rings."""
    outline = [(0, -0.003), (radius - 0.004, -0.003), (radius, 0.004), (radius - 0.005, 0.012), (0, 0.012)]

    def paint(points: Array) -> Array:
        reach = np.hypot(points[:, 0], points[:, 1]) / radius
        return blend(0.5 + 4 * (np.abs(np.mod(reach * 2.5, 1) - 0.5) - 0.25), inner, outer)

    return assembly("rug", body=painted(lathe(outline, 0.045, segments=80), paint, variation=0.04, seed=seed))


def curtain(width: float, height: float, fabric: Rgb, seed: int) -> Assembly:
    """A pleated curtain hanging down to `z` = 0 from its rod; x along the wall."""
    flat = grid_surface(line(-width / 2, width / 2, 0.018), line(0.0, height, 0.10), np.array([-1.0, 1.0]))

    def change(points: Array) -> Array:
        x, z, side = points.T
        fold = 0.028 * np.sin(2 * np.pi * x / 0.115 + 0.6 * np.sin(2.3 * z)) * (0.65 + 0.35 * (1 - z / height))
        return columns(x, 0.07 + fold + 0.005 * side, z)

    cloth = painted(outward(warped(flat, change)), fabric, variation=0.03, seed=seed)
    return assembly("curtain", body=cloth)


def picture(width: float, height: float, seed: int) -> Assembly:
    """A framed picture hanging on the wall behind it: back at y = 0, middle at z = 0."""
    rng = np.random.default_rng(seed)
    colors = [np.array(BOOK_COLORS[int(i)], float) for i in rng.choice(len(BOOK_COLORS), 3, replace=False)]
    frame = moved(rounded_box((width, 0.03, height), 0.008, 0.03), y=0.012)

    def paint(points: Array) -> Array:
        x, y, z = points[:, 0] / width, points[:, 1], points[:, 2] / height
        inside = (np.abs(x) < 0.5 - 0.05 / width) & (np.abs(z) < 0.5 - 0.05 / height) & (y > 0.02)
        mat = inside & ((np.abs(x) > 0.5 - 0.11 / width) | (np.abs(z) > 0.5 - 0.11 / height))
        hill = z + 0.22 * np.sin(5 * x + seed) * smooth_noise(columns(x, 0 * x, 0 * x), seed, 1.2)
        art = blend((hill + 0.15) / 0.1, blend((hill + 0.3) / 0.1, colors[0], colors[1]), colors[2] * 0.5 + 120)
        return np.where(mat[:, None], (244, 240, 230), np.where(inside[:, None], art, (70, 50, 38)))

    return assembly("picture", body=painted(frame, paint, variation=0.0))


def television(width: float = 1.1) -> Assembly:
    """A flat television on a small foot."""
    screen = moved(rounded_box((width, 0.035, 0.58 * width), 0.01, 0.05), z=0.05 + 0.29 * width)
    foot = [
        moved(rounded_box((0.36, 0.18, 0.014), 0.006, 0.03), z=0.006),
        moved(rounded_box((0.08, 0.03, 0.10), 0.01, 0.03), z=0.05),
    ]

    def paint(points: Array) -> Array:
        glow = (points[:, 1] > 0.014) & (np.abs(points[:, 0]) < 0.48 * width)
        shade = 34 + 22 * np.clip(points[:, 2] + 0.4 * points[:, 0], 0, 1)
        return np.where(glow[:, None], columns(shade, shade + 6, shade + 14), (24, 24, 26))

    return assembly("tv", body=[painted(screen, paint, variation=0.0), *(painted(m, (30, 30, 32)) for m in foot)])


def small_vase(glaze: Rgb, seed: int, height: float = 0.24) -> Assembly:
    """A slim vase with three dried stems."""
    s = height / 0.24
    body = lathe(
        [
            (0, 0),
            (0.045 * s, 0),
            (0.07 * s, 0.09 * s),
            (0.03 * s, 0.19 * s),
            (0.04 * s, 0.24 * s),
            (0.033 * s, 0.238 * s),
            (0.022 * s, 0.19 * s),
            (0, 0.17 * s),
        ],
        0.016,
        smooth=1,
    )
    rng = np.random.default_rng(seed)
    stems: list[Mesh] = []
    for k in range(3):
        tip = np.array([0.10 * np.cos(2.1 * k + 1), 0.10 * np.sin(2.1 * k + 1), height + rng.uniform(0.12, 0.24)])
        stems.append(
            painted(
                tube(
                    [
                        (0, 0, 0.8 * height),
                        tuple(0.4 * tip * (1, 1, 0) + (0, 0, 0.6 * tip[2] + 0.4 * height)),
                        tuple(tip),
                    ],
                    0.003,
                ),
                (122, 104, 62),
            )
        )
        stems.append(painted(moved(ellipsoid((0.016, 0.016, 0.03), 0.012), *tip), (214, 178, 112), seed=k))
    return assembly("vase", body=[painted(body, glaze, variation=0.05, seed=seed), *stems])


def toy_crate(seed: int) -> Assembly:
    """A low open wooden box with toy balls and blocks in it."""
    grain = wood((206, 166, 112), "x", seed)
    walls = [moved(rounded_box((0.56, 0.36, 0.018), 0.004, 0.03), z=0.009)]
    walls += [moved(rounded_box((0.56, 0.016, 0.26), 0.004, 0.03), y=s * 0.172, z=0.13) for s in (-1, 1)]
    walls += [moved(rounded_box((0.016, 0.36, 0.26), 0.004, 0.03), x=s * 0.272, z=0.13) for s in (-1, 1)]
    rng = np.random.default_rng(seed)
    toys = []
    for k in range(10):
        color = BOOK_COLORS[int(rng.integers(len(BOOK_COLORS)))]
        x, y = (k % 4 - 1.5) * 0.12, (k // 4 - 1) * 0.105
        solid = sphere(0.05, 0.02) if k % 3 else rounded_box((0.08, 0.08, 0.08), 0.008, 0.02)
        toys.append(painted(moved(solid, x, y, 0.018 + (0.049 if k % 3 else 0.039)), color))
    return assembly("storage box", body=[painted(m, grain, seed=seed) for m in walls], toy=toys)


def cushion_on_slope(pattern: Finish, tilt_deg: float, seed: int, label: str = "cushion") -> Assembly:
    """A throw cushion leaning back by `tilt_deg` from lying, its lower rim on z = 0, its face towards +y."""
    body = turned(
        painted(lens(0.21, 0.21, 0.065, 0.06, edge=0.018), pattern, variation=0.03, seed=seed), "x", -tilt_deg
    )
    return assembly(label, body=moved(body, z=-float(body.bounds[0, 2])))
