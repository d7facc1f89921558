"""Ctrl-C and SIGTERM are never lost, not even where a library's import catches everything."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

PATIENCE = 120.0
"""For machines that are busy [s]."""
CAREFREE = """
try:
    import optional
except BaseException:
    pass
"""
"""As libraries import what may be missing."""
OPTIONAL = """
import sys, time
print("begun", flush=True)
end = time.monotonic() + float(sys.argv[1])
while time.monotonic() < end:
    time.sleep(0.005)
"""
PROGRAM = """
import sys, time, types
sys.path.insert(0, sys.argv[2])
import flows.cli
from flows import interrupts
interrupts.LONGEST_SECONDS = float(sys.argv[3])

def command(arguments):
    try:
        work()
        sys.stdout.write("went on\\n")  # at once: a print is interrupted before the end of its line, too
        sys.stdout.flush()
        time.sleep(600)
    finally:
        print("cleared up", flush=True)

app = types.ModuleType("flows.cli.app")
app.main = command
sys.modules["flows.cli.app"] = flows.cli.app = app
"""
"""A `dcap` whose command does some `work`."""
IMPORT = """
def work():
    import carefree
"""
UNDER_PREFECT = """
def work():
    import signal
    def raising(number, frame): raise BaseException("Prefect's")
    signal.signal(signal.SIGTERM, raising)
    with interrupts.put_off(signal.SIGTERM):
        import carefree
"""
BENCHMARK = """
def work():
    print("begun", flush=True)
    import flows.benchmark, solver.settle
"""
Said = tuple[int, str, str]
INTERRUPTED: Said = (130, "cleared up\n", "dcap: interrupted\n")


def start(
    folder: Path, work: str, kind: int, seconds: float, longest: float, *, ignored: bool = False
) -> "subprocess.Popen[str]":
    """A program that begins an import of so many seconds, and waits `longest` for one when it is interrupted."""
    (folder / "carefree.py").write_text(CAREFREE)
    (folder / "optional.py").write_text(OPTIONAL)
    disposition = "SIG_IGN" if ignored else "default_int_handler" if kind == signal.SIGINT else "SIG_DFL"
    code = (
        f"import signal; signal.signal({int(kind)}, signal.{disposition})\n{PROGRAM}{work}\nsys.exit(flows.cli.main())"
    )
    words = [sys.executable, "-P", "-c", code, str(seconds), str(folder), str(longest)]
    program = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert program.stdout is not None
    assert program.stdout.readline() == "begun\n"
    return program


def end(program: "subprocess.Popen[str]") -> Said:
    """How it ends by itself; it may come to the line after the import."""
    out, error = program.communicate(timeout=PATIENCE)
    return program.returncode, out.removeprefix("went on\n"), error


@pytest.mark.slow
@pytest.mark.parametrize("kind", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("times", [1, 3])
def test_an_import_that_catches_everything_cannot_lose_it(tmp_path: Path, kind: signal.Signals, times: int) -> None:
    """It comes when the import is over, one time, so that nothing disturbs what clears up."""
    program = start(tmp_path, IMPORT, kind, 0.3, PATIENCE)
    for _ in range(times):
        os.kill(program.pid, kind)
        time.sleep(0.03)
    assert end(program) == INTERRUPTED


@pytest.mark.slow
@pytest.mark.parametrize("kind", [signal.SIGINT, signal.SIGTERM])
def test_a_long_import_is_not_waited_for(tmp_path: Path, kind: signal.Signals) -> None:
    """The program ends in the middle of it and says so."""
    program = start(tmp_path, IMPORT, kind, 600.0, 0.1)
    os.kill(program.pid, kind)
    assert end(program) == (130, "", "dcap: interrupted\n")


@pytest.mark.slow
def test_a_handler_that_others_have_put_in_place_waits_as_well(tmp_path: Path) -> None:
    """In a flow run SIGTERM is Prefect's."""
    program = start(tmp_path, UNDER_PREFECT, signal.SIGTERM, 0.3, PATIENCE)
    os.kill(program.pid, signal.SIGTERM)
    code, out, error = end(program)
    assert (code, out) == (1, "cleared up\n")
    assert error.endswith("BaseException: Prefect's\n")


@pytest.mark.slow
def test_what_is_to_be_ignored_stays_ignored(tmp_path: Path) -> None:
    """Ctrl-C is for what runs in the foreground."""
    program = start(tmp_path, IMPORT, signal.SIGINT, 0.1, PATIENCE, ignored=True)
    os.kill(program.pid, signal.SIGINT)
    assert program.stdout is not None
    assert program.stdout.readline() == "went on\n"
    os.kill(program.pid, signal.SIGINT)
    with pytest.raises(subprocess.TimeoutExpired):
        program.wait(0.2)
    program.kill()
    program.communicate()


@pytest.mark.slow
@pytest.mark.parametrize(
    "seconds", [pytest.param(0.0, marks=pytest.mark.long), pytest.param(0.5, marks=pytest.mark.long), 1.5]
)
def test_whatever_a_benchmark_loads_ends(tmp_path: Path, seconds: float) -> None:
    """Taichi's decorators, too, which look at what is around them within an `except` for everything."""
    program = start(tmp_path, BENCHMARK, signal.SIGINT, 0.0, PATIENCE)
    time.sleep(seconds)
    os.kill(program.pid, signal.SIGINT)
    assert end(program) == INTERRUPTED
