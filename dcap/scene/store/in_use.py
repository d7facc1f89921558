"""Who uses a cache: each program that opens it holds a shared lock, and what deletes from it needs the lock alone.

The locks are those of `flock(2)`: whoever dies lets go. A cache that cannot be written has no lock, and nothing can be
deleted from it either.
"""

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from dcap.scene.errors import StoreError

LOCK = "in-use.lock"
"""Name of the locked file in the folder of the cache."""

held: dict[Path, int] = {}
"""Open files by the folder of the cache; locks last as long as the program."""


def note_use(cache: Path) -> None:
    """Hold the shared lock of a cache until this program ends; waits while something is deleted from it."""
    if cache in held:
        return
    try:
        cache.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(cache / LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o644)
    except OSError:  # read-only or full: what cannot be written has nothing to protect, and says so where it is written
        return
    fcntl.flock(descriptor, fcntl.LOCK_SH)
    held[cache] = descriptor


@contextmanager
def used_alone(cache: Path) -> Iterator[None]:
    """While inside, no other program opens this cache; StoreError if one has it open."""
    note_use(cache)
    if cache not in held:
        raise StoreError(f"{cache} cannot be written, so nothing can be deleted from it")
    descriptor = held[cache]
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        fcntl.flock(descriptor, fcntl.LOCK_SH)  # a lock that could not be raised is lost
        raise StoreError(f"{cache} is in use by {users(descriptor)}; wait until that has ended") from None
    try:
        yield
    finally:
        fcntl.flock(descriptor, fcntl.LOCK_SH)


def users(descriptor: int) -> str:
    """Other programs that hold a lock on an open file, in words."""
    inode = str(os.fstat(descriptor).st_ino)
    try:
        lines = [line.split() for line in Path("/proc/locks").read_text(encoding="utf-8").splitlines()]
    except OSError:  # not on Linux
        lines = []
    holders = (line for line in lines if line[1] == "FLOCK")  # those that wait have an arrow there
    found = {line[4] for line in holders if line[5].split(":")[-1] == inode}
    others = sorted(found - {str(os.getpid()), "0", "-1"}, key=int)
    return f"process {', '.join(others)}" if others else "another program"
