"""The documentation site: it builds, loads nothing from elsewhere, and says of the code what the code has."""

import os
import re
import subprocess
import sys
from dataclasses import fields
from html.parser import HTMLParser
from pathlib import Path

import nbformat
import pytest
from pydantic import BaseModel

from dcap.evaluation.outcome_table import SampleOutcome
from dcap.evaluation.run_summary import RunSummary
from dcap.scene.types.outcome import Reason
from dcap.scene.types.settled import PlacementChecks
from flows.place import PlaceConfig
from solver.certificate import Certificate, ContactRow, History, KickCheck, SignalRows

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"
METRICS = DOCS / "metrics.md"
NOTEBOOK = DOCS / "place_one.ipynb"
LARGEST_PICTURE, ALL_PICTURES = 150_000, 2_500_000
"""The clone stays small [bytes]."""
LOADED = {
    "img": "src",
    "script": "src",
    "iframe": "src",
    "source": "src",
    "video": "src",
    "audio": "src",
    "object": "data",
}
FROM_ELSEWHERE = re.compile(r"url\(\s*['\"]?(?:https?:)?//|@import\s+['\"](?:https?:)?//")
FIRST_CELL = re.compile(r"^\| ((?:`\w+`(?:, )?)+) \|", re.MULTILINE)


class LoadedFiles(HTMLParser):
    """Collects what a page loads by itself; links that a reader follows do not count."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        place = given.get(LOADED.get(tag, ""))
        if tag == "link" and given.get("rel") != "canonical":
            place = given.get("href")
        self.found += [place] if place else []


def section(heading: str) -> set[str]:
    """The names in the first cells of the table below a heading of docs/metrics.md."""
    _, found, rest = METRICS.read_text().partition(f" {heading}\n")
    assert found, heading
    table = re.split(r"^#+ ", rest, maxsplit=1, flags=re.MULTILINE)[0]
    return {name for cell in FIRST_CELL.findall(table) for name in re.findall(r"`(\w+)`", cell)}


@pytest.mark.parametrize(
    ("heading", "kind"),
    [
        ("Columns of results.parquet", SampleOutcome),
        ("Keys of summary.json", RunSummary),
        ("Signals of rest", SignalRows),
        ("The kick", KickCheck),
        ("What else a certificate holds", Certificate),
        ("What was asked", PlacementChecks),
        ("Contacts", ContactRow),
        ("Columns of history.parquet", History),
    ],
)
def test_every_metric_is_defined(heading: str, kind: type) -> None:
    """docs/metrics.md has a row for each column, key and row that the code writes, and for no other."""
    assert section(heading) == {one.name for one in fields(kind)}


def test_every_reason_is_explained() -> None:
    """The table of reason codes is that of the code, and the page of some stage says when each comes."""
    overview = (DOCS / "stages" / "index.md").read_text()
    assert set(FIRST_CELL.findall(overview)) == {f"`{reason.value}`" for reason in Reason}
    pages = "".join(page.read_text() for page in (DOCS / "stages").glob("*.md") if page.name != "index.md")
    assert [reason.value for reason in Reason if f"| `{reason.value}`" not in pages] == []


def test_every_setting_of_a_stage_has_its_place() -> None:
    """Each configuration class that a placement uses is rendered on the page of some stage, from the code."""
    pages = "".join(page.read_text() for page in (DOCS / "stages").glob("*.md"))

    def classes(kind: type[BaseModel]) -> set[str]:
        inner = [one.annotation for one in kind.model_fields.values()]
        nested = [one for one in inner if isinstance(one, type) and issubclass(one, BaseModel)]
        return {f"{one.__module__}.{one.__name__}" for one in nested} | {
            name for one in nested for name in classes(one)
        }

    assert sorted(name for name in classes(PlaceConfig) if f"::: {name}\n" not in pages) == []


def test_pictures_are_small_and_used() -> None:
    """Each picture is below 150 kB, all together below 2.5 MB, and some page shows it."""
    pictures = sorted((DOCS / "images").iterdir())
    text = "".join(page.read_text() for page in [ROOT / "README.md", *DOCS.rglob("*.md")])
    assert [one.name for one in pictures if one.stat().st_size > LARGEST_PICTURE or one.name not in text] == []
    assert sum(one.stat().st_size for one in pictures) < ALL_PICTURES
    script = (DOCS / "make_pictures.py").read_text()
    assert [one.name for one in pictures if f'"{one.name}"' not in script] == []


def test_the_notebook_holds_no_outputs() -> None:
    """A notebook is kept as it was written; what it shows is made where it runs."""
    book = nbformat.read(NOTEBOOK, as_version=4)
    nbformat.validate(book)
    cells = [cell for cell in book.cells if cell.cell_type == "code"]
    assert cells
    assert all(not cell.outputs and cell.execution_count is None for cell in cells)


@pytest.mark.slow
def test_the_site_builds_and_loads_nothing_from_elsewhere(tmp_path: Path) -> None:
    """mkdocs builds every page without a warning; no page or style sheet loads a file from another host."""
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(tmp_path)]
    environment = os.environ | {"NO_MKDOCS_2_WARNING": "1"}
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    pages = sorted(tmp_path.rglob("*.html"))
    assert {"index.html", "api.html", "cookbook.html", "metrics.html"} <= {page.name for page in pages}
    for page in pages:
        reader = LoadedFiles()
        reader.feed(page.read_text())
        assert reader.found, page
        assert [one for one in reader.found if re.match(r"(?:\w+:)?//", one)] == [], page
    for sheet in tmp_path.rglob("*.css"):
        assert not FROM_ELSEWHERE.search(sheet.read_text()), sheet
    settings = (tmp_path / "stages" / "drop.html").read_text()
    assert "Unbalanced force on a free body over its weight" in settings  # a docstring of SolverConfig
    assert not (tmp_path / "make_pictures.py").exists()


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.timeout(900)
def test_the_notebook_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every cell runs, in a data folder of its own, and the ball comes to rest."""
    from nbclient import NotebookClient

    monkeypatch.setenv("DCAP_DATA", str(tmp_path / "data"))
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    book = nbformat.read(NOTEBOOK, as_version=4)
    NotebookClient(book, timeout=800, kernel_name="python3", resources={"metadata": {"path": str(tmp_path)}}).execute()
    shown = [output for cell in book.cells if cell.cell_type == "code" for output in cell.outputs]
    pictures = sum("image/png" in output.get("data", {}) for output in shown)
    assert pictures == 5  # three of the placement, two plots
    assert any("at_rest on bed" in output.get("text", "") for output in shown)
