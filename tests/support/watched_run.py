"""`dcap` in a process of its own that does something as a stage begins, and what such a run leaves."""

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import patience
import pytest

from dcap.scene.settings import PROJECT_ROOT
from flows.sample_records import RECORDS
from flows.server import prefect_server

PATIENCE = 600.0
"""For machines that are busy [s]."""
WATCHED = """
import sys
from pathlib import Path
from threading import Thread
from time import sleep
from tasks.runner import process, stage

folder, wanted, run = Path(sys.argv.pop(1)), sys.argv.pop(1), stage.run_in_process

def tell():
    while not process.running:
        sleep(0.001)
    (folder / "begun").touch()

def told(job, *rest):
    with (folder / "stages").open("a") as file:
        print(job["function"], file=file)
    if job["function"] in wanted.split(","):
        WANTED
    return run(job, *rest)

stage.run_in_process = told
from flows.cli import main
sys.exit(main())
"""
TELL = "Thread(target=tell, daemon=True).start()"


@contextmanager
def server_elsewhere(folder: Path) -> Iterator[str]:
    """URL of a server for all programs of a test, whose database is not on their disk."""
    with pytest.MonkeyPatch.context() as patch:
        for name in ("DCAP_DATA", "PREFECT_HOME"):
            patch.setenv(name, str(folder))
        patch.delenv("PREFECT_API_URL", raising=False)
        with prefect_server() as url:
            yield url


def started(folder: Path, data: Path, url: str, wanted: str, act: str, *words: str) -> "subprocess.Popen[str]":
    """`dcap WORDS` with its data in a folder, which notes in the file `stages` those that have a process of their own,
    and does something as one of the `wanted` begins; with a server of its own where `url` names none."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PREFECT_")}
    server = {"PREFECT_API_URL": url} if url else {}
    path = os.pathsep.join(map(str, (PROJECT_ROOT, Path(__file__).parent)))
    return subprocess.Popen(
        [sys.executable, "-c", WATCHED.replace("WANTED", act), str(folder), wanted, *words],
        env=environment | {"DCAP_DATA": str(data), "PYTHONPATH": path} | server,
        cwd=folder,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )


def begun_stages(folder: Path) -> list[str]:
    """The stages that have begun in a process, in their order; forgotten by then."""
    path = folder / "stages"
    told = path.read_text().split() if path.exists() else []
    path.unlink(missing_ok=True)
    return told


wait_until = partial(patience.wait_until, seconds=PATIENCE, every=0.002)


def results(data: Path) -> dict[str, object]:
    """What the last run gave for each sample: its verdict, and the digest of what each stage returned."""
    samples = (data / "runs" / "last" / "samples").resolve()
    return {str(path.parent.relative_to(samples)): result(path.parent) for path in samples.rglob(RECORDS)}


def result(placement: Path) -> tuple[object, object]:
    """The same of one placement."""
    verdict = json.loads((placement / "placement.json").read_text())["verdict"]
    return verdict, json.loads((placement / RECORDS).read_text())


def finished(process: "subprocess.Popen[str]") -> str:
    """What a program said on standard error that came to its end."""
    _, err = process.communicate(timeout=PATIENCE)
    assert process.returncode == 0, err
    return err
