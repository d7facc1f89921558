"""Functions for processes of their own, and who of them is alive."""

import json
import os
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

from dcap.scene.errors import InputError


def family(path: str) -> None:
    """Start a process, tell both numbers, and go on for a minute."""
    grandchild = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
    draft = Path(path + ".draft")
    draft.write_text(json.dumps([os.getpid(), os.getppid(), grandchild.pid]))
    draft.rename(path)
    time.sleep(60)


def orphan() -> int:
    """Start a process that is not waited for."""
    return subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"]).pid


def surroundings() -> tuple[str, str, bool]:
    """Return a variable of the environment, the working directory, and whether the process leads a session."""
    return os.environ.get("DCAP_SOMETHING", ""), os.getcwd(), os.getsid(0) == os.getpid()


def alive(pid: int) -> bool:
    """Whether a process runs (a dead one that nobody has waited for does not)."""
    with suppress(FileNotFoundError, ProcessLookupError):
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    return False


class CannotTravelError(Exception):
    """An error that no other process can read."""

    def __init__(self, first: int, second: int) -> None:
        super().__init__(f"{first} and {second}")


def fail(how: str, log: str) -> None:
    """Note that this ran, and fail."""
    with Path(log).open("a") as file:
        file.write("ran\n")
    raise {
        "known": InputError("no such thing"),
        "mistake": ValueError("a mistake"),
        "end of a file": EOFError("no more"),
        "cannot travel": CannotTravelError(1, 2),
    }[how]
