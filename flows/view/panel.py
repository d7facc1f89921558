"""The panel next to the scene: the slider over the drop, visibility of nodes, texts, and a plot of the signals."""

import threading
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import viser
from viser import uplot

from dcap.arrays import Array
from dcap.evaluation.pages import environment
from dcap.scene.types.choices import POSE_OF_THE_FILE, Rotation
from dcap.scene.types.settled import Settled
from dcap.scene.written_files import JsonValue
from flows.view.model import DEEP, LEVEL, RAISED, PlacementView
from flows.view.nodes import PieceNode, PlacementNodes, place_cameras

FLOOR, CEILING = 1e-3, 1e9
"""Drawn range of a signal over its threshold [-]: a logarithm has no zero."""
NAMES = ("linear_speed", "angular_speed", "particle_speed", "force_residual", "torque_residual")
FRAME_SECONDS = 0.06
"""Time between two frames while it plays [s]: frames are equally spaced in motion, not in time."""
MOST_BOXES = 60
"""Most things with a check box each; above, things with one label share a box [-]."""
UNITS = {
    "linear_speed": "m/s", "angular_speed": "rad/s", "particle_speed": "m/s", "center_drift": "m", "box_change": "m",
    "angle_rad": "rad", "distance_m": "m", "change_rad": "rad", "tilt_rad": "rad", "turn_rad": "rad",
}  # fmt: skip
"""Units of rows of the certificate; other rows are ratios."""
GROUPS = {"signals": "at rest", "kick": "after a kick", "placement": "as asked", "lean": "leans as asked"}
STROKES = ("#1c7ed6", "#e8590c", "#2f9e44", "#9c36b5", "#c2255c")


def number(value: object) -> str:
    """A number with three digits; a dash for none."""
    if value is None:
        return "-"
    return f"{value:.3g}" if isinstance(value, (int, float)) and not isinstance(value, bool) else str(value)


TEXTS = environment(Path(__file__).parent)
TEXTS.filters["number"] = number
TEXTS.globals |= {"units": UNITS, "groups": GROUPS}


def said(text: str, *values: object) -> str:
    """A text of the panel as HTML, by its name in the template."""
    return str(getattr(TEXTS.get_template("panel.html.j2").module, text)(*values))


@dataclass(frozen=True, eq=False, slots=True)
class SignalSeries:
    """Signals over time."""

    time: Array
    """[s], increasing, shape (s,)."""
    share: dict[str, Array]
    """Signals over their thresholds, between FLOOR and CEILING [-], shape (s,) each."""
    threshold: dict[str, float]
    """Thresholds of the signals, in their units."""


def signal_series(settled: Settled, certificate: JsonValue) -> SignalSeries | None:
    """The series of a drop; None where there are less than two steps, or no thresholds."""
    rows = certificate.get("signals") if isinstance(certificate, Mapping) else None
    history = settled.history
    if not isinstance(rows, Mapping) or len(history.time) < 2:
        return None
    share, threshold = {}, {}
    for name in NAMES:
        row = rows.get(name)
        limit = row.get("threshold") if isinstance(row, Mapping) else None
        if not isinstance(limit, (int, float)) or limit <= 0.0:
            continue
        values = np.asarray(getattr(history, name), dtype=np.float64)
        share[name] = np.clip(np.nan_to_num(values / limit, nan=CEILING, posinf=CEILING), FLOOR, CEILING)
        threshold[name] = float(limit)
    return SignalSeries(np.asarray(history.time, dtype=np.float64), share, threshold) if share else None


@dataclass(frozen=True, eq=False, slots=True)
class PanelText:
    """Content of the panel."""

    tree: Mapping[str, JsonValue]
    """The content of placement.json."""
    rotation: Rotation | None
    signals: SignalSeries | None


class PlacementPanel:
    """The widgets of one placement; `close` stops the playback."""

    def __init__(self, server: viser.ViserServer, nodes: PlacementNodes, view: PlacementView, text: PanelText) -> None:
        self._server, self._nodes, self._view = server, nodes, view
        self._closed = threading.Event()
        self._playing = threading.Event()
        gui = server.gui
        self.verdict = gui.add_html(said("verdict", text.tree))
        self._add_slider(gui)
        tabs = gui.add_tab_group()
        with tabs.add_tab("Show"):
            self._add_toggles(gui)
        with tabs.add_tab("Certificate"):
            gui.add_html(said("facts_tab", text.tree))
        if text.signals is not None:
            with tabs.add_tab("Signals"):
                add_signals(gui, text.signals)
        if text.rotation is not None:
            with tabs.add_tab("Rotation"):
                add_rotation(gui, text.rotation)
        with tabs.add_tab("Materials"):
            gui.add_html(said("materials", text.tree["materials"]))
        self._player = threading.Thread(target=self._play, name="view-play", daemon=True)
        self._player.start()

    def close(self) -> None:
        """Stop the playback; the server removes the widgets."""
        self._closed.set()
        self._playing.set()
        self._player.join()

    def _add_slider(self, gui: viser.GuiApi) -> None:
        """Add the slider over the frames, if there is more than one."""
        last = len(self._view.time) - 1
        self.slider = gui.add_slider(
            "frame", min=0, max=max(last, 1), step=1, initial_value=self._nodes.frame, visible=last > 0
        )
        self.play = gui.add_button("Play", visible=last > 1)
        self.time = gui.add_html("", visible=last > 0)
        self._say_time()

        @self.slider.on_update
        def _(_: object) -> None:
            self._nodes.show_frame(int(self.slider.value))
            self._say_time()

        @self.play.on_click
        def _(_: object) -> None:
            if self._playing.is_set():
                self._pause()
                return
            if int(self.slider.value) >= last:
                self.go_to(0)
            self.play.label = "Pause"
            self._playing.set()

    def go_to(self, frame: int) -> None:
        """Move the slider, and the scene with it."""
        self.slider.value = frame  # type: ignore[misc]  # viser's setter stands apart from its property

    def _pause(self) -> None:
        """Pause at the present frame."""
        self._playing.clear()
        self.play.label = "Play"

    def _play(self) -> None:
        """Advance frame by frame while it plays, until the panel is closed."""
        while self._playing.wait() and not self._closed.is_set():
            frame = int(self.slider.value) + 1
            self.go_to(min(frame, len(self._view.time) - 1))
            if frame >= len(self._view.time) - 1:
                self._pause()
            self._closed.wait(FRAME_SECONDS)

    def _say_time(self) -> None:
        """Show the time of the frame."""
        frame, last = self._nodes.frame, len(self._view.time) - 1
        self.time.content = said("line", moment(self._view, frame, last))

    def _add_toggles(self, gui: viser.GuiApi) -> None:
        """Add the boxes that show and hide nodes."""
        nodes, view = self._nodes, self._view
        if view.notes:
            gui.add_html(said("notes", view.notes))
        if nodes.thing is not None:
            shown_box(gui, "object", [nodes.thing], on=True)
        if nodes.contact is not None:
            shown_box(gui, "contact patch", [nodes.contact], on=True)
        if nodes.anchor is not None:
            shown_box(gui, "anchor and normal", [nodes.anchor], on=False)
        if nodes.ray is not None:
            shown_box(gui, "vertical ray", [nodes.ray], on=False)
        if view.bending is not None:
            self._switch(
                gui, "dent as a heat map", said("heat_legend", view.span, (DEEP, LEVEL, RAISED)), nodes.show_heat
            )
        if nodes.clouds:
            self._switch(
                gui,
                "material points",
                said("cloud_legend", {one.material: one.color for one in view.clouds}),
                nodes.show_clouds,
            )
        add_room(gui, nodes.pieces)
        gui.add_button("Start view").on_click(lambda _: place_cameras(self._server, view.view))

    def _switch(self, gui: viser.GuiApi, label: str, legend_text: str, show: Callable[[bool], None]) -> None:
        """Add a check box, initially off, whose legend shows when it is on."""
        box = gui.add_checkbox(label, initial_value=False)
        legend = gui.add_html(legend_text, visible=False)

        @box.on_update
        def _(_: object) -> None:
            legend.visible = bool(box.value)
            show(legend.visible)


def moment(view: PlacementView, frame: int, last: int) -> str:
    """Time of a frame, in words."""
    if not view.settled and len(view.time) == 2:
        return "before the drop" if frame == 0 else "where the drop ended"
    where = "before the drop" if frame == 0 else "at the end" if frame == last else ""
    told = f"{view.time[frame]:.3f} s of {view.time[last]:.3f} s"
    kept = "" if view.whole else "; frames in between were not kept"
    return f"{told}{', ' + where if where else ''}{kept}"


def shown_box(
    gui: viser.GuiApi, label: str, nodes: Iterable[viser.SceneNodeHandle], *, on: bool
) -> viser.GuiCheckboxHandle:
    """Add a check box that shows and hides nodes."""
    shown = list(nodes)
    box = gui.add_checkbox(label, initial_value=on)

    def show(_: object = None) -> None:
        for one in shown:
            one.visible = bool(box.value)

    box.on_update(show)
    show()
    return box


def add_room(gui: viser.GuiApi, pieces: list[PieceNode]) -> None:
    """Add check boxes for walls and things; a thing of several parts has one for each part."""
    walls = [one.node for one in pieces if one.piece.structure and not one.piece.ceiling]
    ceilings = [one.node for one in pieces if one.piece.ceiling]
    if ceilings:
        shown_box(gui, "ceiling", ceilings, on=True)
    if walls:
        shown_box(gui, "walls and floor", walls, on=True)
    things: dict[str, list[PieceNode]] = defaultdict(list)
    names = {one.piece.instance for one in pieces if not one.piece.structure}
    for one in pieces:
        if not one.piece.structure:
            label = one.piece.label or one.piece.instance
            key = f"{label} ({one.piece.instance})" if len(names) <= MOST_BOXES and one.piece.label else label
            things[key].append(one)
    if not things:
        return
    with gui.add_folder("Things", expand_by_default=False):
        for name in sorted(things):
            several = things[name]
            if len(several) == 1 or len(names) > MOST_BOXES:
                shown_box(gui, name, [one.node for one in several], on=True)
                continue
            with gui.add_folder(name, expand_by_default=False):
                for one in several:
                    shown_box(gui, one.piece.part or "rest", [one.node], on=True)


def add_signals(gui: viser.GuiApi, signals: SignalSeries) -> None:
    """Add a plot of the signals over their thresholds, on a logarithmic axis."""
    one = np.ones_like(signals.time)
    gui.add_html(said("line", "Each signal over its threshold: at rest where all are below 1 for a while."))
    lines = [
        uplot.Series(label=name.replace("_", " "), stroke=STROKES[number % len(STROKES)], width=1.5)
        for number, name in enumerate(signals.share)
    ]
    top = float(np.clip(max(values.max() for values in signals.share.values()), 10.0, CEILING))
    low = float(min(0.1, *(values.min() for values in signals.share.values())))
    limit = uplot.Series(label="threshold", stroke="#868e96", width=1, dash=(6, 4))
    gui.add_uplot(
        (signals.time, *signals.share.values(), one),
        (uplot.Series(label="time [s]"), *lines, limit),
        scales={"x": uplot.Scale(time=False), "y": uplot.Scale(distr=3, log=10, min=low, max=top, auto=False)},
        axes=(uplot.Axis(label="time [s]"), uplot.Axis(label="over its threshold", size=70, ticks={"show": False})),
        legend=uplot.Legend(show=True),
        aspect=1.1,
    )  # fmt: skip
    gui.add_html(said("thresholds", signals.threshold))


def add_rotation(gui: viser.GuiApi, rotation: Rotation) -> None:
    """Add the chosen rotation, and the three pictures if a model saw some."""
    gui.add_html(said("rotation", rotation, POSE_OF_THE_FILE))
    for axis, picture in zip("xyz", rotation.pictures, strict=False):
        gui.add_image(picture, label=f"half a turn about {axis}")
