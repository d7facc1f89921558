"""The surfaces of the anchors, as a short list to choose from, and those of the object.

Planar surfaces of an anchor are grown on the mesh. Boxes of things give their sides and outlines, too. A mostly uneven
top gets a coarser growth or, failing that, the top of its box. Covered surfaces (a mattress under its blanket) are left
out.

The object's surface that faces a direction consists of its outermost planar faces in that direction (the four feet of a
chair together). If a shape has none, like a ball or a plush toy, its outermost part is flattened onto its box's side.
The directions offered for resting are the same for every method: the six sides in the file's pose, those of the
standing pose if that differs, and the resting faces of the convex hull.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dcap.arrays import Array, IntArray
from dcap.evaluation.baselines.fireplace.planar import (
    COARSE,
    FINE,
    LEAST_SHARE,
    Flatness,
    InteractionSurface,
    hull_on_plane,
    planar_surfaces,
    rectangle_surface,
    surface_of,
)
from dcap.geometry.placement.named_regions import ViewerFrame
from dcap.geometry.placement.poses import front_of, rotated, surface_points, symmetry_about_z
from dcap.geometry.placement.resting_poses import on_legs, resting_poses
from dcap.geometry.placement.upright import standing_pose, stands_as_read, used_vertices
from dcap.geometry.raycast import Raycaster
from dcap.knowledge.kinds import front_side, to_right
from dcap.knowledge.lexicon import thing_of
from dcap.language.protocol.requests import PoseView
from dcap.scene.types.boxes import OrientedBox
from dcap.scene.types.mesh import Mesh

LOOKS = 0.7
"""Least cosine between the normal of a surface and the side that it faces [-]."""
SLOPED = 0.4
"""The same for tops: pillows and shades slope [-]."""
OPEN = 0.03
"""Free height over a point of a surface on which something can stand [m]."""
ABOVE = 0.001
"""Start of rays over a surface [m]: a blanket may lie this close to its mattress."""
THICK = 0.25
"""Largest thickness of a covering thing whose underside is missing or inside the surface [m]."""
LEAST_OPEN = 0.1
"""Share of a surface that must be free [-]."""
ENOUGH = 0.5
"""Least share of a top's upward area in one planar surface; below it a coarser surface is offered too [-]."""
SMALLEST = 4e-4
"""Least area of a planar surface [m^2]."""
LOWEST = 0.08
"""Depth of a side without planar faces, as a share of the object's extent [-]."""
POINTS = 4000
"""Number of points that represent a shape without planar faces [-]."""
DOWN = np.array([0.0, 0.0, -1.0])


@dataclass(frozen=True, eq=False, slots=True)
class AnchorSurface:
    """A surface of a thing or of one of its parts."""

    surface: InteractionSurface
    part: int
    """Index of the part."""
    flatness: float
    """Allowed unevenness [m]."""
    open_area: float
    """Uncovered area [m^2]."""
    kind: str
    """planar, coarse or box."""


def side_ways(frame: ViewerFrame) -> dict[str, Array]:
    """Outward unit vectors of the sides, as the viewer of a frame sees them, shape (3,) each."""
    right, front = np.append(frame.right, 0.0), np.append(frame.front, 0.0)
    up = np.array([0.0, 0.0, 1.0])
    return {"left": -right, "right": right, "front": front, "back": -front, "top": up, "bottom": -up}


def surfaces_of_part(
    mesh: Mesh, faces: IntArray, part: int, way: Array, side: str, caster: Raycaster
) -> list[AnchorSurface]:
    """Planar surfaces of a part with faces (k,) that face a direction; for an uneven top also coarse ones."""
    own = mesh.submesh(faces), faces
    limit = SLOPED if side in ("top", "bottom") else LOOKS
    found = measured(own, FINE, "planar", way, limit, part, caster)
    if side == "top":
        normal, area = own[0].face_normals, own[0].face_areas
        upward = float(area[normal[:, 2] > SLOPED * 2.0 * area].sum())
        if max((one.open_area for one in found), default=0.0) < ENOUGH * upward:
            found += measured(own, COARSE, "coarse", way, limit, part, caster)
    return found


def measured(
    own: tuple[Mesh, IntArray], flatness: Flatness, kind: str, way: Array, limit: float, part: int, caster: Raycaster
) -> list[AnchorSurface]:
    """Open planar surfaces that face a direction; `own` is a part alone and its faces in the scene."""
    found = []
    for one in planar_surfaces(own[0], flatness, SMALLEST):
        if one.normal @ way < limit:
            continue
        share = open_share(one, caster)
        if share > LEAST_OPEN:
            one = replace(one, faces=own[1][one.faces])
            found.append(AnchorSurface(one, part, flatness.offset, share * one.area, kind))
    return found


def open_share(surface: InteractionSurface, caster: Raycaster) -> float:
    """Share of a surface over which nothing lies or stands [-]."""
    start = surface.points + ABOVE * surface.normal
    way = np.tile(surface.normal, (len(start), 1))
    distance = caster.cast(start, way).distance
    # a ray that leaves a solid started inside it: a frame under its mattress
    within = caster.left_at(start, way) < THICK
    return float(1.0 - ((distance < OPEN) | within).mean())


def box_side(box: OrientedBox, frame: ViewerFrame, side: str) -> InteractionSurface:
    """A side of a thing's box as its viewer sees it; `whole` is its outline from above, at its middle height."""
    right, front = np.append(frame.right, 0.0), np.append(frame.front, 0.0)
    up, center = np.array([0.0, 0.0, 1.0]), np.array([*frame.center, box.center[2]])
    half = {"right": float(frame.half[0]), "front": float(frame.half[1]), "up": float(box.half_extents[2])}
    if side in ("top", "bottom", "whole"):
        normal = -up if side == "bottom" else up
        shift = {"top": half["up"], "bottom": -half["up"], "whole": 0.0}[side]
        size = np.array([half["right"], half["front"]])
        return rectangle_surface(side, center + shift * up, normal, right, size)
    normal, first, reach, width = {
        "left": (-right, front, half["right"], half["front"]),
        "right": (right, front, half["right"], half["front"]),
        "front": (front, right, half["front"], half["right"]),
        "back": (-front, right, half["front"], half["right"]),
    }[side]
    return rectangle_surface(f"{side} side", center + reach * normal, normal, first, np.array([width, half["up"]]))


def extent_across(frame: ViewerFrame, side: str) -> float:
    """Extent of a thing perpendicular to one of its sides [m]."""
    return 2.0 * float(frame.half[0] if side in ("left", "right") else frame.half[1])


def joined_box(boxes: Sequence[OrientedBox]) -> OrientedBox:
    """The box around several boxes, turned like the first."""
    if len(boxes) == 1:
        return boxes[0]
    first = boxes[0]
    local = first.to_local(np.concatenate([one.corners for one in boxes]))
    low, high = local.min(axis=0), local.max(axis=0)
    return OrientedBox(first.to_world(0.5 * (low + high)[None])[0], first.axes, 0.5 * (high - low))


@dataclass(frozen=True, eq=False, slots=True)
class ItemSurfaces:
    """Surfaces of the object for constraints; everything in the mesh's frame, at its final scale."""

    poses: tuple[PoseView, ...]
    """Surfaces on which it may rest, as the poses in which they face down."""
    sides: Mapping[str, InteractionSurface]
    """front, back, left, right, top, bottom of the standing object."""
    up: Array
    """Unit vector up of the standing object, shape (3,)."""
    symmetry: int
    """Order of the rotational symmetry about `up`; 0: any angle, 1: none."""
    has_front: bool
    stands: bool
    righting: float
    on_legs: bool
    """As in `OutlinesRequest`."""


def item_surfaces(mesh: Mesh, name: str) -> ItemSurfaces:
    """All surfaces of an object with this name."""
    own, righting, _ = standing_pose(mesh)
    stands, side = stands_as_read(mesh), front_side(name)
    trusted = to_right(thing_of(name), righting=righting, stands=stands, file_up=float(own[2, 2]))
    believed = own if trusted else np.eye(3)
    standing = rotated(mesh, believed)
    front, has_front = front_of(standing, side)
    left = np.cross((0.0, 0.0, 1.0), front)
    ways = {"front": front, "back": -front, "left": left, "right": -left, "top": -DOWN, "bottom": DOWN}
    return ItemSurfaces(
        poses=tuple(
            PoseView.of(one.id, one.rotation, one.probability, one.up, one.front, one.size)
            for one in resting_poses(mesh, own, believed, side)
        ),
        sides={key: surface_towards(mesh, believed.T @ way, key) for key, way in ways.items()},
        up=believed[2].copy(),
        symmetry=symmetry_about_z(standing),
        has_front=has_front,
        stands=stands,
        righting=righting,
        on_legs=on_legs(mesh, believed[2]),
    )


def surface_towards(mesh: Mesh, way: Array, name: str) -> InteractionSurface:
    """The outermost surface of a mesh in a direction (3,): its planar faces there, else its outermost part, flat."""
    along = used_vertices(mesh) @ way
    depth = max(FINE.offset, 0.01 * float(np.ptp(along)))
    normal, area = mesh.face_normals, mesh.face_areas
    looking = normal @ way > np.cos(FINE.angle) * 2.0 * area
    outer = (along.max() - mesh.triangles.mean(axis=1) @ way < depth) & looking & (area > 0.0)
    if area[outer].sum() > LEAST_SHARE * area.sum():
        return surface_of(mesh, np.flatnonzero(outer), name)
    points = np.concatenate([surface_points(mesh, POINTS), used_vertices(mesh)])
    reach = max(LOWEST * float(np.ptp(along)), FINE.offset)
    points = points[along.max() - points @ way < reach]
    points = points - (points @ way - along.max())[:, None] * way
    outline = hull_on_plane(points, points.mean(axis=0), way)
    center = outline.mean(axis=0) if len(outline) else points.mean(axis=0)
    size = float(np.prod(np.ptp(outline @ np.linalg.svd(way[None])[2][1:].T, axis=0))) if len(outline) else 0.0
    return InteractionSurface(name, center, way, points, outline, size, np.zeros(0, dtype=np.int64))
