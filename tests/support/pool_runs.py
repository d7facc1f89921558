"""A pool, its workers, and what benchmarks give."""

import json
import os
import signal
import subprocess
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import patience
import pytest

from dcap.packages import module_command
from dcap.scene.settings import data_root
from flows.cli.app import main
from flows.output import RECORDS

PATIENCE = 300.0
"""For machines that are busy [s]."""
wait_until = partial(patience.wait_until, seconds=PATIENCE, every=0.1)


@contextmanager
def data_folder(folder: Path) -> Iterator[None]:
    """An empty data folder."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DCAP_DATA", str(folder))
        patch.setenv("DCAP_RENDER__SIZE", "256")  # nothing here is seen in the pictures
        yield


@contextmanager
def a_worker(limit: int = 2, environment: Mapping[str, str] = {}) -> Iterator["subprocess.Popen[bytes]"]:
    """`dcap worker`, in a session of its own."""
    process = subprocess.Popen(
        module_command("flows.cli", "worker", "--limit", str(limit)), stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL, start_new_session=True, env=os.environ | dict(environment),
    )  # fmt: skip
    try:
        yield process
    finally:
        process.send_signal(signal.SIGTERM)
        try:
            process.wait(30)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()


@contextmanager
def a_program(*words: str) -> Iterator["subprocess.Popen[bytes]"]:
    """`dcap WORDS`, which is killed where a test does not wait for it."""
    with subprocess.Popen(module_command("flows.cli", *words), stdout=subprocess.DEVNULL) as process:
        try:
            yield process
        finally:
            process.kill()


def benchmark(dataset: Path, *options: str) -> list[str]:
    """The command of a benchmark."""
    return ["benchmark", "--dataset", str(dataset), "--workers", "2", *options]


def placed_results(dataset: Path, *options: str) -> dict[str, object]:
    """What a benchmark gave for each sample: its verdict, and the digest of what each stage returned."""
    assert main(benchmark(dataset, *options)) == 0
    return kept_results()


def kept_results() -> dict[str, object]:
    """The same of the last run."""
    samples = (data_root() / "runs" / "last" / "samples").resolve()
    return {str(path.parent.relative_to(samples)): result(path.parent) for path in samples.rglob(RECORDS)}


def result(placement: Path) -> tuple[object, object]:
    """The same of one placement."""
    verdict = json.loads((placement / "placement.json").read_text())["verdict"]
    return verdict, json.loads((placement / RECORDS).read_text())
