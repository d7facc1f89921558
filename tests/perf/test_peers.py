"""What `make perf-peers` promises without the peers: the mesh it gives them, what it calls rest, its refusal."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from perf.peers import reference as ref
from perf.peers.__main__ import PEERS_PYTHON, present

ROOT = Path(__file__).resolve().parent.parent.parent


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
