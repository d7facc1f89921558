"""Thin rigid things on soft ones by the method mls: what lies on one side is not felt on the other."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dcap.geometry.distance import distance_grid
from dcap.geometry.primitives import Box
from dcap.scene.types.materials import ContactFriction
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.particles import GRAVITY, InertialProperties, RigidSimulationBody
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


@pytest.mark.slow
@pytest.mark.long
def test_a_thin_plate_rests_on_the_foam_it_falls_on() -> None:
    """All foam stays under a plate of a sixth of a cell, and it sinks as far as a thick block of the same base and mass
    does by tl."""
    start(2)
    one = ExplicitDrop(on_foam(THIN, FALL), SolverConfig(method="mls"))
    result = one.run(None)
    depth = -(FALL + float(result.bodies[0].translation[2]))
    local = (one.soft[1].x - one.rigid.state.center[0]) @ one.rigid.state.rotation[0]
    # foam beside the rim may lean over it by its particles' spacing
    above = (np.abs(local[:, :2]) < 0.5 * (SIDE - CELL)).all(axis=1) & (local[:, 2] > 0.5 * THIN)
    assert not above.any()
    thick = settle(on_foam(0.02, 0.001), SolverConfig(threads=2))
    assert (result.verdict, thick.verdict) == ("at_rest", "at_rest")
    assert depth == pytest.approx(-0.001 - float(thick.bodies[0].translation[2]), abs=0.05 * CELL)
