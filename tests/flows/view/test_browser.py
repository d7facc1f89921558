"""The viewer as a person sees it: a page in headless Chromium."""

from pathlib import Path

import numpy as np
import pytest
import viser
from headless_page import HeadlessPage, chromium, headless_page
from numpy.typing import NDArray
from placed_ball import shown
from textured import plate

from dcap.geometry.rendering.painted import own_paint
from dcap.scene.types.mesh import PaintedMesh
from flows.view.model import StartView
from flows.view.nodes import place_cameras, set_light
from flows.view.page_glb import glb_of
from flows.view.serving import url_of
from flows.view.surface import whole

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(chromium() is None, reason="no Chromium on this machine"),
]

WIDTH, HEIGHT, PANEL = 1500, 960, 460
LEAST_COLORS = 500
"""Colours of a lit scene: an empty canvas has one, a page of text a few dozen shades of grey [-]."""
RED = 60
"""By how much the ball's red is above its green [0..255]."""
HUES = (([0], [1, 2]), ([1], [0, 2]), ([2], [0, 1]), ([0, 1], [2, 2]))
"""Channels that are above others in the plate's quarters: red, green, blue, yellow."""


def canvas(page: HeadlessPage) -> NDArray[np.uint8]:
    """The scene without the panel and without the notices at the top."""
    return page.picture()[200:, : WIDTH - PANEL]


def colors(picture: NDArray[np.uint8]) -> int:
    """Different colours of a picture."""
    return len(np.unique(picture.reshape(-1, 3), axis=0))


def red(picture: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Pixels of the ball, which alone is red."""
    wide = picture.astype(int)
    return np.asarray((wide[..., 0] - wide[..., 1] > RED) & (wide[..., 0] - wide[..., 2] > RED))


def settled_canvas(page: HeadlessPage) -> NDArray[np.uint8]:
    """The canvas once two pictures in a row are the same."""
    before = canvas(page)
    for _ in range(40):
        now = canvas(page)
        if colors(now) > LEAST_COLORS and (now == before).all():
            return now
        before = now
    raise AssertionError(f"the picture does not settle: {colors(before)} colours")


@pytest.mark.long
def test_the_page_shows_textures(server: viser.ViserServer, tmp_path: Path) -> None:
    """Every quarter of a plate is seen in its own hue."""
    surface = plate()
    server.scene.add_glb("/plate", glb_of(whole(PaintedMesh(surface.mesh, own_paint(surface)))))
    set_light(server.scene)
    place_cameras(server, StartView(np.array([0.0, -0.1, 4.0]), np.zeros(3), 45.0))
    with headless_page(url_of(server), tmp_path, (WIDTH, HEIGHT)) as page:
        page.wait_for("document.querySelector('canvas') !== null")
        for _ in range(40):
            seen = page.picture()[:, : WIDTH - PANEL].reshape(-1, 3).astype(int)
            hues = [((seen[:, up].min(axis=1) - seen[:, down].max(axis=1)) > RED).any() for up, down in HUES]
            if all(hues):
                break
        assert hues == [True] * 4


@pytest.mark.long
def test_the_page_shows_the_scene_and_the_result(server: viser.ViserServer, tmp_path: Path) -> None:
    """The canvas has many colours, the ball is red and sinks with the slider; the panel says how it ended."""
    nodes, panel = shown(server)
    place_cameras(server, nodes.view.view)
    with headless_page(url_of(server), tmp_path, (WIDTH, HEIGHT)) as page:
        page.wait_for("document.querySelector('canvas') !== null && document.body.innerText.includes('at rest')")
        rest = settled_canvas(page)
        assert red(rest).any()
        for words in ("put <it> there", "frame", "contact patch", "Certificate", "0.300 s of 0.300 s, at the end"):
            assert words in page.text()
        panel.go_to(0)
        page.wait_for("document.body.innerText.includes('before the drop')")
        start = settled_canvas(page)
        assert np.argwhere(red(start))[:, 0].min() < np.argwhere(red(rest))[:, 0].min()
        page.click_on("Certificate")
        page.wait_for("document.body.innerText.includes('linear speed')")
        assert "threshold" in page.text()
        assert "a & b" in page.text()
    panel.close()
