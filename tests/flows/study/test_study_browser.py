"""A study as raters see it: two of them in headless Chromium, and a server that is killed in the middle."""

import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from headless_page import WITHOUT_GPU, chromium
from many_methods_run import many_methods_run
from PIL import Image
from playwright.sync_api import Browser, Page, expect, sync_playwright
from ports import free_port

from dcap.evaluation.statistics.comparisons import JudgedAxis
from dcap.evaluation.study.study_folder import STUDY_FOLDER, StudyDesign, read_design, read_votes
from dcap.packages import ROOT
from flows.cli.app import main

pytestmark = [
    pytest.mark.browser,
    pytest.mark.slow,
    pytest.mark.timeout(900),
    pytest.mark.skipif(chromium() is None, reason="no Chromium on this machine"),
]

WAIT_MS = 60_000
LINK = re.compile(r"^(r\d\d)  (http\S+)$")


@dataclass
class StudyProcess:
    """A running `dcap study serve` and the links that it printed."""

    process: "subprocess.Popen[str]"
    links: dict[str, str]

    def kill(self) -> None:
        """As a machine that loses its power does."""
        self.process.kill()
        self.process.wait()


def start(run: Path, port: int) -> StudyProcess:
    """Serve the study; returns once the links are printed."""
    command = [sys.executable, "-m", "flows.cli", "study", "serve", str(run), "--port", str(port), "--raters", "2"]
    process = subprocess.Popen(
        command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL, text=True
    )
    assert process.stdout is not None
    links, said = {}, ""
    for line in process.stdout:
        said += line
        found = LINK.match(line.strip())
        if found:
            links[found[1]] = found[2]
        if "stop with Ctrl-C" in line:
            return StudyProcess(process, links)
    raise AssertionError(said)


@contextmanager
def browser() -> Iterator[Browser]:
    """Chromium as the system has it."""
    with sync_playwright() as play:
        one = play.chromium.launch(executable_path=chromium(), args=[*WITHOUT_GPU])
        yield one
        one.close()


def open_page(browser: Browser, link: str, troubles: list[str], **options: object) -> Page:
    """A page of a rater's own, that notes what goes wrong in it and what it loads from elsewhere."""
    page = browser.new_context(**options).new_page()  # type: ignore[arg-type]
    page.set_default_timeout(WAIT_MS)
    page.on("pageerror", lambda error: troubles.append(str(error)))
    own = link.split("/s/")[0]
    page.on("request", lambda one: None if one.url.startswith((own, "data:", "blob:")) else troubles.append(one.url))
    page.goto(link)
    return page


def done(page: Page) -> int:
    """How many comparisons the page says are answered."""
    return int(page.locator("progress").get_attribute("value") or "-1")


def item_of(page: Page) -> str:
    """The comparison that is shown."""
    return page.locator("main").get_attribute("data-item") or ""


def to_questions(page: Page) -> None:
    """From the introduction with Enter, once the pages listen to keys."""
    expect(page.locator("main[data-page=introduction][data-ready]")).to_be_visible()
    page.keyboard.press("Enter")
    expect(page.locator("main[data-page=comparison][data-ready]")).to_be_visible()


def answer_by_keys(page: Page, keys: str) -> None:
    """Continue with Enter, choose with a key per question, go on with Enter."""
    before = done(page)
    to_questions(page)
    for key in f"v{keys}":
        page.keyboard.press({"<": "ArrowLeft", ">": "ArrowRight"}.get(key, key))
    page.keyboard.press("Enter")
    expect(page.locator("progress")).to_have_attribute("value", str(before + 1))


def answer_by_mouse(page: Page, sides: dict[JudgedAxis, str]) -> None:
    """Continue, choose and go on with the mouse."""
    before = done(page)
    page.click("#continue")
    page.click("[data-view='1']")
    for axis, side in sides.items():
        page.click(f"[data-axis={axis}] label:has(input[value={side}])")
    page.click("button[type=submit]")
    expect(page.locator("progress")).to_have_attribute("value", str(before + 1))


def colors(page: Page, selector: str, path: Path) -> int:
    """Different colours of a part of the page."""
    page.locator(selector).screenshot(path=path)
    return len(np.unique(np.asarray(Image.open(path).convert("RGB")).reshape(-1, 3), axis=0))


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A run of three methods, whose study nobody has answered yet."""
    return many_methods_run(tmp_path / "run")


@pytest.mark.long
def test_a_whole_session_survives_a_killed_server(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Two raters at once, one by keyboard and one by mouse. Between two answers, and while an answer is being given,
    the server is killed; after a restart both go on where they were, and every vote is there once."""
    port, troubles = free_port(), list[str]()
    served = start(run, port)
    links = served.links
    try:
        with browser() as chrome:
            one, two = (open_page(chrome, links[rater], troubles) for rater in ("r01", "r02"))
            mouse = {
                JudgedAxis.RIGHT_PLACE: "right",
                JudgedAxis.PHYSICS_NATURALNESS: "left",
            }
            for _ in range(3):
                answer_by_keys(one, "1>")
                answer_by_mouse(two, mouse)
            to_questions(one)
            for key in "v21":
                one.keyboard.press(key)
            asked = item_of(one)
            served.kill()
            one.keyboard.press("Enter")
            expect(one.locator("#problem")).to_contain_text("not saved yet")
            two.close()
            assert len(read_votes(run / STUDY_FOLDER)) == 2 * 3 * 2
            served = start(run, port)
            assert served.links == links
            one.keyboard.press("Enter")  # the answer that was not saved is sent again
            expect(one.locator("progress")).to_have_attribute("value", "4")
            assert item_of(one) != asked
            two = open_page(chrome, links["r02"], troubles)
            assert done(two) == 3
            while done(one) < 14:
                answer_by_keys(one, "12")
            while done(two) < 14:
                answer_by_mouse(two, mouse)
            for page in (one, two):
                expect(page.locator("h1")).to_have_text("Thank you")
    finally:
        served.kill()
    assert [one for one in troubles if "ERR_CONNECTION_REFUSED" not in one] == []
    design = read_design(run / STUDY_FOLDER)
    assert design is not None
    check_votes(run, design)
    assert main(["study", "report", str(run)]) == 0
    assert "table2.csv" in capsys.readouterr().out
    assert pq.read_table(run / STUDY_FOLDER / "votes.parquet").num_rows == 2 * 14 * 2


def check_votes(run: Path, design: StudyDesign) -> None:
    """Each vote is the key that was pressed for it, once, and no line of the journal repeats another."""
    votes = read_votes(run / STUDY_FOLDER)
    assert len((run / STUDY_FOLDER / "votes.jsonl").read_bytes().splitlines()) == len(votes) == 2 * 14 * 2
    given = {(vote.rater, int(vote.item)): [] for vote in votes}  # type: ignore[var-annotated]
    for vote in votes:
        given[vote.rater, int(vote.item)].append(vote.winner.value)
        item = design.raters[vote.rater][int(vote.item) - 1]
        assert (vote.sample, vote.left, vote.right, vote.lifted) == (item.sample, item.left, item.right, item.lifted)
    for number in range(1, 15):
        first = ["left", "right"] if number != 4 else ["right", "left"]
        assert given["r01", number] == first, number
        assert given["r02", number] == ["right", "left"]


@pytest.mark.long
@pytest.mark.parametrize("size", [(1400, 900), (390, 844)], ids=["desktop", "narrow"])
def test_pictures_enlarge_and_models_turn(run: Path, tmp_path: Path, size: tuple[int, int]) -> None:
    """A click enlarges the view that is shown; in 3D both sides are drawn, and turn together when one is dragged;
    nothing is wider than the window."""
    troubles = list[str]()
    served = start(run, free_port())
    try:
        with browser() as chrome:
            viewport = {"width": size[0], "height": size[1]}
            page = open_page(chrome, served.links["r01"], troubles, viewport=viewport)
            page.click("[data-three]")
            expect(page.locator("[data-state=drawn]")).to_have_count(1)
            assert colors(page, ".asset .stage", tmp_path / "asset.png") > 50
            page.click("#continue")
            expect(page.locator("main[data-page=comparison][data-ready]")).to_be_visible()
            page.keyboard.press("v")
            shown = page.locator("[data-side=right] .picture img:not([hidden])").get_attribute("src")
            page.click("[data-side=right] .picture")
            assert page.locator("dialog[open] img").get_attribute("src") == f"{page.url.split('/s/')[0]}{shown}"
            page.keyboard.press("1")  # is no answer while a picture is enlarged
            page.keyboard.press("Escape")
            expect(page.locator("dialog[open]")).to_have_count(0)
            assert page.locator("input:checked").count() == 0
            page.click("nav [data-three]")
            expect(page.locator("[data-state=drawn]")).to_have_count(2)
            before = [page.locator(f"[data-side={side}] canvas").screenshot() for side in ("left", "right")]
            box = page.locator("[data-side=left] canvas").bounding_box()
            assert box is not None
            page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
            page.mouse.down()
            page.mouse.move(box["x"] + box["width"] / 2 + 60, box["y"] + box["height"] / 2 + 20, steps=3)
            page.mouse.up()
            after = [page.locator(f"[data-side={side}] canvas").screenshot() for side in ("left", "right")]
            assert all(one != two for one, two in zip(before, after, strict=True))
            assert page.evaluate("document.documentElement.scrollWidth") <= size[0]
            for key in ("1", "2", "Enter"):  # buttons that were clicked do not keep the keys
                page.keyboard.press(key)
            expect(page.locator("progress")).to_have_attribute("value", "1")
    finally:
        served.kill()
    assert troubles == []
