"""Pictures of Gaussians along a path of cameras, and the COLMAP model of these cameras."""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.camera import Camera
from dcap.scene.types.gaussians import Gaussians
from dcap.scene.types.pictures import ColmapModel, Pinhole, posed

MOST_POINTS = 100_000
"""Maximum number of Gaussian centres used as points of the model [-]."""
OPAQUE = 0.5
"""Least opacity of a point on a surface [-]."""


def pictures(splats: Gaussians, cameras: Sequence[Camera], threads: int) -> Iterator[NDArray[np.uint8]]:
    """sRGB pictures over black as bytes (rows, columns, 3), one after the other; starts Taichi in this process."""
    from dcap.geometry.splatting.render import Splatter  # loads Taichi
    from solver.runtime import start

    start(threads)
    splatter = Splatter(splats)
    for camera in cameras:
        yield np.rint(255.0 * np.clip(splatter.view(camera).image, 0.0, 1.0)).astype(np.uint8)


def names(count: int) -> list[str]:
    """File names of the pictures, in order."""
    return [f"view_{k:05d}.png" for k in range(count)]


def colmap_model(splats: Gaussians, cameras: Sequence[Camera], seed: int = 0) -> ColmapModel:
    """The cameras, which must share one model, and some of the Gaussians' centres with their colours."""
    first = cameras[0]
    kind = Pinhole(1, first.width, first.height, (first.focal,) * 2, (0.5 * first.width, 0.5 * first.height))
    images = tuple(
        posed(k + 1, name, kind.id, camera.world_from_camera, camera.position)
        for k, (name, camera) in enumerate(zip(names(len(cameras)), cameras, strict=True))
    )
    opaque = np.flatnonzero(splats.opacity > OPAQUE)
    some = np.sort(np.random.default_rng(seed).permutation(opaque)[:MOST_POINTS])
    return ColmapModel((kind,), images, splats.position[some].astype(np.float64), splats.color[some])
