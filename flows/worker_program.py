"""The process of a worker: Prefect's own, which ends with whoever started it.

In: the process id of the parent, and the arguments of Prefect. A parent that is killed ends nothing: its worker would
take samples for ever, or ask a server that is gone. It is killed with the processes of its samples, as all would be
with their machine, so that those begin again elsewhere.
"""

import os
import runpy
import signal
import sys
import threading
import time
from collections.abc import Callable, Coroutine, Iterable
from contextlib import suppress
from functools import wraps
from typing import Any

import psutil

from flows.prefect_settings import apply_settings

POLL_SECONDS = 0.5
GIVES_UP = "exceeded error threshold"
"""What the RuntimeError of a loop says that has met its server too often in vain."""
Loop = Callable[..., Coroutine[Any, Any, None]]


def main() -> None:
    """Work until interrupted, or until the parent has gone."""
    threading.Thread(target=end_with, args=(int(sys.argv[1]),), daemon=True).start()
    apply_settings()
    be_patient()
    sys.argv = ["prefect", *sys.argv[2:]]
    runpy.run_module("prefect", run_name="__main__", alter_sys=True)


def be_patient() -> None:
    """Ask a server that is away for ever: Prefect's worker ends after a quarter of an hour, and its samples with it."""
    from prefect.utilities import services

    services.critical_service_loop = patient(services.critical_service_loop)


def patient(loop: Loop) -> Loop:
    """One of Prefect's loops, which begins anew where it would give up."""

    @wraps(loop)
    async def for_ever(*args: Any, **kwargs: Any) -> None:
        while True:
            try:
                return await loop(*args, **kwargs)
            except RuntimeError as error:
                if GIVES_UP not in str(error):
                    raise

    return for_ever


def end_with(parent: int) -> None:
    """Kill this process and all that it has started once its parent has gone."""
    try:
        while os.getppid() == parent:
            time.sleep(POLL_SECONDS)
        for _ in range(2):  # one may have started another meanwhile
            kill(started_by(os.getpid()))
    finally:
        os.kill(os.getpid(), signal.SIGKILL)


def started_by(pid: int) -> list[psutil.Process]:
    """What a process has started, and what that has, whatever sessions they lead; empty where it is gone."""
    with suppress(psutil.Error):
        return list(psutil.Process(pid).children(recursive=True))
    return []


def kill(processes: Iterable[psutil.Process]) -> None:
    """Kill those that are still there."""
    for one in processes:
        with suppress(psutil.Error):  # it knows them by their start, too: a number may be another's by now
            one.kill()


if __name__ == "__main__":
    main()
