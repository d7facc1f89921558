"""Thin rigid things on soft ones by the method mls, with the solver's defaults: their two sides are told apart."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dcap.geometry.distance import distance_grid
from dcap.geometry.primitives import Box
from dcap.scene.types.gravity import GRAVITY
from dcap.scene.types.materials import ContactFriction
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.particles import InertialProperties, RigidSimulationBody
from solver.config import SolverConfig
from solver.mls.drop import ExplicitDrop
from solver.model.bodies import Model
from solver.runtime import start
from solver.settle import settle
from tasks.bodies.solver_model import solver_model
from tasks.case.bodies import case_particles
from tasks.case.file import checked_case

CELL = 0.0125
SLAB_TOP = 0.06
SIDE = 0.1  # of the plate [m]
THIN = 0.002  # the plate's thickness [m]
FALL = 0.1  # [m]
FOAM = {"density": 60, "youngs_modulus": 2e4, "poisson_ratio": 0.3, "static_friction": 0.5, "dynamic_friction": 0.4}


def plate(thickness: float, height: float) -> RigidSimulationBody:
    """A plate of 2 kg, `height` over the slab [m]."""
    solid, position = Box(np.array([SIDE, SIDE, thickness])), np.array([0.0, 0.0, SLAB_TOP + height + 0.5 * thickness])
    surface = solid.surface(0.01)
    mesh = Mesh.of(surface.vertices + position, surface.faces)
    low, high = mesh.bounds
    grid = distance_grid(mesh, low - 0.01, high + 0.01, min(0.35 * thickness, 2e-3))
    inertial = InertialProperties(2.0, position, np.diag(solid.inertia_per_mass * 2.0))
    return RigidSimulationBody(name="plate", instance="object", fixed=False, surface=mesh, distance=grid,
                               inertial=inertial, friction=ContactFriction(0.5, 0.4, 0.0))  # fmt: skip


def on_foam(thickness: float, height: float) -> Model:
    """The plate over a slab of foam that is held at its bottom."""
    steel = {**FOAM, "density": 7800, "youngs_modulus": 2e11}
    cube = {"name": "cube", "shape": {"box": {"size": [SIDE] * 3}}, "position": [0, 0, 0.2], "material": steel}
    slab = {"name": "slab", "shape": {"box": {"size": [0.2, 0.2, SLAB_TOP]}}, "position": [0, 0, 0.5 * SLAB_TOP],
            "motion": "fixed", "material": FOAM}  # fmt: skip
    case = case_particles(checked_case({"bodies": [cube, slab]}, "cube on foam"), Path(), CELL)
    return solver_model(replace(case, bodies=(plate(thickness, height), case.bodies[1])), (0.0, 0.0, -GRAVITY))


def dropped(*, cpic: bool | None = None) -> tuple[float, int, tuple[str, ...]]:
    """A plate of a sixth of a cell 0.8 s after it was let fall: its depth in the foam [m], the particles of foam above
    its upper face, and the warnings."""
    start(2)
    config = SolverConfig(method="mls", mls_cell=CELL, step_limit=100)
    if cpic is not None:
        config = config.model_copy(update={"cpic": cpic})
    one = ExplicitDrop(on_foam(THIN, FALL), config)
    result = one.run(None)
    body = result.bodies[0]
    local = (one.soft.particles.x - one.rigid.state.center[0]) @ one.rigid.state.rotation[0]
    # foam beside the rim may lean over it by its particles' spacing
    above = (np.abs(local[:, :2]) < 0.5 * (SIDE - CELL)).all(axis=1) & (local[:, 2] > 0.5 * THIN)
    return -(FALL + float(body.translation[2])), int(above.sum()), result.warnings


@pytest.mark.slow
@pytest.mark.long
def test_a_thin_plate_rests_on_the_foam_it_falls_on() -> None:
    """All foam stays under it, and it sinks as far as a block of the same base and mass by tl, whose contact is between
    surfaces, to the fifth of a cell to which mls knows a surface; the result says why."""
    depth, above, warnings = dropped()
    assert above == 0
    thick = settle(on_foam(0.02, 0.001), SolverConfig(threads=2))
    assert thick.verdict == "at_rest"
    assert depth == pytest.approx(-0.001 - float(thick.bodies[0].translation[2]), abs=0.2 * CELL)
    assert any("'plate'" in line and "(CPIC)" in line for line in warnings)


@pytest.mark.slow
@pytest.mark.long
def test_without_sides_the_plate_goes_into_the_foam() -> None:
    """What the default is good for: with cpic off the foam leaks through the plate, which ends in it, and that is
    said."""
    _, above, warnings = dropped(cpic=False)
    assert above > 0
    assert any("'plate'" in line and "cpic is off" in line for line in warnings)
