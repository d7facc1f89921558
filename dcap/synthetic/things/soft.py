"""Soft and mixed things to place, standing or lying on z = 0 [m], their front towards +y."""

from collections.abc import Callable, Sequence

import numpy as np
from skimage.measure import marching_cubes

from dcap.arrays import Array
from dcap.scene.types.mesh import Mesh
from dcap.synthetic.paint import Painter, Rgb, blend, checks, painted, smooth_noise, stripes
from dcap.synthetic.shapes import (
    Assembly,
    assembly,
    columns,
    difference,
    ellipsoid,
    lens,
    loft,
    moved,
    outward,
    rounded_box,
    scaled,
    turned,
    union,
    warped,
)

Blob = tuple[tuple[float, float, float], tuple[float, float, float], Rgb]
"""Centre [m], half axes [m] and colour of an ellipsoid."""


def blended(blobs: Sequence[Blob], *, spacing: float, softness: float) -> Mesh:
    """Ellipsoids melted into one closed skin by a smooth minimum of their distances; `softness` [m] rounds the joints.

    The distance to an ellipsoid is the usual first-order estimate f / |grad f|; marching cubes makes the skin.
    """
    centers, radii = np.array([b[0] for b in blobs]), np.array([b[1] for b in blobs])
    low = (centers - radii).min(axis=0) - 3 * spacing
    counts = np.ceil(((centers + radii).max(axis=0) + 3 * spacing - low) / spacing).astype(int) + 1
    points = low + spacing * np.moveaxis(np.indices(tuple(counts)), 0, -1).reshape(-1, 3)
    distances = np.stack([_ellipsoid_distance(points, c, r) for c, r in zip(centers, radii, strict=True)])
    field = -softness * np.log(np.exp(-np.clip(distances / softness, -60, 60)).sum(axis=0))
    vertices, faces, _, _ = marching_cubes(field.reshape(tuple(counts)), 0.0, spacing=(spacing,) * 3)  # type: ignore[no-untyped-call]
    mesh = outward(Mesh.of(vertices + low, faces))
    near = np.stack([_ellipsoid_distance(mesh.vertices, c, r) for c, r in zip(centers, radii, strict=True)])
    share = np.exp(-np.clip((near - near.min(axis=0)) / (0.35 * softness), 0, 60))
    colors = (share / share.sum(axis=0)).T @ np.array([b[2] for b in blobs], float)
    fur = 1 + 0.05 * smooth_noise(mesh.vertices, 7, 0.02) + 0.03 * smooth_noise(mesh.vertices, 8, 0.06)
    return Mesh.of(mesh.vertices, mesh.faces, np.clip(colors * fur[:, None], 0, 255).astype(np.uint8))


def _ellipsoid_distance(points: Array, center: Array, radii: Array) -> Array:
    local = (points - center) / radii
    size = np.linalg.norm(local, axis=1)
    slope = np.linalg.norm(local / radii, axis=1)
    result: Array = size * (size - 1) / np.maximum(slope, 1e-9)
    return result


def plush_bear() -> Assembly:
    """A sitting teddy bear, 32 cm high, with a muzzle, ears, limbs and black eyes; it looks towards +y."""
    fur, light, pad = (156, 104, 62), (214, 176, 128), (228, 196, 156)
    blobs: list[Blob] = [
        ((0, 0, 0.085), (0.075, 0.066, 0.084), fur),
        ((0, -0.030, 0.032), (0.066, 0.052, 0.031), fur),  # a broad seat: toys that sit have one
        ((0, 0.016, 0.085), (0.056, 0.058, 0.062), light),
        ((0, 0.008, 0.220), (0.068, 0.060, 0.060), fur),
        ((0, 0.064, 0.205), (0.031, 0.026, 0.024), light),
        ((0, 0.088, 0.213), (0.0105, 0.008, 0.008), (40, 30, 28)),
    ]
    for side in (-1, 1):
        blobs += [
            ((side * 0.056, 0.0, 0.268), (0.026, 0.014, 0.026), fur),
            ((side * 0.056, 0.009, 0.266), (0.017, 0.010, 0.017), light),
            ((side * 0.085, 0.034, 0.122), (0.027, 0.050, 0.029), fur),
            ((side * 0.058, 0.082, 0.034), (0.034, 0.062, 0.033), fur),
            ((side * 0.058, 0.141, 0.038), (0.028, 0.012, 0.029), pad),
        ]
    body = blended(blobs, spacing=0.0052, softness=0.0035)
    eyes = [
        painted(moved(ellipsoid((0.0075, 0.0065, 0.0085), 0.0022), s * 0.026, 0.0612, 0.236), (22, 18, 18))
        for s in (-1, 1)
    ]
    return _standing(assembly("plush toy", body=body, eye=eyes))


def plush_rabbit() -> Assembly:
    """A sitting plush rabbit with long ears, 34 cm high; it looks towards +y."""
    fur, light = (212, 208, 204), (244, 214, 212)
    blobs: list[Blob] = [
        ((0, 0, 0.075), (0.064, 0.058, 0.075), fur),
        ((0, 0.014, 0.075), (0.046, 0.050, 0.054), (246, 242, 236)),
        ((0, 0.006, 0.190), (0.055, 0.051, 0.051), fur),
        ((0, 0.050, 0.178), (0.026, 0.017, 0.018), (246, 242, 236)),
        ((0, 0.066, 0.186), (0.007, 0.006, 0.006), (222, 130, 138)),
        ((0, -0.060, 0.040), (0.022, 0.022, 0.022), (250, 248, 244)),
    ]
    for side in (-1, 1):
        blobs += [
            ((side * 0.030, -0.004, 0.268), (0.019, 0.012, 0.060), fur),
            ((side * 0.030, 0.004, 0.268), (0.012, 0.008, 0.046), light),
            ((side * 0.066, 0.026, 0.100), (0.020, 0.040, 0.022), fur),
            ((side * 0.048, 0.074, 0.026), (0.026, 0.056, 0.026), fur),
        ]
    body = blended(blobs, spacing=0.0048, softness=0.003)
    eyes = [
        painted(moved(ellipsoid((0.006, 0.005, 0.007), 0.0018), s * 0.023, 0.0485, 0.203), (24, 20, 24))
        for s in (-1, 1)
    ]
    return _standing(assembly("plush rabbit", body=body, eye=eyes))


def _standing(toy: Assembly) -> Assembly:
    """The toy with its lowest point at z = 0."""
    return toy.placed(z=-float(toy.bounds[0, 2]))


def pillow() -> Assembly:
    """A bed pillow, 66 by 44 cm, with a striped cover."""
    cover = stripes((236, 234, 226), (120, 152, 178), "x", 0.11, 0.3)
    return assembly("pillow", body=moved(painted(lens(0.33, 0.22, 0.075, 0.055, edge=0.014), cover), z=0.061))


def cushion() -> Assembly:
    """A square throw cushion, 42 cm."""
    return assembly(
        "cushion",
        body=moved(
            painted(lens(0.21, 0.21, 0.07, 0.06, edge=0.011), checks((196, 118, 66), (238, 212, 164), 0.105)), z=0.066
        ),
    )


def _folded(size: tuple[float, float], layer: float, count: int, painter: Painter, seed: int, edge: float) -> Mesh:
    """Flat layers with round rims on top of each other, united where they touch; a fold closes one side."""
    rng = np.random.default_rng(seed)
    solids = []
    for level in range(count):
        shrink = 1 - 0.012 * level
        slab = rounded_box((size[0] * shrink, size[1] * shrink, layer), 0.499 * layer, edge)
        slab = painted(warped(slab, _wrinkled(seed + level, 0.0012)), painter, variation=0.04, seed=seed)
        shift = rng.uniform(-0.002, 0.002, 2)
        solids.append(moved(slab, float(shift[0]), float(shift[1]), layer / 2 + level * 0.86 * layer))
    fold = rounded_box((0.9 * layer, size[1] * 0.975, layer * (0.86 * (count - 1) + 0.9)), 0.45 * layer, edge)
    fold = moved(
        painted(fold, painter, seed=seed), -size[0] / 2 + 0.55 * layer, 0, layer * (0.86 * (count - 1) + 1) / 2
    )
    return union([*solids, fold])


def _wrinkled(seed: int, depth: float) -> Callable[[Array], Array]:
    def change(points: Array) -> Array:
        return points + depth * columns(np.zeros((len(points), 2)), smooth_noise(points, seed, 0.12))

    return change


def folded_towel() -> Assembly:
    """A terry towel folded to 34 by 24 cm, four layers."""

    def paint(points: Array) -> Array:
        band = (0.012 - np.abs(np.abs(points[:, 0]) - 0.115)) / 0.004
        return blend(band, (92, 158, 150), (238, 234, 222))

    mesh = _folded((0.34, 0.24), 0.019, 4, paint, 3, 0.0085)
    return _standing(assembly("towel", body=mesh))


def folded_blanket() -> Assembly:
    """A woollen blanket folded to 52 by 40 cm, four thick layers."""
    mesh = _folded((0.52, 0.40), 0.030, 4, checks((150, 52, 56), (228, 204, 168), 0.13), 5, 0.013)
    return _standing(assembly("blanket", body=mesh))


def shoe() -> Assembly:
    """A sneaker, 28 cm long, its toe towards +y: a rubber sole and a hollow fabric upper."""
    return assembly("shoe", sole=_sole(), upper=_upper())


def _half_width(s: Array) -> Array:
    """Half width of the foot over its length s in 0 (heel) .. 1 (toe) [m]."""
    ends = np.clip(1 - np.abs(2 * s - 1) ** 5, 0, 1) ** 0.5
    waist = 0.036 + 0.012 * np.sin(np.pi * (s - 0.18) / 0.9) ** 2 - 0.006 * np.exp(-(((s - 0.42) / 0.16) ** 2))
    result: Array = ends * waist
    return result


def _sole() -> Mesh:
    flat = rounded_box((0.10, 0.28, 0.026), 0.006, 0.0068)
    box = scaled(flat, 20.0, 1.0, 1.0)  # x from -1 to 1 across the foot

    def change(points: Array) -> Array:
        s = np.clip((points[:, 1] + 0.14) / 0.28, 0.0, 1.0)
        lift = 0.014 * np.clip((s - 0.72) / 0.28, 0, 1) ** 2
        return columns(
            points[:, 0] * (_half_width(s) + 0.004 * np.clip(8 * s * (1 - s), 0, 1)), points[:, 1], points[:, 2] + lift
        )

    def paint(points: Array) -> Array:
        return np.where((points[:, 2] < -0.004)[:, None], (112, 92, 76), (242, 240, 234))

    return moved(painted(outward(warped(box, change)), paint, variation=0.01), z=0.013)


def _upper() -> Mesh:
    s = np.linspace(0.012, 0.985, 46)
    width = _half_width(s) * 0.97
    toe = 0.052 * np.clip((1 - s) / 0.06, 0, 1) ** 0.5
    height = np.minimum(
        0.026 + toe, 0.098 - 0.062 * np.clip((s - 0.30) / 0.5, 0, 1) ** 0.9 + 0.008 * np.exp(-((s / 0.1) ** 2))
    )
    angle = np.arange(36) * (2 * np.pi / 36)
    x = np.sign(np.cos(angle)) * np.abs(np.cos(angle)) ** 0.8
    z = np.where(np.sin(angle) > 0, np.abs(np.sin(angle)) ** 0.8, -0.10 * np.abs(np.sin(angle)) ** 0.5)
    lift = 0.014 * np.clip((s - 0.72) / 0.28, 0, 1) ** 2
    rings = np.stack(
        [
            columns(
                w * x * (1 - 0.28 * np.clip(z, 0, 1) ** 2), np.full(36, 0.28 * t - 0.14), 0.022 + up + (h - 0.022) * z
            )
            for w, h, t, up in zip(width, height, s, lift, strict=True)
        ]
    )
    tip = np.array([0.0, 0.002, 0.0])
    body = loft(rings, rings[0].mean(axis=0) - tip, rings[-1].mean(axis=0) + tip)

    def paint(points: Array) -> Array:
        t = (points[:, 1] + 0.14) / 0.28
        laces = (np.abs(points[:, 0]) < 0.020) & (t > 0.44) & (t < 0.72) & (points[:, 2] > 0.05)
        lace = laces & (np.mod(t / 0.055, 1) < 0.5)
        stripe = (
            (np.abs(np.abs(points[:, 0]) - 0.04) < 0.02)
            & (np.mod((t * 2.2 + points[:, 2] * 9), 1) < 0.32)
            & (t > 0.35)
            & (t < 0.68)
            & ~laces
            & (points[:, 2] < 0.062)
        )
        color = np.where(laces[:, None], (36, 48, 74), (44, 76, 128))
        color = np.where((stripe | lace)[:, None], (244, 242, 236), color)
        toe_cap = t > 0.86
        return np.where(toe_cap[:, None], (238, 236, 230), color)

    opening = moved(turned(ellipsoid((0.028, 0.062, 0.062), 0.006), "x", 14), 0, -0.068, 0.103)
    return difference(painted(body, paint, variation=0.02), painted(opening, (70, 72, 84)))
