"""What `make perf-peers` promises without the peers: the mesh it gives them, what it calls rest, its refusal."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from perf.peers import reference as ref
from perf.peers.tets import slab

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
    """Without any peer: exit 2 and one line that holds a pip command."""
    command = [sys.executable, "-m", "perf.peers", "--python", str(tmp_path / "python")]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "pip install" in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert not done.stdout
