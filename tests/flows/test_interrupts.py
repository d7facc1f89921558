"""Ctrl-C and SIGTERM end a program, whatever it does just then."""

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from types import ModuleType

import pytest

from dcap.scene.settings import PROJECT_ROOT
from flows import interrupts

PATIENCE = 120.0
CAREFREE = """
import time
try:
    print("begun", flush=True)
    time.sleep(float({seconds}))
except BaseException:
    pass  # as optional imports of several libraries do
print("went on", flush=True)
time.sleep(600)
"""


def started(folder: Path, seconds: float, kind: signal.Signals, *, ignored: bool = False) -> "subprocess.Popen[str]":
    """A program that catches everything for so many seconds."""
    (folder / "carefree.py").write_text(CAREFREE.format(seconds=seconds))
    disposition = "SIG_IGN" if ignored else "default_int_handler" if kind is signal.SIGINT else "SIG_DFL"
    code = (
        f"import signal; signal.signal({int(kind)}, signal.{disposition})\n"
        "from flows.interrupts import end_on_signals\n"
        f"end_on_signals()\nexec(open({str(folder / 'carefree.py')!r}).read())"
    )
    program = subprocess.Popen(
        [sys.executable, "-P", "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env=os.environ | {"PYTHONPATH": str(PROJECT_ROOT)},
    )  # fmt: skip
    assert program.stdout is not None
    assert program.stdout.readline() == "begun\n"
    return program


@pytest.mark.slow
def test_what_catches_everything_cannot_lose_it(tmp_path: Path) -> None:
    """The program ends within seconds, with 130 and a line; a second signal ends it at once."""
    for kind, times in ((signal.SIGINT, 1), (signal.SIGTERM, 1), (signal.SIGINT, 2)):
        program = started(tmp_path, 600.0, kind)
        begin = time.monotonic()
        for _ in range(times):
            os.kill(program.pid, kind)
            time.sleep(0.1)
        _, error = program.communicate(timeout=PATIENCE)
        assert (program.returncode, error) == (130, "dcap: interrupted\n")
        assert time.monotonic() - begin < (2.0 if times == 2 else 5.0)


@pytest.mark.slow
def test_what_is_to_be_ignored_stays_ignored(tmp_path: Path) -> None:
    """Ctrl-C is for what runs in the foreground."""
    program = started(tmp_path, 600.0, signal.SIGINT, ignored=True)
    os.kill(program.pid, signal.SIGINT)
    with pytest.raises(subprocess.TimeoutExpired):
        program.wait(0.5)
    program.kill()
    program.communicate()


@pytest.mark.slow
def test_a_command_ends_while_it_loads(tmp_path: Path) -> None:
    """Taichi and Prefect look at what is around them within an `except` for everything."""
    command = [sys.executable, "-P", "-m", "flows.cli", "benchmark", "--limit", "1"]
    for seconds in (0.7, 2.0):
        program = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
            env=os.environ | {"DCAP_DATA": str(tmp_path), "PYTHONPATH": str(PROJECT_ROOT)}, start_new_session=True,
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # a script in the background ignores it
        )  # fmt: skip
        time.sleep(seconds)
        os.kill(program.pid, signal.SIGINT)
        _, error = program.communicate(timeout=PATIENCE)
        assert program.returncode in (130, -signal.SIGINT), error
        assert program.returncode != 130 or error.endswith("dcap: interrupted\n")


def test_a_module_that_is_half_loaded_keeps_nobody_from_interrupting(monkeypatch: pytest.MonkeyPatch) -> None:
    """The alarm is set whatever the handler meets."""
    alarms: list[float] = []

    class Alarm(threading.Thread):
        def __init__(self, seconds: float, function: object) -> None:
            super().__init__()
            alarms.append(seconds)

    monkeypatch.setattr(interrupts, "_once", threading.Event())
    monkeypatch.setattr(threading, "excepthook", threading.excepthook)  # both are put back after the test
    monkeypatch.setattr(sys, "unraisablehook", sys.unraisablehook)
    monkeypatch.setattr(threading, "Timer", Alarm)
    monkeypatch.setitem(sys.modules, "tasks.process", ModuleType("tasks.process"))
    with pytest.raises(KeyboardInterrupt):
        interrupts._interrupt(signal.SIGINT, None)
    assert alarms == [interrupts.LONGEST_SECONDS]
