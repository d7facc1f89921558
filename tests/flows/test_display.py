"""What a benchmark shows counts every sample once and every stage that there is."""

from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console

from dcap.evaluation.methods import DCAP, joined_id
from dcap.evaluation.outcome_table import AS_POSED, row_of
from dcap.evaluation.run_summary import summary_of
from dcap.scene.errors import InputError
from dcap.scene.json_tree import JsonObject
from dcap.scene.types.sample import Sample
from flows.display import Display, print_plan, print_table
from flows.sample_run import STAGE_NAMES, FailedSample, Plan
from tasks.cache import Event, StageEvent

ONE, TWO, THREE = (Sample(name, "room", "ball", "put it") for name in ("one", "two", "three"))
ALL = len(STAGE_NAMES)
INTENT = STAGE_NAMES.index("rotation")
"""Stages up to intent."""


def shown(display: Display) -> str:
    """What stands on the screen."""
    console = Console(width=120, color_system=None)
    with console.capture() as capture:
        console.print(display.rendered())
    return capture.get()


def test_every_sample_moves_the_bar_once() -> None:
    """One sample fails in planning, one before its first stage, one gets through: two of two samples to place."""
    display = Display([ONE, TWO, THREE])
    display.planned(Plan(ONE, (), "", "", failed=FailedSample(ONE, InputError("no"))))
    display.planned(Plan(TWO, (), "mesh", "new"))
    display.planned(Plan(THREE, STAGE_NAMES[:-1], STAGE_NAMES[-1], "new"))
    display.failed(ONE, "no")
    display.serving("http://127.0.0.1:1/api")
    assert "0/2" in shown(display)
    display.failed(TWO, "the server is gone")
    assert "1/2" in shown(display)
    for stage in STAGE_NAMES:
        display.listener(THREE)(StageEvent(stage, Event.CACHED))
    assert f"{ALL} of {ALL} stages" in shown(display)
    display.finished(THREE)
    assert "2/2" in shown(display)


def test_samples_placed_elsewhere_count_as_they_end() -> None:
    """Nobody tells of their stages: half of the samples is half of the work."""
    display = Display([ONE, TWO])
    for sample in (ONE, TWO):
        display.planned(Plan(sample, (), "mesh", "new"))
    display.serving("http://127.0.0.1:1/api")
    assert display.share() == 0.0
    display.finished(ONE)
    assert display.share() == 0.5
    display.failed(TWO, "its worker was lost")
    assert display.share() == 1.0


def test_an_infeasible_sample_has_the_stages_it_got_to() -> None:
    """A sample that ends in an overview counts its own stages, not those of a feasible one."""
    plan = Plan(ONE, STAGE_NAMES[:INTENT], "overview", "new")
    assert (plan.later, plan.stage_count) == ((), INTENT + 1)
    display = Display([ONE])
    display.planned(Plan(ONE, STAGE_NAMES[: STAGE_NAMES.index("segment")], "segment", "new"))
    for stage in (*STAGE_NAMES[:INTENT], "overview"):
        display.listener(ONE)(StageEvent(stage, Event.FINISHED))
    assert f"{INTENT + 1} of {ALL} stages" in shown(display)
    display.finished(ONE)
    assert f"{INTENT + 1} of {INTENT + 1} stages" in shown(display)


def test_a_plan_counts_the_stages_of_each_sample(capsys: pytest.CaptureFixture[str]) -> None:
    """Of an infeasible sample that lacks its overview all but one stage are there."""
    print_plan([Plan(ONE, STAGE_NAMES[:INTENT], "overview", "new"), Plan(TWO, STAGE_NAMES[:INTENT], "rotation", "new")])
    assert f"{INTENT} of {INTENT + 1}" in (said := capsys.readouterr().out)
    assert f"{INTENT} of {ALL}" in said


def test_ids_are_shown_as_they_are(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """An id that looks like markup is still an id."""
    odd = Sample("[/b] :smile: [red]", "room", "ball", "put it")
    failure = FailedSample(odd, InputError("no [/i] there"))
    with Display([odd]) as display:
        display.serving("http://127.0.0.1:1/api")
        display.failed(odd, failure.message)
    print_plan([Plan(odd, (), "", "", failed=failure)])
    rows = [row_of(odd, None, failure.message, None)]
    print_table(rows, summary_of(rows, run="", wall_s=1.0), tmp_path / "[/b]")
    said = capsys.readouterr()
    assert said.out.count("[/b] :smile: [red]") == said.out.count("no [/i] there") == 1
    assert said.err.count("[/b] :smile: [red]") == said.err.count("no [/i] there") == 2
    assert "[/b]/report.html" in said.err


def test_what_is_printed_where_nobody_looks_has_whole_lines(capsys: pytest.CaptureFixture[str]) -> None:
    """The last state of the progress ends as a line does."""
    with Display([ONE]) as display:
        display.serving("http://127.0.0.1:1/api")
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
