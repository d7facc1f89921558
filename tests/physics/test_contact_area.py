"""The area of a contact is that of the faces that look at the other body, whatever the faces beside them."""

import numpy as np
import pytest

from solver.certificate import Verdict
from solver.config import SolverConfig
from solver.model.bodies import Model
from solver.settle import settle


@pytest.mark.parametrize("edge", [0.01, 0.04], ids=["fine", "coarse"])
def test_a_box_stands_on_its_underside_alone(lab, edge):
    """0.2 x 0.1 m, whatever part of the sides' faces belongs to the points at the rim."""
    box = lab.rigid("box", lab.Box(np.array([0.2, 0.1, 0.1])), [0, 0, 0.0505], mass=2.0, edge=edge)
    result = settle(Model((box, lab.floor()), np.array([0.0, 0.0, -9.81])), SolverConfig(threads=2))
    assert result.verdict is Verdict.AT_REST
    (row,) = result.contacts
    assert row.area_m2 == pytest.approx(0.02, rel=0.01)
    assert row.normal_force_n == pytest.approx(2.0 * 9.81, rel=0.01)
