"""Pictures of an unlabelled thing: in its room in a bright colour, and in close-up; made on demand."""

import numpy as np
from numpy.typing import NDArray

from dcap.arrays import Array, IntArray
from dcap.geometry.camera import looking_at
from dcap.geometry.raycast import Raycaster
from dcap.geometry.rendering.picture import picture
from dcap.geometry.rendering.view_volume import cut_faces
from dcap.geometry.segmentation.rooms.decomposition import DecomposedRoom
from dcap.scene.types.boxes import OrientedBox
from dcap.scene.types.mesh import Mesh

SIZE = 512
"""Side length of the pictures [pixels]."""
LOUD = np.array([255.0, 0.0, 200.0])
"""A colour that hardly anything in a room has [sRGB]."""
TINT = 0.75
"""Opacity of the bright colour, which lets the thing's own shading and pattern through [-]."""
ROOM_DISTANCE = 3.5
"""Least distance of the camera that shows the room [m]."""
ROOM_AROUND = 2.6
"""Distance of that camera, in diagonals of the thing's box [-]."""
THING_DISTANCE = 1.2
"""Distance of the camera at which a thing fills the picture, in diagonals of its box [-]: the thing takes at most
arcsin(0.5 / 1.2) = 25 degrees to each side, which fits into a field of view of 55 degrees."""
NEAREST = 0.5
"""Least distance of the camera [m]."""
ELEVATIONS = (25.0, 50.0)
"""Elevations from which a thing is seen [degrees]; things on the ceiling are seen from below."""
DIRECTIONS = 12
"""Number of directions around a thing that are tried."""
OUTSIDE = 0.1
"""Visible share that the camera must gain to move a quarter turn around the thing [-]."""
SEEN_POINTS = 200
"""Number of points of the thing whose visibility is tested."""


def in_the_room(mesh: Mesh, room: DecomposedRoom, box: OrientedBox, faces: IntArray) -> NDArray[np.uint8]:
    """The room around a thing painted in a bright colour, shape (SIZE, SIZE, 3)."""
    return _seen(mesh, room, faces, loud(mesh.submesh(faces)), box, max(ROOM_DISTANCE, ROOM_AROUND * box.diagonal))


def close_up(mesh: Mesh, room: DecomposedRoom, box: OrientedBox, faces: IntArray) -> NDArray[np.uint8]:
    """A thing in its own colours in close-up, shape (SIZE, SIZE, 3)."""
    return _seen(mesh, room, faces, mesh.submesh(faces), box, max(NEAREST, THING_DISTANCE * box.diagonal))


def loud(mesh: Mesh) -> Mesh:
    """The mesh with the bright colour blended into its own."""
    return Mesh(mesh.vertices, mesh.faces, np.rint((1.0 - TINT) * mesh.colors + TINT * LOUD).astype(np.uint8))


def _seen(
    mesh: Mesh, room: DecomposedRoom, faces: IntArray, thing: Mesh, box: OrientedBox, distance: float
) -> NDArray[np.uint8]:  # fmt: skip
    """The picture from the side that shows most of the thing, with the walls in front of it cut away; `thing` replaces
    its faces (k,) of the mesh."""
    other = np.ones(len(mesh.faces), dtype=bool)
    other[faces] = False
    rest, structure = mesh.submesh(np.flatnonzero(other)), room.shell.any[other]
    loose = rest.submesh(np.flatnonzero(~structure))
    position = best_place(loose, thing, box, distance, *from_inside(rest.bounds, box))
    shown = rest.submesh(np.flatnonzero(~cut_faces(rest, structure, position, box.center)))
    return picture([shown, thing], looking_at(position, box.center, SIZE, SIZE), samples=1, shadows=False).rgb


def from_inside(bounds: Array, box: OrientedBox) -> tuple[Array, bool]:
    """Direction from a thing to the middle of bounds (2, 3), and whether the thing hangs so high that it is seen from
    below."""
    middle = bounds.mean(axis=0) - box.center
    return middle, bool(middle[2] < -0.3 * float(np.ptp(bounds[:, 2])))


def best_place(
    others: Mesh, thing: Mesh, box: OrientedBox, distance: float, way: Array, from_below: bool
) -> Array:  # fmt: skip
    """Position from which a camera sees most of a thing among others, less a penalty for turning away from `way`, shape
    (3,)."""
    solid = Raycaster(Mesh.concatenate([others, thing]))
    start = float(np.arctan2(way[1], way[0]))
    sign = -1.0 if from_below else 1.0
    best, most = box.center, -np.inf
    for elevation in np.radians(ELEVATIONS):
        for turn in np.linspace(-np.pi, np.pi, DIRECTIONS, endpoint=False):
            flat = np.array([np.cos(start + turn), np.sin(start + turn)])
            direction = np.array([*(np.cos(elevation) * flat), sign * np.sin(elevation)])
            place = box.center + distance * direction
            worth = _visible_share(solid, thing, place) - OUTSIDE * (1.0 - float(np.cos(turn)))
            if worth > most:
                best, most = place, worth
    return best


def _visible_share(loose: Raycaster, thing: Mesh, camera: Array) -> float:
    """Share of points on the thing that face the camera and are not hidden."""
    face = np.linspace(0, len(thing.faces) - 1, min(SEEN_POINTS, len(thing.faces))).astype(np.int64)
    points, normal = thing.corners(face).mean(axis=1), thing.face_normals[face]
    way = camera - points
    facing = np.einsum("ij,ij->i", way, normal) > 0.0
    if not facing.any():
        return 0.0
    length = np.linalg.norm(way[facing], axis=1)
    unit = way[facing] / length[:, None]
    blocked = loose.occluded(points[facing] + 2e-3 * unit, unit, length - 4e-3)
    return float((~blocked).sum()) / len(face)
