"""Soft contact against static finite elements and closed forms; all drops come to rest and are verified by a kick."""

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from solver.certificate import Verdict
from solver.config import SolverConfig
from solver.model.bodies import Model
from solver.runtime import start
from solver.settle import ImplicitDrop, settle
from solver.tl.simulation import StepControl


def hertz_radius(load, modulus, radius):
    """Contact radius of a rigid ball on a half-space with E / (1 - nu^2) = modulus: a^3 = 3 F R / (4 E*)."""
    return (0.75 * load * radius / modulus) ** (1 / 3)


def slab_under(lab, E, reach, cell, *, thick=0.15, mu=(0.5, 0.4)):
    """The reference slab, fine within `reach` of the middle of its top."""
    planes_x = lab.planes(-0.2, 0.2, -reach, reach, cell, 1.8)
    planes_z = lab.planes(0.0, thick, thick - reach, thick, cell, 1.8)
    return lab.soft("slab", lab.Box(np.array([0.4, 0.4, thick])), [0, 0, thick / 2], E=E, cell=cell,
                    planes=(planes_x, planes_x, planes_z), held=np.s_[:, :, 0], fixed=True, loaded=True,
                    spacing=0.005, mu=mu)  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(("mass", "E"), [
    (1.0, 2e4), *(pytest.param(*each, marks=pytest.mark.long) for each in ((.5, 1e4), (5., 1e5), (.2, 1e5), (1., 5e5)))
])  # fmt: skip
def test_a_ball_sinks_into_a_slab_as_deep_as_static_finite_elements_say(lab, tmp_path, mass, E):
    """Within 2 % for the same m g / E from 0.2 to 5 kg; forces balance the weight, gaps are invisible."""
    result, depth = lab.reference_drop(tmp_path, mass, E)
    reference = lab.known_depth[min(lab.known_depth, key=lambda known: abs(np.log(E / mass / known)))]
    assert depth == pytest.approx(reference, rel=0.02)
    assert result["residual"]["force"] < 0.005
    assert result["contacts"][0]["max_penetration_m"] < 3e-4
    assert result["contacts"][0]["max_gap_m"] < 3e-4


@pytest.mark.slow
@pytest.mark.long
def test_depth_converges_with_the_grid(lab, tmp_path):
    """Finer cells, smaller error: from a third of the contact radius to a fifth, the default; that is within 2 %."""
    errors = []
    for cells in (3, 5):
        folder = tmp_path / str(cells)
        folder.mkdir()
        errors.append(abs(lab.reference_drop(folder, 1.0, 2e4, 0.0256 / cells)[1] / lab.known_depth[2e4] - 1.0))
    assert errors[0] > errors[1]
    assert errors[1] < 0.02


@pytest.mark.slow
@pytest.mark.long
def test_a_small_dent_obeys_hertz(lab):
    """d = a^2 / R within 3 % where the slab is 40 contact radii thick."""
    E, mass = 5e5, 0.08
    contact = hertz_radius(mass * lab.gravity, E / 0.91, lab.radius)
    assert 39 * contact < lab.thick
    slab = slab_under(lab, E, 1.3 * contact, contact / 6)
    height = lab.thick + lab.radius + 2e-4
    ball = lab.rigid("ball", lab.Capsule(lab.radius, 0.0), [0, 0, height], mass=mass, edge=0.0015, spacing=0.0008)
    result = lab.drop(ball, slab)
    assert result.verdict == "at_rest"
    assert lab.thick - result.bodies[0].vertices[:, 2].min() == pytest.approx(contact**2 / lab.radius, rel=0.03)


@pytest.mark.slow
@pytest.mark.long
def test_a_flat_punch_obeys_boussinesq(lab):
    """d = F (1 - nu^2) / (2 a E)."""
    E, mass, a = 2e4, 0.02, 0.005
    slab = slab_under(lab, E, 1.3 * a, a / 8)
    punch = lab.rigid("punch", lab.Cylinder(a, 0.02), [0, 0, lab.thick + 0.0101], mass=mass, edge=a / 8, spacing=4e-4)
    result = lab.drop(punch, slab)
    depth = lab.thick - result.bodies[0].vertices[:, 2].min()
    expected = mass * lab.gravity * 0.91 / (2 * a * E)
    assert result.verdict == "at_rest"
    # the edge is known to half a cell: a / 16; the slab's bottom, 30 radii below, makes it stiffer by about a / H
    assert depth == pytest.approx(expected, rel=1 / 16 + a / lab.thick)


@pytest.mark.slow
@pytest.mark.long
def test_a_lying_capsule_sinks_evenly_and_less_than_a_ball(lab):
    """The same weight on a line instead of a point: shallower than the ball, deeper than the capsule's plane-strain
    bound, and level.
    """
    mass, E, length = 1.0, 2e4, 0.1
    planes_x = lab.planes(-0.2, 0.2, -0.08, 0.08, 0.01, 1.8)
    planes_y = lab.planes(-0.2, 0.2, -0.02, 0.02, 0.005, 1.8)
    planes_z = lab.planes(0.0, lab.thick, lab.thick - 0.02, lab.thick, 0.005, 1.8)
    slab = lab.soft("slab", lab.Box(np.array([0.4, 0.4, lab.thick])), [0, 0, lab.thick / 2], E=E, cell=0.005,
                    planes=(planes_x, planes_y, planes_z), held=np.s_[:, :, 0], fixed=True, loaded=True)  # fmt: skip
    turn = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])
    capsule = lab.rigid("capsule", lab.Capsule(lab.radius, length), [0, 0, lab.thick + lab.radius + 0.002], mass=mass,
                        rotation=turn, edge=0.005, rolling=1e-3)  # fmt: skip
    result = lab.drop(capsule, slab)
    depth = lab.thick - result.bodies[0].vertices[:, 2].min()
    assert result.verdict == "at_rest"
    assert np.degrees(np.arcsin(abs(result.bodies[0].rotation[2, 0]))) < 0.5
    # a rigid strip of half width b = sqrt(2 R d) and the capsule's whole length on a layer sinks no less than
    # uniaxially over its whole plan of 2 R (length + 2 R): F H (1 - 2 nu)(1 + nu) / (E (1 - nu) A)
    least = mass * lab.gravity * lab.thick * 0.52 / (0.7 * E * 2 * lab.radius * (length + 2 * lab.radius))
    assert least < depth < lab.known_depth[2e4]


@pytest.mark.slow
@pytest.mark.parametrize(("mu", "top"), [(0.0, 0.199383), (5.0, 0.199421)])
def test_a_cube_under_its_own_weight_on_a_plane(lab, mu, top):
    """Top centre from static finite elements, frictionless and gluing (friction far above the shear); 2 % of its
    sinking.
    """
    cube = lab.soft("cube", lab.Box(np.array([0.2, 0.2, 0.2])), [0, 0, 0.1001], E=1e5, rho=300.0, cell=0.02,
                    mu=(mu, mu), edge=0.02)  # fmt: skip
    result = lab.drop(cube, lab.floor(mu=(mu, mu)), kick_speed=0.0, kick_angular_speed=0.0)
    vertices = result.bodies[0].vertices
    start = cube.vertices
    middle = (np.abs(start[:, :2]) < 0.011).all(axis=1) & (start[:, 2] > 0.2)
    assert 0.2 - vertices[middle, 2].mean() == pytest.approx(0.2 - top, rel=0.04)


@pytest.mark.slow
def test_a_soft_ball_flattens_under_its_own_weight(lab):
    """R 0.1, E 5e4, rho 200 on a rigid plane: top at 195.243 mm from static finite elements; 2 % of the sinking."""
    cell = hertz_radius(200.0 * lab.gravity * 4.18879e-3, 5e4 / 0.91, 0.1) / 4
    across, up = lab.planes(-0.1, 0.1, -5 * cell, 5 * cell, cell, 1.5), lab.planes(0.0, 0.2, 0.0, 5 * cell, cell, 1.5)
    ball = lab.soft("ball", lab.Capsule(0.1, 0.0), [0, 0, 0.101], E=5e4, rho=200.0, cell=cell, mu=(0.05, 0.05),
                    planes=(across, across, up + 0.001), edge=0.004)  # fmt: skip
    result = lab.drop(ball, lab.floor(mu=(0.05, 0.05)), kick_speed=0.0, kick_angular_speed=0.0)
    assert 0.2 - result.bodies[0].vertices[:, 2].max() == pytest.approx(0.2 - 0.195243, rel=0.02)


@pytest.mark.slow
def test_stacked_soft_cubes_share_the_load(lab):
    """nu = 0: each shortens by (own weight / 2 + load above) H / (E A); together 2 rho g H^2 / E to first order."""
    E, rho, H = 1e5, 300.0, 0.1
    lower = lab.soft("lower", lab.Box(np.array([H, H, H])), [0, 0, H / 2], E=E, nu=0.0, rho=rho, cell=0.02,
                     held=np.s_[:, :, 0], fixed=True, edge=0.004)  # fmt: skip
    upper = lab.soft("upper", lab.Box(np.array([H, H, H])), [0, 0, 1.5 * H + 2e-4], E=E, nu=0.0, rho=rho, cell=0.02,
                     edge=0.004)  # fmt: skip
    result = lab.drop(upper, lower)
    top = result.bodies[0].vertices[:, 2].max()
    strain = rho * lab.gravity * H / E
    assert result.verdict == "at_rest"
    # penetration of 0.05 mm at most; points on the rim see the other cube's edge and carry nothing: 8 % less area
    assert 2 * H - top == pytest.approx(2 * strain * H, rel=0.04, abs=5e-5)


@pytest.mark.slow
@pytest.mark.parametrize(("mass", "side"), [(0.001, 0.1), (0.1, 0.1), pytest.param(50.0, 0.5, marks=pytest.mark.long)])
@pytest.mark.parametrize("E", [1e4, pytest.param(1e6, marks=pytest.mark.long), 9e8])
def test_nothing_is_thrown_off_and_nothing_falls_through(lab, mass, side, E):
    """From 1 g to 50 kg on 1e4 to 9e8 Pa: the block ends level, near where it fell, carried by the slab."""
    slab = lab.soft("slab", lab.Box(np.array([0.6, 0.6, 0.1])), [0, 0, 0.05], E=E, rho=100.0, cell=0.025,
                    held=np.s_[:, :, 0], fixed=True, loaded=True)  # fmt: skip
    block = lab.rigid("block", lab.Box(np.array([side, side, 0.05])), [0, 0, 0.135], mass=mass, edge=0.02)
    result = lab.drop(block, slab)
    assert result.verdict == "at_rest"
    uniaxial = mass * lab.gravity * 0.1 / (E * side**2)
    sunk = 0.1 - result.bodies[0].vertices[:, 2].min()
    assert -1e-4 < sunk < max(1.5 * uniaxial, 3e-4)  # corotated elasticity softens by a few per cent at 20 % strain
    assert np.abs(result.bodies[0].translation[:2]).max() < 2e-3
    assert result.bodies[0].rotation[2, 2] > np.cos(np.radians(1.0))


@pytest.mark.slow
def test_springs_that_become_stiffer_throw_nothing_up(lab):
    """Near rest contacts are stiffened until the penetration is invisible; that a ball rises out of it is no motion."""
    slab = lab.soft("slab", lab.Box(np.array([0.3, 0.3, 0.1])), [0, 0, -0.05], E=2e4, cell=0.02,
                    held=np.s_[:, :, 0], fixed=True, loaded=True)  # fmt: skip
    ball = lab.rigid("ball", lab.Capsule(0.05, 0.0), [0, 0, 0.051], mass=1.0)
    start(2)
    model = Model((ball, slab), np.array([0.0, 0.0, -lab.gravity]))
    one = ImplicitDrop(model, SolverConfig())
    state, control, stiffened, fastest = one.start_state(), StepControl(4e-3), 0, 0.0
    with threadpool_limits(1):
        for _ in range(60):
            step = one.step(state, control)
            state, control = step.state, step.control
            if stiffened:
                fastest = max(fastest, state.velocity[0, 2])
            one.stiffen(state, step.report.contacts, step.signals)
            stiffened += bool(state.memory.stiffened)
    assert stiffened >= 2
    # what the tolerance of a thousandth of the weight leaves pushes for three of the longest steps
    assert fastest < 3 * 1e-3 * lab.gravity * one.balance_step()


@pytest.mark.slow
@pytest.mark.long
def test_what_presses_hard_stays_on_its_side(lab):
    """A sheet 6 mm thick presses with E: with the first guess of the stiffness points sink through half of it, and from
    there the way out leads to the other side. Contacts become stiffer before it lies still."""
    thick = 0.006
    slab = lab.soft("slab", lab.Box(np.array([0.4, 0.4, 0.2])), [0, 0, -0.1], E=1.2e4, cell=0.02,
                    held=np.s_[:, :, 0], fixed=True, loaded=True)  # fmt: skip
    sheet = lab.rigid("sheet", lab.Box(np.array([0.1, 0.1, thick])), [0, 0, 0.5 * thick + 0.001], mass=12.0,
                      vertical=True, edge=0.01)  # fmt: skip
    start(2)
    one = ImplicitDrop(Model((sheet, slab), np.array([0.0, 0.0, -lab.gravity])), SolverConfig())
    state, control, deepest = one.start_state(), StepControl(4e-3), 0.0
    with threadpool_limits(1):
        for _ in range(60):
            step = one.step(state, control)
            state, control = step.state, step.control
            one.stiffen(state, step.report.contacts, step.signals)
            for t in step.report.contacts.active:
                deepest = max(deepest, -float(t.gap @ t.normal_force / t.normal_force.sum()))
    assert step.report.inverted == 0
    assert 0.0 < deepest < 0.25 * thick


@pytest.mark.parametrize("edge", [0.01, 0.04], ids=["fine", "coarse"])
def test_a_box_stands_on_its_underside_alone(lab, edge):
    """0.2 x 0.1 m, whatever part of the sides' faces belongs to the points at the rim."""
    box = lab.rigid("box", lab.Box(np.array([0.2, 0.1, 0.1])), [0, 0, 0.0505], mass=2.0, edge=edge)
    result = settle(Model((box, lab.floor()), np.array([0.0, 0.0, -9.81])), SolverConfig(threads=2))
    assert result.verdict is Verdict.AT_REST
    (row,) = result.contacts
    assert row.area_m2 == pytest.approx(0.02, rel=0.01)
    assert row.normal_force_n == pytest.approx(2.0 * 9.81, rel=0.01)
