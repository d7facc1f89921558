"""Bathroom things: tub, washstand, toilet, mirror; origin below, front towards +y."""

from itertools import pairwise

import numpy as np

from dcap.arrays import Array
from dcap.synthetic.furniture.tables import cabinet
from dcap.synthetic.paint import Rgb, painted
from dcap.synthetic.shapes import Assembly, assembly, columns, lathe, loft, moved, rounded_box, rounded_rings, tube


def bathtub(seed: int) -> Assembly:
    """A free-standing tub, 1.7 by 0.78 m, 0.58 m high: a hollow shell with a rounded rim; length along x."""
    levels = [
        (0.10, 0.04, 0.0),
        (0.35, 0.13, 0.0),
        (0.60, 0.25, 0.0),
        (0.68, 0.285, 0.012),
        (0.74, 0.32, 0.12),
        (0.80, 0.35, 0.34),
        (0.823, 0.363, 0.545),
        (0.797, 0.337, 0.545),
        (0.765, 0.312, 0.36),
        (0.69, 0.27, 0.16),
        (0.60, 0.225, 0.095),
        (0.40, 0.15, 0.085),
        (0.12, 0.045, 0.08),
    ]
    dense = [
        tuple(a + (b - a) * t for a, b in zip(p, q, strict=True))
        for p, q in pairwise(levels)
        for t in np.linspace(0, 1, max(1, int(np.ceil(np.linalg.norm(np.subtract(q, p)) / 0.035))), endpoint=False)
    ]
    rings = rounded_rings([*dense, levels[-1]], 120, exponent=3.0)
    shell = loft(rings, np.zeros(3), np.array([0, 0, 0.08]))
    around = np.linspace(0, 2 * np.pi, 14, endpoint=False)
    edge = rounded_rings(
        [(0.812 + 0.036 * np.cos(a), 0.352 + 0.036 * np.cos(a), 0.552 + 0.026 * np.sin(a)) for a in around],
        140,
        exponent=3.0,
    )
    rim = loft(edge, None, None)
    return assembly(
        "bathtub",
        shell=painted(shell, (244, 244, 240), variation=0.012, seed=seed),
        rim=painted(rim, (250, 250, 247), variation=0.01, seed=seed),
    )


def basin_cabinet(timber: Rgb, seed: int) -> Assembly:
    """A washstand: cabinet, stone top, a round basin on the left half of it and a tap."""
    stand = cabinet((1.0, 0.48, 0.82), timber, timber, seed, "basin cabinet", columns=2)
    top = painted(
        moved(rounded_box((1.02, 0.50, 0.03), 0.008, 0.026), z=0.829), (226, 222, 214), variation=0.03, seed=seed
    )
    bowl = lathe(
        [(0, 0), (0.10, 0), (0.17, 0.05), (0.20, 0.13), (0.192, 0.133), (0.162, 0.06), (0.09, 0.018), (0, 0.014)],
        0.02,
        smooth=1,
    )
    basin = moved(painted(bowl, (250, 250, 248), variation=0.01), -0.24, 0.01, 0.8425)
    path = [
        (-0.24, -0.21, 0.84),
        (-0.24, -0.21, 1.03),
        (-0.24, -0.18, 1.075),
        (-0.24, -0.13, 1.075),
        (-0.24, -0.105, 1.04),
    ]
    tap = painted(tube(path, 0.012, 0.014), (188, 192, 198), variation=0.02)
    return assembly(
        "basin cabinet", top=top, body=[*stand.parts[1].solids, *stand.parts[0].solids], basin=[basin], tap=[tap]
    )


def toilet(seed: int) -> Assembly:
    """A toilet with a cistern against the wall behind it."""
    white = (246, 246, 243)
    bowl = loft(
        rounded_rings(
            [
                (0.09, 0.14, 0.0),
                (0.11, 0.17, 0.02),
                (0.10, 0.17, 0.2),
                (0.17, 0.23, 0.36),
                (0.18, 0.24, 0.39),
                (0.16, 0.22, 0.395),
            ],
            40,
            2.6,
        ),
        np.zeros(3),
        np.array([0, 0, 0.395]),
    )
    lid = loft(
        rounded_rings(
            [
                (0.10, 0.15, 0.386),
                (0.185, 0.245, 0.39),
                (0.185, 0.245, 0.412),
                (0.17, 0.23, 0.418),
                (0.09, 0.12, 0.421),
            ],
            44,
            2.6,
        ),
        np.array([0, 0, 0.386]),
        np.array([0, 0, 0.421]),
    )
    cistern = moved(rounded_box((0.38, 0.18, 0.42), 0.03, 0.035), y=-0.29, z=0.60)
    neck = moved(rounded_box((0.22, 0.24, 0.30), 0.04, 0.035), y=-0.24, z=0.26)
    return assembly("toilet", body=[painted(m, white, variation=0.012, seed=seed) for m in (bowl, neck, cistern, lid)])


def mirror(width: float = 0.7, height: float = 0.8) -> Assembly:
    """A wall mirror: back at y = 0, middle at z = 0."""
    body = moved(rounded_box((width, 0.025, height), 0.01, 0.035), y=0.010)

    def paint(points: Array) -> Array:
        glass = (
            (points[:, 1] > 0.018)
            & (np.abs(points[:, 0]) < width / 2 - 0.03)
            & (np.abs(points[:, 2]) < height / 2 - 0.03)
        )
        return np.where(
            glass[:, None],
            columns(0 * points[:, 0] + 176, 196 + 20 * points[:, 2], 206 + 20 * points[:, 2]),
            (150, 120, 80),
        )

    return assembly("mirror", body=painted(body, paint, variation=0.0))
