"""Parts of seats: sofa (base, seat cushion, back, arm), chair (seat, back, leg), stool (seat, leg).

The seat is the level with most upward area in the middle; the back is the side that rises above it over most of its
width; arms rise on the two sides next to it.
"""

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.segmentation.faces import level_of
from dcap.geometry.segmentation.parts.instance_surface import SIDES, InstanceSurface, PartMap, SurfacePiece

SEAT_BAND = 0.06
"""Tolerance of the seat's level, as a share of the height [-]."""


def _seat_level(surface: InstanceSurface) -> float:
    """Height of the sitting surface [m]."""
    middle = (np.abs(surface.center[:, :2]) < 0.3 * surface.size[:2]).all(axis=1)
    z = surface.center[:, 2]
    chosen = surface.open_up & middle & (z > 0.15 * surface.size[2]) & (z < 0.95 * surface.size[2])
    return level_of(z[chosen], surface.area[chosen], 0.06 * float(surface.size[2]))


def _back_side(surface: InstanceSurface, level: float) -> NDArray[np.float64] | None:
    """Outward direction of the side whose outer third has most area well above the seat."""
    height = float(surface.size[2]) - level
    if height < 0.12 * surface.size[2]:
        return None
    high = surface.center[:, 2] > level + 0.45 * height
    scores = []
    for side in SIDES:
        axis = int(np.argmax(np.abs(side)))
        outer = high & (surface.center @ side > 0.15 * surface.size[axis])
        width = float(np.ptp(surface.center[outer, 1 - axis])) / float(surface.size[1 - axis]) if outer.any() else 0.0
        # A back spreads along its side, unlike an arm.
        scores.append(
            float((surface.area[outer] * np.abs(surface.center[outer] @ side)).sum()) / surface.size[axis] * width
        )
    best = int(np.argmax(scores))
    return SIDES[best] if scores[best] > 0 else None


def sofa_parts(surface: InstanceSurface) -> PartMap:
    """Name the faces of a sofa or armchair."""
    parts = PartMap.filled(len(surface.area), "base")
    level = _seat_level(surface)
    if np.isnan(level):
        return parts
    back = _back_side(surface, level)
    parts.front = None if back is None else -back
    height = float(surface.size[2])
    seat_bottom = _seat_bottom(surface, level, height)
    for piece in surface.pieces():
        name = _sofa_piece(surface, piece, level, seat_bottom, back)
        if name:
            parts.names[piece.faces] = name
        else:
            parts.names[piece.faces] = _sofa_faces(surface, piece.faces, level, seat_bottom, back)
    parts.confidence = 0.8 if (parts.names == "seat cushion").any() and back is not None else 0.45
    return parts


def _seat_bottom(surface: InstanceSurface, level: float, height: float) -> float:
    """Height of the underside of the seat cushions [m], estimated from their usual thickness if none is found."""
    cushions = _cushions(surface, level, height)
    return float(cushions[0].low[2]) if cushions else level - 0.18 * height


def _cushions(surface: InstanceSurface, level: float, height: float) -> list[SurfacePiece]:
    """The seat cushions, the largest first; empty if they are not most of the seat, because a scan tears fragments off
    a seat without cushions."""
    found = [piece for piece in surface.pieces() if _is_seat_piece(surface, piece, level, height)]
    seat = surface.area * (surface.open_up & (np.abs(surface.center[:, 2] - level) < SEAT_BAND * height))
    return found if sum(seat[one.faces].sum() for one in found) > 0.5 * seat.sum() else []


def _is_seat_piece(surface: InstanceSurface, piece: SurfacePiece, level: float, height: float) -> bool:
    """Return whether a piece is a cushion: its top at the level, not rising above it, in the middle band."""
    flat = piece.size[2] < 0.45 * height and abs(float(piece.high[2]) - level) < 0.12 * height
    return bool(flat and piece.up_area > 0.04 * np.prod(surface.size[:2]) and piece.low[2] > 0.1 * level)


def _sofa_piece(
    surface: InstanceSurface, piece: SurfacePiece, level: float, seat_bottom: float, back: NDArray[np.float64] | None
) -> str:
    """Name of a piece that is one part; empty if it must be cut."""
    height = float(surface.size[2])
    if _is_seat_piece(surface, piece, level, height):
        return "seat cushion"
    if piece.high[2] < level - 0.02 * height:
        return "base"
    if back is None:
        return ""
    axis = int(np.argmax(np.abs(back)))
    across = piece.size[1 - axis] / surface.size[1 - axis]
    behind = min(piece.low @ back, piece.high @ back) > -0.12 * surface.size[axis]
    beside = min(abs(piece.low[1 - axis]), abs(piece.high[1 - axis])) > 0.25 * surface.size[1 - axis]
    if behind and piece.high[2] > level + 0.12 * height and not (across < 0.25 and beside):
        return "back"
    if across < 0.3 and beside and np.sign(piece.low[1 - axis]) == np.sign(piece.high[1 - axis]):
        return "arm"
    return ""


def _sofa_faces(
    surface: InstanceSurface,
    faces: NDArray[np.int64],
    level: float,
    seat_bottom: float,
    back: NDArray[np.float64] | None,
) -> NDArray[np.object_]:
    """Names of the faces of a piece that combines shell, arms and back, and the seat if there are no cushions."""
    names = np.full(len(faces), "base", dtype=object)
    if back is None:
        return names
    height = float(surface.size[2])
    center, normal = surface.center[faces], surface.normal[faces]
    axis = int(np.argmax(np.abs(back)))
    sideways, rearward = center[:, 1 - axis], center @ back
    inner_arm, inner_back = _inner_edges(surface, level, axis, back)
    above = center[:, 2] > seat_bottom
    arm = above & (np.abs(sideways) > inner_arm)
    rear = above & (rearward > inner_back)
    if not _cushions(surface, level, height):
        names[above & ~arm & ~rear & (center[:, 2] < level + 0.06 * height) & (normal[:, 2] > -0.5)] = "seat cushion"
    names[arm] = "arm"
    # Where back and arm meet, faces higher than the arms are back.
    arm_top = _arm_top(center, arm & ~rear, height)
    names[rear & (~arm | (center[:, 2] > arm_top))] = "back"
    names[(names == "base") & (center[:, 2] > level + SEAT_BAND * height)] = "back"  # on a corner sofa's other wing
    return names


def _arm_top(center: NDArray[np.float64], arm: NDArray[np.bool_], height: float) -> float:
    return float(np.percentile(center[arm, 2], 98)) + 0.02 * height if arm.any() else np.inf


def _inner_edges(surface: InstanceSurface, level: float, axis: int, back: NDArray[np.float64]) -> tuple[float, float]:
    """Distances from the middle at which the arms and the back begin [m]."""
    height, width, depth = float(surface.size[2]), float(surface.size[1 - axis]), float(surface.size[axis])
    seat = surface.open_up & (np.abs(surface.center[:, 2] - level) < SEAT_BAND * height)
    points = surface.corners[seat].reshape(-1, 3)
    sideways = float(np.percentile(np.abs(points[:, 1 - axis]), 98))
    rearward = float(np.percentile(points @ back, 97))
    return float(np.clip(sideways, 0.32 * width, 0.49 * width)), float(np.clip(rearward, 0.0, 0.42 * depth))


def chair_parts(surface: InstanceSurface) -> PartMap:
    """Name the faces of a chair: everything above the seat is back, everything below it leg."""
    parts = PartMap.filled(len(surface.area), "leg")
    level = _seat_level(surface)
    if np.isnan(level):
        return parts
    back = _back_side(surface, level)
    parts.front = None if back is None else -back
    height = float(surface.size[2])
    bottom = underside(surface, level, 0.14 * height)
    z = surface.center[:, 2]
    seat_area = surface.area * (surface.up & (np.abs(z - level) < 0.06 * height))
    for piece in surface.pieces():
        middle = 0.5 * float(piece.low[2] + piece.high[2])
        holds_seat = seat_area[piece.faces].sum() > 0.25 * seat_area.sum()
        under_pad = (piece.size[:2] > 0.6 * surface.size[:2]).all() and 0 < level - piece.high[2] < 0.12 * height
        if (holds_seat or under_pad) and piece.size[2] < 0.25 * height:
            parts.names[piece.faces] = "seat"
        elif holds_seat or (piece.low[2] < level - 0.12 * height and piece.high[2] > level + 0.12 * height):
            cut = np.where(z[piece.faces] > level + 0.035 * height, "back", "seat" if holds_seat else "leg")
            cut[z[piece.faces] < bottom] = "leg"
            parts.names[piece.faces] = cut
        elif middle > level:
            parts.names[piece.faces] = "back"
    parts.confidence = 0.8 if back is not None else 0.5
    return parts


def stool_parts(surface: InstanceSurface) -> PartMap:
    """Name the faces of a stool, whose top is the seat."""
    parts = PartMap.filled(len(surface.area), "leg")
    z, height = surface.center[:, 2], float(surface.size[2])
    chosen = surface.open_up & (z > 0.5 * height)
    level = level_of(z[chosen], surface.area[chosen], 0.08 * height)
    if np.isnan(level):
        return PartMap.filled(len(surface.area), "seat")
    bottom = underside(surface, level, 0.3 * height)
    for piece in surface.pieces():
        wide = bool((piece.size[:2] > 0.6 * surface.size[:2]).all())
        stands_clear = piece.low[2] > (0.15 if wide else 0.7) * height
        if stands_clear and piece.high[2] > level - 0.1 * height:
            parts.names[piece.faces] = "seat"
        elif wide and piece.high[2] > level - 0.05 * height:
            parts.names[piece.faces] = np.where(z[piece.faces] >= bottom, "seat", "leg")
    parts.confidence = 0.8
    return parts


def underside(surface: InstanceSurface, level: float, reach: float) -> float:
    """Height of the underside of the slab with its top at `level` [m]: from its downward faces, else half of `reach`
    lower."""
    z = surface.center[:, 2]
    below = surface.down & (z < level - 0.02 * reach) & (z > level - reach)
    found = level_of(z[below], surface.area[below], 0.15 * reach)
    if np.isnan(found) or surface.area[below].sum() < 0.08 * np.prod(surface.size[:2]):
        return level - 0.5 * reach
    return found - 0.02 * reach
