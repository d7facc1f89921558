"""What the documents say to type can be typed: Python snippets run, command lines are understood."""

import ast
import doctest
import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest
import typer

from flows.cli import main
from flows.cli.app import app

ROOT = Path(__file__).resolve().parent.parent
DECISIONS = ROOT / "docs" / "decisions"
PAGES = [page for page in [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
         if page.parent != DECISIONS]  # fmt: skip
FENCE = re.compile(
    r"^(?P<mark><!-- slow[^\n]*-->\n)?```(?P<language>\w+)[^\n]*\n(?P<text>.*?)^```$", re.MULTILINE | re.DOTALL
)
SHELL = ("sh", "bash", "console")
NOT_A_LINE = "..."
"""Stands for something left out."""
FLAGS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE | doctest.IGNORE_EXCEPTION_DETAIL
DATASET = "- {id: bed-ball, room: bedroom_01, object: ball, prompt: put the ball at the center of the bed}\n"


def name_of(page: Path) -> str:
    """A page in the name of a test."""
    return str(page.relative_to(ROOT))


def blocks(page: Path, *languages: str) -> Iterator[tuple[str, bool]]:
    """The text of each block of code of these languages, and whether it is marked as slow."""
    for found in FENCE.finditer(page.read_text()):
        if found["language"] in languages:
            yield found["text"], found["mark"] is not None


def run_examples(page: Path, *, slow: bool) -> int:
    """Run the examples of a page in the order in which they stand, the slow ones only if asked; how many there were."""
    names: dict[str, object] = {}
    count = 0
    for text, marked in blocks(page, "python"):
        if ">>>" not in text or (marked and not slow):
            continue
        test = doctest.DocTestParser().get_doctest(text, names, name_of(page), str(page), 0)
        told: list[str] = []
        runner = doctest.DocTestRunner(optionflags=FLAGS)
        runner.run(test, out=told.append, clear_globs=False)
        assert runner.failures == 0, "".join(told)
        names.update(test.globs)
        count += runner.tries
    return count


def command_lines(text: str) -> Iterator[str]:
    """The lines of a shell's block, continued ones as one."""
    for line in text.replace("\\\n", " ").splitlines():
        for one in line.removeprefix("$ ").split(" && "):
            yield one.strip()


DCAP_LINES = [
    pytest.param(line, id=f"{name_of(page)}: {line[:60]}")
    for page in PAGES
    for text, _ in blocks(page, *SHELL)
    for line in command_lines(text)
    if line.startswith("dcap ") and NOT_A_LINE not in line
]


def test_there_are_snippets_to_try() -> None:
    """The patterns find what the pages hold: a change of style must not leave every test below without work."""
    assert len(DCAP_LINES) > 50
    assert sum(">>>" in text for page in PAGES for text, _ in blocks(page, "python")) > 6


@pytest.mark.parametrize("line", DCAP_LINES)
def test_command_lines_are_understood(line: str) -> None:
    """Each `dcap ...` line of a document names a command, options that it has and values of their kinds."""
    command, words = typer.main.get_command(app), shlex.split(line, comments=True)[1:]
    if words == ["--version"]:
        return
    while inner := getattr(command, "commands", None):
        assert words, f"{line}: a group alone"
        assert words[0] in inner, f"{line}: no command {words[0]!r}"
        command, words = inner[words[0]], words[1:]
    command.make_context(line, words)  # raises what the command line would complain about


@pytest.mark.parametrize(
    "line", ["dcap place a b c --oot d", "dcap place a b", "dcap plaice", "dcap benchmark --workers many"]
)
def test_wrong_command_lines_are_not(line: str) -> None:
    """The test above fails where an option, an argument, a command or a value is wrong."""
    with pytest.raises((typer.TyperException, AssertionError)):
        test_command_lines_are_understood(line)


@pytest.mark.parametrize("page", [page for page in PAGES if any(blocks(page, "sh"))], ids=name_of)
def test_make_targets_exist(page: Path) -> None:
    """Each `make TARGET` line of a document names a target of the Makefile."""
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    lines = [line for text, _ in blocks(page, *SHELL) for line in command_lines(text) if line.startswith("make ")]
    assert [line for line in lines if shlex.split(line, comments=True)[1] not in targets] == []


@pytest.mark.parametrize("page", [page for page in PAGES if any(blocks(page, "python"))], ids=name_of)
def test_python_snippets_are_python(page: Path) -> None:
    """Each block of Python without `>>>` is well formed."""
    for text, _ in blocks(page, "python"):
        if ">>>" not in text:
            ast.parse(text)


@pytest.mark.parametrize("page", [page for page in PAGES if any(blocks(page, "python"))], ids=name_of)
def test_fast_examples_give_what_they_show(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Examples that need no placement run and print what stands below them."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("DCAP_DATA", str(tmp_path / "data"))
    run_examples(page, slow=False)


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.timeout(900)
def test_slow_examples_give_what_they_show(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """So do those that read a placement or a run, after the commands that the pages name."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("DCAP_DATA", str(tmp_path / "data"))
    Path("mine.yaml").write_text(DATASET)
    assert main(["dataset", "make", "--rooms", "bedroom_01"]) == 0
    asked = ["data/rooms/bedroom_01", "data/objects/ball.glb", "put the ball at the center of the bed"]
    assert main(["place", *asked, "--out", "results"]) == 0
    assert main(["benchmark", "--dataset", "mine.yaml"]) == 0
    assert sum(run_examples(page, slow=True) for page in PAGES) > 10
