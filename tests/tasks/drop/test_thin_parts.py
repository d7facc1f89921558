"""Thin rigid things on soft ones by the method mls, through the stage: their two sides are told apart by themselves."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dcap.geometry.distance import distance_grid
from dcap.geometry.primitives import Box
from dcap.scene.types.anchor import Anchor
from dcap.scene.types.intent import Intent, OrientationRequest, RegionRequest
from dcap.scene.types.materials import ContactFriction
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.particles import InertialProperties, RigidSimulationBody
from dcap.scene.types.settled import LastState, Settled
from solver.config import SolverConfig
from tasks.case.bodies import case_particles
from tasks.case.file import checked_case
from tasks.drop.stage import DropConfig, drop

CELL = 0.0125
SLAB_TOP = 0.06
FALL = 0.1  # [m]
KNOWN = 3.09e-3  # depth [m] by tl, whose contact is between surfaces, whatever is behind them
FOAM = {"density": 60, "youngs_modulus": 2e4, "poisson_ratio": 0.3, "static_friction": 0.5, "dynamic_friction": 0.4}
STEEL = {**FOAM, "density": 7800, "youngs_modulus": 2e11}


def plate() -> RigidSimulationBody:
    """A plate of a sixth of a cell, FALL over the slab."""
    solid, position = Box(np.array([0.1, 0.1, 0.002])), np.array([0.0, 0.0, SLAB_TOP + FALL + 0.001])
    surface = solid.surface(0.01)
    mesh = Mesh.of(surface.vertices + position, surface.faces)
    low, high = mesh.bounds
    grid = distance_grid(mesh, low - 0.01, high + 0.01, 7e-4)
    inertial = InertialProperties(2.0, position, np.diag(solid.inertia_per_mass * 2.0))
    return RigidSimulationBody(name="plate", instance="object", fixed=False, surface=mesh, distance=grid,
                               inertial=inertial, friction=ContactFriction(0.5, 0.4, 0.0))  # fmt: skip


def dropped(*, cpic: bool | None = None) -> tuple[float, tuple[str, ...]]:
    """How far a steel plate of a sixth of a cell is in the foam 0.8 s after it was let fall [m], and the warnings."""
    cube = {"name": "cube", "shape": {"box": {"size": [0.1, 0.1, 0.1]}}, "position": [0, 0, 0.2], "material": STEEL}
    slab = {"name": "slab", "shape": {"box": {"size": [0.2, 0.2, SLAB_TOP]}}, "position": [0, 0, 0.5 * SLAB_TOP],
            "motion": "fixed", "material": FOAM}  # fmt: skip
    case = case_particles(checked_case({"bodies": [cube, slab]}, "cube on foam"), Path(), CELL)
    particles = replace(case, bodies=(plate(), case.bodies[1]))
    square = np.array([[-0.1, -0.1], [0.1, -0.1], [0.1, 0.1], [-0.1, 0.1]])
    anchor = Anchor("slab", "top", 0, "center", np.zeros(2), np.zeros(3), np.eye(4), 0.01, square, "test")
    region, free = RegionRequest("", ("center",), (), ""), OrientationRequest("any", "", "")
    intent = Intent("slab", "slab", "test", np.full(3, 0.1), 2.0, False, 1.0, free, region, (), ())
    config = SolverConfig(method="mls", mls_cell=CELL, step_limit=100)
    if cpic is not None:
        config = config.model_copy(update={"cpic": cpic})
    found = drop(particles, anchor, intent, 0, DropConfig(solver=config, threads=2))
    if isinstance(found, Settled):
        return -(FALL + float(found.bodies[0].position[2])), found.warnings
    assert isinstance(found.evidence, LastState)
    return -(FALL + float(found.evidence.position[2])), found.evidence.warnings


@pytest.mark.slow
def test_a_thin_plate_rests_on_the_foam_it_falls_on() -> None:
    """With the stage's defaults it sinks as far as by tl, to what mls knows of a surface, and the result says why."""
    depth, warnings = dropped()
    assert depth == pytest.approx(KNOWN, abs=0.2 * CELL)
    assert any("'plate'" in line and "(CPIC)" in line for line in warnings)


@pytest.mark.slow
def test_without_sides_the_plate_goes_into_the_foam() -> None:
    """What the default is good for: with cpic off the foam leaks through the plate, which ends in it, and that is
    said."""
    depth, warnings = dropped(cpic=False)
    assert depth > KNOWN + 0.25 * CELL
    assert any("'plate'" in line and "cpic is off" in line for line in warnings)
