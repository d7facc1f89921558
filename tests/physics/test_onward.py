"""A final state simulated on: rest stays, what floats falls, what is deep inside something is pushed out."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from solver.config import SolverConfig
from solver.errors import ModelError
from solver.model.bodies import Model
from solver.onward import PlacedBodies, begun, onward
from solver.runtime import start
from solver.settle import settle
from solver.tl.simulation import Simulation
from tasks.measure.drift import DriftConfig

G = 9.81
CONFIG = SolverConfig(threads=2)


def bodies(lab, height=0.005):
    slab = lab.soft("slab", lab.Box(np.array([0.3, 0.3, 0.1])), [0, 0, 0.05], E=2e4, nu=0.3, cell=0.0125,
                    held=np.s_[:, :, 0], fixed=True, loaded=True)  # fmt: skip
    ball = lab.rigid("ball", lab.Capsule(0.05, 0.0), [0, 0, 0.15 + height], mass=0.8)
    return Model((ball, slab), np.array([0.0, 0.0, -G]))


def placed(result):
    """Where everything ended."""
    rest = {one.name: one for one in result.bodies}
    return PlacedBodies(
        {name: one.rotation for name, one in rest.items()},
        {name: one.translation for name, one in rest.items()},
        result.nodes,
    )


@pytest.mark.slow
def test_a_rest_state_stays(lab):
    """A ball in its dent moves by micrometres in a second, and nothing is unbalanced."""
    model = bodies(lab)
    result = settle(model, CONFIG)
    found = onward(model, CONFIG, placed(result), 1.0, 400)
    assert found.seconds == pytest.approx(1.0)
    assert found.distance < 2e-5
    assert found.force_residual < 0.02


@pytest.mark.slow
@pytest.mark.long
def test_the_same_pose_over_a_slab_without_its_dent_is_pushed_out_and_sinks_in(lab):
    """The dent is 1 cm: without it the ball is that deep inside, and comes back to where it was."""
    model = bodies(lab)
    rest = placed(settle(model, CONFIG))
    found = onward(model, CONFIG, PlacedBodies(rest.rotation, rest.translation), 1.0, 400)
    assert found.distance < 1e-3


def test_what_is_deep_in_a_corner_is_pushed_out_of_both_sides(lab):
    """12 mm in a floor and 8 mm in a wall; that far is its drift."""
    wall = lab.rigid("wall", lab.Box(np.array([0.1, 0.3, 0.3])), [0.15, 0, 0.15], fixed=True, spacing=0.004)
    cube = lab.rigid("cube", lab.Box(np.array([0.1, 0.1, 0.1])), [0.058, 0, 0.038], mass=0.8)
    found = onward(Model((cube, lab.floor(), wall), np.array([0.0, 0.0, -G])), CONFIG, PlacedBodies(), 0.2, 400)
    assert found.distance == pytest.approx(np.hypot(0.012, 0.008), rel=0.05)
    assert found.angle < 0.02


def test_what_has_no_way_out_is_refused(lab):
    """A ball of 10 cm between slabs that are 6 cm apart."""
    size = np.array([0.3, 0.3, 0.2])
    slabs = [lab.rigid(f"slab {side}", lab.Box(size), [0, 0, side * 0.13], fixed=True, spacing=0.004)
             for side in (-1, 1)]  # fmt: skip
    ball = lab.rigid("ball", lab.Capsule(0.05, 0.0), [0, 0, 0.0], mass=0.8)
    with pytest.raises(ModelError, match="inside each other"):
        onward(Model((ball, *slabs), np.array([0.0, 0.0, -G])), CONFIG, PlacedBodies(), 0.2, 400)


def test_a_soft_body_of_which_only_a_pose_is_known_begins_there(lab):
    """Turned, and half a metre to the side: whole. What is fixed stays."""
    cube = lab.soft("cube", lab.Box(np.array([0.1, 0.1, 0.1])), [0, 0, 0.3], E=1e5, nu=0.3, cell=0.025)
    model = Model((cube, *bodies(lab).bodies[1:]), np.array([0.0, 0.0, -G]))
    turn = Rotation.from_rotvec([0.0, 0.0, 0.5]).as_matrix()
    start(CONFIG.threads, CONFIG.arch)
    simulation = Simulation(model, CONFIG)
    state = begun(simulation, PlacedBodies({"cube": turn}, {"cube": np.array([0.5, 0.0, 0.1])}))
    nodes = simulation.soft_of[0].nodes
    rest = simulation.soft.rest[nodes]
    np.testing.assert_allclose(state.x[nodes], rest @ turn.T + [0.5, 0.0, 0.1], atol=1e-6)
    slab = simulation.soft_of[1].nodes
    np.testing.assert_allclose(state.x[slab], simulation.soft.rest[slab], atol=1e-6)


def test_what_floats_falls(lab):
    """g t^2 / 2 while it meets nothing; all of its weight is unbalanced."""
    found = onward(bodies(lab, height=0.6), CONFIG, PlacedBodies(), 0.3, 400)
    assert found.seconds == pytest.approx(0.3)
    assert found.distance == pytest.approx(0.5 * G * 0.3**2, rel=0.05)
    assert found.force_residual == pytest.approx(1.0, rel=1e-3)


@pytest.mark.slow
@pytest.mark.long
def test_what_leans_on_nothing_tips_with_the_steps_of_the_measure(lab):
    """A pole on its edge, three degrees past its balance: over in a second, as seconds of a fall over are few."""
    slab = lab.soft("slab", lab.Box(np.array([0.3, 0.3, 0.05])), [0, 0, 0.025], E=1e6, nu=0.3, cell=0.0125,
                    held=np.s_[:, :, 0], fixed=True, loaded=True)  # fmt: skip
    size = np.array([0.04, 0.04, 0.2])
    pole = lab.rigid("pole", lab.Box(size), [0, 0, 0.15], mass=0.4)
    lean = np.arctan(size[0] / size[2]) + np.radians(3.0)
    turn = Rotation.from_rotvec([0.0, lean, 0.0]).as_matrix()
    lowest = (turn @ (0.5 * size * [1, 1, -1]))[2]
    start = PlacedBodies({"pole": turn}, {"pole": np.array([0.0, 0.0, 0.0501 - lowest]) - turn @ [0, 0, 0.15]})
    found = onward(Model((pole, slab), np.array([0.0, 0.0, -G])), DriftConfig().solver, start, 1.0, 400)
    assert np.degrees(found.angle) > 45.0


def test_the_work_is_bounded(lab):
    model = bodies(lab, height=0.6)
    points = len(Simulation(model, CONFIG).soft.real)
    found = onward(model, CONFIG, PlacedBodies(), 1.0, 400, most_work=3 * points)
    assert 1 <= found.steps <= 3
    assert onward(model, CONFIG, PlacedBodies(), 1.0, 4, most_work=1e9).steps == 4


def test_the_steps_are_bounded(lab):
    found = onward(bodies(lab, height=0.6), CONFIG, PlacedBodies(), 1.0, 3)
    assert found.steps == 3
    assert found.seconds < 1.0
