"""Thin rigid things on soft ones by the method mls, through the stage: their two sides are told apart by themselves."""

from pathlib import Path

import numpy as np
import pytest

from dcap.scene.types.anchor import Anchor
from dcap.scene.types.intent import Intent, OrientationRequest, RegionRequest
from dcap.scene.types.settled import Settled
from solver.config import SolverConfig
from tasks.case.bodies import case_particles
from tasks.case.file import checked_case
from tasks.drop.stage import DropConfig, drop

CELL = 0.0125
SLAB_TOP = 0.06
FOAM = {"density": 60, "youngs_modulus": 2e4, "poisson_ratio": 0.3, "static_friction": 0.5, "dynamic_friction": 0.4}
STEEL = {**FOAM, "density": 7800, "youngs_modulus": 2e11}


def dropped(**solver: object) -> tuple[float, tuple[str, ...]]:
    """How far a steel plate of a sixth of a cell sinks into foam that it falls on from 10 cm [m], and the warnings."""
    plate = {"name": "plate", "shape": {"box": {"size": [0.1, 0.1, 0.002]}}, "position": [0, 0, SLAB_TOP + 0.101],
             "mass": 2.0, "material": STEEL}  # fmt: skip
    slab = {"name": "slab", "shape": {"box": {"size": [0.2, 0.2, SLAB_TOP]}}, "position": [0, 0, 0.5 * SLAB_TOP],
            "motion": "fixed", "material": FOAM}  # fmt: skip
    particles = case_particles(checked_case({"bodies": [plate, slab]}, "plate on foam"), Path(), CELL)
    square = np.array([[-0.1, -0.1], [0.1, -0.1], [0.1, 0.1], [-0.1, 0.1]])
    anchor = Anchor("slab", "top", 0, "center", np.zeros(2), np.zeros(3), np.eye(4), 0.01, square, "test")
    region, free = RegionRequest("", ("center",), (), ""), OrientationRequest("any", "", "")
    intent = Intent("slab", "slab", "test", np.full(3, 0.1), 2.0, False, 1.0, free, region, (), ())
    found = drop(particles, anchor, intent, 0, DropConfig(solver=SolverConfig.model_validate(solver), threads=2))
    assert isinstance(found, Settled)
    return SLAB_TOP - float(found.bodies[0].surface.bounds[0, 2]), found.warnings


@pytest.fixture(scope="module")
def known() -> float:
    """The depth by tl, whose contact is between surfaces, whatever is behind them."""
    return dropped(kick_speed=0.0, kick_angular_speed=0.0)[0]


@pytest.mark.slow
def test_a_thin_plate_rests_on_the_foam_it_falls_on(known: float) -> None:
    """With the stage's defaults it sinks as far as by tl, to what mls knows of a surface, and the result says why."""
    depth, warnings = dropped(method="mls", mls_cell=CELL)
    assert depth == pytest.approx(known, abs=0.2 * CELL)
    assert any("'plate'" in line and "(CPIC)" in line for line in warnings)


@pytest.mark.slow
def test_without_sides_the_plate_goes_into_the_foam(known: float) -> None:
    """What the default is good for: with cpic off the foam leaks through the plate, which ends in it, and that is
    said."""
    depth, warnings = dropped(method="mls", mls_cell=CELL, cpic=False)
    assert depth > known + 0.25 * CELL
    assert any("'plate'" in line and "cpic is off" in line for line in warnings)
