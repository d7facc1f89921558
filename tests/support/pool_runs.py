"""A pool, its workers, and what its server tells of them."""

import os
import signal
import subprocess
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import patience
import pytest
from prefect_pages import PrefectPages
from watched_run import results as kept_results

from dcap.packages import module_command
from dcap.scene.settings import data_root
from flows.cli.app import main

PATIENCE = 600.0
"""For machines that are busy [s]."""

wait_until = partial(patience.wait_until, seconds=PATIENCE, every=0.1)


@contextmanager
def data_folder(folder: Path) -> Iterator[None]:
    """An empty data folder."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DCAP_DATA", str(folder))
        patch.setenv("DCAP_RENDER__SIZE", "256")  # nothing here is seen in the pictures
        patch.setenv("PREFECT_HOME", str(folder))
        patch.delenv("PREFECT_API_URL", raising=False)
        yield


@contextmanager
def a_worker(
    limit: int = 2, environment: Mapping[str, str] = {}, said: Path | None = None
) -> Iterator["subprocess.Popen[bytes]"]:
    """`dcap worker`, in a session of its own; what it says goes into a file."""
    told = said.open("wb") if said else None
    process = subprocess.Popen(
        module_command("flows.cli", "worker", "--limit", str(limit)),
        stdout=told or subprocess.DEVNULL,
        stderr=told,
        start_new_session=True,
        env=os.environ | dict(environment),
    )
    try:
        yield process
    finally:
        process.send_signal(signal.SIGTERM)
        try:
            process.wait(30)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
        if told:
            told.close()


def waiting(pages: PrefectPages) -> list[object]:
    """Flow runs that wait in the pool."""
    return [run["id"] for run in pages.post("/flow_runs/filter") if run["state_type"] == "SCHEDULED"]


def taken(pages: PrefectPages) -> list[dict[str, Any]]:
    """Flow runs that a worker has taken."""
    return [run for run in pages.post("/flow_runs/filter") if "worker:" in str(run["tags"])]


def placed_results(dataset: Path, *options: str) -> dict[str, object]:
    """What a benchmark gave for each sample: its verdict, and the digest of what each stage returned."""
    code = main(["benchmark", "--dataset", str(dataset), "--workers", "2", *options])
    assert code == 0
    return kept_results(data_root())
