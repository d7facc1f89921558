"""Which program a flow run belongs to, and whether that program still runs.

A number of a process is given again, so it counts with the time at which the process started. Whether a program runs
can be told on its own machine only, and in a container only among those that see each other.
"""

import os
import platform
import subprocess
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path

PROC = Path("/proc")
MACHINE_ID = Path("/etc/machine-id")
STATE, START = 0, 19
"""Where they stand in `/proc/PID/stat`, counted behind the name."""
DEAD = frozenset("ZXx")
"""States of processes that have ended, and that nobody has waited for."""


@dataclass(frozen=True, slots=True)
class Program:
    """A program that runs flow runs."""

    host: str
    """Its machine, and in which space of process numbers."""
    pid: int
    started: str
    """When its process started, as the system counts."""

    @classmethod
    def this(cls) -> "Program":
        """The program that asks."""
        pid = os.getpid()
        return cls(this_host(), pid, start_of(pid))

    @classmethod
    def from_json(cls, tree: object) -> "Program | None":
        """What `to_json` gave; None for anything else."""
        if not isinstance(tree, Mapping):
            return None
        host, pid, started = tree.get("host"), tree.get("pid"), tree.get("started")
        if not (isinstance(host, str) and isinstance(pid, int) and isinstance(started, str)):
            return None
        return cls(host, pid, started)

    def to_json(self) -> dict[str, object]:
        """Plain form."""
        return asdict(self)

    @property
    def is_gone(self) -> bool:
        """Whether it has surely ended: of one of another machine, or of another user where those are hidden, nobody
        can tell."""
        return self.host == this_host() and self.started != start_of(self.pid) and not is_hidden(self.pid)


@cache
def this_host() -> str:
    """Name and number of this machine, as many are called alike, with the namespace that process numbers are of; each
    where the system has such."""
    number = space = ""
    with suppress(OSError):
        number = MACHINE_ID.read_text(encoding="utf-8").strip()
    with suppress(OSError):
        space = os.readlink(PROC / "self" / "ns" / "pid")
    return " ".join(one for one in (platform.node(), number, space) if one)


def start_of(pid: int) -> str:
    """When a process started; empty if there is none of that number, or it has ended."""
    if not PROC.is_dir():  # not Linux
        command, fixed = ["ps", "-o", "lstart=", "-p", str(pid)], os.environ | {"LC_ALL": "C", "TZ": "UTC"}
        told = subprocess.run(command, capture_output=True, text=True, check=False, env=fixed)
        return " ".join(told.stdout.split())
    try:
        fields = (PROC / str(pid) / "stat").read_text(encoding="utf-8", errors="replace").rpartition(")")[2].split()
        boot = (PROC / "sys" / "kernel" / "random" / "boot_id").read_text(encoding="utf-8").strip()
    except OSError:
        return ""
    return "" if fields[STATE] in DEAD else f"{boot} {fields[START]}"


def is_hidden(pid: int) -> bool:
    """Whether there is a process of that number, but of another user and not to be seen (`hidepid`)."""
    try:
        os.kill(pid, 0)
    except PermissionError:
        return not (PROC / str(pid)).exists()
    except OSError:
        return False
    return False
