"""The reference drops in dcap and in other simulators, each in a process of its own; prints one table.

make perf-peers     or     python -m perf.peers [--python PATH] [--only NAME ...] [--limit SECONDS]
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.table import Table

from dcap.packages import module_command
from dcap.scene.settings import PROJECT_ROOT
from perf.peers.reference import DEPTH, PeerDrop

PEERS_PYTHON = PROJECT_ROOT / ".venv-peers" / "bin" / "python"
"""Python of the peers, used if it exists: they pin versions of their own, so they get an environment of their own."""
INSTALL = (
    "perf.peers: none of Genesis, Newton and MuJoCo is installed; run: python3 -m venv .venv-peers && "
    ".venv-peers/bin/pip install genesis-world==1.4.5 newton==1.8.0 torch mujoco==4.0.0 (or name their Python with "
    "--python)"
)
PEERS = (("Genesis MPM", "genesis", True), ("Newton VBD", "newton", True), ("MuJoCo flex", "mujoco", False))
"""Name in the table, top-level import, and whether it runs on graphics cards: MuJoCo's own engine does not."""
GRACE = 900.0
"""Seconds for a peer to import, build and compile, in addition to the limit for its steps."""


@dataclass(frozen=True)
class Runner:
    """Command of a simulator: `python -m module YOUNGS_MODULUS argument LIMIT`."""

    name: str
    module: str
    argument: str
    package: str
    """Top-level import that must be installed."""
    python: str


def present(python: str, package: str) -> bool:
    """Whether that Python finds the package, without importing it."""
    code = f"import importlib.util, sys; sys.exit(importlib.util.find_spec({package!r}) is None)"
    return subprocess.run([python, "-P", "-c", code], check=False, capture_output=True).returncode == 0


def measured(runner: Runner, modulus: float, limit: float) -> PeerDrop | str:
    """Outcome of one drop, or the reason for its lack in one line."""
    command = module_command(runner.module, repr(modulus), runner.argument, repr(limit), python=runner.python)
    threads = {"QD_NUM_THREADS": str(os.cpu_count())} | dict(os.environ)  # Genesis takes one thread unless told
    try:
        done = subprocess.run(
            command, cwd=PROJECT_ROOT, env=threads, timeout=limit + GRACE, capture_output=True, text=True, check=False
        )
    except subprocess.TimeoutExpired:
        return f"stopped after {limit + GRACE:.0f} s"
    lines = done.stdout.strip().splitlines()
    if done.returncode or not lines:
        said = done.stderr.strip().splitlines()
        return f"exit {done.returncode}: {said[-1] if said else 'no output'}"
    try:
        return PeerDrop(**json.loads(lines[-1]))
    except (ValueError, TypeError):
        return f"no result in its last line: {lines[-1][:80]}"


def runners(python: str) -> list[Runner]:
    """dcap twice, then each peer on the processor and, if there is one, on the graphics card."""
    card = shutil.which("nvidia-smi") is not None
    own = [
        Runner(f"dcap {method}", "perf.peers.own_drop", method, "taichi", sys.executable) for method in ("tl", "mls")
    ]
    return own + [
        Runner(f"{name}, {device}", f"perf.peers.{package}_drop", device, package, python)
        for name, package, on_cards in PEERS
        for device in ["cpu"] + ["cuda"] * (card and on_cards)
    ]


def row(outcome: PeerDrop, depth: float, best: PeerDrop | None) -> list[str]:
    """Cells of the table: error against `depth` [m], times as multiples of dcap's."""
    wall, cpu = (outcome.wall / best.wall, outcome.cpu / best.cpu) if best else (float("nan"), float("nan"))
    return [
        outcome.elements,
        f"{1e3 * outcome.cell:.1f} mm",
        f"{1e3 * outcome.step:.2f} ms",
        f"{1e3 * outcome.depth:.3f} mm",
        f"{100 * (outcome.depth / depth - 1):+.1f} %",
        f"{'yes' if outcome.at_rest else 'no'}, {1e3 * outcome.speed:.2f} mm/s",
        f"{outcome.simulated:.2f} s",
        f"{outcome.prepare:.0f} s",
        f"{outcome.wall:.1f} s",
        f"{outcome.cpu:.1f} s",
        f"{wall:.1f}",
        f"{cpu:.1f}",
    ]


def main() -> None:
    """Measure and print; exit 2 without any peer."""
    parser = argparse.ArgumentParser(prog="python -m perf.peers", description=__doc__.splitlines()[0])
    found = str(PEERS_PYTHON) if PEERS_PYTHON.exists() else sys.executable
    parser.add_argument("--python", default=found, help="Python of the environment that has the peers")
    parser.add_argument("--only", nargs="*", default=[], help="names as in the table, or their beginnings")
    parser.add_argument("--limit", type=float, default=600.0, help="wall time of the steps of one drop [s]")
    chosen = parser.parse_args()
    if not Path(chosen.python).exists() or not any(present(chosen.python, package) for _, package, _ in PEERS):
        sys.stderr.write(INSTALL + "\n")
        sys.exit(2)
    console = Console(highlight=False, width=200)
    versions: set[str] = set()
    for modulus, depth in DEPTH.items():
        titles = ["", "size", "cell", "step", "depth", "error", "at rest", "simulated", "prepared", "wall", "cpu"]
        table = Table(*titles, "wall / dcap", "cpu / dcap", box=None, title=f"E {modulus:.0e} Pa, {1e3 * depth} mm")
        best: PeerDrop | None = None
        for runner in runners(chosen.python):
            if chosen.only and not runner.name.lower().startswith(tuple(name.lower() for name in chosen.only)):
                continue
            if not present(runner.python, runner.package):
                table.add_row(runner.name, "not installed")
                continue
            outcome = measured(runner, modulus, chosen.limit)
            sys.stderr.write(f"{modulus:.0e} Pa, {runner.name}: {outcome}\n")
            if isinstance(outcome, str):
                table.add_row(runner.name, outcome)
                continue
            best = best or (outcome if runner.name == "dcap tl" else None)
            versions.add(outcome.versions)
            table.add_row(runner.name, *row(outcome, depth, best))
        console.print(table)
    console.print("; ".join(sorted(versions)))


if __name__ == "__main__":
    main()
