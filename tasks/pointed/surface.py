"""The upward surface at a point of a scene, or one line with the reason why there is none."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.raycast import Raycaster
from dcap.scene.errors import InputError
from dcap.scene.types.scan import Scan
from dcap.scene.types.segmentation import Segmentation

Array = NDArray[np.float64]

LEVEL = 0.5
"""Least cosine to the vertical of a carrying face: within 60 degrees [-]."""
SUNK = 0.05
"""Largest depth of a point below the intended surface: scans and fingers are uncertain [m]."""
STEP = 1e-4
"""Distance behind an ignored face at which the search continues [m]."""
MOST_FACES = 200
"""Most faces above each other that are examined [-]."""
ABOVE = 0.1
"""Height of a point over the surface below above which it is reported [m]."""
DOWN = np.array([0.0, 0.0, -1.0])


@dataclass(frozen=True, eq=False, slots=True)
class Meeting:
    """Intersection of the vertical through a point with the scene."""

    face: int
    position: Array
    """[m], shape (3,)."""


def file_bounds(scan: Scan) -> Array:
    """Lowest and highest corner of the scene in the file's own frame, shape (2, 3)."""
    low, high = scan.mesh.bounds
    corners = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
    own = in_file(scan, corners)
    return np.stack([own.min(axis=0), own.max(axis=0)])


def in_file(scan: Scan, points: Array) -> Array:
    """World points (n, 3) in the file's own frame."""
    file_from_world = np.linalg.inv(scan.world_from_file)
    return np.asarray(points @ file_from_world[:3, :3].T + file_from_world[:3, 3])


def in_words(scan: Scan) -> str:
    """The scene's bounds for a message."""
    low, high = file_bounds(scan)
    spans = (f"{axis} {a:.4g} to {b:.4g}" for axis, a, b in zip("xyz", low, high, strict=True))
    return f"the scene spans {', '.join(spans)} ({scan.up} up) in its file"


def level_axes(scan: Scan) -> tuple[int, int]:
    """The file's two level axes in their order: x and z of a file with y up."""
    upright = "xyz".index(scan.up.removeprefix("-"))
    first, second = (axis for axis in range(3) if axis != upright)
    return first, second


def meeting(scan: Scan, scene: Segmentation, at: tuple[float, ...]) -> Meeting:
    """The intended surface: nearest below the point, or the highest there; InputError if there is none."""
    text = f"--at {','.join(f'{one:g}' for one in at)}"
    own = np.zeros(3)
    own[list(level_axes(scan)) if len(at) == 2 else [0, 1, 2]] = at
    point = scan.world_from_file[:3, :3] @ own + scan.world_from_file[:3, 3]
    low, high = scan.mesh.bounds
    if (point[:2] < low[:2]).any() or (point[:2] > high[:2]).any():
        raise InputError(f"{text} is outside of the scene: {in_words(scan)}; give a point of the file's own frame")
    caster = Raycaster(scene.mesh)
    if len(at) == 2:
        return highest(scan, scene, caster, point, text)
    if point[2] < low[2] - SUNK:
        raise InputError(
            f"{text} is under the floor: {in_words(scan)}; give a higher point, or two numbers: the highest surface"
        )
    if point[2] > high[2] + SUNK:
        raise InputError(
            f"{text} is above the scene: {in_words(scan)}; give a lower point, or two numbers: the highest surface"
        )
    start = np.array([*point[:2], point[2] + SUNK])
    hit = caster.cast(start[None], DOWN[None])
    face = int(hit.face[0])
    if face < 0:
        raise InputError(f"{text} is in the air with nothing below it: {in_words(scan)}; give a point on a surface")
    normal = float(hit.normal[0, 2])
    if normal < -STEP:
        raise InputError(
            f"{text} is inside of {owner_name(scene, face)}: the surface below it faces down; {in_words(scan)};  "
            "give a point on its surface, or two numbers: the highest surface there"
        )
    if normal < LEVEL:
        steep = np.degrees(np.arccos(normal))
        raise InputError(
            f"{text} is over {owner_name(scene, face)} where that is {steep:.0f} degrees steep; nothing stays there: "
            f"give a point on a surface that looks up ({in_words(scan)})"
        )
    return Meeting(face, hit.position[0])


def highest(scan: Scan, scene: Segmentation, caster: Raycaster, point: Array, text: str) -> Meeting:
    """The highest upward surface that belongs to no wall or ceiling."""
    start = np.array([*point[:2], float(scene.mesh.bounds[1, 2]) + 1.0])
    for _ in range(MOST_FACES):
        hit = caster.cast(start[None], DOWN[None])
        face = int(hit.face[0])
        if face < 0:
            break
        if hit.normal[0, 2] >= LEVEL and carries(scene, face):
            return Meeting(face, hit.position[0])
        start = hit.position[0] + STEP * DOWN
    raise InputError(f"{text}: nothing there looks up; {in_words(scan)}; give a point over a surface")


def carries(scene: Segmentation, face: int) -> bool:
    """Whether a face belongs to a thing or the floor."""
    owner = int(scene.face_instance[face])
    return owner >= 0 and (not scene.instances[owner].structure or scene.instances[owner].label == "floor")


def owner_name(scene: Segmentation, face: int) -> str:
    """Owner of a face, in words."""
    owner = int(scene.face_instance[face])
    return scene.instances[owner].id if owner >= 0 else "the scene"
