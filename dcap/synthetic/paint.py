"""Vertex colours: fabrics, wood, tiles and small variation, as functions of position.

A painter maps points (n, 3) [m] to sRGB values 0..255 (n, 3). Detail finer than the mesh cannot show.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from dcap.arrays import Array
from dcap.scene.types.mesh import Mesh

Rgb = Sequence[float] | Array
Painter = Callable[[Array], Array]
Finish = Painter | Rgb
"""Finish of a surface: a pattern or one colour."""
Axis = Literal["x", "y", "z"]

AXES = {"x": 0, "y": 1, "z": 2}


def painted(mesh: Mesh, painter: Finish, *, variation: float = 0.03, seed: int = 0) -> Mesh:
    """The mesh coloured by a painter or one colour; `variation` is a soft relative change of brightness."""
    points = mesh.vertices
    base = painter(points) if callable(painter) else np.broadcast_to(np.asarray(painter, float), points.shape)
    shade = (
        1 + 0.6 * variation * smooth_noise(points, seed, 0.30) + 0.3 * variation * smooth_noise(points, seed + 1, 0.05)
    )
    return replace(mesh, colors=np.clip(np.rint(base * shade[:, None]), 0, 255).astype(np.uint8))


def smooth_noise(points: Array, seed: int, wavelength: float, waves: int = 7) -> Array:
    """Smooth pseudo-random field of about unit size at points (n, 3): a sum of plane waves, shape (n,)."""
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(waves, 3))
    directions *= (
        (2 * np.pi / wavelength) * rng.uniform(0.6, 1.5, (waves, 1)) / np.linalg.norm(directions, axis=1, keepdims=True)
    )
    phases = rng.uniform(0, 2 * np.pi, waves)
    result: Array = np.sin(points @ directions.T + phases).sum(axis=1) * np.sqrt(2.0 / waves)
    return result


def blend(weight: Array, a: Rgb, b: Rgb) -> Array:
    """Colour a where weight is 0, b where it is 1."""
    w = np.clip(weight, 0, 1)[:, None]
    mixed: Array = (1 - w) * np.asarray(a, float) + w * np.asarray(b, float)
    return mixed


def plain(rgb: Rgb) -> Painter:
    """One colour."""

    def paint(points: Array) -> Array:
        return np.broadcast_to(np.asarray(rgb, float), points.shape)

    return paint


def wood(rgb: Rgb, grain: Axis = "x", seed: int = 0) -> Painter:
    """Streaks along the axis `grain`; nearly white colours count as lacquer and get faint streaks."""
    along = AXES[grain]
    contrast = 0.085 if float(np.mean(rgb)) < 200 else 0.015

    def paint(points: Array) -> Array:
        stretched = points.copy()
        stretched[:, along] *= 0.12
        streak = smooth_noise(stretched, seed + 11, 0.09) * 0.6 + smooth_noise(stretched, seed + 12, 0.035) * 0.4
        return np.asarray(rgb, float) * (1 + contrast * streak)[:, None]

    return paint


def stripes(ground: Rgb, stripe: Rgb, axis: Axis = "x", period: float = 0.2, share: float = 0.5) -> Painter:
    """Bands `share` of the period [m] wide on a ground; they follow each other along the axis."""

    def paint(points: Array) -> Array:
        phase = np.mod(points[:, AXES[axis]] / period, 1.0)
        return blend(_pulse(phase, share), ground, stripe)

    return paint


def _pulse(phase: Array, share: float) -> Array:
    """1 in the middle `share` of the period, soft flanks."""
    return np.clip((share / 2 - np.abs(phase - 0.5)) / 0.04 + 0.5, 0, 1)


def checks(first: Rgb, second: Rgb, period: float = 0.2) -> Painter:
    """A woven check in x and y: mixed where only one thread is dark."""

    def paint(points: Array) -> Array:
        along_x = _pulse(np.mod(points[:, 0] / period, 1.0), 0.5)
        along_y = _pulse(np.mod(points[:, 1] / period, 1.0), 0.5)
        return blend(0.5 * (along_x + along_y), first, second)

    return paint


def dots(ground: Rgb, dot: Rgb, period: float = 0.16, radius: float = 0.045) -> Painter:
    """Round dots on a ground, in x and y, rows shifted; period and radius in metres."""

    def paint(points: Array) -> Array:
        row = np.floor(points[:, 1] / period)
        x = np.mod(points[:, 0] + 0.5 * period * np.mod(row, 2), period) - period / 2
        y = np.mod(points[:, 1], period) - period / 2
        return blend((radius - np.hypot(x, y)) / 0.03 + 0.5, ground, dot)

    return paint


def planks(color: Rgb, seed: int = 0, width: float = 0.14, length: float = 1.1) -> Painter:
    """A plank floor along x: each board has its own tone and its streaks; joints are dark."""
    grain = wood((1.0, 1.0, 1.0), "x", seed)

    def paint(points: Array) -> Array:
        row = np.floor(points[:, 1] / width)
        along = points[:, 0] / length + np.mod(row * 0.37, 1.0)
        board = np.floor(along) * 57.0 + row * 131.0
        tone = 1 + 0.09 * np.sin(board * 12.9898 + seed) * np.cos(board * 3.1)
        joint = np.abs(np.mod(points[:, 1] / width, 1.0) - 0.5) > 0.46
        shade = tone * np.where(joint, 0.86, 1.0)
        result: Array = np.asarray(color, float) * shade[:, None] * grain(points)
        return result

    return paint


def tiles(color: Rgb, joint: Rgb, size: float = 0.3) -> Painter:
    """Square tiles with joints."""

    def paint(points: Array) -> Array:
        edge = np.abs(np.mod(points / size, 1.0) - 0.5).max(axis=1, where=_varying(points), initial=0.0)
        return blend((edge - 0.44) / 0.04, color, joint)

    return paint


def _varying(points: Array) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    """Mask of the axes along which the surface extends (a wall is flat along one axis), broadcast to the points."""
    return np.broadcast_to(np.ptp(points, axis=0) > 1e-6, points.shape)


def gradient(low: Rgb, high: Rgb, axis: Axis = "z") -> Painter:
    """A gradient from one colour to the other along the extent of the mesh."""

    def paint(points: Array) -> Array:
        values = points[:, AXES[axis]]
        return blend((values - values.min()) / max(float(np.ptp(values)), 1e-9), low, high)

    return paint
