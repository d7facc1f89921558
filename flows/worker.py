"""A worker of the pool: Prefect's own, with a server, the deployments, and a working directory free of foreign modules.

The kernel kills Prefect's worker with this program, and the worker's samples with it.
"""

import os
import platform
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from secrets import token_hex

from dcap.cores import SHARE, available_cores
from dcap.scene.errors import DcapError
from dcap.scene.settings import data_root, shared_store_url
from flows.given_settings import FILE_VARIABLE, settings_file
from flows.server import pages_of, prefect_server
from tasks.process import die_with_parent

HEARTBEAT_SECONDS = 10
STOP_SECONDS = 10.0


def serve_pool(at_a_time: int, announce: Callable[[str], None]) -> None:
    """Serve the pool until interrupted; `announce` is called with a line when the worker starts."""
    with prefect_server() as url, tempfile.TemporaryDirectory(prefix="dcap-worker-") as folder:
        from flows.pool import POOL, WORKER, register

        register()
        name = f"{platform.node()}-{os.getpid()}-{token_hex(3)}"  # restarted containers share name and number
        environment = (
            os.environ
            | whole_places()
            | {
                SHARE: str(max(1, available_cores() // at_a_time)),
                WORKER: name,
                "PYTHONSAFEPATH": "1",  # its processes import nothing from the working directory
                "PREFECT_WORKER_HEARTBEAT_SECONDS": str(HEARTBEAT_SECONDS),
            }
        )
        words = ("worker", "start", "--pool", POOL, "--type", "process", "--name", name, "--limit", str(at_a_time))
        process = subprocess.Popen(
            [sys.executable, "-P", "-m", "prefect", *words], env=environment, cwd=folder, preexec_fn=die_with_parent
        )
        announce(f"worker {name} of the pool {POOL!r}, server {pages_of(url)}, {at_a_time} at a time")
        try:
            status = process.wait()
        finally:
            process.terminate()
            try:
                process.wait(STOP_SECONDS)
            except subprocess.TimeoutExpired:
                process.kill()
    raise DcapError(f"Prefect's worker ended with status {status}; see its output above")


def whole_places() -> dict[str, str]:
    """Return environment variables with absolute paths of the folders that a worker shares with this program."""
    store, given = shared_store_url(), settings_file()
    places = {"DCAP_DATA": str(data_root())}
    if store:
        places["DCAP_STORE"] = store if "://" in store else str(Path(store).resolve())
    if given is not None:
        places[FILE_VARIABLE] = str(given)
    return places
