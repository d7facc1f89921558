"""A benchmark of the fake pipeline in a process of its own, to be watched, interrupted and killed.

A sample whose prompt says `slow` has a stage that goes on as long as the file `busy` is there, a minute at most: in a
thread, or in a process of its own where the prompt says `heavy`.
"""

import os
import signal
import subprocess
import sys
from pathlib import Path

from fake_pipeline_code import PIPELINE

from dcap.scene.settings import PROJECT_ROOT

SLOW = """
def intent_after(scene: Segmentation, prompt: str) -> Intent | Infeasible:
    import os, pathlib, time
    busy = pathlib.Path(__file__).with_name("busy")
    if "slow" in prompt:
        busy.with_name("begun").write_text(str(os.getpid()))
        for _ in range(1200):
            if not busy.exists():
                break
            time.sleep(0.05)
    return intent(scene, prompt)

stages[2] = stage(intent_after, name="intent", process=lambda scene, prompt: "heavy" in prompt)
"""
PROGRAM = """
import signal, sys
from dcap import packages
import flows.sample_run
signal.signal(signal.SIGINT, signal.default_int_handler)  # which a shell in the background ignores, and its programs
from fake_pipeline import place
flows.sample_run.place_by = place
from flows.cli import main
sys.exit(main())
"""


def fake_benchmark(folder: Path, prompts: list[str], url: str = "", *options: str) -> "subprocess.Popen[str]":
    """`dcap benchmark` over a sample for each prompt, with its data in `folder`; its server is at `url` or its own."""
    (folder / "fake_pipeline.py").write_text(PIPELINE + SLOW)
    (folder / "fine.ply").write_text("fine")
    rows = [f"- {{id: s{n}, scene: fine.ply, object: fine.ply, prompt: {p}}}" for n, p in enumerate(prompts)]
    (folder / "set.yaml").write_text("\n".join(rows) + "\n")
    path = os.pathsep.join(map(str, (PROJECT_ROOT, PROJECT_ROOT / "tests" / "support", folder)))
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PREFECT_")}
    server = {"PREFECT_API_URL": url} if url else {}
    return subprocess.Popen(
        [sys.executable, "-c", PROGRAM, "benchmark", "--dataset", str(folder / "set.yaml"), "--json", *options],
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
