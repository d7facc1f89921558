"""Functions for processes of their own, and who of them is alive."""

import json
import os
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path


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
