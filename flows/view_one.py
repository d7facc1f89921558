"""The 3D viewer of one placement, or of a scene in which nothing is placed yet."""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import viser

from dcap.scene.errors import InputError
from dcap.scene.settings import runs_root
from dcap.scene.store.artifacts import Store
from dcap.scene.types.rotation import Rotation
from flows.output import load
from flows.placement_json import certificate_of, placement_json
from flows.run_files import PLACEMENT, RUN, FinishedPlacement, finished_placement
from flows.view.model import placement_view
from flows.view.nodes import PlacementNodes, stand
from flows.view.panel import PanelText, PlacementPanel
from flows.view.serving import open_browser, open_server, url_of
from flows.view.signals import signal_series


@dataclass(frozen=True, slots=True)
class ViewPage:
    """How the page is served."""

    port: int = 8080
    browse: bool = True
    """Whether a browser is opened."""
    say: Callable[[str, str], None] = lambda url, note: None
    """Told the page's address once it is there, and what a person should know of it or nothing."""


@contextmanager
def served(page: ViewPage) -> Iterator[viser.ViserServer]:
    """A server as long as the block runs."""
    server = open_server(page.port)
    try:
        yield server
    finally:
        server.stop()


def view_sample(run: str, sample: str | None, frame: int | None, page: ViewPage) -> None:
    """Show a sample of a run, or the placement in a folder, until interrupted."""
    found = finished_placement(run, sample)
    view = placement_view(found.values, found.config)
    if frame is not None and not 0 <= frame < len(view.time):
        raise InputError(f"--frame {frame}: there are frames 0 to {len(view.time) - 1}")
    with served(page) as server:
        panel = show_placement(server, found, frame)
        announce(server, page)
        try:
            wait()
        finally:
            panel.close()


def show_placement(server: viser.ViserServer, found: FinishedPlacement, frame: int | None = None) -> PlacementPanel:
    """Put a placement into the scene and the panel."""
    values, config = found.values, found.config
    view = placement_view(values, config)
    tree = placement_json(found.finished, values, {})
    rotation = load(Store.default(), found.finished.placement.rotation, Rotation)
    signals = signal_series(values.settled, certificate_of(values)) if values.settled else None
    with server.atomic():
        nodes = PlacementNodes(server, view, frame)
        stand(server, view.view)
        return PlacementPanel(server, nodes, view, PanelText(tree, rotation, signals))


def is_placement(run: str) -> bool:
    """Whether a name is that of a run or of a placement's folder."""
    folders = (Path(run), runs_root() / run)
    return any((folder / name).is_file() for folder in folders for name in (RUN, PLACEMENT))


def announce(server: viser.ViserServer, page: ViewPage) -> None:
    """Say where the page is, and open it."""
    taken = server.get_port() != page.port
    page.say(url_of(server), f"port {page.port} is taken, {server.get_port()} is used" if taken else "")
    if page.browse:
        open_browser(url_of(server))


wait: Callable[[], None] = signal.pause
"""Until interrupted."""
