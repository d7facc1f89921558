"""Parts of things that carry others: table (top, leg), cabinet (top, surface), shelf (board, side), window (sill)."""

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.segmentation.faces import connected_regions, level_of, pairs_among
from dcap.geometry.segmentation.parts.instance_surface import InstanceSurface, PartMap
from dcap.geometry.segmentation.parts.seating import underside

SEVERAL = 0.2
"""Share of a thing's height spanned by boards from which they count as several [-]."""
SILL = 0.3
"""Share of a window's height below which its sill lies [-]."""
SILL_DEPTH = 0.5
"""Least share of a window's depth and width for a level surface in it to be its sill [-]."""


def _top_level(surface: InstanceSurface) -> float:
    """Height of the highest surface that covers a good part of the footprint [m]."""
    z, height = surface.center[:, 2], float(surface.size[2])
    width = max(0.02 * height, 1e-3)
    footprint = float(np.prod(surface.size[:2]))
    best = float("nan")
    for low in np.arange(0.35, 1.0, 0.05):
        chosen = surface.open_up & (z > low * height)
        level = level_of(z[chosen], surface.area[chosen], width)
        near = chosen & (np.abs(z - level) < width)
        if surface.area[near].sum() > 0.3 * footprint:
            best = level
    if np.isnan(best):
        chosen = surface.open_up & (z > 0.35 * height)
        best = level_of(z[chosen], surface.area[chosen], width)
    return best


def table_parts(surface: InstanceSurface) -> PartMap:
    """Name the faces of a table or desk; things on the top only count as top if they are joined to it."""
    parts = PartMap.filled(len(surface.area), "leg")
    level = _top_level(surface)
    if np.isnan(level):
        return PartMap.filled(len(surface.area), "top")
    reach = min(0.16 * float(surface.size[2]), 0.25 * float(surface.size[:2].min()))
    bottom = underside(surface, level, reach)
    z = surface.center[:, 2]
    for piece in surface.pieces():
        wide = bool((piece.size[:2] > 0.5 * surface.size[:2]).all())
        reaches_top = piece.high[2] > level - 0.03 * surface.size[2]
        if wide and piece.low[2] > bottom - (0.5 if reaches_top else 0.1) * reach:
            parts.names[piece.faces] = "top"
        elif wide and reaches_top:
            parts.names[piece.faces] = np.where(z[piece.faces] >= bottom, "top", "leg")
        elif piece.low[2] > level - 0.02 * surface.size[2]:
            parts.names[piece.faces] = "item"
    parts.confidence = 0.85
    return parts


def cabinet_parts(surface: InstanceSurface) -> PartMap:
    """Name the faces of a box-like thing: the top slab and the rest."""
    parts = PartMap.filled(len(surface.area), "body")
    level = _top_level(surface)
    if np.isnan(level) or surface.size[2] < 0.05:
        return parts
    thickness = 0.06 * float(surface.size[2])
    z = surface.center[:, 2]
    for piece in surface.pieces():
        wide = bool((piece.size[:2] > 0.5 * surface.size[:2]).all())
        at_level = wide and abs(float(piece.high[2]) - level) < 0.5 * thickness
        if at_level and piece.low[2] > level - 2.0 * thickness:
            parts.names[piece.faces] = "top"
        elif wide and piece.high[2] > level - thickness:
            lid = surface.open_up[piece.faces] & (np.abs(z[piece.faces] - level) < 0.5 * thickness)
            parts.names[piece.faces[lid]] = "top"
        elif piece.low[2] > level - 0.3 * thickness:
            parts.names[piece.faces] = "item"
    parts.confidence = 0.7
    return parts


def basin_parts(surface: InstanceSurface) -> PartMap:
    """Name the faces of a washstand: a piece on its top is the basin, or the tap if it is narrow."""
    parts = cabinet_parts(surface)
    for piece in surface.pieces():
        if (parts.names[piece.faces] == "item").all():
            parts.names[piece.faces] = "basin" if (piece.size[:2] > 0.25 * surface.size[:2].min()).all() else "tap"
    return parts


def other_parts(surface: InstanceSurface) -> PartMap:
    """Name the faces of a thing of unknown kind: a level top if it covers most of the footprint, and its surface."""
    parts = cabinet_parts(surface)
    top = parts.names == "top"
    if surface.area[top & surface.open_up].sum() < 0.75 * float(np.prod(surface.size[:2])):
        return PartMap.filled(len(surface.area), "body")
    return parts


def shelf_parts(surface: InstanceSurface) -> PartMap:
    """Name the faces of a shelf: every level slab is a separate board, the rest are sides."""
    parts = PartMap.filled(len(surface.area), "side")
    parts.separate = frozenset({"board"})
    gap = 0.2 * float(surface.size[:2].min())
    for piece in surface.pieces():
        flat = piece.size[2] < min(gap, 0.12 * max(float(surface.size[2]), 0.3)) or piece.size[2] < 0.03
        broad = float(np.prod(piece.size[:2])) > 0.25 * float(np.prod(surface.size[:2]))
        if flat and broad:
            parts.names[piece.faces] = "board"
        elif not flat and (piece.size[:2] > 0.6 * surface.size[:2]).all():
            parts.names[piece.faces[_in_slabs(surface, piece.faces)]] = "board"
    parts.confidence = 0.75 if (parts.names == "board").any() else 0.4
    return parts


def storage_parts(surface: InstanceSurface) -> PartMap:
    """Name the faces of "storage", the scanners' word for shelves and cupboards: boards at several heights make a
    shelf."""
    shelf = shelf_parts(surface)
    boards = surface.center[(shelf.names == "board") & surface.up, 2]
    return shelf if len(boards) and np.ptp(boards) > SEVERAL * float(surface.size[2]) else cabinet_parts(surface)


def window_parts(surface: InstanceSurface) -> PartMap:
    """Name the faces of a window: the broadest level surface low in it, with everything below, is its sill, the rest
    frame."""
    parts = PartMap.filled(len(surface.area), "body")
    low = np.flatnonzero(surface.center[:, 2] < SILL * surface.size[2] + surface.corners[..., 2].min())
    extent = np.sort(surface.size[:2])
    deep = [
        (height, float(np.prod(span[1] - span[0]))) for height, span in _level_patches(surface, low, surface.up)
        if (np.sort(span[1] - span[0]) > SILL_DEPTH * extent).all()
    ]  # fmt: skip
    if deep:
        level = max(deep, key=lambda one: one[1])[0]
        below = surface.center[:, 2] < level + 0.01 * surface.size[2]
        parts.names[:] = np.where(below, "sill", "frame")
        parts.confidence = 0.75
    return parts


def _in_slabs(surface: InstanceSurface, faces: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Mask of the faces of one fused piece that lie between the upper and lower face of a board, shape (k,)."""
    z_low, z_high = surface.corners[faces][..., 2].min(axis=1), surface.corners[faces][..., 2].max(axis=1)
    slack = 0.004 * float(surface.size.max())
    inside = np.zeros(len(faces), dtype=bool)
    for low, high, span in _slabs(surface, faces):
        within = (surface.center[faces, :2] >= span[0] - slack) & (surface.center[faces, :2] <= span[1] + slack)
        inside |= (z_low > low - slack) & (z_high < high + slack) & within.all(axis=1)
    return inside


def _slabs(surface: InstanceSurface, faces: NDArray[np.int64]) -> list[tuple[float, float, NDArray[np.float64]]]:
    """Boards of one fused piece: (underside, upper side, extents in x and y (2, 2)) of each broad upward patch."""
    ups, downs = _level_patches(surface, faces, surface.up), _level_patches(surface, faces, surface.down)
    thickest = 0.5 * float(surface.size[:2].min())
    slabs = []
    for height, span in ups:
        ceilings = [h for h, s in ups if h < height and _overlap(s, span)]
        beneath = [h for h, s in downs if max([height - thickest, *ceilings]) <= h < height and _overlap(s, span)]
        slabs.append((max(beneath, default=height - 0.02 * float(surface.size.max())), height, span))
    return slabs


def _overlap(a: NDArray[np.float64], b: NDArray[np.float64]) -> bool:
    """Return whether two horizontal extents (2, 2) share at least half of the smaller one along both axes."""
    shared = np.minimum(a[1], b[1]) - np.maximum(a[0], b[0])
    return bool((shared > 0.5 * np.minimum(a[1] - a[0], b[1] - b[0])).all())


def _level_patches(
    surface: InstanceSurface, faces: NDArray[np.int64], level: NDArray[np.bool_]
) -> list[tuple[float, NDArray[np.float64]]]:
    """Connected level patches that cover a good part of the footprint: (height, extents in x and y (2, 2))."""
    pairs = pairs_among(surface.pairs, faces, len(surface.area))
    flag = level[faces]
    patch = connected_regions(len(faces), pairs, flag[pairs[:, 0]] & flag[pairs[:, 1]])
    size = np.bincount(patch, np.where(flag, surface.area[faces], 0.0))
    found = []
    for number in np.flatnonzero(size > 0.15 * float(np.prod(surface.size[:2]))):
        points = surface.corners[faces[patch == number]].reshape(-1, 3)
        found.append((float(np.median(points[:, 2])), np.stack([points[:, :2].min(axis=0), points[:, :2].max(axis=0)])))
    return found
