"""What `make perf-peers` promises without the peers: the mesh it gives them, what it calls rest, its refusal."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from perf.peers import reference as ref
from perf.peers.__main__ import PEERS_PYTHON, present, runners
from perf.peers.tets import lumped, slab

ROOT = Path(__file__).resolve().parent.parent.parent


@pytest.mark.parametrize(("cell", "growth"), [(20e-3, 1.2), (10e-3, 1.25)])
def test_tetrahedra_fill_the_slab_once(cell: float, growth: float) -> None:
    """Volumes are positive and sum to the slab's; an inner face belongs to two tetrahedra, an outer one to one."""
    nodes, tets = slab(cell, growth)
    volume = np.linalg.det(nodes[tets[:, 1:]] - nodes[tets[:, :1]]) / 6
    assert volume.min() > 0
    assert volume.sum() == pytest.approx(np.prod(ref.SLAB), rel=1e-12)  # sums of exact products
    faces = np.concatenate([np.delete(tets, corner, axis=1) for corner in range(4)])
    unique, count = np.unique(np.sort(faces, axis=1), axis=0, return_counts=True)
    assert count.max() == 2
    outer = nodes[unique[count == 1]]
    area = np.linalg.norm(np.cross(outer[:, 1] - outer[:, 0], outer[:, 2] - outer[:, 0]), axis=1).sum() / 2
    width, depth, height = ref.SLAB
    assert area == pytest.approx(2 * (width * depth + width * height + depth * height), rel=1e-12)


def test_nodes_share_the_slab_about_its_axis() -> None:
    """The nodes' volumes are positive, sum to the slab's and have their centre in the slab's middle across."""
    nodes, tets = slab(20e-3, 1.2)
    volume = lumped(nodes, tets)
    assert volume.min() > 0
    assert volume.sum() == pytest.approx(np.prod(ref.SLAB), rel=1e-12)
    # a quarter of a tetrahedron at each corner keeps its centre of mass, so that of the whole is the box's own
    centre = volume @ nodes / volume.sum()
    assert centre == pytest.approx([0.0, 0.0, ref.SLAB[2] / 2], abs=1e-12)


def test_rest_needs_speed_and_height_to_stay(capsys: pytest.CaptureFixture[str]) -> None:
    """A ball that is slow enough but sinks by more than REST_DRIFT per REST_SECONDS is not at rest until it stops."""
    top = ref.SLAB[2] + ref.RADIUS
    seconds, sinking, stops = 0.0, 0.5 * ref.REST_SPEED, 0.5

    def advance() -> float:
        nonlocal seconds
        seconds += ref.LOOK_SECONDS
        return ref.LOOK_SECONDS

    fall = ref.follow(advance, lambda: (top - sinking * min(seconds, stops), sinking), limit=60.0)
    assert fall.at_rest
    assert fall.depth == pytest.approx(sinking * stops)
    left = ref.REST_DRIFT / sinking  # of the window may still see it sink
    assert stops + ref.REST_SECONDS - left <= fall.simulated + 1e-9 <= stops + ref.REST_SECONDS + ref.LOOK_SECONDS


def test_says_how_to_install_the_peers(tmp_path: Path) -> None:
    """Without any peer: exit 2 and one line that names them all and holds a pip command."""
    command = [sys.executable, "-m", "perf.peers", "--python", str(tmp_path / "python")]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "pip install" in done.stderr
    assert all(name in done.stderr for name in ("Genesis", "Newton", "MuJoCo", "genesis-world", "newton=", "mujoco="))
    assert len(done.stderr.splitlines()) == 1
    assert not done.stdout


@pytest.mark.parametrize("card", [False, True])
def test_cards_run_only_what_can_use_them(monkeypatch: pytest.MonkeyPatch, card: bool) -> None:
    """Every peer runs on the processor, and Genesis and Newton also on a card; MuJoCo's own engine has no such code."""
    monkeypatch.setattr(shutil, "which", lambda name: name if card else None)
    found = [(runner.package, runner.argument) for runner in runners("python") if runner.package != "taichi"]
    both = ["genesis", "newton"]
    expected = [(package, "cpu") for package in [*both, "mujoco"]] + [(package, "cuda") for package in both if card]
    assert sorted(found) == sorted(expected)


def test_mujoco_comes_to_rest_near_the_reference() -> None:
    """With cells as large as the contact MuJoCo's ball comes to rest, too high, by less than half of the depth."""
    python = str(PEERS_PYTHON) if PEERS_PYTHON.exists() else sys.executable
    if not present(python, "mujoco"):
        pytest.skip("mujoco is not installed (docs/peers.md)")
    modulus, cell = 2e4, 0.02  # the contact's radius is 0.024 m
    command = [python, "-m", "perf.peers.mujoco_drop", repr(modulus), "cpu", "120", repr(cell)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    outcome = json.loads(done.stdout.splitlines()[-1])
    assert outcome["at_rest"], done.stderr[-400:]
    # linear tetrahedra are too stiff, never too soft
    assert 0.5 * ref.DEPTH[modulus] < outcome["depth"] < ref.DEPTH[modulus]
