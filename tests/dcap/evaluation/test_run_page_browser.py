"""The page of a run as people use it, opened from disk in headless Chromium: filters, views, and placements in 3D."""

import io
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from headless_page import WITHOUT_GPU, chromium
from many_methods_run import METHODS, SAMPLES, many_methods_run
from numpy.typing import NDArray
from PIL import Image
from playwright.sync_api import Page, expect, sync_playwright
from run_rows import outcomes, written

from dcap.scene.types.pictures import PLACED

pytestmark = [
    pytest.mark.browser,
    pytest.mark.slow,
    pytest.mark.long,
    pytest.mark.timeout(600),
    pytest.mark.skipif(chromium() is None, reason="no Chromium on this machine"),
]
WAIT_MS = 60_000
SCORES = {"dcap": 9.0}
"""Physics and naturalness by method; low of all others."""
LOCAL = ("file:", "blob:", "data:")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of three methods with its page."""
    folder = many_methods_run(tmp_path_factory.mktemp("runs") / "run")
    rows = [replace(row, physics_naturalness=SCORES.get(row.method, 4.0), right_place=8.0) for row in outcomes(folder)]
    written(folder, rows)
    return folder


@pytest.fixture
def page() -> Iterator[Page]:
    """A page of the browser; what a script complains of, or what is asked of another machine, is an error."""
    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=chromium(), args=[*WITHOUT_GPU])
        one = browser.new_page(viewport={"width": 1400, "height": 1000})
        one.set_default_timeout(WAIT_MS)
        wrong: list[str] = []
        one.on("pageerror", lambda error: wrong.append(str(error)))
        one.on("request", lambda request: wrong.append(request.url) if not request.url.startswith(LOCAL) else None)
        yield one
        browser.close()
        assert wrong == []


def test_filters_and_views(run: Path, page: Page) -> None:
    """Methods and failures choose what is seen; a view changes all pictures; folded views are made once."""
    page.goto((run / "report.html").as_uri())
    cards, cells = page.locator("article.card:visible"), page.locator(".cell:visible")
    expect(cards).to_have_count(len(SAMPLES))
    page.select_option("[name=method]", "fireplace")
    expect(cells).to_have_count(len(SAMPLES))
    expect(page.locator("output")).to_have_text(f"{len(SAMPLES)} of {len(SAMPLES)} samples")
    page.select_option("[name=fault]", "failed")
    expect(cards).to_have_count(0)
    page.select_option("[name=fault]", "low score")
    expect(cards).to_have_count(len(SAMPLES))
    page.select_option("[name=method]", "dcap")
    expect(cards).to_have_count(0)
    page.select_option("[name=method]", "")
    page.select_option("[name=fault]", "")
    page.fill("[name=words]", "SOFA")
    expect(cards).to_have_count(1)
    page.select_option("[name=view]", f"views/{PLACED[-1]}.png")
    sources = page.locator("article.card:visible img[data-views]").evaluate_all("all => all.map(one => one.src)")
    assert [one.rsplit("/", 2)[1:] for one in sources] == [["views", f"{PLACED[-1]}.png"]] * len(METHODS)
    folded = page.locator("article.card:visible details.spread")
    for _ in range(3):
        folded.locator("summary").click()
    expect(folded.locator(".all-views img")).to_have_count(len(PLACED) * len(METHODS))


@pytest.mark.long
def test_placements_turn_together(run: Path, page: Page) -> None:
    """All methods of the sample are drawn, each its own; a drag over one turns all; a method can be left out."""
    page.goto((run / "report.html").as_uri())
    page.locator("article.card").nth(2).get_by_text("compare in 3D").click()
    stages = page.locator(".stage[data-state=drawn]")
    expect(stages).to_have_count(len(METHODS))
    expect(page.locator("h1")).to_contain_text("left seat of the sofa")
    before = [picture_of(page, number) for number in range(len(METHODS))]
    assert all(np.abs(one - before[0]).mean() > 0.5 for one in before[1:])
    stages.nth(0).hover()
    page.mouse.down()
    page.mouse.move(900, 500)
    page.mouse.up()
    after = [picture_of(page, number) for number in range(len(METHODS))]
    assert all(np.abs(one - other).mean() > 2.0 for one, other in zip(before, after, strict=True))
    page.get_by_label("LayoutGPT").uncheck()
    expect(page.locator(".stage")).to_have_count(2)
    expect(stages).to_have_count(2)
    page.select_option("#sample", "bed-2")
    expect(page.locator("h1")).to_contain_text("<b>near</b>")
    expect(stages).to_have_count(2)


def picture_of(page: Page, number: int) -> NDArray[np.float64]:
    """What a drawing shows, shape (h, w, 3)."""
    data = page.locator(".stage").nth(number).screenshot()
    return np.asarray(Image.open(io.BytesIO(data)).convert("RGB"), dtype=float)[:240, :380]
