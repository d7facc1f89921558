"""Memory of the placing program for a long list of fully cached samples.

python -m perf.memory [SAMPLES] [--rooms 12 --workers 2]

A few generated rooms, each with one sentence, are placed once, on coarse cells and with small pictures: the memory per
sample does not depend on them. Their list, repeated under new ids, is the observed benchmark, in a process of its own:
its resident memory is sampled ten times a second, with the number of sample folders in its run.
"""

import argparse
import json
import os
import subprocess
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import count, islice
from pathlib import Path

import numpy as np
import psutil
from rich.console import Console
from rich.table import Table

from dcap.evaluation.run_folder import SAMPLES_FOLDER
from dcap.packages import module_command
from flows.samples import load_yaml
from tasks.machine_errors import API_URL

SETTINGS = {"DCAP_PARTICLES__CELL": "0.04", "DCAP_RENDER__SIZE": "128", "DCAP_CONFIG": ""}
"""Environment for fast drops and pictures, without a file of settings."""
OTHERS = ("DCAP_STORE", API_URL)
"""Variables that would bring in other servers and stores."""
FOLDERS = "rooms", "objects"
PLACED, REPEATED = "placed", "repeated"
"""Names of the data set that is placed, and of the observed one."""
SOME_FAILED = 4
"""Exit code of a benchmark with failed samples, which count like the others."""
LOOK_SECONDS = 0.1
MEGABYTE, KILOBYTE = 1e6, 1e3


@dataclass(frozen=True, slots=True)
class Observation:
    """The placing program at one moment."""

    settled: int
    """Number of samples with written files."""
    memory: int
    """Resident [bytes]."""


def repeated(rows: Sequence[dict[str, object]], samples: int) -> list[dict[str, object]]:
    """`samples` samples: the rows repeated under new ids."""
    endless = (row | {"id": f"{row['id']}-{turn}"} for turn in count() for row in rows)
    return list(islice(endless, samples))


def command(words: Sequence[str], data: Path) -> "subprocess.Popen[bytes]":
    """A command of dcap with a data folder of its own."""
    own = {name: value for name, value in os.environ.items() if name not in OTHERS}
    environment = own | SETTINGS | {"DCAP_DATA": str(data)}
    return subprocess.Popen(module_command("flows.cli", *words), env=environment, stdout=subprocess.DEVNULL)


def done(process: "subprocess.Popen[bytes]") -> None:
    """Wait for a command; SystemExit if it fails."""
    if process.wait() not in (0, SOME_FAILED):
        raise SystemExit(f"perf.memory: a command ended with status {process.returncode}; see its output above")


def place_once(data: Path, rooms: int, workers: int) -> Path:
    """Make rooms, and place one thing in each; returns the data set's file."""
    scenes, objects = (str(data / name) for name in FOLDERS)
    dataset = data / f"{PLACED}.yaml"
    done(command(["dataset", "make", "--folder", str(data), "--scenes", str(rooms)], data))
    ends = ["--per-scene", "1", "--infeasible", "0", "--out", str(dataset)]
    done(command(["dataset", "sample", scenes, "--objects", objects, *ends], data))
    done(command(["benchmark", "--dataset", str(dataset), "--workers", str(workers)], data))
    return dataset


def observed(process: "subprocess.Popen[bytes]", runs: Path) -> Iterator[Observation]:
    """Observe the program as long as it runs."""
    watched = psutil.Process(process.pid)
    while process.poll() is None:
        settled = sum(1 for _ in runs.glob(f"{REPEATED}-*/{SAMPLES_FOLDER}/*"))
        try:
            yield Observation(settled, watched.memory_info().rss)
        except psutil.Error:  # it has just ended
            return
        time.sleep(LOOK_SECONDS)


def memory_table(seen: Sequence[Observation], samples: int) -> Table:
    """Memory after planning, at each quarter of the samples, and the maximum afterwards, while the report is
    written."""
    shown = Table("resident memory", "MB", box=None)
    first = [next(one for one in seen if one.settled >= max(1, samples * part // 4)) for part in range(5)]
    titles = ["once planned", *(f"{number} samples written" for number in (one.settled for one in first[1:]))]
    for title, one in zip(titles, first, strict=True):
        shown.add_row(title, f"{one.memory / MEGABYTE:.0f}")
    most = max(one.memory for one in seen if one.settled >= samples)
    shown.add_row("at most while the report is written", f"{most / MEGABYTE:.0f}")
    return shown


def slope(seen: Sequence[Observation]) -> float:
    """Bytes that each sample adds from the first to the last, by least squares."""
    last = max(one.settled for one in seen)
    written = [one for one in seen if 0 < one.settled < last]
    return float(np.polyfit([one.settled for one in written], [one.memory for one in written], 1)[0])


def main() -> None:
    """Measure and print."""
    about = argparse.ArgumentParser(prog="python -m perf.memory", description=(__doc__ or "").partition("\n")[0])
    about.add_argument("samples", nargs="?", type=int, default=2000)
    about.add_argument("--rooms", type=int, default=12, help="that are placed, and repeated")
    about.add_argument("--workers", type=int, default=2)
    asked = about.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        data = Path(folder)
        dataset = place_once(data, asked.rooms, asked.workers)
        rows = load_yaml(dataset)
        assert isinstance(rows, list)
        again = dataset.with_stem(REPEATED)
        again.write_text(json.dumps(repeated(rows, asked.samples)), encoding="utf-8")  # which is YAML, too
        process = command(["benchmark", "--dataset", str(again), "--workers", str(asked.workers)], data)
        seen = list(observed(process, data / "runs"))
        done(process)
    console = Console(highlight=False, width=120)
    console.print(memory_table(seen, asked.samples))
    console.print(f"{slope(seen) / KILOBYTE:.1f} KB a sample, from the first that is written to the last")


if __name__ == "__main__":
    main()
