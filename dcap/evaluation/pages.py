"""Pages from templates, and the page for checking the things that were found in a scene.

The page for checking has numbered pictures and a row for each thing. It embeds its pictures and shows the content of
labels.json, which is the file to correct.
"""

import base64
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from jinja2 import FileSystemLoader, StrictUndefined
from jinja2.sandbox import SandboxedEnvironment
from numpy.typing import NDArray
from PIL import Image

from dcap.scene.writers.labels import FoundThing

TEMPLATES = Path(__file__).parent / "templates"
UNSURE = 0.9
"""Probability below which a label is marked as uncertain [-]."""


@cache
def environment(folder: Path) -> SandboxedEnvironment:
    """The templates of a folder; texts are escaped, and a name that a template lacks is an error."""
    return SandboxedEnvironment(
        loader=FileSystemLoader(folder), autoescape=True, undefined=StrictUndefined, trim_blocks=True,
        lstrip_blocks=True,
    )  # fmt: skip


def rendered(template: str, values: Mapping[str, object], folder: Path = TEMPLATES) -> str:
    """A page from a template."""
    return environment(folder).get_template(template).render(values)


@dataclass(frozen=True, eq=False, slots=True)
class Row:
    """A thing on the page."""

    thing: FoundThing
    picture: NDArray[np.uint8]
    """Picture of the thing alone, (h, w, 3)."""
    color: str
    """Colour of its number in the pictures, in CSS."""
    parts: str
    """Names of its parts."""
    others: str = ""
    """Alternative labels."""

    @property
    def unsure(self) -> bool:
        """Whether a person should check it."""
        return self.thing.confidence < UNSURE


def labels_page(
    scene: str,
    plan: NDArray[np.uint8],
    views: Sequence[NDArray[np.uint8]],
    rows: Sequence[Row],
    command: str,
    *,
    offline: bool,
) -> str:
    """The page; `command` uses the corrected file, `offline` says whether rules labelled things that the source does
    not name."""
    values = {
        "scene": scene, "plan": embedded(plan), "views": [embedded(view) for view in views],
        "rows": [(row, embedded(row.picture)) for row in rows], "unsure": sum(row.unsure for row in rows),
        "command": command, "offline": offline,
    }  # fmt: skip
    return rendered("labels.html.j2", values)


def embedded(rgb: NDArray[np.uint8]) -> str:
    """A picture as a data URL."""
    out = io.BytesIO()
    Image.fromarray(rgb).save(out, "WEBP", quality=85)
    return "data:image/webp;base64," + base64.b64encode(out.getvalue()).decode()
