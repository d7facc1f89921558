"""The server of a team, over PostgreSQL: runs are kept there, and nobody is told of them without a log-in."""

import os
import shutil
import signal
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from urllib.error import HTTPError
from urllib.request import Request, urlopen

import pytest
from desk_room import desk_dataset
from patience import wait_until
from ports import free_port

from dcap.packages import module_command
from flows.cli.app import main
from flows.server import is_healthy

PATIENCE = 240.0
"""For machines that are busy [s]."""
DATABASE, OWNER = "prefect", "postgres"
LOG_IN = "team:of-ours"
STATES = "select state_name, count(*) from flow_run group by 1 order by 1"
SAMPLES = {"mug": "put the mug on the desk", "lost": "put the mug on the piano"}


def program(name: str) -> str:
    """Path of a program of PostgreSQL; empty where it is not installed."""
    found = sorted(Path("/usr/lib/postgresql").glob(f"*/bin/{name}"))
    return str(found[-1]) if found else shutil.which(name) or ""


def as_owner(*words: str) -> str:
    """What a program says that is run as a user who may run a database: root may not."""
    command = ["runuser", "-u", OWNER, "--", *words] if os.geteuid() == 0 else list(words)
    return subprocess.run(command, check=True, capture_output=True, text=True, cwd="/").stdout


@dataclass(frozen=True)
class Database:
    """A database server of its own, on the loopback."""

    port: int
    folder: Path

    def control(self, *words: str) -> None:
        """Start or stop it."""
        as_owner(program("pg_ctl"), "-D", str(self.folder / "data"), "-l", str(self.folder / "log"), "-w", *words)

    def start(self) -> None:
        """Listen."""
        self.control("-o", f"-p {self.port} -k {self.folder} -c listen_addresses=127.0.0.1", "start")

    def stop(self) -> None:
        """Break off, as a machine that is switched off."""
        self.control("-m", "immediate", "stop")

    def ask(self, words: str) -> list[str]:
        """The words of the answer to a query."""
        where = ("-h", "127.0.0.1", "-p", str(self.port), "-U", OWNER, "-d", DATABASE)
        return as_owner(program("psql"), *where, "-tAc", words).split()


@pytest.fixture
def database() -> Iterator[Database]:
    """A database server."""
    if not program("initdb") or (os.geteuid() == 0 and not shutil.which("runuser")):
        pytest.skip("PostgreSQL is not installed")
    found = Database(free_port(), Path(tempfile.mkdtemp(prefix="dcap-postgresql-")))
    if os.geteuid() == 0:
        shutil.chown(found.folder, OWNER)
    try:
        as_owner(program("initdb"), "-D", str(found.folder / "data"), "-A", "trust", "-U", OWNER)
        found.start()
        try:
            as_owner(program("createdb"), "-h", "127.0.0.1", "-p", str(found.port), "-U", OWNER, DATABASE)
            yield found
        finally:
            with suppress(subprocess.CalledProcessError):  # it was stopped in the middle of a test
                found.stop()
    finally:
        shutil.rmtree(found.folder, ignore_errors=True)


@pytest.fixture
def dataset(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A data set, and an empty data folder of who places it."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path / "data"))
    monkeypatch.setenv("DCAP_RENDER__SIZE", "256")  # nothing here is seen in the pictures
    monkeypatch.setenv("PREFECT_HOME", str(tmp_path / "home"))
    return desk_dataset(tmp_path, SAMPLES)


@contextmanager
def program_of_ours(words: Sequence[str], said: Path, **own: str) -> Iterator["subprocess.Popen[bytes]"]:
    """A command of dcap that goes on until it is interrupted, with variables of its own."""
    with said.open("wb") as told:
        process = subprocess.Popen(
            module_command("flows.cli", *words), env=os.environ | own, stdout=told, stderr=told, start_new_session=True
        )
    try:
        yield process
    finally:
        process.send_signal(signal.SIGTERM)
        process.wait(60)


@contextmanager
def server_over(database: Database, folder: Path) -> Iterator[str]:
    """The server of a team as docs/workflow.md starts it; its API's address."""
    port, said = free_port(), folder / "server.txt"
    own = {
        "DCAP_DATA": str(folder / "server"),
        "PREFECT_SERVER_DATABASE_CONNECTION_URL": f"postgresql+asyncpg://{OWNER}@127.0.0.1:{database.port}/{DATABASE}",
        "PREFECT_SERVER_API_HOST": "0.0.0.0",
        "PREFECT_SERVER_API_AUTH_STRING": LOG_IN,
    }
    url = f"http://127.0.0.1:{port}/api"
    with program_of_ours(("ui", "--port", str(port)), said, **own) as process:
        wait_until(lambda: is_healthy(url) or process.poll() is not None, PATIENCE)
        assert process.poll() is None, said.read_text()
        yield url


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.timeout(900)
def test_a_team_s_server_keeps_its_runs_in_postgresql(
    database: Database, dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What a worker has placed is in its tables; who does not sign in is told nothing."""
    with server_over(database, tmp_path) as url:
        monkeypatch.setenv("PREFECT_API_URL", url)
        monkeypatch.setenv("PREFECT_API_AUTH_STRING", LOG_IN)
        with program_of_ours(("worker",), tmp_path / "worker.txt"):
            assert main(["benchmark", "--dataset", str(dataset), "--runner", "pool"]) == 0
        with pytest.raises(HTTPError, match="401"):
            urlopen(Request(f"{url}/flow_runs/filter", b"{}"), timeout=30)
    assert not list(tmp_path.rglob("prefect.db"))
    assert database.ask(STATES) == ["Completed|2", "Infeasible|1"]
