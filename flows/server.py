"""A real local Prefect server for as long as programs use it: Prefect's built-in temporary one loses history.

`prefect server start` runs in the foreground of a session of its own, on the promised port or a free one, with its
database in the cache. Each program that uses it holds a shared lock, which the kernel releases when the program ends; a
keeper process (`main` below) waits until nobody holds the lock, and then stops the server. A server that
$PREFECT_API_URL names is used and never stopped.
"""

import ctypes
import fcntl
import json
import logging
import os
import signal
import socket
import subprocess
import sys
import threading
import time
import tomllib
import urllib.request
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import chdir, contextmanager, suppress
from functools import cache
from http.client import HTTPException
from importlib.util import find_spec
from pathlib import Path

from dcap.packages import module_command
from dcap.scene.errors import DcapError, InputError
from dcap.scene.secrets import has_log_in, redacted_url
from dcap.scene.settings import resource, server_folder
from dcap.scene.written_files import write_whole
from dcap.shared_context import SharedContext
from flows.own_requests import LOOPBACK, is_loopback, url_host
from tasks.machine_errors import API_URL, LOGIN, OWN_URL
from tasks.process import die_with_parent

HOST, SERVER_LOGIN = "PREFECT_SERVER_API_HOST", "PREFECT_SERVER_API_AUTH_STRING"
"""Prefect's settings of a server: the address that it listens on, and the `NAME:PASSWORD` that it requires."""
DATABASE, OLD_DATABASE = "PREFECT_SERVER_DATABASE_CONNECTION_URL", "PREFECT_API_DATABASE_CONNECTION_URL"
RETRIES = "PREFECT_CLIENT_MAX_RETRIES"
CLONE_FS = 0x200
"""CLONE_FS: the flag of `unshare` for the working directory of a thread (sched.h)."""
USERS, STARTING, SERVING = "users.lock", "starting.lock", "serving.lock"
"""Lock files in the server's folder: for its users, for the program that starts it, and for its keeper."""
ADDRESS, LOG = "server.json", "server.log"
PORT = 4200
START_SECONDS = 120.0
"""Longest wait for a start [s]: the first one creates the database, in 8 s on two idle cores."""
STOP_SECONDS, POLL_SECONDS = 10.0, 0.5
PATIENT_SECONDS = 10.0
"""Longest wait for a named server, which may be busy [s]."""
LOOK_SECONDS, MOST_MISSED = 5.0, 2
_reading = threading.Lock()
_retries_before: dict[str, str] = {}
"""RETRIES as it was before a server was given up; empty while none is."""


@contextmanager
def prefect_server(port: int = PORT, *, only_there: bool = False) -> Iterator[str]:
    """Set $PREFECT_API_URL to a healthy server inside of the block, and yield it; one is started if none runs.

    Where the port is taken, a new server gets a free one, or is refused if it may be `only_there`.
    """
    reach_this_machine()
    given = os.environ.get(API_URL, "")
    if given and not is_healthy(given, PATIENT_SECONDS):
        raise DcapError(f"{API_URL}={redacted_url(given)}: {unanswered(given)}")
    with _as_own_server(given or _joined_server(port, only_there)) as url:
        yield url


@contextmanager
def watching_server(say: Callable[[str], object]) -> Iterator[str]:
    """Like `prefect_server`, but only if a server runs already; else yields an empty string, and says so if a server
    was named."""
    reach_this_machine()
    given = os.environ.get(API_URL, "")
    if not given and _kept_url():
        _use(server_folder())  # from here on it stays as long as this process
    url = given or _kept_url()  # check again: it may have been about to end
    if url and is_healthy(url, PATIENT_SECONDS):
        with _as_own_server(url) as named:
            yield named
        return
    if url:
        say(f"the Prefect server at {pages_of(url)} does not answer: this placement will not be on its pages")
    yield ""


def reach_this_machine() -> None:
    """Bypass the environment's proxy for servers of this machine."""
    known = urllib.request.getproxies_environment().get("no", "")
    missing = [host for host in ("localhost", LOOPBACK) if host not in known.split(",")]
    os.environ["no_proxy"] = ",".join(filter(None, (known, *missing)))


def _kept_url() -> str:
    """Return the address of the server of this data folder, whose keeper lives; empty if there is none."""
    folder = server_folder()
    try:
        with (folder / SERVING).open() as file:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        return ""  # its keeper has ended, and a foreign server may have its port by now
    except BlockingIOError:
        pass
    except OSError:
        return ""
    try:
        return str(json.loads((folder / ADDRESS).read_bytes())["url"])
    except (OSError, ValueError, KeyError, TypeError):
        return ""


def is_healthy(url: str, seconds: float = 2.0) -> bool:
    """Return whether a server of Prefect answers at an address within some time [s]."""
    try:
        with urllib.request.urlopen(f"{url}/health", timeout=seconds) as answer:
            return bytes(answer.read(100)) == b"true"
    except (OSError, ValueError, HTTPException):
        return False


def unanswered(url: str) -> str:
    """Return why a named server cannot be used, and what to do."""
    if has_log_in(url):
        return f"an address must not contain a login; set {LOGIN}=NAME:PASSWORD"
    if not url.startswith(("http://", "https://")):
        return "an address of a server begins with http:// or https://"
    if is_healthy(f"{url.rstrip('/')}/api"):
        return f"the address of Prefect's server ends in /api: {redacted_url(url.rstrip('/'))}/api"
    return "no server of Prefect answers there; start it or unset the variable"


def wait_for_end(url: str) -> None:
    """Wait until a server has ended: our own when its keeper is gone, another when it no longer answers."""
    missed = 0
    while missed < MOST_MISSED and not own_server_has_ended():
        time.sleep(LOOK_SECONDS)
        missed = 0 if OWN_URL in os.environ or is_healthy(url, PATIENT_SECONDS) else missed + 1


def own_server_has_ended() -> bool:
    """Return whether the server that this program started is gone; a slow server is not."""
    url = os.environ.get(OWN_URL, "")
    return url != "" and _kept_url() != url


def give_up_server() -> None:
    """Let Prefect send each request to the lost server only once, until another server is used."""
    if not was_given_up():
        _retries_before.setdefault(RETRIES, os.environ.get(RETRIES, "0"))  # threads may lose a server together
        os.environ[RETRIES] = "0"
        apply_settings()


def was_given_up() -> bool:
    """Return whether the server was lost: Prefect's pending updates would keep the program from ending."""
    return bool(_retries_before)


def pages_of(url: str) -> str:
    """Return the address of a server's pages, without credentials."""
    return redacted_url(url.removesuffix("/api"))


def apply_settings() -> None:
    """Apply our settings, and import Prefect from a folder without settings: it reads `.env`, `prefect.toml` and
    `pyproject.toml` of the working directory, which may belong to a downloaded data set."""
    _set_environment()
    with ThreadPoolExecutor(1) as thread:
        thread.submit(_read_settings).result()


def _read_settings() -> None:
    """Let Prefect read its settings in the server's folder, in a thread of its own.

    The thread gets a working directory of its own, where the system and the container allow it: other threads may be
    placing samples whose paths are relative to theirs.
    """
    if sys.platform == "linux":
        ctypes.CDLL(None).unshare(CLONE_FS)
    with _reading, chdir(server_folder()):
        if "prefect" not in sys.modules:
            import prefect  # noqa: F401
        else:  # it was imported for an earlier server
            from prefect.context import refresh_global_settings_context

            refresh_global_settings_context()


def _set_environment() -> None:
    """Put the project's prefect.toml into the environment; variables that are already set win."""
    tree = tomllib.loads(resource("prefect.toml").read_text(encoding="utf-8"))
    for name, value in _flattened(tree, "PREFECT"):
        os.environ.setdefault(name, value)
    os.environ.setdefault("DO_NOT_TRACK", "1")
    if "PREFECT_HOME" not in os.environ:
        os.environ["PREFECT_HOME"] = str(server_folder())
        # ignore a file in the data folder too, which may be another user's
        own = Path(str(find_spec("prefect").origin)).parent  # type: ignore[union-attr]
        os.environ.setdefault("PREFECT_PROFILES_PATH", str(own / "settings" / "profiles.toml"))
        os.environ.setdefault("PREFECT_LOGGING_CONFIG_PATH", str(own / "logging" / "logging.yml"))
    # runs report to the server; the terminal belongs to our own lines
    os.environ.setdefault("PREFECT_LOGGING_HANDLERS_CONSOLE_LEVEL", "CRITICAL")
    os.environ.setdefault("PREFECT_INTERNAL_LOGGING_LEVEL", "CRITICAL")
    server_folder().mkdir(parents=True, exist_ok=True)


@contextmanager
def _as_own_server(url: str) -> Iterator[str]:
    """Name a server in the environment of this process and its children, and let Prefect see it. If another thread has
    named one already, that one stays."""
    with _shared_name(url):
        apply_settings()
        yield os.environ[API_URL]


@contextmanager
def _named(url: str) -> Iterator[None]:
    """Name a server in the environment if none is named there, and forget that an earlier one was lost."""
    own = {} if os.environ.get(API_URL) else {API_URL: url, OWN_URL: url}
    if own and SERVER_LOGIN in os.environ and LOGIN not in os.environ:
        own[LOGIN] = os.environ[SERVER_LOGIN]
    os.environ.update(own | _retries_before)
    _retries_before.clear()
    logging.raiseExceptions = False  # logs that a lost server does not take are dropped silently
    try:
        yield
    finally:
        for name in own:
            os.environ.pop(name, None)
        os.environ.update(_retries_before)


_shared_name = SharedContext(_named)


def _joined_server(port: int, only_there: bool) -> str:
    """Return the address of the server of this data folder, started if need be; this process counts as its user."""
    folder = server_folder()
    folder.mkdir(parents=True, exist_ok=True)
    _use(folder)
    while not (url := _wait_for_running(folder)):
        with (folder / STARTING).open("w") as file:
            fcntl.flock(file, fcntl.LOCK_EX)  # programs that start at the same moment share one server
            if not _kept_url():
                return _start(folder, port, only_there)
    return url


def _wait_for_running(folder: Path) -> str:
    """Return the address of the server of this data folder once it answers; empty if none runs.

    A slow server is waited for, since no second one can be started.
    """
    deadline = time.monotonic() + START_SECONDS
    while url := _kept_url():
        if is_healthy(url):
            return url
        if time.monotonic() > deadline:
            raise DcapError(f"the Prefect server at {pages_of(url)} does not answer; {_how_to_stop(folder)}")
        time.sleep(POLL_SECONDS)
    return ""


def _how_to_stop(folder: Path) -> str:
    """Return how to stop the server of a data folder: its keeper's process if known, and its log."""
    with suppress(OSError):
        if (keeper := (folder / SERVING).read_text().strip()).isdigit():
            return f"stop process {keeper} (log: {folder / LOG})"
    return f"stop it (log: {folder / LOG})"


@cache
def _use(folder: Path) -> int:
    """Hold the shared lock of the users until this process ends; waits while a server is being stopped."""
    lock = os.open(folder / USERS, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
    fcntl.flock(lock, fcntl.LOCK_SH)
    return lock


def _start(folder: Path, port: int, only_there: bool) -> str:
    """Start a server, wait until it is healthy, and return its address."""
    host = os.environ.get(HOST) or LOOPBACK
    if not is_loopback(host) and not all(os.environ.get(SERVER_LOGIN, "").partition(":")):
        raise InputError(
            f"{HOST}={host}: others would reach a server without authentication; set {SERVER_LOGIN}=NAME:PASSWORD"
        )
    if not _is_free(host, port):
        if only_there:
            raise InputError(
                f"port {port} of {host} is taken; stop the program that listens there, or choose another with --port"
            )
        port = _free_port(host)
    url = f"http://{url_host(host)}:{port}/api"
    write_whole(folder / ADDRESS, json.dumps({"url": url}).encode())
    with (folder / LOG).open("wb") as log:
        keeper = subprocess.Popen(
            module_command("flows.server", str(folder), host, str(port)),
            stdin=subprocess.DEVNULL, stdout=log, stderr=log, start_new_session=True,
        )  # fmt: skip
    deadline = time.monotonic() + START_SECONDS
    while not is_healthy(url):
        if keeper.poll() is not None or time.monotonic() > deadline:
            keeper.terminate()
            words = (folder / LOG).read_text(encoding="utf-8", errors="replace").split("\n")
            last = next((line for line in reversed(words) if line.strip()), "it wrote nothing").strip()
            raise DcapError(f"the Prefect server on port {port} did not start: {last[:300]} (log: {folder / LOG})")
        time.sleep(0.1)
    return url


def _is_free(host: str, port: int) -> bool:
    with socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET) as one:
        one.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            one.bind((host, port))
        except OSError:
            return False
        return True


def _free_port(host: str) -> int:
    with socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET) as one:
        one.bind((host, 0))
        return int(one.getsockname()[1])


def _flattened(tree: dict[str, object], prefix: str) -> Iterator[tuple[str, str]]:
    """Yield `[server] analytics_enabled = false` as PREFECT_SERVER_ANALYTICS_ENABLED=false."""
    for key, value in tree.items():
        name = f"{prefix}_{key.upper()}"
        if isinstance(value, dict):
            yield from _flattened(value, name)
        else:
            yield name, str(value).lower() if isinstance(value, bool) else str(value)


def main() -> None:
    """Keep a server until nobody uses it: FOLDER HOST PORT."""
    folder, host, port = Path(sys.argv[1]), sys.argv[2], sys.argv[3]
    _set_environment()
    serving = (folder / SERVING).open("a")
    fcntl.flock(serving, fcntl.LOCK_EX)  # until this process ends
    serving.truncate(0)
    print(os.getpid(), file=serving, flush=True)
    environment = os.environ | {
        "PREFECT_SERVER_API_PORT": port,
        "PREFECT_HOME": str(folder),
        "PREFECT_UI_API_URL": "/api",  # whichever address the pages came from
        "PREFECT_SERVER_CORS_ALLOWED_ORIGINS": f"http://{url_host(host)}:{port}",  # but no page of another site
    }
    if OLD_DATABASE not in environment:
        environment.setdefault(DATABASE, f"sqlite+aiosqlite:///{folder / 'prefect.db'}")
    environment.pop(API_URL, None)
    command = [sys.executable, "-P", "-m", "prefect", "server", "start", "--host", host, "--port", port]
    server = subprocess.Popen(command, env=environment, cwd=folder, preexec_fn=die_with_parent)
    with serving, (folder / USERS).open("a") as users:
        while server.poll() is None:
            try:
                fcntl.flock(users, fcntl.LOCK_EX | fcntl.LOCK_NB)  # programs that start now wait for its end
                break
            except BlockingIOError:
                time.sleep(POLL_SECONDS)
        server.send_signal(signal.SIGINT)
        try:
            server.wait(STOP_SECONDS)
        except subprocess.TimeoutExpired:
            server.kill()
            server.wait()


if __name__ == "__main__":
    main()
