"""A real local Prefect server for as long as work runs: Prefect's built-in temporary one loses history.

The server keeps its database in the cache and listens on a free port of this machine only. Programs that run at the
same time share it; the last one to leave stops it by its process id. A server that $PREFECT_API_URL names is used and
left alone.
"""

import fcntl
import json
import os
import signal
import socket
import subprocess
import sys
import time
import tomllib
import urllib.error
import urllib.request
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path

from dcap.packages import module_command
from dcap.scene.errors import DcapError
from dcap.scene.settings import cache_root, resource

START_SECONDS = 300.0
"""A start that takes longer hangs. A first one creates the database: 8 s on two idle cores, over 90 s on busy ones."""
STOP_SECONDS = 10.0
DELIVER_SECONDS = 15.0


@contextmanager
def prefect_server(port: int | None = None) -> Iterator[str]:
    """URL of a healthy server, also in $PREFECT_API_URL, as long as the block runs."""
    apply_settings()
    given = os.environ.get("PREFECT_API_URL")
    if given:
        if not is_healthy(given):
            raise DcapError(f"PREFECT_API_URL={given}: no server answers there; start it or unset the variable")
        yield given
        return
    folder = cache_root() / "prefect"
    folder.mkdir(parents=True, exist_ok=True)
    with one_at_a_time(folder):
        url = running_url(folder) or start(folder, port or free_port())
        users = lock_users(folder, fcntl.LOCK_SH)
    os.environ["PREFECT_API_URL"] = url
    notice_settings()
    try:
        yield url
    finally:
        deliver_reports()
        os.environ.pop("PREFECT_API_URL", None)
        with one_at_a_time(folder):
            os.close(users)
            if nobody_uses(folder):
                stop(folder)


def lock_users(folder: Path, kind: int) -> int:
    """Lock the file that every user of the server holds shared, even if killed only as long as it lives."""
    descriptor = os.open(folder / "users.lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
    try:
        fcntl.flock(descriptor, kind | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(descriptor)
        raise
    return descriptor


def nobody_uses(folder: Path) -> bool:
    """Whether no program uses the server any more."""
    try:
        os.close(lock_users(folder, fcntl.LOCK_EX))
    except BlockingIOError:
        return False
    return True


def notice_settings() -> None:
    """Let a Prefect that was imported for an earlier server see the new address."""
    if "prefect" in sys.modules:
        from prefect.context import refresh_global_settings_context

        refresh_global_settings_context()


def deliver_reports() -> None:
    """Wait until logs and states of finished runs have reached the server."""
    if "prefect" not in sys.modules:
        return
    from prefect.events.worker import EventsWorker
    from prefect.logging.handlers import APILogWorker

    with ThreadPoolExecutor(1) as waiting:  # in a thread where a notebook's loop runs, Prefect would not wait
        for worker in (EventsWorker, APILogWorker):
            waiting.submit(worker.drain_all, timeout=DELIVER_SECONDS).result()


def apply_settings() -> None:
    """Put the project's prefect.toml into the environment, wherever the program was started."""
    tree = tomllib.loads(resource("prefect.toml").read_text())
    for name, value in flattened(tree, "PREFECT"):
        os.environ.setdefault(name, value)
    os.environ.setdefault("DO_NOT_TRACK", "1")
    os.environ.setdefault("PREFECT_HOME", str(cache_root() / "prefect"))
    # runs report to the server; the terminal belongs to our own lines
    os.environ.setdefault("PREFECT_LOGGING_HANDLERS_CONSOLE_LEVEL", "CRITICAL")


def flattened(tree: dict[str, object], prefix: str) -> Iterator[tuple[str, str]]:
    """`[server] analytics_enabled = false` as PREFECT_SERVER_ANALYTICS_ENABLED=false."""
    for key, value in tree.items():
        name = f"{prefix}_{key.upper()}"
        if isinstance(value, dict):
            yield from flattened(value, name)
        else:
            yield name, str(value).lower() if isinstance(value, bool) else str(value)


@contextmanager
def one_at_a_time(folder: Path) -> Iterator[None]:
    """Programs that start or stop at the same moment share one server."""
    with (folder / "server.lock").open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


def running_url(folder: Path) -> str:
    """URL of the healthy server on this database; empty if there is none."""
    try:
        url = str(json.loads((folder / "server.json").read_text())["url"])
    except (OSError, ValueError, KeyError):
        return ""
    return url if is_healthy(url) else ""


def is_healthy(url: str) -> bool:
    """Whether a server answers."""
    try:
        with urllib.request.urlopen(f"{url}/health", timeout=2) as answer:
            return bool(answer.status == 200)
    except (urllib.error.URLError, OSError, ValueError):
        return False


def free_port() -> int:
    """A port of this machine that nobody listens on now."""
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


def start(folder: Path, port: int) -> str:
    """Start a server, wait until it is healthy, and return its URL."""
    url = f"http://127.0.0.1:{port}/api"
    environment = os.environ | {
        "PREFECT_API_DATABASE_CONNECTION_URL": f"sqlite+aiosqlite:///{folder / 'prefect.db'}",
        "PREFECT_SERVER_API_PORT": str(port),
        "PREFECT_UI_API_URL": url,
        "PYTHONSAFEPATH": "1",  # what the server starts takes nothing from the working directory either
    }
    log_path = folder / "server.log"
    with log_path.open("wb") as log:
        process = subprocess.Popen(
            module_command("prefect", "server", "start", "--host", "127.0.0.1", "--port", str(port)),
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=log,
            start_new_session=True,
        )
    (folder / "server.json").write_text(json.dumps({"url": url, "pid": process.pid}))
    deadline = time.monotonic() + START_SECONDS
    while not is_healthy(url):
        if process.poll() is not None or time.monotonic() > deadline:
            stop(folder)
            raise DcapError(f"the Prefect server on port {port} did not start; its log is {log_path}")
        time.sleep(0.2)
    return url


def stop(folder: Path) -> None:
    """Stop the server that this project started on this database, with its helpers."""
    pid = int(json.loads((folder / "server.json").read_text())["pid"])
    (folder / "server.json").unlink()
    if not is_server(pid):
        return
    for kind in (signal.SIGINT, signal.SIGKILL):
        with suppress(ProcessLookupError):
            os.killpg(pid, kind)
        deadline = time.monotonic() + STOP_SECONDS
        while is_server(pid) and time.monotonic() < deadline:
            with suppress(ChildProcessError):  # another program started it and waits for it
                os.waitpid(pid, os.WNOHANG)
            time.sleep(0.05)


def is_server(pid: int) -> bool:
    """Whether a process is a Prefect server that still runs: numbers are given again after a restart of the machine."""
    try:
        words = Path(f"/proc/{pid}/cmdline").read_bytes().split(b"\0")
    except OSError:
        return False
    return b"prefect" in words and b"server" in words
