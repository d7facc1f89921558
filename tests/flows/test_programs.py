"""Whether a program still runs is told on its own machine, by its number and the time at which it started."""

import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from patience import wait_until

from flows.programs import Program, start_of


def test_a_program_that_runs_is_not_gone() -> None:
    """Neither this one nor another; its plain form is the same program."""
    here = Program.this()
    assert not here.is_gone
    assert Program.from_json(here.to_json()) == here
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as other:
        assert not replace(here, pid=other.pid, started=start_of(other.pid)).is_gone


def test_a_program_that_was_killed_is_gone() -> None:
    """At once, also while nobody has waited for its process, and for ever after."""
    process = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    program = replace(Program.this(), pid=process.pid, started=start_of(process.pid))
    os.kill(process.pid, signal.SIGKILL)
    wait_until(lambda: program.is_gone, 60.0)
    assert Path(f"/proc/{process.pid}").exists()  # a zombie
    process.communicate()
    assert program.is_gone


def test_a_number_that_was_given_again_is_another_program() -> None:
    """The process of that number started at another time."""
    assert replace(Program.this(), started="yesterday").is_gone


def test_nothing_is_known_of_programs_elsewhere() -> None:
    """Its number may be free here."""
    assert not replace(Program.this(), host="elsewhere", pid=2**22, started="yesterday").is_gone


def test_nothing_is_known_of_programs_that_are_hidden(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Where the system hides the processes of other users, all that it says of one is that it must not be touched."""
    here = Program.this()
    monkeypatch.setattr("flows.programs.PROC", tmp_path)
    assert here.is_gone
    monkeypatch.setattr(os, "kill", refused)
    assert not here.is_gone


def refused(*_: int) -> None:
    """What the system answers of another user's process."""
    raise PermissionError


def test_what_is_no_program() -> None:
    """Of flow runs that others made."""
    for tree in (None, "x", {}, {"host": "a", "pid": "1", "started": "b"}, {"host": "a", "pid": 1}):
        assert Program.from_json(tree) is None
