"""Prefect over PostgreSQL: a benchmark shows there as it does over its own database."""

import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from desk_room import desk_dataset
from prefect_pages import PrefectPages

from dcap.packages import module_command
from flows.cli.app import main
from flows.server import free_port, is_healthy

PATIENCE = 240.0
"""For machines that are busy [s]."""
DATABASE, OWNER = "prefect", "postgres"
SAMPLES = {"mug": "put the mug on the desk", "lost": "put the mug on the piano"}


def program(name: str) -> str:
    """Path of a program of PostgreSQL; empty where it is not installed."""
    found = sorted(Path("/usr/lib/postgresql").glob(f"*/bin/{name}"))
    return str(found[-1]) if found else shutil.which(name) or ""


def as_owner(*words: str) -> str:
    """What a program says that is run as a user who may run a database: root may not."""
    command = ["runuser", "-u", OWNER, "--", *words] if os.geteuid() == 0 else list(words)
    return subprocess.run(command, check=True, capture_output=True, text=True, cwd="/").stdout


@pytest.fixture
def database() -> Iterator[int]:
    """Port of a database server of its own, on the loopback."""
    if not program("initdb") or (os.geteuid() == 0 and not shutil.which("runuser")):
        pytest.skip("PostgreSQL is not installed")
    folder, port = Path(tempfile.mkdtemp(prefix="dcap-postgresql-")), free_port()
    if os.geteuid() == 0:
        shutil.chown(folder, OWNER)
    try:
        as_owner(program("initdb"), "-D", str(folder / "data"), "-A", "trust", "-U", OWNER)
        listens = f"-p {port} -k {folder} -c listen_addresses=127.0.0.1"
        control = (program("pg_ctl"), "-D", str(folder / "data"), "-l", str(folder / "log"), "-w")
        as_owner(*control, "-o", listens, "start")
        try:
            as_owner(program("createdb"), "-h", "127.0.0.1", "-p", str(port), "-U", OWNER, DATABASE)
            yield port
        finally:
            as_owner(*control, "-m", "immediate", "stop")
    finally:
        shutil.rmtree(folder, ignore_errors=True)


@contextmanager
def server_over(database: int, folder: Path) -> Iterator[str]:
    """Prefect's own server, as docs/formats.md says; its API's address."""
    port = free_port()
    own = {
        "PREFECT_HOME": str(folder),
        "PREFECT_SERVER_DATABASE_CONNECTION_URL": f"postgresql+asyncpg://{OWNER}@127.0.0.1:{database}/{DATABASE}",
        "PREFECT_SERVER_ANALYTICS_ENABLED": "false",
    }
    words = ("server", "start", "--host", "127.0.0.1", "--port", str(port), "--no-ui")
    folder.mkdir()
    said = folder / "said.txt"
    with said.open("wb") as told:
        process = subprocess.Popen(
            module_command("prefect", *words), env=os.environ | own, stdout=told, stderr=told, start_new_session=True
        )
    try:
        url, deadline = f"http://127.0.0.1:{port}/api", time.monotonic() + PATIENCE
        while not is_healthy(url):
            assert process.poll() is None, said.read_text()
            assert time.monotonic() < deadline, said.read_text()
            time.sleep(0.2)
        yield url
    finally:
        process.terminate()
        process.wait(60)


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.timeout(900)
def test_a_benchmark_is_kept_by_postgresql(database: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A run with its samples is on the pages of a server over PostgreSQL, and in its tables."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path / "data"))
    monkeypatch.setenv("PREFECT_HOME", str(tmp_path / "home"))
    dataset = desk_dataset(tmp_path, SAMPLES)
    with server_over(database, tmp_path / "server") as url:
        monkeypatch.setenv("PREFECT_API_URL", url)
        assert main(["benchmark", "--dataset", str(dataset), "--workers", "2"]) == 0
        pages = PrefectPages(url)
        (benchmark,) = pages.flow_runs()
        children = pages.flow_runs(str(benchmark["id"]))
        assert {run["state_name"] for run in children} == {"Completed", "Infeasible"}
    asked = "select count(*) from flow_run"
    said = as_owner(program("psql"), "-h", "127.0.0.1", "-p", str(database), "-U", OWNER, "-d", DATABASE, "-tAc", asked)
    assert int(said) == 1 + len(SAMPLES)
