"""Locks of records, which stages hold while they compute, with Prefect and without."""

import fcntl
import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import ClassVar

from dcap.scene.settings import cache_root


class FileLocks:
    """Exclusive locks by `flock(2)` for threads and processes of one machine: the kernel releases those of a killed
    process. The methods are those of Prefect's LockManager, which sets no timeouts here."""

    _held: ClassVar[dict[str, tuple[str, int]]] = {}

    def acquire_lock(
        self, key: str, holder: str, acquire_timeout: float | None = None, hold_timeout: float | None = None
    ) -> bool:
        """Wait for a lock."""
        if not self.is_lock_holder(key, holder):
            lock = self._open(key)
            fcntl.flock(lock, fcntl.LOCK_EX)
            self._held[key] = (holder, lock)
        return True

    async def aacquire_lock(
        self, key: str, holder: str, acquire_timeout: float | None = None, hold_timeout: float | None = None
    ) -> bool:
        """Wait for a lock."""
        return self.acquire_lock(key, holder)

    def release_lock(self, key: str, holder: str) -> None:
        """Release a lock that the holder holds."""
        if self.is_lock_holder(key, holder):
            os.close(self._held.pop(key)[1])

    def is_locked(self, key: str) -> bool:
        """Return whether anybody holds a lock."""
        lock = self._open(key)
        try:
            fcntl.flock(lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
        finally:
            os.close(lock)
        return False

    def is_lock_holder(self, key: str, holder: str) -> bool:
        """Return whether this holder in this process holds a lock."""
        return self._held.get(key, ("", -1))[0] == holder

    def wait_for_lock(self, key: str, timeout: float | None = None) -> bool:
        """Wait until nobody holds a lock."""
        lock = self._open(key)
        fcntl.flock(lock, fcntl.LOCK_SH)
        os.close(lock)
        return True

    async def await_for_lock(self, key: str, timeout: float | None = None) -> bool:
        """Wait until nobody holds a lock."""
        return self.wait_for_lock(key)

    @contextmanager
    def held(self, key: str) -> Iterator[None]:
        """Hold a lock inside of the block."""
        holder = str(threading.get_ident())
        self.acquire_lock(key, holder)
        try:
            yield
        finally:
            self.release_lock(key, holder)

    def _open(self, key: str) -> int:
        path = cache_root() / "locks" / f"{Path(key).name}.lock"
        path.parent.mkdir(parents=True, exist_ok=True)
        return os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
