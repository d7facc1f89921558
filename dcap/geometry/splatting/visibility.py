"""Selection of the Gaussians that are part of the visible surface, with the best viewpoint of each.

The share of a pixel is not sufficient: in a layer of overlapping Gaussians, the last one in the order by depth has no
larger share than one in a layer below, between two of the first. The position is: a Gaussian behind the plane of the
one that stops most of the light in its pixel is hidden.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.arrays import Array
from dcap.geometry.camera import Camera
from dcap.geometry.splatting.config import SurfaceConfig
from dcap.geometry.splatting.render import RenderedSplats, Splatter
from dcap.geometry.splatting.viewpoints import viewpoints

Progress = Callable[[float, str], None]


def best_origins(
    splatter: Splatter, gap: NDArray[np.float32], config: SurfaceConfig, progress: Progress | None = None
) -> Array:
    """Position of the camera that sees each Gaussian best, frontally and from nearby [m], shape (n, 3); NaN if none
    does. `gap` is the spacing of Gaussians around each [m], shape (n,)."""
    splats = splatter.splats
    best, origin = np.zeros(len(splats)), np.full((len(splats), 3), np.nan)
    for seen in sightings(splatter, gap, viewpoints(splats, config.places, config.pixels), config, progress):
        score = seen.weight * np.abs(seen.cosine) / seen.distance
        better = score > best[seen.index]
        best[seen.index[better]], origin[seen.index[better]] = score[better], seen.camera.position
    return origin


@dataclass(frozen=True, eq=False, slots=True)
class Sighting:
    """The Gaussians of the visible surface that one camera sees."""

    camera: Camera
    index: NDArray[np.int64]
    """Indices of the Gaussians, shape (k,)."""
    weight: NDArray[np.float32]
    """Largest share of each Gaussian in a pixel [-], shape (k,)."""
    cosine: Array
    """Cosine of the angle between its thinnest axis and the direction to the camera, of either sign [-], shape (k,)."""
    distance: Array
    """Distance to the camera [m], shape (k,)."""


def sightings(
    splatter: Splatter,
    gap: NDArray[np.float32],
    cameras: Sequence[Camera],
    config: SurfaceConfig,
    progress: Progress | None = None,
) -> Iterator[Sighting]:
    """Sightings of Gaussians from each camera; `gap` is the spacing of Gaussians around each [m], shape (n,)."""
    splats = splatter.splats
    flat = np.take_along_axis(splatter.axes, splats.log_scale.argmin(axis=1)[:, None, None], axis=2)[:, :, 0]
    for i, camera in enumerate(cameras):
        view = splatter.view(camera)
        visible = np.flatnonzero(view.weight > config.seen)
        visible = visible[behind(splats.position, flat, view, camera, visible) <= config.slack * gap[visible]]
        away = camera.position - splats.position[visible]
        distance = np.linalg.norm(away, axis=1)
        cosine = np.einsum("ni,ni->n", flat[visible], away) / distance
        yield Sighting(camera, visible, view.weight[visible], cosine, distance)
        if progress is not None:
            progress(0.5 * (i + 1) / len(cameras), f"view {i + 1} of {len(cameras)}")


def behind(
    position: NDArray[np.float32],
    flat: NDArray[np.float32],
    view: RenderedSplats,
    camera: Camera,
    index: NDArray[np.int64],
) -> Array:
    """Distance of the Gaussians with these indices behind the plane of the front Gaussian in the pixel of their middle
    [m], shape (k,): negative in front of it or if there is none, infinite if the middle is not in the picture.

    `flat` are the thinnest axes (n, 3) of all Gaussians at `position` (n, 3)."""
    place = position[index].astype(np.float64)
    column, row = np.floor(camera.project(place)[:, :2]).astype(np.int64).T
    inside = (column >= 0) & (column < camera.width) & (row >= 0) & (row < camera.height)
    front = view.front[np.where(inside, row, 0), np.where(inside, column, 0)]
    normal = flat[front].astype(np.float64)
    normal *= np.sign(np.einsum("ni,ni->n", camera.position - position[front], normal))[:, None]
    depth = np.einsum("ni,ni->n", position[front] - place, normal)
    return np.where(inside, np.where(front >= 0, depth, -np.inf), np.inf)
