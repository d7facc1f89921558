"""The friction of a pair: the geometric mean of the two rows unless the pair is given, in placements and in cases."""

import math
from pathlib import Path

import numpy as np
import pytest

from dcap.knowledge.material_table import load_materials
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.particles import DistanceGrid, Particles, RigidSimulationBody
from solver.contact.friction import PairFriction
from solver.model.bodies import Body, Model
from tasks.bodies.discretization import inertial_of_shell
from tasks.bodies.solver_model import solver_model
from tasks.case.bodies import case_particles
from tasks.case.file import Case

NAMES = ("steel", "granite")
CORNERS = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
TETRAHEDRON = Mesh.of(CORNERS, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
GRID = DistanceGrid(np.zeros(3), 1.0, np.zeros((3, 3, 3), np.float32))


def placed() -> Model:
    """A placement's model of two rigid bodies."""
    library = load_materials()
    bodies = (
        RigidSimulationBody(
            name=name, instance=name, fixed=True, surface=TETRAHEDRON, distance=GRID,
            inertial=inertial_of_shell(TETRAHEDRON, 1.0), friction=library[name].friction,
        )
        for name in NAMES
    )  # fmt: skip
    return solver_model(Particles(tuple(bodies), (), 0.1, ()), (0.0, 0.0, -9.81))


def from_case(*pairs: dict[str, object]) -> Model:
    """A case's model of two rigid bodies."""
    shape = {"box": {"size": [1, 1, 1]}}
    bodies = [
        {"name": name, "shape": shape, "position": [0, 0, 0], "material": name, "motion": "fixed"} for name in NAMES
    ]
    case = Case.model_validate({"bodies": bodies, "friction_pairs": list(pairs)})
    return solver_model(case_particles(case, Path(), 0.25), case.gravity)


def of_pair(model: Model, one: Body, other: Body) -> tuple[float, float]:
    """Static and dynamic friction with which the solver lets a point of one body touch the other."""
    static, dynamic, _ = PairFriction.of(model, one, other).at(np.array([0]), np.zeros((1, 3)))[0].tolist()
    return static, dynamic


@pytest.mark.parametrize("model", [placed, from_case])
def test_a_pair_has_the_geometric_mean_of_its_rows(model) -> None:
    """sqrt(mu_a mu_b), static and dynamic."""
    steel, granite = (load_materials()[name] for name in NAMES)
    made = model()
    expected = (
        math.sqrt(steel.static_friction * granite.static_friction),
        math.sqrt(steel.dynamic_friction * granite.dynamic_friction),
    )
    assert of_pair(made, *made.bodies) == pytest.approx(expected)


def test_a_given_pair_wins_in_either_order() -> None:
    """`friction_pairs` of a case names bodies, not an order."""
    made = from_case({"a": "granite", "b": "steel", "static_friction": 0.3, "dynamic_friction": 0.2})
    assert of_pair(made, *made.bodies) == of_pair(made, *made.bodies[::-1]) == (0.3, 0.2)
