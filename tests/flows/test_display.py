"""What a benchmark shows counts every sample once and every stage that there is."""

from dataclasses import replace
from io import StringIO
from pathlib import Path
from types import SimpleNamespace

import pytest
from rich.console import Console

from dcap.evaluation.methods import DCAP, joined_id
from dcap.evaluation.outcome_table import AS_POSED, row_of
from dcap.evaluation.run_folder import summary_of
from dcap.scene.errors import InputError
from dcap.scene.types.sample import Sample
from dcap.scene.written_files import JsonObject
from flows.display import Display, console_on, print_table
from flows.plan import print_plan
from flows.sample_run import FailedSample, Plan
from tasks.run_context import Event, StageEvent

ONE, TWO = (Sample(name, "room", "ball", "put it") for name in ("one", "two"))


def shown(display: Display) -> str:
    """What stands on the screen."""
    console = Console(width=120, color_system=None)
    with console.capture() as capture:
        console.print(display.progress.get_renderable())
    return capture.get()


def test_every_sample_moves_the_bar_once() -> None:
    """Whether it fails or gets through; a stage at work has its line, and is counted when it has ended."""
    display = Display([ONE, TWO])
    assert "0/2" in shown(display)
    listener = display.listener(ONE)
    listener(StageEvent("drop", Event.STARTED))
    listener(StageEvent("drop", Event.PROGRESS, 0.5, "half way"))
    assert "one" in shown(display)
    assert "half way" in shown(display)
    listener(StageEvent("drop", Event.FINISHED))
    assert "1 stages done" in shown(display)
    display.ended(ONE)
    assert "half way" not in shown(display)
    assert (display.share, display.counts) == (0.5, "1 of 2 samples")
    display.ended(TWO, "its worker was lost")
    assert (display.share, display.counts) == (1.0, "2 of 2 samples, 1 failed")
    assert "2/2" in shown(display)


def test_ids_are_shown_as_they_are(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """An id that looks like markup is still an id."""
    odd = Sample("[/b] :smile: [red]", "room", "ball", "put it")
    failure = FailedSample(odd, InputError("no [/i] there"))
    with Display([odd]) as display:
        display.ended(odd, failure.message)
    print_plan([Plan(odd, (), failed=failure)])
    rows = [row_of(odd, None, failure.message, None)]
    print_table(rows, summary_of(rows, run="", wall_s=1.0), tmp_path / "[/b]")
    said = capsys.readouterr()
    assert said.out.count("[/b] :smile: [red]") == said.out.count("no [/i] there") == 1
    assert said.err.count("[/b] :smile: [red]") == said.err.count("no [/i] there") == 2
    assert "[/b]/report.html" in said.err


def test_what_is_printed_where_nobody_looks_has_whole_lines(capsys: pytest.CaptureFixture[str]) -> None:
    """The last state of the progress ends as a line does."""
    with Display([ONE]):
        pass
    assert capsys.readouterr().err.endswith("\n")


def test_cached_samples_are_told(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """The seconds of an earlier run are not those of this one."""
    tree: JsonObject = {"verdict": "at_rest", "timings": {"drop": 12.5}}
    rows = [row_of(sample, tree, "", None) for sample in (ONE, TWO)]
    print_table(rows, summary_of(rows, run="", wall_s=1.0), tmp_path, {"one"})
    one, two = (line.split()[-1] for line in capsys.readouterr().err.splitlines()[1:3])
    assert (one, two) == ("cached", "12.5")


def test_the_list_of_a_run_names_the_method_of_each_row(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """Where there are several; with one, no column says the same again. What stands as posed is counted."""
    rows = [row_of(Sample(joined_id(method, "one"), "room", "ball", "put it"), None, "", None)
            for method in (DCAP, "layoutgpt")]  # fmt: skip
    rows[1] = replace(rows[1], verdict=AS_POSED)
    print_table(rows, summary_of(rows, run="", wall_s=1.0), tmp_path)
    said = capsys.readouterr().err
    assert "method" in said
    assert "layoutgpt" in said
    assert "1 as posed" in said
    print_table(rows[:1], summary_of(rows[:1], run="", wall_s=1.0), tmp_path)
    said = capsys.readouterr().err
    assert "method" not in said
    assert "as posed" not in said


def test_a_program_may_have_no_terminal_at_all() -> None:
    """Its standard error is missing, or an object that only writes."""
    text = StringIO()
    console_on(None, quiet=True).print("nothing")  # type: ignore[arg-type]
    console_on(SimpleNamespace(write=text.write, flush=text.flush), quiet=False).print("a line")  # type: ignore[arg-type]
    assert text.getvalue() == "a line\n"
