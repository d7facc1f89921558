"""The process of the local server: Prefect's own, which ends itself once no program uses it.

In: the folder of the server, the address and the port. Each program that uses the server holds a lock on a file in that
folder, also while it starts one, and the kernel lets go of it however the program ends. So a server never stays alone,
not even one whose program was killed before it had answered.
"""

import fcntl
import os
import runpy
import signal
import sys
import threading
import time
from contextlib import asynccontextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flows.own_requests import OwnRequests, OwnRequestsOnly
from flows.prefect_settings import apply_settings

if TYPE_CHECKING:
    from collections.abc import AsyncGenerator

    from sqlalchemy.ext.asyncio import AsyncSession, AsyncSessionTransaction
    from starlette.types import ASGIApp

ORIGINS = "PREFECT_SERVER_CORS_ALLOWED_ORIGINS"
"""Prefect's setting of whose pages may ask, `https://name` between commas."""
USERS = "users.lock"
"""File that each user of the server has locked shared."""
POLL_SECONDS = 0.5
END_SECONDS = 3.0
"""For how long requests that are under way may end."""


def main() -> None:
    """Serve until interrupted, or until nobody uses the server."""
    folder, host, port = Path(sys.argv[1]), sys.argv[2], sys.argv[3]
    apply_settings()
    threading.Thread(target=end_when_unused, args=(folder / USERS,), daemon=True).start()
    answer_own_requests(host)
    lock_before_reading()
    sys.argv = ["prefect", "server", "start", "--host", host, "--port", port]
    runpy.run_module("prefect", run_name="__main__", alter_sys=True)


def answer_own_requests(host: str) -> None:
    """Let Prefect's server refuse what pages of other origins ask: it takes orders from any, and knows no names."""
    import uvicorn

    run, before = uvicorn.run, [one for one in os.environ.get(ORIGINS, "").split(",") if "://" in one]

    def run_guarded(app: "ASGIApp", **how: Any) -> None:
        run(OwnRequestsOnly(app, OwnRequests.to(host, before), ORIGINS), **how)

    uvicorn.run = run_guarded  # type: ignore[assignment]  # Prefect calls it with the whole application


def lock_before_reading() -> None:
    """Let a transaction that will write lock its SQLite database when it begins, as Prefect does for some of them.

    One that reads first and locks later fails at once if another has written in between: "database is locked", with no
    waiting. The server then answers 503, and its client asks again after two seconds. The lock is for this transaction:
    what is read within it over another connection begins as it would have."""
    from prefect.server.database.configurations import SQLITE_BEGIN_MODE, AioSqliteConfiguration

    @asynccontextmanager
    async def begin_locked(
        configuration: AioSqliteConfiguration, session: "AsyncSession", with_for_update: bool = False
    ) -> "AsyncGenerator[AsyncSessionTransaction]":
        async with session.begin() as transaction:
            before = SQLITE_BEGIN_MODE.set("IMMEDIATE")
            try:
                await session.connection()
            finally:
                SQLITE_BEGIN_MODE.reset(before)
            yield transaction

    AioSqliteConfiguration.begin_transaction = begin_locked  # type: ignore[method-assign, assignment]


def end_when_unused(users: Path) -> None:
    """Wait until nobody holds the lock, and end this process and what it started; who comes now waits for the lock
    until that is done."""
    with users.open("a") as file:
        while not taken(file.fileno()):
            time.sleep(POLL_SECONDS)
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(END_SECONDS)
        os.killpg(0, signal.SIGKILL)


def taken(descriptor: int) -> bool:
    """Take the lock if nobody has it."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


if __name__ == "__main__":
    main()
