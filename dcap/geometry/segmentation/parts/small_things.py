"""Parts of lamps, bathtubs and small things to place: dumbbells, shoes, laptops, plush toys."""

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.segmentation.faces import level_of
from dcap.geometry.segmentation.oversegmentation import color_clusters
from dcap.geometry.segmentation.parts.instance_surface import InstanceSurface, PartMap, SurfacePiece


def lamp_parts(surface: InstanceSurface) -> PartMap:
    """Name the faces of a standing lamp by their distance from its axis: shade above, base below, pole between."""
    parts = PartMap.filled(len(surface.area), "pole")
    height, radius = float(surface.size[2]), 0.5 * float(surface.size[:2].max())
    shade_low, base_high = _lamp_bands(surface, height)
    for piece in surface.pieces():
        parts.names[piece.faces] = _lamp_piece(surface, piece, shade_low, base_high, radius)
    parts.confidence = 0.8 if (parts.names == "shade").any() else 0.4
    return parts


def _lamp_bands(surface: InstanceSurface, height: float) -> tuple[float, float]:
    """Lower edge of the shade and upper edge of the base [m], from the widest reach per slice of height."""
    count = 24
    slice_of = np.clip((surface.center[:, 2] / height * count).astype(int), 0, count - 1)
    reach = np.zeros(count)
    np.maximum.at(reach, slice_of, np.linalg.norm(surface.corners[..., :2], axis=2).mean(axis=1))
    narrow = reach < 0.35 * reach.max()
    if not narrow.any():
        return 0.45 * height, 0.12 * height
    widest_above = int(np.argmax(np.where(np.arange(count) >= count // 3, reach, 0)))
    below = np.flatnonzero(narrow[:widest_above])
    shade_low = (below[-1] + 1) / count * height if len(below) else 0.45 * height
    base_high = (np.flatnonzero(narrow)[0]) / count * height
    return float(shade_low), float(min(base_high, shade_low))


def _lamp_piece(
    surface: InstanceSurface, piece: SurfacePiece, shade_low: float, base_high: float, radius: float
) -> NDArray[np.object_] | str:
    """Name of a piece, or names of its faces if it extends over several bands."""
    z = surface.center[piece.faces, 2]
    reach = 0.5 * float(piece.size[:2].max())
    height = float(surface.size[2])
    if reach > 0.4 * radius and piece.low[2] > 0.2 * height and piece.high[2] > 0.7 * height:
        return "shade"
    if reach < 0.3 * radius:
        return "pole" if piece.high[2] > 0.15 * height else "base"
    if piece.high[2] < 0.65 * height and piece.low[2] < 0.1 * height:
        return "base"
    names = np.full(len(z), "pole", dtype=object)
    wide = np.linalg.norm(surface.center[piece.faces, :2], axis=1) > 0.15 * radius
    names[(z >= shade_low) & wide] = "shade"
    names[z <= base_high] = "base"
    return names


def bathtub_parts(surface: InstanceSurface) -> PartMap:
    """Name the faces of a bathtub: the upper edge all around, and the shell."""
    parts = PartMap.filled(len(surface.area), "shell")
    z, height = surface.center[:, 2], float(surface.size[2])
    chosen = surface.up & (z > 0.6 * height)
    level = level_of(z[chosen], surface.area[chosen], 0.05 * height)
    if np.isnan(level):
        return parts
    parts.names[(z > level - 0.06 * height) & ((np.abs(surface.normal[:, 2]) > 0.3) | (z > level))] = "rim"
    for piece in surface.pieces():
        if piece.low[2] > level - 0.15 * height:
            parts.names[piece.faces] = "rim"
    parts.confidence = 0.75
    return parts


def dumbbell_parts(surface: InstanceSurface) -> PartMap:
    """Name the faces of a dumbbell: thick along its axis is head, thin is handle."""
    axis = int(np.argmax(surface.size))
    across = np.delete(surface.corners, axis, axis=2) - np.delete(surface.corners.reshape(-1, 3).mean(axis=0), axis)
    reach = np.linalg.norm(across, axis=2).max(axis=1)
    count = 40
    low = float(surface.corners[..., axis].min())
    slice_of = np.clip(((surface.center[:, axis] - low) / surface.size[axis] * count).astype(int), 0, count - 1)
    thickest = np.zeros(count)
    np.maximum.at(thickest, slice_of, reach)
    is_head = thickest > 0.6 * thickest.max()
    parts = PartMap.filled(len(surface.area), "handle")
    radius = 0.5 * float(np.delete(surface.size, axis).max())
    for piece in surface.pieces():
        if 0.5 * float(np.delete(piece.size, axis).max()) < 0.6 * radius:
            continue
        through = piece.size[axis] > 0.6 * surface.size[axis]
        parts.names[piece.faces] = np.where(is_head[slice_of[piece.faces]] | (not through), "head", "handle")
    parts.confidence = 0.8
    return parts


def shoe_parts(surface: InstanceSurface) -> PartMap:
    """Name the faces of a shoe: the sole is the lowest fifth, or the material that touches the ground."""
    parts = PartMap.filled(len(surface.area), "upper")
    z = surface.center[:, 2]
    parts.names[z < 0.2 * surface.size[2]] = "sole"
    cluster = color_clusters(surface.lab, surface.area)
    ground = surface.down & (z < 0.05 * surface.size[2])
    if ground.any():
        main = int(np.argmax(np.bincount(cluster[ground], surface.area[ground])))
        same = cluster == main
        high = float(np.average(z[same] > 0.4 * surface.size[2], weights=surface.area[same]))
        if len(np.unique(cluster)) > 1 and high < 0.05:
            parts.names[:] = np.where(same, "sole", "upper")
    parts.confidence = 0.6
    return parts


def laptop_parts(surface: InstanceSurface) -> PartMap:
    """Name the faces of a laptop: the lying slab is the base, the standing slab is the screen."""
    z, height = surface.center[:, 2], float(surface.size[2])
    pieces = surface.pieces()
    parts = PartMap.filled(len(surface.area), "base")
    slab = min(0.25 * height, 0.12 * float(surface.size[:2].max()))
    if height > 0.2 * float(surface.size[:2].max()):
        parts.names[z > slab] = "screen"
        for piece in pieces:
            parts.names[piece.faces] = "base" if piece.high[2] < 1.5 * slab else parts.names[piece.faces]
            if piece.size[2] > 0.5 * height:
                steep = np.abs(surface.normal[piece.faces, 2]) < 0.9
                keep = (z[piece.faces] > slab) | (steep & (piece.low[2] > 0.3 * slab))
                parts.names[piece.faces[keep]] = "screen"
    parts.confidence = 0.6
    return parts


def plush_parts(surface: InstanceSurface) -> PartMap:
    """Name the faces of a plush toy: small dark pieces on its surface are eyes (or a nose), the rest is body."""
    parts = PartMap.filled(len(surface.area), "body")
    largest = float(surface.size.max())
    for piece in surface.pieces():
        dark = float(np.average(surface.lab[piece.faces, 0], weights=surface.area[piece.faces] + 1e-12)) < 35.0
        if piece.size.max() < 0.15 * largest and dark:
            parts.names[piece.faces] = "eye"
    parts.confidence = 0.7
    return parts


def plant_parts(surface: InstanceSurface) -> PartMap:
    """Name the faces of a potted plant: the pot stands on the ground, the rest are leaves."""
    parts = PartMap.filled(len(surface.area), "leaves")
    for piece in surface.pieces():
        if piece.low[2] < 0.05 * surface.size[2] and piece.high[2] < 0.7 * surface.size[2]:
            parts.names[piece.faces] = "body"
    if not (parts.names == "body").any():
        parts.names[:] = "body"
    parts.confidence = 0.6
    return parts


def flat_parts(surface: InstanceSurface) -> PartMap:
    """Name all faces of a rug or a picture as one part."""
    parts = PartMap.filled(len(surface.area), "body")
    parts.confidence = 0.9
    return parts
