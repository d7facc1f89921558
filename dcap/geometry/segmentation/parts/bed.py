"""Parts of a bed: mattress, frame, headboard, pillow, blanket.

The level with most upward area in the middle is the lying surface. The headboard end is the end that rises above it, or
the one with pillows. Pieces are then distinguished by their lower and upper ends; a bed scanned as a single piece is
cut by colour, and if that fails by height. Lengths scale with the bed's length over 2 m, so that models in any unit
work.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from dcap.geometry.segmentation.faces import connected_regions, level_of
from dcap.geometry.segmentation.parts.instance_surface import SIDES, InstanceSurface, PartMap, SurfacePiece

COLOR_LENGTH = 0.002
"""Length that corresponds to ten steps of CIELAB in the search for the nearest face [m]."""

USUAL_LENGTH = 2.0
"""Length of a bed [m]."""

THICKEST_MATTRESS = 0.34
"""Thickness above which a piece is mattress and frame in one [m]."""

MATTRESS_THICKNESS = 0.22
"""Thickness used if neither a ledge nor a colour shows the mattress's underside [m]."""


def bed_parts(surface: InstanceSurface) -> PartMap:
    """Name the faces of a bed."""
    scale = float(surface.size[:2].max()) / USUAL_LENGTH
    level = _sleeping_level(surface, scale)
    parts = PartMap.filled(len(surface.area), "frame")
    parts.separate = frozenset({"pillow"})
    if np.isnan(level):
        return parts
    head = _head_side(surface, level, scale)
    surface = _cut_composites(surface, level, scale)
    pieces = surface.pieces()
    mattress = _bared(surface, pieces, level, head, scale) or _mattress(surface, pieces, level, scale)
    for piece in pieces:
        parts.names[piece.faces] = _piece_name(surface, piece, mattress, level, head, scale)
    _name_head_end(surface, parts, pieces, mattress, level, head, scale)
    if mattress is None:
        _cut_by_height(surface, parts, level, scale)
    else:
        parts.names[mattress.faces] = "mattress"
        _cut_frame(surface, parts, pieces, mattress, level, scale)
        _cut_bumps(surface, parts, mattress, level, scale)
    _cut_headboard(surface, parts, level, head, scale)
    _name_scraps(surface, parts, pieces, level)
    parts.confidence = 0.85 if mattress is not None else 0.55
    parts.front = None if head is None else -head
    return parts


def _middle(surface: InstanceSurface, share: float) -> NDArray[np.bool_]:
    """Mask of the faces over the middle `share` of the footprint, shape (k,)."""
    return np.asarray((np.abs(surface.center[:, :2]) < 0.5 * share * surface.size[:2]).all(axis=1))


def _sleeping_level(surface: InstanceSurface, scale: float) -> float:
    """Height of the lying surface [m]."""
    chosen = surface.open_up & _middle(surface, 0.8) & (surface.center[:, 2] > 0.15 * surface.size[2])
    return level_of(surface.center[chosen, 2], surface.area[chosen], 0.06 * scale)


def _head_side(surface: InstanceSurface, level: float, scale: float) -> NDArray[np.float64] | None:
    """Outward direction of the head end: the side that rises highest above the level, else the side with pillows."""
    high = surface.center[:, 2] > level + 0.12 * scale
    best, found = 0.0, None
    for side in SIDES:
        axis = int(np.argmax(np.abs(side)))
        along = surface.center @ side
        near = high & (along > 0.5 * surface.size[axis] - 0.14 * surface.size[axis] - 0.03 * scale)
        across = surface.center[near, 1 - axis]
        width = float(np.ptp(across)) if len(across) else 0.0
        # Only something nearly as wide as the bed is a headboard; its height counts, a wide rail at the side does not.
        score = float(surface.area[near].sum()) * (width > 0.6 * surface.size[1 - axis]) * surface.size[axis]
        if score > best:
            best, found = score, side
    if found is not None and best > 0.02 * float(np.prod(surface.size[:2])) * surface.size[:2].max():
        return found
    return _pillow_side(surface, level, scale)


def _pillow_side(surface: InstanceSurface, level: float, scale: float) -> NDArray[np.float64] | None:
    """The end of the long axis near which more surface lies above the level; None if there is none."""
    axis = int(np.argmax(surface.size[:2]))
    raised = (surface.center[:, 2] > level + 0.05 * scale) & (
        np.abs(surface.center[:, axis]) > 0.2 * surface.size[axis]
    )
    weight = np.where(raised, surface.area, 0.0)
    lean = float((weight * np.sign(surface.center[:, axis])).sum())
    if abs(lean) < 0.02 * float(np.prod(surface.size[:2])):
        return None
    side: NDArray[np.float64] = np.zeros(3)
    side[axis] = np.sign(lean)
    return side


def _is_composite(surface: InstanceSurface, piece: SurfacePiece, level: float, scale: float) -> bool:
    """Return whether a piece holds several parts: wide, ending above the lying level, and thicker than any mattress."""
    wide = bool((piece.size[:2] > 0.6 * surface.size[:2]).all())
    thick = bool(piece.size[2] > THICKEST_MATTRESS * scale or piece.low[2] < 0.12 * level)
    return wide and thick and bool(piece.high[2] > level - 0.03 * scale)


def _cut_composites(surface: InstanceSurface, level: float, scale: float) -> InstanceSurface:
    """Cut pieces with several parts by colour."""
    for piece in surface.pieces():
        if _is_composite(surface, piece, level, scale):
            surface = surface.split_by_color(piece.faces)
    return surface


def _mattress(surface: InstanceSurface, pieces: list[SurfacePiece], level: float, scale: float) -> SurfacePiece | None:
    """The piece that people lie on: wide, with its top at the level; under a blanket, the thick piece below it."""
    wide = [
        p
        for p in pieces
        if (p.size[:2] > 0.55 * surface.size[:2]).all()
        and p.up_area > 0.05 * np.prod(surface.size[:2])
        and p.low[2] > 0.12 * level
        and level - 0.2 * scale < p.high[2] < level + 0.25 * scale
    ]
    if not wide:
        return None
    wide.sort(key=lambda p: -_top_level(surface, p, scale))
    top = wide[0]
    for below in wide[1:]:
        # A blanket lies close on the mattress; a piece more than its own thickness above it is bedding itself.
        gap = _top_level(surface, top, scale) - _top_level(surface, below, scale)
        longer = below.size[:2].max() > 0.8 * surface.size[:2].max() and below.size[2] > 0.05 * scale
        if gap < 0.1 * scale and longer and _is_cover(top, below):
            return below
    return top


def _bared(
    surface: InstanceSurface, pieces: list[SurfacePiece], level: float, head: NDArray[np.float64] | None, scale: float
) -> SurfacePiece | None:
    """The head end of a mattress whose rest is hidden by a blanket, as in scans: broad, at the level, beyond the
    cover."""
    if head is None:
        return None
    along = int(np.argmax(np.abs(head)))
    broad = [
        p
        for p in pieces
        if p.size[1 - along] > 0.55 * surface.size[1 - along]
        and p.up_area > 0.05 * np.prod(surface.size[:2])
        and p.low[2] > 0.12 * level
        and abs(_top_level(surface, p, scale) - level) < 0.06 * scale
    ]
    broad = sorted(
        (p for p in broad if p.size[along] > 0.15 * surface.size[along]), key=lambda p: -float(p.middle @ head)
    )
    if (
        len(broad) < 2
        or any(p.size[along] > 0.8 * surface.size[along] for p in broad)
        or float(broad[0].middle @ head) < 0.1 * surface.size[along]
    ):
        return None
    shared = min(broad[0].high[along], broad[1].high[along]) - max(broad[0].low[along], broad[1].low[along])
    return broad[0] if shared < 0.3 * broad[0].size[along] else None


def _is_cover(top: SurfacePiece, below: SurfacePiece) -> bool:
    """Return whether the upper piece is a cover: shorter than the lower piece, or hanging over its edges."""
    shorter = bool((top.size[:2] < 0.93 * below.size[:2]).any())
    hangs = bool((top.size[:2] > 1.005 * below.size[:2]).any() and top.low[2] < below.high[2])
    return shorter or hangs


def _top_level(surface: InstanceSurface, piece: SurfacePiece, scale: float) -> float:
    """Height of a piece's upper surface [m]."""
    faces = piece.faces[surface.up[piece.faces]]
    level = level_of(surface.center[faces, 2], surface.area[faces], 0.06 * scale)
    return float(piece.high[2]) if np.isnan(level) else level


def _name_head_end(
    surface: InstanceSurface,
    parts: PartMap,
    pieces: list[SurfacePiece],
    mattress: SurfacePiece | None,
    level: float,
    head: NDArray[np.float64] | None,
    scale: float,
) -> None:
    """Name the pieces behind the mattress headboard, including bars and rails, if any of them rises above the
    bedding."""
    if head is None or mattress is None:
        return
    edge = float(max(mattress.low @ head, mattress.high @ head)) - 0.03 * scale
    behind = [p for p in pieces if p is not mattress and float(min(p.low @ head, p.high @ head)) > edge]
    if any(p.high[2] > level + 0.12 * scale for p in behind):
        for piece in behind:
            parts.names[piece.faces] = "headboard"


def _name_scraps(surface: InstanceSurface, parts: PartMap, pieces: list[SurfacePiece], level: float) -> None:
    """Name scraps of a scan between blanket and mattress, which are not frame, like the nearest face of similar
    colour."""
    total = float(surface.area.sum())
    scraps = [
        p for p in pieces if p.area < 0.03 * total and p.low[2] > 0.45 * level and parts.names[p.faces[0]] == "frame"
    ]
    bedding = np.flatnonzero(parts.names != "frame")
    if not scraps or not len(bedding):
        return
    place = np.concatenate([surface.center, COLOR_LENGTH * surface.lab], axis=1)
    faces = np.concatenate([p.faces for p in scraps])
    parts.names[faces] = parts.names[bedding[cKDTree(place[bedding]).query(place[faces])[1]]]


def _piece_name(
    surface: InstanceSurface,
    piece: SurfacePiece,
    mattress: SurfacePiece | None,
    level: float,
    head: NDArray[np.float64] | None,
    scale: float,
) -> str:
    """Name of a piece that is one part."""
    top = _top_level(surface, piece, scale)
    if head is not None and _at_head(surface, piece, head) and piece.high[2] > level + 0.12 * scale:
        lies_on_bed = _lies_at(piece, level, scale) and _inset(surface, piece, head) > 0.03 * scale
        if not lies_on_bed:
            return "headboard"
    small = float(np.prod(piece.size[:2])) < 0.35 * float(np.prod(surface.size[:2]))
    if _lies_at(piece, level, scale) and small and level + 0.02 * scale < piece.high[2] < level + 0.4 * scale:
        return "pillow" if piece.size[2] > 0.045 * scale else "blanket"
    across = int(np.argmin(surface.size[:2])) if head is None else 1 - int(np.argmax(np.abs(head)))
    broad = piece.size[across] > 0.6 * surface.size[across] and piece.size[1 - across] > 0.2 * surface.size[1 - across]
    covers = mattress is not None and top > _top_level(surface, mattress, scale) - 0.03 * scale
    if covers and piece.size[across] > 0.5 * surface.size[across] and piece.high[2] < level + 0.2 * scale:
        return "blanket"
    if broad and piece.low[2] > 0.6 * level and piece.size[2] < 0.4 * scale and piece.high[2] <= level + 0.05 * scale:
        return "mattress"
    return "frame"


def _lies_at(piece: SurfacePiece, level: float, scale: float) -> bool:
    """Return whether a piece rests on the bedding, perhaps on another pillow."""
    return bool(level - 0.15 * scale < piece.low[2] < level + 0.16 * scale) and piece.up_area > 0.0


def _at_head(surface: InstanceSurface, piece: SurfacePiece, head: NDArray[np.float64]) -> bool:
    """Return whether a piece lies within the outer quarter at the head end."""
    axis = int(np.argmax(np.abs(head)))
    ends = np.array([piece.low @ head, piece.high @ head])
    return bool(
        ends.min() > 0.25 * surface.size[axis] and ends.max() > 0.5 * surface.size[axis] - 0.12 * surface.size[axis]
    )


def _inset(surface: InstanceSurface, piece: SurfacePiece, head: NDArray[np.float64]) -> float:
    """Distance of a piece from the outer face of the head end [m]."""
    axis = int(np.argmax(np.abs(head)))
    return float(0.5 * surface.size[axis] - max(piece.low @ head, piece.high @ head))


def _cut_headboard(
    surface: InstanceSurface, parts: PartMap, level: float, head: NDArray[np.float64] | None, scale: float
) -> None:
    """Name faces high at the head end headboard, even if they are one piece with the frame or the mattress."""
    if head is None:
        return
    axis = int(np.argmax(np.abs(head)))
    at_end = surface.center @ head > 0.5 * surface.size[axis] - 0.12 * surface.size[axis]
    risen = surface.center[:, 2] > level + 0.12 * scale
    fused = (parts.names == "frame") | (parts.names == "mattress")
    if not (fused & at_end & risen).any():
        return
    inner = float((surface.center[fused & at_end & risen] @ head).min()) - 0.01 * scale
    column = (surface.center @ head > inner) & (surface.center[:, 2] > 0.5 * level)
    parts.names[fused & column] = "headboard"


def _cut_frame(
    surface: InstanceSurface,
    parts: PartMap,
    pieces: list[SurfacePiece],
    mattress: SurfacePiece,
    level: float,
    scale: float,
) -> None:
    """Name the frame of a fused piece of the same colour: the mattress ends a usual thickness below the level."""
    carried = any(
        (p.size[:2] > 0.6 * surface.size[:2]).all() and p.low[2] < mattress.low[2] - 0.05 * scale for p in pieces
    )
    if _is_composite(surface, mattress, level, scale) and not carried:
        low = surface.center[mattress.faces, 2] < level - MATTRESS_THICKNESS * scale
        parts.names[mattress.faces[low]] = "frame"


def _cut_bumps(surface: InstanceSurface, parts: PartMap, mattress: SurfacePiece, level: float, scale: float) -> None:
    """Name small patches of the mattress's piece that rise above the level, which are pillows of the same cloth."""
    risen = np.zeros(len(surface.area), dtype=bool)
    risen[mattress.faces] = surface.center[mattress.faces, 2] > level + 0.04 * scale
    a, b = surface.pairs.T
    patch = connected_regions(len(risen), surface.pairs, risen[a] & risen[b])
    size = np.bincount(patch, np.where(risen, surface.area, 0.0))
    top = np.zeros(len(size))
    np.maximum.at(top, patch, surface.center[:, 2])
    footprint = float(np.prod(surface.size[:2]))
    bump = (size > 0.02 * footprint) & (size < 0.5 * footprint) & (top > level + 0.08 * scale)
    parts.names[risen & bump[patch]] = "pillow"


def _cut_by_height(surface: InstanceSurface, parts: PartMap, level: float, scale: float) -> None:
    """Name the faces of a single piece: a band of height is the mattress, faces above it are pillow or blanket."""
    z = surface.center[:, 2]
    bottom = level - min(MATTRESS_THICKNESS * scale, 0.55 * level)
    open_name = parts.names == "frame"
    parts.names[open_name & (z >= bottom) & (z <= level + 0.3 * scale)] = "mattress"
