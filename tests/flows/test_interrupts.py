"""Ctrl-C and SIGTERM are never lost, not even where a library's import catches everything."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

PATIENCE = 60.0
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
    time.sleep(0.01)
"""
PROGRAM = """
import sys, time
from flows.cli.interrupts import interruptible
sys.path.insert(0, sys.argv[2])
with interruptible(own=True):
    try:
        import carefree
        time.sleep(60)
    except KeyboardInterrupt:
        sys.exit(99)
"""


def interrupted(
    tmp_path: Path, seconds: float, kind: signal.Signals, *, ignored: bool = False
) -> "subprocess.Popen[str]":
    """A program that has got a signal in the middle of an import of so many seconds."""
    (tmp_path / "carefree.py").write_text(CAREFREE)
    (tmp_path / "optional.py").write_text(OPTIONAL)
    disposition = "SIG_IGN" if ignored else "default_int_handler" if kind is signal.SIGINT else "SIG_DFL"
    code = f"import signal; signal.signal({int(kind)}, signal.{disposition})\n{PROGRAM}"
    words = [sys.executable, "-P", "-c", code, str(seconds), str(tmp_path)]
    program = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert program.stdout is not None
    assert program.stdout.readline() == "begun\n"
    os.kill(program.pid, kind)
    return program


@pytest.mark.parametrize(("kind", "code"), [(signal.SIGINT, 99), (signal.SIGTERM, 130)])
def test_an_import_that_catches_everything_cannot_lose_it(tmp_path: Path, kind: signal.Signals, code: int) -> None:
    """It comes when the import is over."""
    program = interrupted(tmp_path, 0.1, kind)
    program.communicate(timeout=PATIENCE)
    assert program.returncode == code


@pytest.mark.parametrize("kind", [signal.SIGINT, signal.SIGTERM])
def test_a_long_import_is_not_waited_for(tmp_path: Path, kind: signal.Signals) -> None:
    """The program ends in the middle of it and says so."""
    program = interrupted(tmp_path, 600.0, kind)
    _, said = program.communicate(timeout=PATIENCE)
    assert (program.returncode, said) == (130, "dcap: interrupted\n")


def test_what_is_to_be_ignored_stays_ignored(tmp_path: Path) -> None:
    """Ctrl-C is for what runs in the foreground."""
    program = interrupted(tmp_path, 0.1, signal.SIGINT, ignored=True)
    try:
        with pytest.raises(subprocess.TimeoutExpired):
            program.communicate(timeout=2.0)
    finally:
        program.kill()
        program.communicate()


@pytest.mark.parametrize("seconds", [0.0, 0.2, 0.5, 1.0, 2.0])
def test_a_benchmark_that_is_being_loaded_ends(seconds: float) -> None:
    """Whatever library it loads just then."""
    code = PROGRAM.replace(
        "sys.path.insert(0, sys.argv[2])", "signal.signal(signal.SIGINT, signal.default_int_handler)"
    )
    code = code.replace("import carefree", "print(flush=True); import flows.benchmark")
    words = [sys.executable, "-P", "-c", f"import signal\n{code}"]
    program = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert program.stdout is not None
    program.stdout.readline()
    time.sleep(seconds)
    program.send_signal(signal.SIGINT)
    _, said = program.communicate(timeout=PATIENCE)
    assert (program.returncode, said) in ((99, ""), (130, "dcap: interrupted\n"))
