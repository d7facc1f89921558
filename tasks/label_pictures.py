"""Pictures of a thing that nobody named: in its room in a loud colour, and from near; made only if a client looks."""

import numpy as np
from numpy.typing import NDArray

from geometry.cutaway import cut_faces
from geometry.picture import Camera, picture
from geometry.raycast import Raycaster
from geometry.segmentation.unlabelled import Things
from scene.box import OrientedBox
from scene.mesh import Mesh

Array = NDArray[np.float64]
Index = NDArray[np.int64]

SIZE = 512
"""Width and height [pixels]."""
LOUD = np.array([255.0, 0.0, 200.0])
"""A colour that hardly anything in a room has [sRGB]."""
TINT = 0.75
"""Share of the loud colour; the rest lets the thing's own shading and pattern through [-]."""
ROOM_DISTANCE = 3.5
"""Distance of the camera that shows the room [m]..."""
THING_DISTANCE = 2.6
"""... and, over the diagonal of the thing's box, of both at least [-]."""
NEAREST = 0.5
"""The camera does not come nearer [m]."""
ELEVATIONS = (25.0, 50.0)
"""Heights over the horizon from which a thing is looked at [degrees]; things on the ceiling from below."""
DIRECTIONS = 12
"""Directions all around that are tried."""
OUTSIDE = 0.1
"""Share of the thing that may be hidden before the camera goes round by a quarter turn [-]."""
SEEN_POINTS = 200
"""Points of the thing that are looked for."""


def in_the_room(mesh: Mesh, things: Things, box: OrientedBox, faces: Index) -> NDArray[np.uint8]:
    """The room around a thing that is painted in a loud colour, shape (SIZE, SIZE, 3)."""
    rest, thing = _apart(mesh, faces)
    loud = np.rint((1.0 - TINT) * thing.colors + TINT * LOUD).astype(np.uint8)
    painted = Mesh(thing.vertices, thing.faces, loud)
    return _seen(rest, painted, _others(things, faces), box, max(ROOM_DISTANCE, THING_DISTANCE * box.diagonal))


def close_up(mesh: Mesh, things: Things, box: OrientedBox, faces: Index) -> NDArray[np.uint8]:
    """A thing in its own colours from near, shape (SIZE, SIZE, 3)."""
    rest, thing = _apart(mesh, faces)
    return _seen(rest, thing, _others(things, faces), box, max(NEAREST, THING_DISTANCE * box.diagonal))


def _apart(mesh: Mesh, faces: Index) -> tuple[Mesh, Mesh]:
    """Everything else, and the thing."""
    other = np.ones(len(mesh.faces), dtype=bool)
    other[faces] = False
    return mesh.submesh(np.flatnonzero(other)), mesh.submesh(faces)


def _others(things: Things, faces: Index) -> NDArray[np.bool_]:
    """Which of the faces that are not the thing's are the shell's."""
    return np.delete(things.shell.any, faces)


def _seen(
    rest: Mesh, thing: Mesh, structure: NDArray[np.bool_], box: OrientedBox, distance: float
) -> NDArray[np.uint8]:  # fmt: skip
    """The picture from the side from which most of the thing is seen, walls in front of it cut away."""
    loose = Raycaster(Mesh.concatenate([rest.submesh(np.flatnonzero(~structure)), thing]))
    seen = [
        (_visible_share(loose, thing, place) - cost, -k, place)
        for k, (place, cost) in enumerate(_places(rest, box, distance))
    ]
    position = max(seen, key=lambda one: one[:2])[2]
    shown = rest.submesh(np.flatnonzero(~cut_faces(rest, structure, position, box.center)))
    return picture([shown, thing], Camera(position, box.center, width=SIZE, height=SIZE), samples=1, shadows=False).rgb


def _places(rest: Mesh, box: OrientedBox, distance: float) -> list[tuple[Array, float]]:
    """Places of the camera around a thing, and what is held against each: best is from the middle of the room."""
    middle = rest.bounds.mean(axis=0) - box.center
    start = float(np.arctan2(middle[1], middle[0]))
    sign = -1.0 if middle[2] < -0.3 * float(np.ptp(rest.bounds[:, 2])) else 1.0  # from below under the ceiling
    found = []
    for elevation in np.radians(ELEVATIONS):
        for turn in np.linspace(-np.pi, np.pi, DIRECTIONS, endpoint=False):
            flat = np.array([np.cos(start + turn), np.sin(start + turn)])
            direction = np.array([*(np.cos(elevation) * flat), sign * np.sin(elevation)])
            found.append((box.center + distance * direction, OUTSIDE * (1.0 - float(np.cos(turn)))))
    return found


def _visible_share(loose: Raycaster, thing: Mesh, camera: Array) -> float:
    """Share of points on the thing that face the camera and that nothing hides."""
    face = np.linspace(0, len(thing.faces) - 1, min(SEEN_POINTS, len(thing.faces))).astype(np.int64)
    points, normal = thing.triangles[face].mean(axis=1), thing.face_normals[face]
    way = camera - points
    facing = np.einsum("ij,ij->i", way, normal) > 0.0
    if not facing.any():
        return 0.0
    length = np.linalg.norm(way[facing], axis=1)
    unit = way[facing] / length[:, None]
    blocked = loose.occluded(points[facing] + 2e-3 * unit, unit, length - 4e-3)
    return float((~blocked).sum()) / len(face)
