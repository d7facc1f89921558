"""The page of a scene in which nothing is placed yet: click a point, read its command-line option, or place there."""

from collections.abc import Callable
from html import escape

import numpy as np
import viser

from flows.view import texts
from flows.view.model import PlacementView
from flows.view.nodes import ANCHOR_COLOR, add_piece, place_cameras, set_light
from flows.view.panel import add_room
from flows.view.picking import PickedPoint, SurfacePicker

MARKER = 0.012
"""Radius of the marker over the room's diagonal; the radius is at most MARKER_LARGEST [-]."""
MARKER_LARGEST = 0.02
"""[m]."""


class PickPanel:
    """The widgets of a scene without a placement; the button calls `place` with the point."""

    def __init__(
        self,
        server: viser.ViserServer,
        view: PlacementView,
        picker: SurfacePicker,
        intro: str,
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
        gui.add_html(texts.page(intro))
        self.told = gui.add_html(texts.page("<p>Click a point of the scene.</p>"))
        self.button = gui.add_button("Place here", disabled=True, visible=place is not None)
        self.state = gui.add_html("")
        if view.notes:
            gui.add_html(texts.page(texts.bullets(view.notes, "")))
        add_room(gui, self.pieces)
        gui.add_button("Start view").on_click(lambda _: place_cameras(server, view.view))
        place_cameras(server, view.view)
        self.button.on_click(lambda _: self.press())
        self._listener = server.scene.on_click()(self._clicked)

    def close(self) -> None:
        """Ignore further clicks; the server removes the widgets."""
        self._server.scene.remove_click_callback(self._listener)

    def say(self, text: str, *, wrong: bool = False) -> None:
        """Show one line of status."""
        self.state.content = texts.page(f'<p class="{"no" if wrong else ""}">{escape(text)}</p>')
        self.button.disabled = self.picked is None

    def point_at(self, origin: tuple[float, ...], direction: tuple[float, ...]) -> None:
        """Pick the point that a ray hits."""
        hidden = frozenset(
            (one.piece.instance, one.piece.number) for one in self.pieces if not one.node.visible
        )  # fmt: skip
        found = self._picker.pick(np.array(origin), np.array(direction), hidden)
        if found is None:
            self.told.content = texts.page("<p>Nothing of the scene is there; click a surface.</p>")
            return
        self.picked = found
        self._marker = self._server.scene.add_icosphere(
            "/picked", self._radius, color=ANCHOR_COLOR, position=found.position
        )
        where = f"on {found.label} ({found.instance})" if found.label else found.instance
        self.told.content = texts.page(f"<p>{escape(where)}</p><p><code>{escape(found.option)}</code></p>")
        self.button.disabled = False

    def _clicked(self, event: viser.SceneClickEvent) -> None:
        """Handle a click into the scene."""
        self.point_at(event.ray_origin, event.ray_direction)

    def press(self) -> None:
        """Handle the button: it is disabled until this placement is done."""
        if self.picked is None or self._place is None or self.button.disabled:
            return
        self.button.disabled = True
        self.state.content = texts.page("<p>Placing; the stages are listed in the terminal.</p>")
        self._place(self.picked)
