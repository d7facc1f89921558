"""Picks points of a scene in which nothing is placed yet: a click, its surface point, and its command-line option.

In: a scene as segmented, how its file's frame lies in the world, and rays. Out: points in the file's frame and unit.
"""

import math
from dataclasses import dataclass

import numpy as np

from dcap.arrays import Array
from dcap.geometry.raycast import Raycaster
from dcap.scene.types.segmentation import Segmentation
from flows.view.model import UNASSIGNED

STEP = 1e-3
"""Rounding of coordinates [m]."""
PAST = 1e-4
"""Distance behind a transparent surface at which the ray continues [m]."""
MOST_SURFACES = 64
"""Most surfaces that a ray may pass through [-]."""


@dataclass(frozen=True, slots=True)
class PickedPoint:
    """A point of the scene's surface."""

    position: tuple[float, float, float]
    """Position in the world [m]."""
    at: tuple[float, float, float]
    """Position in the file's own frame and unit."""
    option: str
    """Command-line option for it: `--at X,Y,Z`."""
    instance: str
    """Id of the thing it is on."""
    label: str


class SurfacePicker:
    """A scene prepared for clicks."""

    def __init__(self, scene: Segmentation, world_from_file: Array, inside: Array) -> None:
        """`inside` [m] is the point from which walls are visible: from behind they are transparent."""
        self._scene, self._inside = scene, inside
        self._file_from_world = np.linalg.inv(world_from_file)
        self._caster = Raycaster(scene.mesh)
        self._structure = np.array([one.structure for one in scene.instances] + [False])

    def pick(self, origin: Array, direction: Array, hidden: frozenset[tuple[str, int]]) -> PickedPoint | None:
        """First visible point on a ray; `hidden` has the instances' ids and the numbers of their parts."""
        way = direction / np.linalg.norm(direction)
        start = origin
        for _ in range(MOST_SURFACES):
            hits = self._caster.cast(start[None], way[None])
            face = int(hits.face[0])
            if face < 0:
                return None
            point = hits.position[0]
            if not self._looked_through(face, point, way, hidden):
                return self._told(face, point)
            start = point + PAST * way
        return None

    def _looked_through(self, face: int, point: Array, way: Array, hidden: frozenset[tuple[str, int]]) -> bool:
        """Whether the surface that a ray hits is hidden, or a wall seen from outside."""
        index, part = int(self._scene.face_instance[face]), int(self._scene.face_part[face])
        if (self._scene.instances[index].id if index >= 0 else UNASSIGNED, part) in hidden:
            return True
        if not self._structure[index]:
            return False
        a, b, c = self._scene.mesh.vertices[self._scene.mesh.faces[face]]
        normal = np.cross(b - a, c - a)
        inward = normal if float(normal @ (self._inside - point)) >= 0.0 else -normal
        return float(inward @ way) > 0.0

    def _told(self, face: int, point: Array) -> PickedPoint:
        """The point as a command-line option."""
        index = int(self._scene.face_instance[face])
        at = self._file_from_world[:3, :3] @ point + self._file_from_world[:3, 3]
        unit = float(np.cbrt(abs(np.linalg.det(self._file_from_world[:3, :3]))))  # file units per metre
        digits = max(0, math.ceil(-math.log10(STEP * unit) - 1e-9))
        numbers = tuple(round(float(one), digits) + 0.0 for one in at)
        text = ",".join(f"{one:.{digits}f}" for one in numbers)
        owner = self._scene.instances[index] if index >= 0 else None
        return PickedPoint(
            position=(float(point[0]), float(point[1]), float(point[2])),
            at=(numbers[0], numbers[1], numbers[2]),
            option=f"--at={text}" if text.startswith("-") else f"--at {text}",
            instance=owner.id if owner else "",
            label=owner.label if owner else "",
        )
