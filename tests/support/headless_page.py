"""A page in headless Chromium, driven over the DevTools protocol: what a person sees of the viewer."""

import base64
import io
import json
import os
import shutil
import signal
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from urllib.request import urlopen

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from websockets.sync.client import connect
from websockets.sync.connection import Connection

START_SECONDS = 120.0
LARGEST = 64 * 1024 * 1024
WITHOUT_GPU = ("--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
"""Options of a browser on a machine without a display and a graphics card."""
OPTIONS = (
    "--headless", *WITHOUT_GPU, "--remote-debugging-port=0", "--no-first-run", "--disable-dev-shm-usage",
    "--hide-scrollbars",
)  # fmt: skip


def chromium() -> str | None:
    """The browser, if there is one."""
    return shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")


class HeadlessPage:
    """One page of the browser."""

    def __init__(self, connection: Connection) -> None:
        self._connection, self._number = connection, 0

    def call(self, method: str, **parameters: object) -> dict[str, object]:
        """One command and its result; events in between are left out."""
        self._number += 1
        self._connection.send(json.dumps({"id": self._number, "method": method, "params": parameters}))
        while True:
            reply = json.loads(self._connection.recv(timeout=START_SECONDS))
            if reply.get("id") == self._number:
                assert "error" not in reply, reply["error"]
                return dict(reply["result"])

    def value(self, expression: str) -> object:
        """The value of an expression in the page."""
        result = self.call("Runtime.evaluate", expression=expression, returnByValue=True)["result"]
        assert isinstance(result, dict)
        return result.get("value")

    def text(self) -> str:
        """What can be read on the page."""
        return str(self.value("document.body.innerText"))

    def wait_for(self, expression: str, seconds: float = START_SECONDS) -> None:
        """Wait until an expression is true; a page that is not there yet has none."""
        deadline = time.monotonic() + seconds
        while True:
            with suppress(AssertionError):
                if self.value(expression):
                    return
            assert time.monotonic() < deadline, f"never true: {expression}"
            time.sleep(0.1)

    def picture(self) -> NDArray[np.uint8]:
        """What is seen, shape (h, w, 3)."""
        data = self.call("Page.captureScreenshot", format="png")["data"]
        return np.asarray(Image.open(io.BytesIO(base64.b64decode(str(data)))).convert("RGB"))

    def click(self, x: float, y: float) -> None:
        """A click of the left button at a pixel."""
        self.call("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y)
        for kind in ("mousePressed", "mouseReleased"):
            self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=1, clickCount=1)

    def click_on(self, words: str) -> None:
        """A click on the last element with this text alone, or on the box that it is the label of."""
        found = self.value(
            f"(() => {{ const all = [...document.querySelectorAll('button, label, [role=tab], p, span')].filter("
            f"e => e.innerText && e.innerText.trim() === {json.dumps(words)}); const one = all[all.length - 1];"
            "if (!one) return null; let row = one;"
            "for (let i = 0; i < 4 && row; i++, row = row.parentElement) {"
            "const box = row.querySelectorAll('input[type=checkbox]');"
            "if (box.length === 1) { box[0].scrollIntoView({block: 'center'}); box[0].click(); return [] }"
            "if (box.length > 1) break }"
            "one.scrollIntoView({block: 'center'}); const b = one.getBoundingClientRect();"
            "return [b.x + b.width / 2, b.y + b.height / 2] })()"
        )
        assert isinstance(found, list), f"nothing on the page says {words!r}"
        if found:
            self.click(*found)


@contextmanager
def headless_page(url: str, folder: Path, size: tuple[int, int] = (1400, 900)) -> Iterator[HeadlessPage]:
    """A page that has begun to load; the browser is ended with all its processes."""
    program = chromium()
    assert program is not None
    browser = subprocess.Popen(
        [program, *OPTIONS, f"--user-data-dir={folder}", f"--window-size={size[0]},{size[1]}", url],
        stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True,
    )  # fmt: skip
    try:
        with connect(page_address(folder, url), max_size=LARGEST) as connection:
            yield HeadlessPage(connection)
    finally:
        with suppress(ProcessLookupError):
            os.killpg(browser.pid, signal.SIGKILL)
        browser.wait()


def page_address(folder: Path, url: str) -> str:
    """Where the DevTools of the page listen."""
    deadline = time.monotonic() + START_SECONDS
    while time.monotonic() < deadline:
        with suppress(OSError, ValueError):
            port = (folder / "DevToolsActivePort").read_text().split()[0]
            with urlopen(f"http://127.0.0.1:{port}/json/list", timeout=5) as reply:
                for one in json.load(reply):
                    if one["type"] == "page" and one["url"].startswith(url):
                        return str(one["webSocketDebuggerUrl"])
        time.sleep(0.1)
    raise AssertionError(f"the browser did not open {url}")
