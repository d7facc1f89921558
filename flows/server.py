"""A real local Prefect server for as long as work runs: Prefect's built-in temporary one loses history.

The server keeps its database in the cache, unless one is named, and listens on a free port of this machine only.
Programs that run at the same time share it; the last one to leave stops it, and it ends itself where the last one was
killed. One that dies under a run is started again, on the same database and port. A server that $PREFECT_API_URL names
is used and left alone.
"""

import errno
import fcntl
import json
import logging
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
import urllib.request
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, nullcontext, suppress
from functools import partial
from http.client import HTTPException
from pathlib import Path
from urllib.parse import urlsplit

from dcap.packages import module_command
from dcap.scene.errors import DcapError, InputError
from dcap.scene.given_text import shortened
from dcap.scene.machine_errors import free_space
from dcap.scene.redaction import has_log_in, redacted_url
from dcap.scene.secrets import redacted
from dcap.scene.settings import server_folder
from dcap.scene.team_server import API_URL, LOGIN, OWN_URL, team_server
from dcap.scene.whole_files import write_whole
from flows.interrupts import say
from flows.own_requests import LOOPBACK, is_loopback, url_host
from flows.prefect_settings import apply_settings
from flows.server_program import USERS

PROGRAM = "flows.server_program"
HOST, AUTH_STRING = "PREFECT_SERVER_API_HOST", "PREFECT_SERVER_API_AUTH_STRING"
"""Prefect's settings of a server: the address that it listens on, and `NAME:PASSWORD` of who may ask."""
DATABASES = "PREFECT_SERVER_DATABASE_CONNECTION_URL", "PREFECT_API_DATABASE_CONNECTION_URL"
"""Prefect's setting of a server's database, by its new and its old name; where neither is set, it is a file."""
START_SECONDS = 300.0
"""A first start creates the database, which takes 8 s on two idle cores; more than a minute on busy ones."""
STOP_SECONDS = 10.0
INTERRUPTED_STOP_SECONDS = 0.5
"""Who interrupts a run does not wait for requests that are under way; states of flow runs are in the database by
then."""
DELIVER_SECONDS = 15.0
LISTEN_SECONDS, MOST_MISSED = 5.0, 2
"""How often a server is looked for, and how often in vain until it counts as away: one may be busy."""
WATCH_SECONDS = 0.5
"""How often a run looks whether its server lives."""
HEALTHY = b"true"
"""What a server of Prefect says of its health; pages of any kind may answer, too."""
ERROR_LINE = re.compile(r"[\w.]*(Error|Exception)\b.*:")
"""How the last line of a traceback begins."""
LONGEST_LINE, LOG_END = 300, 1 << 13
"""Letters of a line of a log that is shown, and bytes of its end that are read."""
SHORT_ANSWER = 100
"""Bytes of an answer that are read of whoever speaks at an address."""
LEAST_ROOM = 8 << 20
"""A new database with its journal takes 5 MB."""
ROOM = "make room, or name a folder on another disk with DCAP_DATA"


@contextmanager
def prefect_server(port: int | None = None, *, tells: bool = True) -> Iterator[str]:
    """URL of a healthy server, also in $PREFECT_API_URL, as long as the block runs. It `tells` where a server of others
    is away for a while."""
    with quiet_logging(), some_server(port, tells=tells) as url:
        yield url


@contextmanager
def quiet_logging() -> Iterator[None]:
    """What a server does not take of logs, its disk being full, is dropped without a word: Prefect's client would write
    each time to the terminal, and what is wrong is told by what else was asked of the server."""
    before, logging.raiseExceptions = logging.raiseExceptions, False
    try:
        yield
    finally:
        logging.raiseExceptions = before


@contextmanager
def some_server(port: int | None, *, tells: bool) -> Iterator[str]:
    """The server that $PREFECT_API_URL names, the one of this data folder, or a new one."""
    apply_settings()
    given = os.environ.get(API_URL)
    if given:
        if not is_healthy(given):
            raise DcapError(f"{API_URL}={redacted_url(given)}: {unanswered(given)}")
        with suppress(OSError):  # Prefect's home: it warns where it cannot make it, and does not make what is above it
            server_folder().mkdir(parents=True, exist_ok=True)
        notice_settings()
        with listened_to(given, partial(say_whether, given)) if tells else nullcontext():
            yield given
        return
    host, folder = server_host(), server_folder()
    folder.mkdir(parents=True, exist_ok=True)
    with one_at_a_time(folder):
        users = lock_users(folder)  # before the server starts: without users, it ends
        try:
            url = running_url(folder) or start_anew(folder, host, port or free_port())
        except BaseException:
            os.close(users)
            raise
    os.environ[API_URL] = os.environ[OWN_URL] = url
    own_login = AUTH_STRING in os.environ and LOGIN not in os.environ
    if own_login:  # what this server asks for
        os.environ[LOGIN] = os.environ[AUTH_STRING]
    notice_settings()
    patience = INTERRUPTED_STOP_SECONDS
    try:
        with kept_alive(folder, url):
            yield url
        deliver_reports()
        patience = STOP_SECONDS
    except Exception:
        deliver_reports()
        patience = STOP_SECONDS
        raise
    finally:
        for name in (API_URL, OWN_URL):
            os.environ.pop(name, None)
        if own_login:
            os.environ.pop(LOGIN, None)
        with one_at_a_time(folder):
            os.close(users)
            if nobody_uses(folder):
                stop(folder, patience)


@contextmanager
def listened_to(url: str, tell: Callable[[bool], None]) -> Iterator[None]:
    """Tell that a server does not answer (False), and that it does again (True), as long as the block runs: Prefect's
    client would ask for a minute before it complains."""
    done = threading.Event()

    def listen() -> None:
        missed = 0
        while not done.wait(LISTEN_SECONDS):
            missed, before = 0 if is_ready(url) else missed + 1, missed
            if missed == MOST_MISSED or (missed == 0 and before >= MOST_MISSED):
                tell(missed == 0)

    threading.Thread(target=listen, name="server listener", daemon=True).start()
    try:
        yield
    finally:
        done.set()


def say_whether(url: str, answers: bool) -> None:
    """A line that a server does not answer, or does again."""
    whether = "answers again" if answers else "does not answer; it is waited for"
    say(f"the Prefect server {redacted_url(url)} {whether}")


def server_host() -> str:
    """The address that a server listens on: this machine alone, unless $PREFECT_SERVER_API_HOST says otherwise;
    InputError for one that others would reach without a word."""
    host = os.environ.get(HOST) or LOOPBACK
    name, _, password = os.environ.get(AUTH_STRING, "").partition(":")
    if not is_loopback(host) and not (name and password):
        raise InputError(
            f"{HOST}={host}: others would reach a server without a log-in; set {AUTH_STRING}=NAME:PASSWORD, or leave "
            "the host out"
        )
    return host


def server_answers() -> bool:
    """Whether a run would find a server without starting one."""
    given = os.environ.get(API_URL)
    return is_healthy(given) if given else running_url(server_folder()) != ""


def lock_users(folder: Path) -> int:
    """Lock the file that every user of the server holds shared, even if killed only as long as it lives; waits for a
    server that is ending."""
    descriptor = os.open(folder / USERS, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
    fcntl.flock(descriptor, fcntl.LOCK_SH)
    return descriptor


def nobody_uses(folder: Path) -> bool:
    """Whether no program uses the server any more."""
    with (folder / USERS).open("a") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
    return True


@contextmanager
def kept_alive(folder: Path, url: str) -> Iterator[None]:
    """Start the server again whenever it has died, as long as the block runs."""
    done = threading.Event()

    def watch() -> None:
        while not done.wait(WATCH_SECONDS):
            if not is_server(known_pid(folder)):
                with suppress(DcapError, OSError):  # tried again; who needs the server says what is wrong with it
                    start_again(folder, url, done)

    thread = threading.Thread(target=watch, name="server watch", daemon=True)
    thread.start()
    try:
        yield
    finally:
        done.set()


def start_again(folder: Path, url: str, done: threading.Event) -> None:
    """Start a server that has died, unless another of its users has done so or nobody needs it any more."""
    with one_at_a_time(folder):
        if running_url(folder) != url and not done.is_set():
            start(folder, server_host(), port_of(url), done)


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


@contextmanager
def one_at_a_time(folder: Path) -> Iterator[None]:
    """Programs that start or stop at the same moment share one server."""
    with (folder / "server.lock").open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


def running_url(folder: Path) -> str:
    """URL of the healthy server on this database; empty if there is none."""
    url = str(known(folder).get("url", ""))
    return url if url and is_healthy(url) else ""


def known(folder: Path) -> dict[str, object]:
    """What is written of the server that was started last: its URL and process id."""
    try:
        tree = json.loads((folder / "server.json").read_bytes())
    except (OSError, ValueError):
        return {}
    return tree if isinstance(tree, dict) else {}


def known_pid(folder: Path) -> int:
    """Process id of the server that was started last; 0 if nothing is known of one."""
    pid = known(folder).get("pid", 0)
    return pid if isinstance(pid, int) else 0


def is_healthy(url: str) -> bool:
    """Whether a server of Prefect answers."""
    return answer_of(f"{url}/health") == HEALTHY


def is_ready(url: str) -> bool:
    """Whether a server of Prefect answers, and reaches its database."""
    return is_healthy(url) and answer_of(f"{url}/ready") is not None


def answer_of(page: str) -> bytes | None:
    """The beginning of a page; None where there is none."""
    try:
        with urllib.request.urlopen(page, timeout=2) as answer:
            return bytes(answer.read(SHORT_ANSWER)) if answer.status == 200 else None
    except (OSError, ValueError, HTTPException):  # none, no address, or something else that speaks there
        return None


def unanswered(url: str) -> str:
    """Why a server that was named cannot be used, and what to do."""
    if has_log_in(url):
        return f"an address holds no log-in; give it as {LOGIN}=NAME:PASSWORD"
    if not url.startswith(("http://", "https://")):
        return "an address of a server begins with http:// or https://"
    whole = f"{url.rstrip('/')}/api"
    if is_healthy(whole):
        return f"the address of Prefect's server ends in /api: {redacted_url(whole)}"
    return "no server of Prefect answers there; start it or unset the variable"


def free_port() -> int:
    """A port of this machine that nobody listens on now."""
    with socket.socket() as one:
        one.bind((LOOPBACK, 0))
        return int(one.getsockname()[1])


def pages_of(url: str) -> str:
    """Where the pages of a server are that answers at `url`, as people are told: without who signs in there."""
    return redacted_url(url.removesuffix("/api"))


def port_of(url: str) -> int:
    """The port in an address."""
    return urlsplit(url).port or 80


def check_port(port: int, host: str = LOOPBACK) -> None:
    """InputError if pages cannot be served on a port: something else listens there, or the system refuses it."""
    with socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET) as one:
        one.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            one.bind((host, port))
        except OSError as error:
            if error.errno == errno.EADDRNOTAVAIL:
                raise InputError(f"{HOST}={host}: this machine has no such address") from None
            raise InputError(
                f"port {port} of {host} cannot be used ({error.strerror}); end what listens there, "
                "or give another with --port"
            ) from None


def start_anew(folder: Path, host: str, port: int) -> str:
    """Start a server, with a new log."""
    (folder / "server.log").unlink(missing_ok=True)
    return start(folder, host, port)


def start(folder: Path, host: str, port: int, done: threading.Event | None = None) -> str:
    """Start a server, wait until it is healthy, and return its URL; once it is `done`, nobody waits."""
    free = free_space(folder)
    here = not any(os.environ.get(name) for name in DATABASES)
    if here and free < LEAST_ROOM and not (folder / "prefect.db").exists():
        raise DcapError(f"{folder}: {free >> 20} MiB are free, too few for Prefect's database; {ROOM}")
    url = f"http://{url_host(host)}:{port}/api"
    process = launch(folder, host, port)
    write_whole(folder / "server.json", json.dumps({"url": url, "pid": process.pid}).encode())
    deadline = time.monotonic() + START_SECONDS
    while not is_healthy(url):
        if process.poll() is not None or time.monotonic() > deadline or (done is not None and done.is_set()):
            stop(folder, 0.0)
            raise DcapError(f"the Prefect server on port {port} did not start; {why_gone(folder)}")
        time.sleep(0.2)
    return url


def why_gone(folder: Path) -> str:
    """What may have ended a server."""
    if team_server():
        return f"{API_URL} names it: see there, or unset the variable"
    free, log = free_space(folder), folder / "server.log"
    full = f"the disk of {folder} has {free >> 20} MiB left ({ROOM}); " if free < LEAST_ROOM else ""
    named = [name for name in DATABASES if os.environ.get(name)]
    other = f"its database is what {named[0]} names; " if named else ""
    words = last_line(log)
    return f"{full}{other}{f'its last words are: {words}; ' if words else ''}its log is {log}"


def last_line(log: Path) -> str:
    """The last error of a log, or its end, as a line to be shown, without the secrets that it quotes."""
    try:
        with log.open("rb") as file:
            begin = file.seek(max(0, file.seek(0, os.SEEK_END) - LOG_END))
            words = file.read()
    except OSError:
        return ""
    if begin:  # in the middle of a line or a word, which may be half a secret
        words = words.partition(b"\n")[2].strip() or words.partition(b" ")[2]
    lines = [line.strip() for line in words.decode(errors="replace").split("\n") if line.strip()]
    errors = [line for line in lines if ERROR_LINE.match(line)]
    return shortened(redacted((errors or lines or [""])[-1]), LONGEST_LINE)


def launch(folder: Path, host: str, port: int) -> "subprocess.Popen[bytes]":
    """The server's process, in a session and folder of its own: a working directory's settings are not the server's."""
    environment = os.environ | {
        "PREFECT_SERVER_API_PORT": str(port),
        "PREFECT_HOME": str(folder),  # leases of limits belong to this database
        "PREFECT_UI_API_URL": "/api",  # of whichever address the pages came from
        "PYTHONSAFEPATH": "1",  # what the server starts takes nothing from the working directory either
    }
    if not any(os.environ.get(name) for name in DATABASES):
        environment[DATABASES[0]] = f"sqlite+aiosqlite:///{folder / 'prefect.db'}"
    environment.pop(API_URL, None)
    (folder / "concurrency_leases" / "expirations.lock").unlink(missing_ok=True)  # of a server that was killed
    with (folder / "server.log").open("ab") as log:
        return subprocess.Popen(
            module_command(PROGRAM, str(folder), host, str(port)),
            env=environment,
            cwd=folder,
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=log,
            start_new_session=True,
        )


def stop(folder: Path, patience: float) -> None:
    """Stop the server that this project started on this database, with its helpers; it is killed after `patience`
    [s]."""
    pid = known_pid(folder)
    (folder / "server.json").unlink(missing_ok=True)
    if not is_server(pid):
        return
    for kind, seconds in ((signal.SIGINT, patience), (signal.SIGKILL, STOP_SECONDS)):
        with suppress(ProcessLookupError):
            os.killpg(pid, kind)
        deadline = time.monotonic() + seconds
        while is_server(pid) and time.monotonic() < deadline:
            with suppress(ChildProcessError):  # another program started it and waits for it
                os.waitpid(pid, os.WNOHANG)
            time.sleep(0.05)


def is_server(pid: int) -> bool:
    """Whether a process is a server of ours that still runs: numbers are given again after a restart of the machine."""
    try:
        words = Path(f"/proc/{pid}/cmdline").read_bytes().split(b"\0")
    except OSError:
        return False
    return PROGRAM.encode() in words
