"""Parts of a bed: mattress, frame, headboard, pillow, blanket.

The level with most upward area in the middle is where one lies. The headboard end is the end that rises above it, or
where pillows lie. Pieces are then told apart by where they start and end; a bed scanned as one piece is cut by colour,
and failing that by height. Lengths scale with the bed's length over 2 m, so that models in their own unit work.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from dcap.geometry.segmentation.faces import connected_regions
from dcap.geometry.segmentation.parts.body import Body, Piece, level_of
from dcap.geometry.segmentation.parts.partmap import SIDES, PartMap

COLOR_LENGTH = 0.002
"""Ten steps of CIELAB count as two centimetres when the nearest face is sought [m]."""

USUAL_LENGTH = 2.0
"""Length of a bed [m]."""

THICKEST_MATTRESS = 0.34
"""A thicker piece is mattress and frame at once [m]."""

MATTRESS_THICKNESS = 0.22
"""Used where neither a ledge nor a colour shows the mattress's underside [m]."""


def bed_parts(body: Body) -> PartMap:
    """Name the faces of a bed."""
    scale = float(body.size[:2].max()) / USUAL_LENGTH
    level = _sleeping_level(body, scale)
    parts = PartMap.filled(len(body.area), "frame")
    parts.separate = frozenset({"pillow"})
    if np.isnan(level):
        return parts
    head = _head_side(body, level, scale)
    body = _cut_composites(body, level, scale)
    pieces = body.pieces()
    mattress = _bared(body, pieces, level, head, scale) or _mattress(body, pieces, level, scale)
    for piece in pieces:
        parts.names[piece.faces] = _piece_name(body, piece, mattress, level, head, scale)
    _name_head_end(body, parts, pieces, mattress, level, head, scale)
    if mattress is None:
        _cut_by_height(body, parts, level, scale)
    else:
        parts.names[mattress.faces] = "mattress"
        _cut_frame(body, parts, pieces, mattress, level, scale)
        _cut_bumps(body, parts, mattress, level, scale)
    _cut_headboard(body, parts, level, head, scale)
    _name_scraps(body, parts, pieces, level)
    parts.confidence = 0.85 if mattress is not None else 0.55
    parts.front = None if head is None else -head
    return parts


def _middle(body: Body, share: float) -> NDArray[np.bool_]:
    """Faces over the middle `share` of the footprint, shape (k,)."""
    return np.asarray((np.abs(body.center[:, :2]) < 0.5 * share * body.size[:2]).all(axis=1))


def _sleeping_level(body: Body, scale: float) -> float:
    """Height of the lying surface [m]."""
    chosen = body.open_up & _middle(body, 0.8) & (body.center[:, 2] > 0.15 * body.size[2])
    return level_of(body.center[chosen, 2], body.area[chosen], 0.06 * scale)


def _head_side(body: Body, level: float, scale: float) -> NDArray[np.float64] | None:
    """Outward direction of the head end: the side that rises highest above the level, else where pillows lie."""
    high = body.center[:, 2] > level + 0.12 * scale
    best, found = 0.0, None
    for side in SIDES:
        axis = int(np.argmax(np.abs(side)))
        along = body.center @ side
        near = high & (along > 0.5 * body.size[axis] - 0.14 * body.size[axis] - 0.03 * scale)
        across = body.center[near, 1 - axis]
        width = float(np.ptp(across)) if len(across) else 0.0
        # Only something nearly as wide as the bed is a headboard; its height counts, a wide rail at the side does not.
        score = float(body.area[near].sum()) * (width > 0.6 * body.size[1 - axis]) * body.size[axis]
        if score > best:
            best, found = score, side
    if found is not None and best > 0.02 * float(np.prod(body.size[:2])) * body.size[:2].max():
        return found
    return _pillow_side(body, level, scale)


def _pillow_side(body: Body, level: float, scale: float) -> NDArray[np.float64] | None:
    """The end of the long axis near which more surface lies above the level; None where neither does."""
    axis = int(np.argmax(body.size[:2]))
    raised = (body.center[:, 2] > level + 0.05 * scale) & (np.abs(body.center[:, axis]) > 0.2 * body.size[axis])
    weight = np.where(raised, body.area, 0.0)
    lean = float((weight * np.sign(body.center[:, axis])).sum())
    if abs(lean) < 0.02 * float(np.prod(body.size[:2])):
        return None
    side: NDArray[np.float64] = np.zeros(3)
    side[axis] = np.sign(lean)
    return side


def _is_composite(body: Body, piece: Piece, level: float, scale: float) -> bool:
    """A wide piece that ends above the lying level and is thicker than any mattress holds several parts."""
    wide = bool((piece.size[:2] > 0.6 * body.size[:2]).all())
    thick = bool(piece.size[2] > THICKEST_MATTRESS * scale or piece.low[2] < 0.12 * level)
    return wide and thick and bool(piece.high[2] > level - 0.03 * scale)


def _cut_composites(body: Body, level: float, scale: float) -> Body:
    """Cut pieces that hold several parts by colour."""
    for piece in body.pieces():
        if _is_composite(body, piece, level, scale):
            body = body.split_by_color(piece.faces)
    return body


def _mattress(body: Body, pieces: list[Piece], level: float, scale: float) -> Piece | None:
    """The piece that one lies on: wide, its top at the level; under a blanket, the thick piece below it."""
    wide = [
        p
        for p in pieces
        if (p.size[:2] > 0.55 * body.size[:2]).all()
        and p.up_area > 0.05 * np.prod(body.size[:2])
        and p.low[2] > 0.12 * level
        and level - 0.2 * scale < p.high[2] < level + 0.25 * scale
    ]
    if not wide:
        return None
    wide.sort(key=lambda p: -_top_level(body, p, scale))
    top = wide[0]
    for below in wide[1:]:
        # A blanket lies close on the mattress; more than its own thickness above it, it is bedding itself.
        gap = _top_level(body, top, scale) - _top_level(body, below, scale)
        longer = below.size[:2].max() > 0.8 * body.size[:2].max() and below.size[2] > 0.05 * scale
        if gap < 0.1 * scale and longer and _is_cover(top, below):
            return below
    return top


def _bared(
    body: Body, pieces: list[Piece], level: float, head: NDArray[np.float64] | None, scale: float
) -> Piece | None:
    """The head end of a mattress whose rest a blanket hides, as scans see it: broad, at the level, beyond the cover."""
    if head is None:
        return None
    along = int(np.argmax(np.abs(head)))
    broad = [
        p
        for p in pieces
        if p.size[1 - along] > 0.55 * body.size[1 - along]
        and p.up_area > 0.05 * np.prod(body.size[:2])
        and p.low[2] > 0.12 * level
        and abs(_top_level(body, p, scale) - level) < 0.06 * scale
    ]
    broad = sorted((p for p in broad if p.size[along] > 0.15 * body.size[along]), key=lambda p: -float(p.middle @ head))
    if (
        len(broad) < 2
        or any(p.size[along] > 0.8 * body.size[along] for p in broad)
        or float(broad[0].middle @ head) < 0.1 * body.size[along]
    ):
        return None
    shared = min(broad[0].high[along], broad[1].high[along]) - max(broad[0].low[along], broad[1].low[along])
    return broad[0] if shared < 0.3 * broad[0].size[along] else None


def _is_cover(top: Piece, below: Piece) -> bool:
    """A cover is shorter than what it covers, or hangs over its edges."""
    shorter = bool((top.size[:2] < 0.93 * below.size[:2]).any())
    hangs = bool((top.size[:2] > 1.005 * below.size[:2]).any() and top.low[2] < below.high[2])
    return shorter or hangs


def _top_level(body: Body, piece: Piece, scale: float) -> float:
    """Height of a piece's upper surface [m]."""
    faces = piece.faces[body.up[piece.faces]]
    level = level_of(body.center[faces, 2], body.area[faces], 0.06 * scale)
    return float(piece.high[2]) if np.isnan(level) else level


def _name_head_end(
    body: Body,
    parts: PartMap,
    pieces: list[Piece],
    mattress: Piece | None,
    level: float,
    head: NDArray[np.float64] | None,
    scale: float,
) -> None:
    """What stands behind the mattress is headboard, bars and rails too, if any of it rises above the bedding."""
    if head is None or mattress is None:
        return
    edge = float(max(mattress.low @ head, mattress.high @ head)) - 0.03 * scale
    behind = [p for p in pieces if p is not mattress and float(min(p.low @ head, p.high @ head)) > edge]
    if any(p.high[2] > level + 0.12 * scale for p in behind):
        for piece in behind:
            parts.names[piece.faces] = "headboard"


def _name_scraps(body: Body, parts: PartMap, pieces: list[Piece], level: float) -> None:
    """Scraps of a scan between blanket and mattress are no frame: they go with the nearest face of like colour."""
    total = float(body.area.sum())
    scraps = [
        p for p in pieces if p.area < 0.03 * total and p.low[2] > 0.45 * level and parts.names[p.faces[0]] == "frame"
    ]
    bedding = np.flatnonzero(parts.names != "frame")
    if not scraps or not len(bedding):
        return
    place = np.concatenate([body.center, COLOR_LENGTH * body.lab], axis=1)
    faces = np.concatenate([p.faces for p in scraps])
    parts.names[faces] = parts.names[bedding[cKDTree(place[bedding]).query(place[faces])[1]]]


def _piece_name(
    body: Body, piece: Piece, mattress: Piece | None, level: float, head: NDArray[np.float64] | None, scale: float
) -> str:
    """Name of a piece that is one part."""
    top = _top_level(body, piece, scale)
    if head is not None and _at_head(body, piece, head) and piece.high[2] > level + 0.12 * scale:
        lies_on_bed = _lies_at(piece, level, scale) and _inset(body, piece, head) > 0.03 * scale
        if not lies_on_bed:
            return "headboard"
    small = float(np.prod(piece.size[:2])) < 0.35 * float(np.prod(body.size[:2]))
    if _lies_at(piece, level, scale) and small and level + 0.02 * scale < piece.high[2] < level + 0.4 * scale:
        return "pillow" if piece.size[2] > 0.045 * scale else "blanket"
    across = int(np.argmin(body.size[:2])) if head is None else 1 - int(np.argmax(np.abs(head)))
    broad = piece.size[across] > 0.6 * body.size[across] and piece.size[1 - across] > 0.2 * body.size[1 - across]
    covers = mattress is not None and top > _top_level(body, mattress, scale) - 0.03 * scale
    if covers and piece.size[across] > 0.5 * body.size[across] and piece.high[2] < level + 0.2 * scale:
        return "blanket"
    if broad and piece.low[2] > 0.6 * level and piece.size[2] < 0.4 * scale and piece.high[2] <= level + 0.05 * scale:
        return "mattress"
    return "frame"


def _lies_at(piece: Piece, level: float, scale: float) -> bool:
    """Whether a piece rests on the bedding, perhaps on another pillow."""
    return bool(level - 0.15 * scale < piece.low[2] < level + 0.16 * scale) and piece.up_area > 0.0


def _at_head(body: Body, piece: Piece, head: NDArray[np.float64]) -> bool:
    """Whether a piece lies within the outer quarter at the head end."""
    axis = int(np.argmax(np.abs(head)))
    ends = np.array([piece.low @ head, piece.high @ head])
    return bool(ends.min() > 0.25 * body.size[axis] and ends.max() > 0.5 * body.size[axis] - 0.12 * body.size[axis])


def _inset(body: Body, piece: Piece, head: NDArray[np.float64]) -> float:
    """How far a piece stays away from the outer face of the head end [m]."""
    axis = int(np.argmax(np.abs(head)))
    return float(0.5 * body.size[axis] - max(piece.low @ head, piece.high @ head))


def _cut_headboard(body: Body, parts: PartMap, level: float, head: NDArray[np.float64] | None, scale: float) -> None:
    """What rises high at the head end is headboard, also where it is of one piece with the frame or the mattress."""
    if head is None:
        return
    axis = int(np.argmax(np.abs(head)))
    at_end = body.center @ head > 0.5 * body.size[axis] - 0.12 * body.size[axis]
    risen = body.center[:, 2] > level + 0.12 * scale
    fused = (parts.names == "frame") | (parts.names == "mattress")
    if not (fused & at_end & risen).any():
        return
    inner = float((body.center[fused & at_end & risen] @ head).min()) - 0.01 * scale
    column = (body.center @ head > inner) & (body.center[:, 2] > 0.5 * level)
    parts.names[fused & column] = "headboard"


def _cut_frame(body: Body, parts: PartMap, pieces: list[Piece], mattress: Piece, level: float, scale: float) -> None:
    """A mattress fused with a frame of its own colour ends a mattress's thickness below the level."""
    carried = any(
        (p.size[:2] > 0.6 * body.size[:2]).all() and p.low[2] < mattress.low[2] - 0.05 * scale for p in pieces
    )
    if _is_composite(body, mattress, level, scale) and not carried:
        low = body.center[mattress.faces, 2] < level - MATTRESS_THICKNESS * scale
        parts.names[mattress.faces[low]] = "frame"


def _cut_bumps(body: Body, parts: PartMap, mattress: Piece, level: float, scale: float) -> None:
    """Small patches of the mattress's piece that rise above the level are pillows of the same cloth."""
    risen = np.zeros(len(body.area), dtype=bool)
    risen[mattress.faces] = body.center[mattress.faces, 2] > level + 0.04 * scale
    a, b = body.pairs.T
    patch = connected_regions(len(risen), body.pairs, risen[a] & risen[b])
    size = np.bincount(patch, np.where(risen, body.area, 0.0))
    top = np.zeros(len(size))
    np.maximum.at(top, patch, body.center[:, 2])
    footprint = float(np.prod(body.size[:2]))
    bump = (size > 0.02 * footprint) & (size < 0.5 * footprint) & (top > level + 0.08 * scale)
    parts.names[risen & bump[patch]] = "pillow"


def _cut_by_height(body: Body, parts: PartMap, level: float, scale: float) -> None:
    """One piece for everything: a band of height is the mattress, what lies on it pillow or blanket."""
    z = body.center[:, 2]
    bottom = level - min(MATTRESS_THICKNESS * scale, 0.55 * level)
    open_name = parts.names == "frame"
    parts.names[open_name & (z >= bottom) & (z <= level + 0.3 * scale)] = "mattress"
