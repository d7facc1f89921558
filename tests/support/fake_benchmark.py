"""A benchmark of the fake pipeline in a process of its own, to be watched, interrupted and killed.

A sample whose prompt says `slow` has a stage that goes on as long as the file `busy` is there, a minute at most: in a
thread, or in a process of its own where the prompt says `heavy`. So does the stage that the file names, and where it
says `record`, the first result's record stops in the middle.
"""

import os
import signal
import subprocess
import sys
from pathlib import Path

from fake_pipeline_code import PIPELINE

from dcap.scene.settings import PROJECT_ROOT

SLOW = """
import functools, os, time

BUSY = Path(__file__).with_name("busy")

def stay():
    BUSY.with_name("begun").write_text(str(os.getpid()))
    for _ in range(1200):
        if not BUSY.exists():
            break
        time.sleep(0.05)

def slowed(function):
    @functools.wraps(function)
    def run(**inputs):
        if BUSY.exists() and (BUSY.read_text() == function.__name__ or "slow" in inputs.get("prompt", "")):
            stay()
        return function(**inputs)
    return run

mesh, segment, intent, anchor, drop, render = map(slowed, (mesh, segment, intent, anchor, drop, render))
stages = [stage(one) for one in (mesh, segment, intent, anchor, drop, render)]
stages[2] = stage(intent, process=lambda scene, prompt: "heavy" in prompt)
stages[4] = stage(drop, process=True)
"""
PROGRAM = """
import signal, sys
from dcap import packages
import flows.sample_run
signal.signal(signal.SIGINT, signal.default_int_handler)  # which a shell in the background ignores, and its programs
import fake_pipeline
from prefect.filesystems import LocalFileSystem
write = LocalFileSystem.write_path
def cut(storage, path, content, **how):
    if fake_pipeline.BUSY.exists() and fake_pipeline.BUSY.read_text() == "record":
        write(storage, path, content[:len(content) // 2], **how)
        fake_pipeline.stay()
    return write(storage, path, content, **how)
LocalFileSystem.write_path = cut
flows.sample_run.place_by = fake_pipeline.place
from flows.cli import main
sys.exit(main())
"""


def fake_benchmark(folder: Path, prompts: list[str], url: str = "", *options: str) -> "subprocess.Popen[str]":
    """`dcap benchmark` over a sample for each prompt, with its data in `folder`; its server is at `url` or its own."""
    (folder / "fake_pipeline.py").write_text(PIPELINE + SLOW)
    (folder / "fine.ply").write_text("fine")
    rows = [f"- {{id: s{n}, scene: fine.ply, object: fine.ply, prompt: {p}}}" for n, p in enumerate(prompts)]
    (folder / "killed.yaml").write_text("\n".join(rows) + "\n")
    path = os.pathsep.join(map(str, (PROJECT_ROOT, PROJECT_ROOT / "tests" / "support", folder)))
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PREFECT_")}
    server = {"PREFECT_API_URL": url} if url else {}
    return subprocess.Popen(
        [sys.executable, "-c", PROGRAM, "benchmark", "--dataset", str(folder / "killed.yaml"), "--json", *options],
        env=environment | {"DCAP_DATA": str(folder / "data"), "PYTHONPATH": path} | server,
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def end(process: "subprocess.Popen[str]") -> None:
    """Kill it, if it is still there, with all of its group."""
    if process.poll() is None:
        os.killpg(process.pid, signal.SIGKILL)
    process.communicate()
