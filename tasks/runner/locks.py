"""Locks by `flock(2)`: whoever dies lets go, so a killed run never blocks the next one."""

import errno
import fcntl
import os
import threading
import time
import uuid
from pathlib import Path
from typing import Self

from dcap.scene.store.building import make_folder, remove

POLL_S = 0.05
LOCK_SUFFIX = ".lock"
NO_FILE = frozenset({errno.EISDIR, errno.ELOOP, errno.ENXIO})
"""How opening a folder, a link or a socket fails."""


class FileLocks:
    """Named exclusive locks for threads and processes of one machine; the interface is Prefect's LockManager."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._held: dict[str, tuple[str, int]] = {}
        self._guard = threading.Lock()

    def __deepcopy__(self, memo: dict[int, object]) -> Self:
        """Copies of a cache policy share their locks."""
        return self

    def acquire_lock(
        self, key: str, holder: str, acquire_timeout: float | None = None, hold_timeout: float | None = None
    ) -> bool:
        """Wait until the lock is ours, at most `acquire_timeout` [s]; false if it is not."""
        if self.is_lock_holder(key, holder):
            return True
        descriptor = self._opened(key)
        deadline = None if acquire_timeout is None else time.monotonic() + acquire_timeout
        while not try_lock(descriptor):
            if deadline is not None and time.monotonic() >= deadline:
                os.close(descriptor)
                return False
            time.sleep(POLL_S)
        with self._guard:
            self._held[key] = (holder, descriptor)
        return True

    async def aacquire_lock(
        self, key: str, holder: str, acquire_timeout: float | None = None, hold_timeout: float | None = None
    ) -> bool:
        """As `acquire_lock`."""
        return self.acquire_lock(key, holder, acquire_timeout, hold_timeout)

    def release_lock(self, key: str, holder: str) -> None:
        """Let go; only the holder may."""
        with self._guard:
            owner, descriptor = self._held.get(key, ("", -1))
            if owner != holder:
                raise ValueError(f"{holder} does not hold the lock {key}")
            del self._held[key]
        os.close(descriptor)

    def is_locked(self, key: str) -> bool:
        """Whether anybody holds the lock."""
        if not self._path(key).is_file():
            return False
        descriptor = self._opened(key)
        try:
            return not try_lock(descriptor)
        finally:
            os.close(descriptor)

    def is_lock_holder(self, key: str, holder: str) -> bool:
        """Whether this holder in this process has the lock."""
        with self._guard:
            return self._held.get(key, ("", -1))[0] == holder

    def wait_for_lock(self, key: str, timeout: float | None = None) -> bool:
        """Wait until nobody holds the lock, at most `timeout` [s]; false if somebody still does."""
        deadline = None if timeout is None else time.monotonic() + timeout
        while self.is_locked(key):
            if deadline is not None and time.monotonic() >= deadline:
                return False
            time.sleep(POLL_S)
        return True

    async def await_for_lock(self, key: str, timeout: float | None = None) -> bool:
        """As `wait_for_lock`."""
        return self.wait_for_lock(key, timeout)

    def _path(self, key: str) -> Path:
        return self.folder / f"{Path(key).name}{LOCK_SUFFIX}"

    def _opened(self, key: str) -> int:
        """The open file of a lock; what stands in its place and is no file goes."""
        make_folder(self.folder, self.folder.with_name(f"{self.folder.name}-{uuid.uuid4().hex}"))
        path = self._path(key)
        flags = os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW
        try:
            return os.open(path, flags, 0o644)
        except OSError as error:
            if error.errno not in NO_FILE:
                raise
        remove(path)
        return os.open(path, flags, 0o644)


def try_lock(descriptor: int) -> bool:
    """Take the lock of an open file if it is free."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True
