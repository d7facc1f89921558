"""The Makefile's targets act where the data is, and what has to pass runs every test once."""

import itertools
import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
MARKERS = ("slow", "long", "third_party", "gpu", "sweep")
TARGETS = ("check", "rest", "long")


def dry_run(target: str, option: str = "--old-file=.venv/.ready", **environment: str) -> str:
    """What make would run, whatever was given to a make that runs these tests."""
    command = ["make", "--dry-run", option, target]
    own = {name: value for name, value in os.environ.items() if not name.startswith(("MAKE", "MFLAGS"))} | environment
    return subprocess.run(command, cwd=ROOT, env=own, capture_output=True, text=True, check=True).stdout


@pytest.mark.parametrize(
    ("target", "words"), [("clean", '"/far away/cache"'), ("demo", '"/far away/rooms/bedroom_01"')]
)
def test_targets_follow_the_data_folder(target: str, words: str) -> None:
    """With $DCAP_DATA set, make clean empties that cache and make demo reads those rooms."""
    said = dry_run(target, DCAP_DATA="/far away")
    assert words in said
    assert " data/" not in said


def test_setup_leaves_nothing_in_the_home_folder() -> None:
    """Prefect makes its own folder there when it is imported, unless it is told another; the one above it must be."""
    said = dry_run("setup", "--what-if=requirements.lock").splitlines()
    number, line = next((number, line) for number, line in enumerate(said) if "prefect.server" in line)
    above, _, name = re.findall(r"PREFECT_HOME=(\S+)", line)[-1].rpartition("/")
    assert name
    assert f"mkdir -p {above}" in said[:number]


def selects(target: str, marks: tuple[str, ...]) -> bool:
    """Whether the target runs a test with these markers."""
    found = re.search(r'pytest .*-m "([^"]+)"', dry_run(target))
    assert found is not None
    assert set(re.findall(r"\w+", found[1])) <= {*MARKERS, "and", "or", "not"}
    return bool(eval(found[1], {mark: mark in marks for mark in MARKERS}))


@pytest.mark.parametrize("marks", [c for n in range(5) for c in itertools.combinations(MARKERS[:4], n)], ids="-".join)
def test_check_rest_and_long_run_each_test_once(marks: tuple[str, ...]) -> None:
    """Whatever a test's markers, exactly one of the three runs it; none runs a sweep."""
    assert [selects(target, marks) for target in TARGETS].count(True) == 1
    assert not any(selects(target, (*marks, "sweep")) for target in TARGETS)


@pytest.mark.parametrize("beside", [True, False])
def test_ci_runs_check_with_the_tests_of_rest_on_the_data_beside_the_project(tmp_path: Path, beside: bool) -> None:
    """`.ci/run` makes check with all tests of check and rest, and names ../shared/data as sample data only where that
    is; a machine without npm goes on."""
    scripts, tools = tmp_path / "project" / ".ci", tmp_path / "tools"
    data = tmp_path / "shared" / "data"
    for folder in (scripts, tools, *([data] if beside else [])):
        folder.mkdir(parents=True)
    shutil.copy(ROOT / ".ci" / "run", scripts / "run")
    (tools / "make").write_text('#!/bin/sh\necho "$1 $2 ${DCAP_SAMPLE_DATA:-}"\n[ "$1" != node-tools ]\n')
    (tools / "make").chmod(0o755)
    environment = {"PATH": f"{tools}:{os.environ['PATH']}"}
    done = subprocess.run([scripts / "run"], env=environment, capture_output=True, text=True, check=True)
    named = str(data) if beside else ""
    tools_asked, skipped, check = done.stdout.splitlines()
    assert tools_asked == f"node-tools  {named}"
    assert "skipped" in skipped
    wanted = "not long and not sweep"
    assert check == f"check FAST={wanted} {named}"
    for marks in (c for n in range(6) for c in itertools.combinations(MARKERS, n)):
        either = selects("check", marks) or selects("rest", marks)
        assert either == bool(eval(wanted, {mark: mark in marks for mark in MARKERS}))
