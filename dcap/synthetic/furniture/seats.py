"""Things to sit on: sofas, armchairs, chairs, stools, benches; front towards +y, origin on the floor."""

import numpy as np

from dcap.scene.types.mesh import Mesh
from dcap.synthetic.paint import Finish, Rgb, painted, wood
from dcap.synthetic.shapes import (
    Assembly,
    Size,
    assembly,
    bar,
    cushioned,
    lathe,
    moved,
    resampled,
    rounded_box,
    tube,
    turned,
)

SINK = 0.003
"""Depth to which cushions press into their support [m]."""
PITCH_DEG = 4.0
"""Backward tilt of a sofa's seat: people and balls settle against its back."""


def sofa(
    seats: int,
    fabric: Finish,
    accent: Finish,
    seed: int,
    label: str = "sofa",
    *,
    seat: float = 0.64,
    depth: float = 0.90,
    arm: float = 0.20,
) -> Assembly:
    """A sofa with one cushion per seat; `seat`, `depth`, `arm` are widths [m]."""
    inner = seats * seat
    width = inner + 2 * arm

    def cover(mesh: Mesh, number: int = 0) -> Mesh:
        return painted(mesh, fabric, variation=0.045, seed=seed + number)

    def leaning(mesh: Mesh) -> Mesh:
        """Turned about the middle of the seat's underside."""
        return moved(turned(moved(mesh, y=-0.12, z=-0.28), "x", PITCH_DEG), y=0.12, z=0.28)

    base = cover(leaning(moved(rounded_box((width - 0.04, depth - 0.06, 0.20), 0.025, 0.035), y=0.0, z=0.18)))
    feet = [
        painted(
            bar(
                (x * (width / 2 - 0.10), y * (depth / 2 - 0.10), 0.0),
                (x * (width / 2 - 0.10), y * (depth / 2 - 0.10), 0.12),
                0.018,
                taper=1.3,
            ),
            (70, 48, 34),
        )
        for x in (-1, 1)
        for y in (-1, 1)
    ]
    cushions = []
    for index in range(seats):
        box = cushioned(rounded_box((seat - 0.006, depth - 0.24, 0.16), 0.05, 0.026), 0.022, 0.0)
        x = (index - (seats - 1) / 2) * seat
        seated = leaning(moved(box, x, 0.12, 0.28 - SINK + 0.08))
        cushions.append(painted(seated, accent, variation=0.04, seed=seed + index))
    back = [
        cover(
            moved(turned(rounded_box((inner + 0.03, 0.17, 0.62), 0.06, 0.03), "x", 6), y=-depth / 2 + 0.115, z=0.50), 7
        )
    ]
    for index in range(seats):
        pad = cushioned(rounded_box((seat - 0.012, 0.40, 0.14), 0.055, 0.026), 0.03, 0.0)
        pad = turned(turned(pad, "x", -90), "x", 14)
        back.append(
            painted(
                moved(pad, (index - (seats - 1) / 2) * seat, -depth / 2 + 0.25, 0.635),
                accent,
                variation=0.04,
                seed=seed + 20 + index,
            )
        )
    arms = [
        cover(moved(rounded_box((arm, depth, 0.50), 0.07, 0.03), x=s * (width - arm) / 2, z=0.35), 9) for s in (-1, 1)
    ]
    return assembly(label, base=[base, *feet], seat_cushion=cushions, back=back, arm=arms)


def chair(timber: Rgb, seed: int, pad: Finish | None = None, label: str = "chair") -> Assembly:
    """A dining chair: turned legs, slatted back, seat with an optional cushion."""
    grain = wood(timber, "y", seed)
    seat: list[Mesh] = [painted(moved(rounded_box((0.44, 0.42, 0.035), 0.014, 0.024), z=0.4375), grain, seed=seed)]
    if pad is not None:
        body = moved(cushioned(rounded_box((0.40, 0.38, 0.05), 0.022, 0.022), 0.012), z=0.455 - SINK + 0.025)
        seat.append(painted(body, pad, variation=0.03, seed=seed + 1))
    legs = [_turned_leg((x * 0.185, y * 0.175), (x * 0.205, y * 0.19), 0.43) for x in (-1, 1) for y in (-1, 1)]
    rails = [bar((x * 0.192, -0.18, 0.20), (x * 0.192, 0.18, 0.20), 0.010) for x in (-1, 1)]
    back = [
        tube(
            resampled(np.array([[s * 0.19, -0.195, 0.44], [s * 0.195, -0.215, 0.70], [s * 0.195, -0.25, 0.94]]), 0.03),
            0.016,
        )
        for s in (-1, 1)
    ]
    for z, height in ((0.885, 0.09), (0.74, 0.05), (0.62, 0.05)):
        y = -0.195 - 0.055 * ((z - 0.44) / 0.50) ** 1.3
        back.append(moved(turned(rounded_box((0.39, 0.020, height), 0.008, 0.024), "x", 8), y=y, z=z))
    return assembly(
        label,
        seat=seat,
        leg=[painted(m, grain, seed=seed) for m in legs + rails],
        back=[painted(m, grain, seed=seed) for m in back],
    )


def _turned_leg(top: tuple[float, float], foot: tuple[float, float], height: float) -> Mesh:
    """A leg with a swelling, from the floor to `height`."""
    path = resampled(np.array([(*foot, 0.0), (*top, height)]), 0.025)
    t = path[:, 2] / height
    radius = 0.013 + 0.007 * np.sin(np.pi * np.clip(t * 1.1, 0, 1)) + 0.004 * (np.abs(t - 0.72) < 0.05)
    return tube(path, radius, 0.02, round_ends=False)


def office_chair(fabric: Rgb, seed: int) -> Assembly:
    """A chair on a star base with a padded seat and back."""
    dark = (46, 48, 52)
    seat = moved(cushioned(rounded_box((0.48, 0.46, 0.09), 0.04, 0.024), 0.012), z=0.465)
    back = moved(turned(rounded_box((0.44, 0.07, 0.52), 0.033, 0.026), "x", 8), y=-0.245, z=0.80)
    arm = bar((0, -0.23, 0.44), (0, -0.27, 0.66), 0.022)
    legs = [bar((0, 0, 0.05), (0, 0, 0.43), 0.026)]
    for k in range(5):
        a = 2 * np.pi * k / 5 + 0.3
        legs.append(bar((0, 0, 0.085), (0.26 * np.cos(a), 0.26 * np.sin(a), 0.055), 0.02, taper=0.7))
        legs.append(
            moved(
                lathe([(0, 0), (0.024, 0), (0.028, 0.03), (0.024, 0.06), (0, 0.06)], 0.018),
                0.26 * np.cos(a),
                0.26 * np.sin(a),
            )
        )
    cover = [painted(m, fabric, variation=0.04, seed=seed) for m in (seat, back)]
    return assembly("chair", seat=[cover[0]], back=[cover[1], painted(arm, dark)], leg=[painted(m, dark) for m in legs])


def stool(top: Rgb, timber: Rgb, seed: int, height: float = 0.45, radius: float = 0.17) -> Assembly:
    """A round wooden stool with four splayed legs."""
    seat = lathe(
        [
            (0, height - 0.035),
            (radius - 0.012, height - 0.035),
            (radius, height - 0.022),
            (radius - 0.004, height - 0.004),
            (radius - 0.014, height),
            (0, height),
        ],
        0.02,
    )
    legs = [
        _turned_leg((x * 0.62 * radius, y * 0.62 * radius), (x * 0.82 * radius, y * 0.82 * radius), height - 0.025)
        for x in (-1, 1)
        for y in (-1, 1)
    ]
    return assembly(
        "stool",
        seat=painted(seat, wood(top, "x", seed), seed=seed),
        leg=[painted(m, wood(timber, "z", seed)) for m in legs],
    )


def ottoman(fabric: Finish, seed: int, size: Size = (1.1, 0.45, 0.46), label: str = "stool") -> Assembly:
    """An upholstered bench with short legs."""
    seat = cushioned(
        moved(rounded_box((size[0], size[1], size[2] - 0.13), 0.05, 0.026), z=size[2] - (size[2] - 0.13) / 2), 0.014
    )
    legs = [
        bar(
            (x * (size[0] / 2 - 0.07), y * (size[1] / 2 - 0.07), 0.0),
            (x * (size[0] / 2 - 0.07), y * (size[1] / 2 - 0.07), 0.15),
            0.016,
            taper=1.35,
        )
        for x in (-1, 1)
        for y in (-1, 1)
    ]
    return assembly(
        label, seat=painted(seat, fabric, variation=0.04, seed=seed), leg=[painted(m, (84, 58, 38)) for m in legs]
    )
