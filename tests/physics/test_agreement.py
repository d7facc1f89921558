"""The two methods, tl and mls, rest in the same state: their grids and times differ, their contact does not."""

import numpy as np
import pytest

from flows.methods import PAPER_STEP_SECONDS
from solver.config import SolverConfig
from solver.model.bodies import Model
from solver.settle import settle
from tasks.bodies.proof import proven

H = 0.0125  # cell [m]
RESOLVED = 0.05 * H  # what springs give way and cells differ by


def both(lab, *bodies):
    """The scene settled by tl and by mls; a plane without friction or a kick would say nothing more."""
    return [lab.drop(*bodies, method=method, kick_speed=0.0, kick_angular_speed=0.0) for method in ("tl", "mls")]


@pytest.mark.long
@pytest.mark.slow
def test_a_soft_cube_on_a_plane(lab):
    """Own weight, a fifth of its height sunk in: top, bottom, width and carried weight agree."""
    cube = lab.soft("cube", lab.Box(np.full(3, 0.1)), [0, 0, 0.0502], E=1e4, rho=300.0, cell=H, mu=(0.1, 0.1))
    results = both(lab, cube, lab.floor(mu=(0.1, 0.1)))
    weight = 300.0 * 0.1**3 * lab.gravity
    boxes = []
    for result in results:
        assert result.verdict == "at_rest"
        vertices = result.bodies[0].vertices
        boxes.append([vertices[:, 2].max(), vertices[:, 2].min(), *np.ptp(vertices[:, :2], axis=0)])
        assert result.contacts[0].normal_force_n == pytest.approx(weight, rel=0.01)
    # both sides of the width are surfaces
    assert np.abs(np.subtract(boxes[0], boxes[1])).max() < 2 * RESOLVED
    assert abs(boxes[0][0] - boxes[1][0]) < RESOLVED


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("step", [{}, {"mls_step_seconds": PAPER_STEP_SECONDS}], ids=["mls", "paper"])
def test_the_dent_of_a_ball_is_as_large_as_by_tl(lab, step):
    """A steel ball of 3 kg on foam at the paper's least modulus: depth within 15 %, contact area within 25 %, and no
    force farther than 1 mm from a surface."""
    slab = lab.soft("slab", lab.Box(np.array([0.2, 0.2, 0.06])), [0, 0, -0.03], E=5e4, cell=H, fixed=True,
                    held=np.s_[:, :, 0], loaded=True)  # fmt: skip
    ball = lab.rigid("ball", lab.Capsule(0.05, 0.0), [0, 0, 0.0505], mass=3.0, rolling=1e-3, edge=0.004)
    model = Model((ball, slab), np.array([0.0, 0.0, -9.81]))
    depth, area = [], []
    for config in (SolverConfig(threads=2), SolverConfig(threads=2, method="mls", **step)):
        result = proven(model, settle(model, config))
        assert result.verdict == "at_rest"
        assert result.certificate.proof is not None
        assert result.certificate.proof.gap_m.value < 1e-3
        depth.append(-result.bodies[0].vertices[:, 2].min())
        area.append(sum(row.area_m2 for row in result.contacts))
    assert depth[0] > 2e-3
    assert depth[1] == pytest.approx(depth[0], rel=0.15)
    assert area[1] == pytest.approx(area[0], rel=0.25)
