"""Placing by a click: the point under it, its command-line option, and the page of the scene.

In: a scene as segmented, how its file's frame lies in the world, and rays. Out: points in the file's frame and unit.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import viser

from dcap.arrays import Array
from dcap.geometry.raycast import Raycaster
from dcap.scene.types.segmentation import Segmentation
from flows.view.model import UNASSIGNED, PlacementView
from flows.view.nodes import ANCHOR_COLOR, add_piece, place_cameras, set_light
from flows.view.panel import add_room, said

STEP = 1e-3
"""Rounding of coordinates [m]."""
PAST = 1e-4
"""Distance behind a transparent surface at which the ray continues [m]."""
MOST_SURFACES = 64
"""Most surfaces that a ray may pass through [-]."""
MARKER = 0.012
"""Radius of the marker over the room's diagonal; the radius is at most MARKER_LARGEST [-]."""
MARKER_LARGEST = 0.02
"""[m]."""


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


class PickPanel:
    """The widgets of a scene without a placement; the button calls `place` with the point."""

    def __init__(
        self,
        server: viser.ViserServer,
        view: PlacementView,
        picker: SurfacePicker,
        intro: tuple[str, str, str],
        place: Callable[[PickedPoint], None] | None,
    ) -> None:
        self._server, self._picker, self._place = server, picker, place
        self.picked: PickedPoint | None = None
        set_light(server.scene)
        self.pieces = [add_piece(server.scene, one, view) for one in view.pieces]
        corners = np.concatenate([one.surface.mesh.vertices for one in view.pieces])
        self._radius = min(MARKER_LARGEST, MARKER * float(np.linalg.norm(np.ptp(corners, axis=0))))
        self._marker: viser.IcosphereHandle | None = None
        gui = server.gui
        gui.add_html(said("scene", *intro))
        self.told = gui.add_html(said("line", "Click a point of the scene."))
        self.button = gui.add_button("Place here", disabled=True, visible=place is not None)
        self.state = gui.add_html("")
        if view.notes:
            gui.add_html(said("notes", view.notes))
        add_room(gui, self.pieces)
        gui.add_button("Start view").on_click(lambda _: place_cameras(server, view.view))
        place_cameras(server, view.view)
        self.button.on_click(lambda _: self.press())
        self._listener = server.scene.on_click()(lambda event: self.point_at(event.ray_origin, event.ray_direction))

    def close(self) -> None:
        """Ignore further clicks; the server removes the widgets."""
        self._server.scene.remove_click_callback(self._listener)

    def say(self, text: str, *, wrong: bool = False) -> None:
        """Show one line of status."""
        self.state.content = said("line", text, wrong)
        self.button.disabled = self.picked is None

    def point_at(self, origin: tuple[float, ...], direction: tuple[float, ...]) -> None:
        """Pick the point that a ray hits."""
        hidden = frozenset(
            (one.piece.instance, one.piece.number) for one in self.pieces if not one.node.visible
        )  # fmt: skip
        found = self._picker.pick(np.array(origin), np.array(direction), hidden)
        if found is None:
            self.told.content = said("line", "Nothing of the scene is there; click a surface.")
            return
        self.picked = found
        self._marker = self._server.scene.add_icosphere(
            "/picked", self._radius, color=ANCHOR_COLOR, position=found.position
        )
        where = f"on {found.label} ({found.instance})" if found.label else found.instance
        self.told.content = said("picked", where, found.option)
        self.button.disabled = False

    def press(self) -> None:
        """Handle the button: it is disabled until this placement is done."""
        if self.picked is None or self._place is None or self.button.disabled:
            return
        self.button.disabled = True
        self.state.content = said("line", "Placing; the stages are listed in the terminal.")
        self._place(self.picked)
