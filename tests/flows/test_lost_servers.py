"""A server that dies under a benchmark and its workers: it is waited for, or given up."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path

import pytest
from desk_room import desk_dataset
from pool_runs import PATIENCE, a_worker, data_folder, placed_results, taken, wait_until
from prefect_pages import PrefectPages
from watched_run import results as kept_results

from dcap.packages import module_command
from dcap.scene.settings import data_root, server_folder
from dcap.scene.team_server import API_URL, OWN_URL
from flows.own_requests import LOOPBACK
from flows.server import is_server, known_pid, port_of, prefect_server, start

SAMPLES = {"mug": "put the mug on the desk", "book": "put the book on the desk", "lost": "put the mug on the piano"}
IMPATIENT = """
import sys
from flows import server, server_wait
from flows.cli import main
server_wait.START_SECONDS, server.LISTEN_SECONDS = 10.0, 1.0
sys.exit(main())
"""
"""`dcap` that gives a server up sooner."""
AT_ONCE = {"PREFECT_CLIENT_MAX_RETRIES": "0", "PREFECT_WORKER_QUERY_SECONDS": "1"}
"""Settings of Prefect with which its own worker ends after 45 seconds without a server, and not after minutes."""


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A desk in a room, and what is put on it: rigid on rigid, the cheapest drops."""
    return desk_dataset(tmp_path_factory.mktemp("lost"), SAMPLES)


class TeamServer:
    """A server of others: nobody here starts it again by himself."""

    def __init__(self, url: str) -> None:
        self.url, self.folder, self.pid = url, server_folder(), known_pid(server_folder())
        self.pages = PrefectPages(url)

    def kill(self) -> None:
        """End it."""
        os.kill(self.pid, signal.SIGKILL)
        wait_until(lambda: not is_server(self.pid))

    def start(self) -> None:
        """Start it again."""
        start(self.folder, LOOPBACK, port_of(self.url))


@pytest.fixture
def team(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[TeamServer]:
    """A server that benchmark and worker are told of."""
    monkeypatch.setattr("flows.server.kept_alive", lambda *_: nullcontext())
    with data_folder(tmp_path / "team"), prefect_server() as url, pytest.MonkeyPatch.context() as patch:
        found = TeamServer(url)
        patch.setenv("DCAP_DATA", str(tmp_path / "data"))
        patch.setenv(API_URL, url)
        patch.delenv(OWN_URL)
        yield found


@contextmanager
def benchmark_of(dataset: Path, runner: str, *program: str) -> Iterator["subprocess.Popen[str]"]:
    """A benchmark as a process."""
    command = [*(program or module_command("flows.cli")), "benchmark", "--dataset", str(dataset), "--runner", runner]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as benchmark:
        yield benchmark


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.timeout(900)
@pytest.mark.parametrize(
    ("seconds", "settings"),
    [(0.0, {}), (45.0, {}), (90.0, AT_ONCE)],
    ids=["for a moment", "longer than heartbeats are waited for", "longer than Prefect's worker waits"],
)
def test_a_server_that_is_lost_is_waited_for(
    dataset: Path, team: TeamServer, tmp_path: Path, seconds: float, settings: dict[str, str]
) -> None:
    """By the benchmark and its workers, each sample is placed once, and none of them counts as lost. No traceback is
    shown."""
    said = tmp_path / "worker.txt"
    with a_worker(1, settings, said) as worker, benchmark_of(dataset, "pool") as benchmark:
        wait_until(lambda: any(run["state_type"] == "RUNNING" for run in taken(team.pages)))
        team.kill()
        time.sleep(seconds)
        team.start()
        _, told = benchmark.communicate(timeout=PATIENCE)
        assert (benchmark.returncode, worker.poll()) == (0, None), told + said.read_text()
    assert [run["state_type"] for run in taken(team.pages)] == ["COMPLETED"] * len(SAMPLES)
    assert "Traceback" not in told
    if not settings:  # with those Prefect complains before the server is looked for
        assert "Traceback" not in said.read_text()
    if seconds:
        assert "does not answer; it is waited for, what Prefect says of it is in" in said.read_text()
    found = kept_results(data_root())
    with data_folder(tmp_path / "home"):
        assert placed_results(dataset) == found


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.timeout(900)
@pytest.mark.parametrize("runner", ["local", "pool"])
def test_a_server_that_stays_away_ends_a_benchmark(
    dataset: Path, team: TeamServer, monkeypatch: pytest.MonkeyPatch, runner: str
) -> None:
    """With a line, after it was waited for, and no sample fails one by one; once the server is there again, the next
    benchmark goes on, and says of what was left that it is over."""
    monkeypatch.setenv("PREFECT_CLIENT_MAX_RETRIES", "1")
    with a_worker(1) if runner == "pool" else nullcontext():
        with benchmark_of(dataset, runner, sys.executable, "-P", "-c", IMPATIENT) as benchmark:
            wait_until(lambda: len(running(team.pages)) > 1)  # the benchmark and a sample
            team.kill()
            _, told = benchmark.communicate(timeout=PATIENCE)
        last = told.rstrip().splitlines()[-1]
        assert benchmark.returncode == 2, told
        assert last.startswith(f"dcap: the Prefect server {team.url} is gone; {API_URL} names it"), told
        assert f"the Prefect server {team.url} does not answer; it is waited for\n" in told
        assert "Traceback" not in told
        assert "failed" not in told
        the_next_one_goes_on(dataset, team, runner)


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.timeout(900)
@pytest.mark.parametrize("runner", ["local", "pool"])
def test_who_interrupts_does_not_wait_for_a_server_that_is_away(
    dataset: Path, team: TeamServer, monkeypatch: pytest.MonkeyPatch, runner: str
) -> None:
    """Prefect's client would ask it for a minute, here for hours. The next benchmark says that the other is over."""
    monkeypatch.setenv("PREFECT_CLIENT_MAX_RETRIES", "12")
    with a_worker(1) if runner == "pool" else nullcontext():
        with benchmark_of(dataset, runner) as benchmark:
            wait_until(lambda: len(running(team.pages)) > 1)
            team.kill()
            benchmark.send_signal(signal.SIGINT)
            _, told = benchmark.communicate(timeout=PATIENCE)
        assert (benchmark.returncode, told.splitlines()[-1]) == (130, "dcap: interrupted")
        the_next_one_goes_on(dataset, team, runner)


def the_next_one_goes_on(dataset: Path, team: TeamServer, runner: str) -> None:
    """Once the server is there again, a benchmark places what is left, and nothing seems to run after it."""
    team.start()
    with benchmark_of(dataset, runner) as benchmark:
        _, told = benchmark.communicate(timeout=PATIENCE)
    assert benchmark.returncode == 0, told
    wait_until(lambda: not running(team.pages))


def running(pages: PrefectPages) -> list[object]:
    """Flow runs that have not ended."""
    return [run["id"] for run in pages.post("/flow_runs/filter") if run["state_type"] in ("RUNNING", "PENDING")]
