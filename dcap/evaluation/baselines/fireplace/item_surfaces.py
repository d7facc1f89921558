"""The object's interaction surfaces: those on which it may rest, and its six named sides.

In: the object's mesh at its final scale, and its name. Out: `ItemSurfaces`. The surface that faces a direction consists
of the mesh's outermost planar faces in that direction (the four feet of a chair together); for a shape without any,
such as a ball or a plush toy, the outermost part of its shape stands in, flattened on its box's side. The directions
offered for resting are the same for every method: the six sides in the file's pose, those of the standing pose if that
differs, and the resting faces of the convex hull.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from dcap.arrays import Array
from dcap.evaluation.baselines.fireplace.planar import FINE, LEAST_SHARE, InteractionSurface, hull_on_plane, surface_of
from dcap.geometry.placement.poses import front_of, rotated, surface_points, symmetry_about_z
from dcap.geometry.placement.resting_poses import on_legs, resting_poses
from dcap.geometry.placement.upright import standing_pose, stands_as_read, used_vertices
from dcap.knowledge.kinds import front_side, to_right
from dcap.knowledge.lexicon import thing_of
from dcap.language.protocol.requests import PoseView
from dcap.scene.types.mesh import Mesh

LOWEST = 0.08
"""Depth of a side without planar faces, from its outermost point, over the extent [-]."""
POINTS = 4000
"""Number of points that represent a shape without planar faces [-]."""
DOWN = np.array([0.0, 0.0, -1.0])


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
