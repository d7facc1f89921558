"""The 3D viewer of one placement, or of a scene in which something is yet to be placed.

Threads of viser serve the page. Long work (a placement that the page requests) runs in the main thread, where an
interruption ends it together with its child processes.
"""

import queue
import sys
import traceback
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import viser

from dcap.scene.errors import DcapError, InputError
from dcap.scene.settings import runs_root
from dcap.scene.types.choices import Rotation
from dcap.scene.types.mesh import SourceSurface
from dcap.scene.types.scan import Scan
from dcap.scene.types.segmentation import Segmentation
from flows.configure import configured, language_options
from flows.find_run import RUN
from flows.label_one import found_scene
from flows.options import PlaceOptions, check_out
from flows.output import load
from flows.place import PlaceConfig
from flows.place_one import place_files, sample_of
from flows.placement_json import certificate_of, placement_json
from flows.run_files import PLACEMENT, FinishedPlacement, finished_placement
from flows.view.model import middle_of, placement_view, scene_view
from flows.view.nodes import PlacementNodes, place_cameras
from flows.view.panel import PanelText, PlacementPanel, signal_series
from flows.view.picking import PickedPoint, PickPanel, SurfacePicker
from flows.view.serving import arrange, open_browser, open_server, url_of
from tasks.artifact import Store


@dataclass(frozen=True, slots=True)
class ViewPage:
    """Options of serving the page."""

    port: int = 8080
    browse: bool = True
    """Whether a browser is opened."""
    say: Callable[[str, str], None] = lambda url, note: None
    """Called with the page's address once it is up, and a note for the user, which may be empty."""


@dataclass(frozen=True, slots=True)
class ScenePrompt:
    """A scene, and the request for a placement in it."""

    scene: str
    object: str
    """Path of a mesh; empty: points are shown, nothing is placed."""
    prompt: str
    options: PlaceOptions


@contextmanager
def serve_page(page: ViewPage) -> Iterator[viser.ViserServer]:
    """A server for the duration of the block."""
    server = open_server(page.port)
    try:
        yield server
    finally:
        server.stop()


def view_sample(run: str, sample: str | None, frame: int | None, page: ViewPage) -> None:
    """Show a sample of a run, or the placement in a folder, until interrupted."""
    found = finished_placement(run, sample)
    if found.values.scene is None or found.values.item is None:
        raise InputError(f"{found.finished.sample.id} has no scene to be shown")
    with serve_page(page) as server, closing(show_placement(server, found, frame)):
        announce(server, page)
        work_off(queue.SimpleQueue())


def show_placement(server: viser.ViserServer, found: FinishedPlacement, frame: int | None = None) -> PlacementPanel:
    """Show a placement in the scene and the panel; InputError if it has no such frame."""
    values, config = found.values, found.config
    view = placement_view(values, config)
    if frame is not None and not 0 <= frame < len(view.time):
        raise InputError(f"--frame {frame}: it has frames 0 to {len(view.time) - 1}")
    tree = placement_json(found.finished, values, {})
    chosen = found.finished.placement.rotation
    rotation = load(Store.default(), chosen, Rotation) if chosen else None
    signals = signal_series(values.settled, certificate_of(values)) if values.settled else None
    with server.atomic():
        nodes = PlacementNodes(server, view, frame)
        place_cameras(server, view.view)
        return PlacementPanel(server, nodes, view, PanelText(tree, rotation, signals))


class ScenePage:
    """A page that shows a scene until something is placed in it, then the result, then the scene again."""

    def __init__(
        self, server: viser.ViserServer, asked: ScenePrompt, scan: Scan, scene: Segmentation, surface: SourceSurface
    ) -> None:
        self._server, self._asked, self._scan, self._scene = server, asked, scan, scene
        self.jobs: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        """Jobs for the main thread."""
        self._view = scene_view(scene, PlaceConfig(), surface)
        self.panel: PickPanel | PlacementPanel = self._pick_panel()

    def close(self) -> None:
        """Stop the playback and listening to clicks."""
        self.panel.close()

    def place(self, picked: PickedPoint) -> None:
        """Place the object there and show the result; errors are shown in the panel."""
        panel, asked = self.panel, self._asked
        assert isinstance(panel, PickPanel)
        out = asked.options.out or runs_root() / "view"
        options = asked.options.model_copy(update={"at": ",".join(str(one) for one in picked.at)})
        try:
            place_files(asked.scene, asked.object, asked.prompt, options, out, quiet=False)
            found = finished_placement(str(out), None)
        except DcapError as error:
            panel.say(str(error), wrong=True)
            return
        except Exception as error:  # boundary to the page: in short there, in full in the terminal
            traceback.print_exc(file=sys.stderr)
            panel.say(f"{type(error).__name__}: {error}", wrong=True)
            return
        self._cleared()
        self.panel = show_placement(self._server, found)
        again = self._server.gui.add_button("Place it elsewhere")
        again.on_click(lambda _: self.jobs.put(self._again))

    def _again(self) -> None:
        """Show the scene again."""
        self._cleared()
        self.panel = self._pick_panel()

    def _cleared(self) -> None:
        """Clear scene and panel."""
        self.panel.close()
        self._server.scene.reset()
        self._server.gui.reset()
        arrange(self._server)

    def _pick_panel(self) -> PickPanel:
        """Show the scene without a placement."""
        picker = SurfacePicker(self._scene, self._scan.world_from_file, middle_of(self._scene))
        intro = Path(self._asked.scene).name, Path(self._asked.object).name, self._asked.prompt
        place = (lambda point: self.jobs.put(lambda: self.place(point))) if self._asked.object else None
        with self._server.atomic():
            return PickPanel(self._server, self._view, picker, intro, place)


def view_scene(asked: ScenePrompt, page: ViewPage) -> None:
    """Show a scene without a placement until interrupted."""
    if asked.options.out:
        check_out(asked.options.out)
    asking = language_options(asked.options)
    sample = sample_of(asked.scene, asked.object or "things", asked.prompt, asked.options)
    config = configured(asked.options, language=asking.config())
    refs = found_scene(replace(sample, place=None), config, asking.session(runs_root() / "view"), quiet=False)
    store = Store.default()
    scan, scene, surface = store.load(refs.scan), store.load(refs.scene), store.load(refs.surface)
    assert isinstance(scan, Scan)
    assert isinstance(scene, Segmentation)
    assert isinstance(surface, SourceSurface)
    with serve_page(page) as server, closing(ScenePage(server, asked, scan, scene, surface)) as shown:
        announce(server, page)
        work_off(shown.jobs)


def is_placement(run: str) -> bool:
    """Whether a name refers to a run or to a placement's folder."""
    folders = (Path(run), runs_root() / run)
    return any((folder / name).is_file() for folder in folders for name in (RUN, PLACEMENT))


def announce(server: viser.ViserServer, page: ViewPage) -> None:
    """Announce the page's address, and open it."""
    taken = server.get_port() != page.port
    page.say(url_of(server), f"port {page.port} is taken, {server.get_port()} is used" if taken else "")
    if page.browse:
        open_browser(url_of(server))


def work_off(jobs: "queue.SimpleQueue[Callable[[], None]]") -> None:
    """Run the page's jobs until interrupted."""
    while True:
        jobs.get()()
