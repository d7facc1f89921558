"""Bodies that move along z alone: what would tip, roll or slide stays upright and sinks straight down."""

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dcap.scene.errors import InputError
from solver.errors import ModelError
from tasks.case.file import checked_case
from tasks.case.run import run_case

FOAM = {"density": 60, "youngs_modulus": 2e4, "poisson_ratio": 0.3, "static_friction": 0.5, "dynamic_friction": 0.4}


def on_edge(motion: str, **more: Any) -> Any:
    """A cube on its edge, a little tilted, over a slab of foam."""
    turn = Rotation.from_euler("x", 50.0, degrees=True).as_quat(scalar_first=True)
    return {
        "resolution": 0.02,
        "bodies": [
            {"name": "slab", "shape": {"box": {"size": [0.3, 0.3, 0.1]}}, "position": [0, 0, 0.05], "motion": "fixed",
             "material": FOAM},
            {"name": "cube", "shape": {"box": {"size": [0.1, 0.1, 0.1]}}, "position": [0.02, 0.01, 0.175],
             "quaternion": turn.tolist(), "motion": motion, "mass": 1.0, "material": "steel"} | more,
        ],
    }  # fmt: skip


@pytest.mark.slow
def test_a_guided_cube_rests_on_its_edge(tmp_path):
    """It moves straight down, does not turn, and the foam carries its whole weight; the kick moves it along z alone."""
    result: Any = run_case(on_edge("vertical"), tmp_path, threads=2, quiet=True)
    body = result["bodies"]["cube"]
    assert result["verdict"] == "at_rest"
    assert body["position"][:2] == [0.02, 0.01]
    assert body["quaternion"] == pytest.approx(on_edge("free")["bodies"][1]["quaternion"], abs=1e-12)
    assert body["position"][2] < 0.17
    assert result["contacts"][0]["normal_force_n"] == pytest.approx(9.81, rel=0.05)
    assert result["residual"]["force"] < 5e-3
    assert result["certificate"]["kick"]["done"]


@pytest.mark.long
@pytest.mark.slow
def test_a_free_one_falls_over(tmp_path):
    """Without the guide the same cube comes to lie on a face."""
    result: Any = run_case(on_edge("free"), tmp_path, threads=2, quiet=True)
    up = Rotation.from_quat(result["bodies"]["cube"]["quaternion"], scalar_first=True).as_matrix()[2]
    assert np.abs(up).max() > 0.99


def test_what_cannot_be_guided_is_refused(lab):
    """A soft body, and a start velocity that is not vertical."""
    with pytest.raises(InputError, match="only a rigid body"):
        checked_case(on_edge("vertical", material=FOAM), "case")
    with pytest.raises(ModelError, match="along z alone"):
        lab.rigid("box", lab.Box(np.full(3, 0.1)), [0, 0, 0], vertical=True, velocity=np.array([0.1, 0.0, 0.0]))
