"""The examples of the documents give what they show, and their tables of settings are those of the code."""

import doctest
import re
import runpy
from collections.abc import Iterator
from pathlib import Path

import pytest

from flows.cli import main
from flows.given_settings import section_of
from flows.settings import setting_keys

ROOT = Path(__file__).resolve().parent.parent
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md")])
FENCE = re.compile(r"^(?P<slow><!-- slow[^\n]*-->\n)?```python[^\n]*\n(?P<text>.*?)^```$", re.MULTILINE | re.DOTALL)
FLAGS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE | doctest.IGNORE_EXCEPTION_DETAIL
DATASET = "- {id: bed-ball, room: bedroom_01, object: ball, prompt: put the ball at the center of the bed}\n"


def examples(page: Path, *, slow: bool) -> Iterator[str]:
    """The blocks of Python with examples, in the order in which they stand; the slow ones only if asked."""
    for found in FENCE.finditer(page.read_text()):
        if ">>>" in found["text"] and (slow or found["slow"] is None):
            yield found["text"]


def run_examples(*, slow: bool) -> int:
    """Run the examples of all pages, those of a page with each other's names; how many there were."""
    count, told = 0, list[str]()
    for page in PAGES:
        names: dict[str, object] = {}
        for text in examples(page, slow=slow):
            test = doctest.DocTestParser().get_doctest(text, names, page.name, str(page), 0)
            runner = doctest.DocTestRunner(optionflags=FLAGS)
            runner.run(test, out=told.append, clear_globs=False)
            names.update(test.globs)
            count += runner.tries
    assert told == [], "".join(told)
    return count


def test_fast_examples_give_what_they_show(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Examples that need no placement run and print what stands below them."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("DCAP_DATA", str(tmp_path / "data"))
    assert run_examples(slow=False) > 0


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.timeout(900)
def test_slow_examples_give_what_they_show(server: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """So do those that read a placement or a run, after the commands that the pages name."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("DCAP_DATA", str(tmp_path / "data"))
    Path("mine.yaml").write_text(DATASET)
    assert main(["dataset", "make", "--rooms", "bedroom_01"]) == 0
    asked = ["data/rooms/bedroom_01", "data/objects/ball.glb", "put the ball at the center of the bed"]
    assert main(["place", *asked, "--out", "results"]) == 0
    assert main(["benchmark", "--dataset", "mine.yaml"]) == 0
    assert run_examples(slow=True) > 10


def test_the_tables_of_settings_are_those_of_the_code() -> None:
    """Key, default, option and meaning of every setting; `python docs/make_settings.py` writes them."""
    page = (ROOT / "docs" / "configuration.md").read_text()
    with_tables = runpy.run_path(str(ROOT / "docs" / "make_settings.py"))["page_with_tables"]
    assert with_tables(page) == page
    assert set(re.findall(r"^## `(\w+)`$", page, re.MULTILINE)) == {section_of(one.key) for one in setting_keys()}
