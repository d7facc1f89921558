"""Laws of the method mls: what its transfers keep, what contact at true surfaces means, and closed forms."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from solver.certificate import ContactRow
from solver.config import SolverConfig
from solver.errors import ModelError, UnstableStep
from solver.kernels.mls import ANGULAR_MOMENTUM, MOMENTUM
from solver.mls.drop import ExplicitDrop
from solver.model.bodies import Model
from solver.model.grid import graded_planes
from solver.reference.mls import GridFrame, grid_to_particles, particles_to_grid
from solver.runtime import start
from solver.settle import settle


def drop(lab, *bodies, gravity=(0.0, 0.0, -9.81), threads=2, **config):
    """Settle with mls."""
    chosen = SolverConfig(threads=threads, method="mls", **config)
    return settle(Model(tuple(bodies), np.asarray(gravity, dtype=float)), chosen)


def stepping(lab, *bodies, gravity=(0.0, 0.0, -9.81), **config):
    """A drop to be stepped by hand."""
    start(2)
    return ExplicitDrop(Model(tuple(bodies), np.asarray(gravity, dtype=float)), SolverConfig(method="mls", **config))


def blob(lab, height=0.5, **options):
    return lab.soft("blob", lab.Capsule(0.05, 0.0), [0, 0, height], E=3e4, cell=0.0125, **options)


def shaken(one, seed=0):
    """Give the particles of a body velocities, affine matrices and strains of no symmetry."""
    random = np.random.default_rng(seed)
    one.u[:] = 0.1 * random.normal(size=one.u.shape)
    one.C[:] = random.normal(size=one.C.shape)
    one.F[:] = np.eye(3) + 0.05 * random.normal(size=one.F.shape)
    one.lay_out()
    return one


def momentum(one):
    """Momentum and angular momentum of a body about the world's origin, affine part included; scaled as its inertia."""
    return one.sums[:, MOMENTUM : ANGULAR_MOMENTUM + 3].sum(axis=0)


@pytest.mark.slow
def test_a_step_keeps_momentum_and_angular_momentum_of_a_free_soft_body(lab):
    """Internal stress and both transfers change neither, to float precision, whatever the strains (APIC)."""
    one = shaken(stepping(lab, blob(lab), gravity=(0, 0, 0)).soft[0])
    before = momentum(one)
    size = np.abs(one.constant[:, 0] @ np.abs(one.u)).max()
    one.step(1e-4, np.zeros(3))
    # 2440 particles of 27 nodes each, double precision: sqrt(66000) * 2.2e-16 of the sum of absolute values
    assert np.abs(momentum(one)[:3] - before[:3]).max() < 1e-13 * size
    # angular momentum is taken at the new positions: the position update x + dt u keeps x cross u of each particle,
    # the affine transfer the rest; stress is symmetric
    assert np.abs(momentum(one)[3:] - before[3:]).max() < 1e-12 * size


def test_kinetic_damping_keeps_momentum_and_takes_only_strain_motion(lab):
    """What it leaves is the rigid motion of the same momentum and angular momentum."""
    one = shaken(stepping(lab, blob(lab), gravity=(0, 0, 0)).soft[0])
    before = momentum(one)
    one.peak = 1e9
    one.damp_strain(0.02)
    assert momentum(one) == pytest.approx(before, rel=1e-10, abs=1e-10)
    # a difference of energies that are 1e-4 J: rounding of that
    assert abs(one.motion().strain_motion_energy) < 1e-15


def test_the_transfers_agree_with_their_definition(lab):
    """Grid momentum, mass, and what particles take back, on graded planes that stand askew, against a plain loop
    written from the equations."""
    side = [graded_planes(-0.025, 0.025, -0.025, -0.005, 0.01) for _ in range(3)]
    bit = lab.soft("bit", lab.Box(np.full(3, 0.05)), [0, 0, 0], E=3e4, planes=tuple(side))
    one = stepping(lab, bit).soft[0]
    one.rotation, one.center = Rotation.from_rotvec([0.3, -0.2, 0.5]).as_matrix(), np.array([0.01, 0.02, -0.03])
    one.x[:] = (one.x - one.start_center) @ one.rotation.T + one.center
    shaken(one)
    given = {k: getattr(one, k).copy() for k in ("x", "u", "C", "F", "constant")}
    grid = GridFrame(one.planes, one.rotation, one.center, one.start_center)
    dt, gravity = 1e-4, np.array([0.0, 0.0, -9.81])
    expected = particles_to_grid(given, dt, grid, gravity)
    velocity = np.divide(
        expected[:, :3], expected[:, 3:], out=np.zeros_like(expected[:, :3]), where=expected[:, 3:] > 0
    )
    moved = grid_to_particles(given, velocity, dt, grid)
    one.scale = 1.0  # the body as a whole takes nothing besides
    one.step(dt, gravity)
    # the polar rotation is known to 1e-6: a stress of 2 mu 1e-6, which acts over |x_i - x_p| <= 1.5 h (docs/physics.md)
    h, density = one.cell, float((given["constant"][:, 0] / given["constant"][:, 4]).min())
    speed = dt * 6.0 / h * 2e-6 * float((given["constant"][:, 1] / given["constant"][:, 4]).max()) / density
    near = {"x": dt * speed, "u": speed, "C": 6.0 / h * speed, "F": dt * 6.0 / h * speed}
    for name, error in near.items():
        assert getattr(one, name) == pytest.approx(moved[name], rel=1e-9, abs=error), name


def test_a_soft_body_falls_freely(lab):
    """v = g t: no scaled inertia or damping acts on a body as a whole, and it feels nothing that it does not touch."""
    slab = lab.soft("slab", lab.Box(np.array([0.2, 0.2, 0.05])), [0, 0, 0.37], E=3e4, cell=0.0125, fixed=True,
                    held=np.s_[:, :, 0], loaded=True)  # fmt: skip
    result = drop(lab, blob(lab), slab, step_limit=12)  # 5 cm take 100 ms
    time, speed = result.history.time, result.history.linear_speed
    assert speed == pytest.approx(lab.gravity * time, rel=1e-6)
    # a rigid motion strains nothing: its surface has kept its size
    assert np.ptp(result.bodies[0].vertices[:, 2]) == pytest.approx(0.1, abs=1e-6)


@pytest.mark.parametrize("soft", [False, True])
def test_bodies_exchange_equal_impulses(lab, soft):
    """Momentum of a free ball and a free soft block that it hits, without gravity, is kept to float precision."""
    block = lab.soft("block", lab.Box(np.full(3, 0.1)), [0, 0, 0], E=5e4, cell=0.0125)
    if soft:
        ball = lab.soft("ball", lab.Capsule(0.03, 0.0), [0.01, 0, 0.081], E=5e4, cell=0.0125)
        ball = replace(ball, velocity=np.array([0.1, 0, -0.5]))
    else:
        ball = lab.rigid("ball", lab.Capsule(0.03, 0.0), [0.01, 0, 0.081], mass=0.05, velocity=np.array([0.1, 0, -0.5]))
    one = stepping(lab, block, ball, gravity=(0, 0, 0))
    before = one._momenta()
    for _ in range(60):
        one.step(2e-4)
    after = one._momenta()
    assert np.linalg.norm(after[0].linear) > 0.1 * np.linalg.norm(before[1].linear)  # it did hit
    total = [sum(one.linear for one in some.values()) for some in (before, after)]
    assert total[1] == pytest.approx(total[0], abs=1e-9)


@pytest.mark.slow
@pytest.mark.long
def test_a_soft_ball_on_a_plane_agrees_with_static_finite_elements(lab):
    """Top at 195.24 mm (static finite elements) within 5 % of its sag, and the floor carries the weight."""
    ball = lab.soft("soft", lab.Capsule(0.1, 0.0), [0, 0, 0.102], E=5e4, rho=200.0, cell=0.0125)
    result = drop(lab, ball, lab.floor())
    weight = 200.0 * 4.0 / 3.0 * np.pi * 0.1**3 * lab.gravity
    assert result.verdict == "at_rest"
    assert 0.2 - result.bodies[0].vertices[:, 2].max() == pytest.approx(0.2 - 0.195243, rel=0.05)
    # of the weight 0.5 % is the change of momentum that the rest threshold allows, 1 % the volume of the facets
    assert result.contacts[0].normal_force_n == pytest.approx(weight, rel=0.02)


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("E", [2e4, 5e5])
def test_a_ball_on_a_slab_agrees_with_static_finite_elements(lab, tmp_path, E):
    """Depths 12.17 and 1.49 mm within a tenth on cells by default."""
    _, depth = lab.reference_drop(tmp_path / "ball", 1.0, E, solver="mls")
    assert depth == pytest.approx(lab.known_depth[E], rel=0.1)


@pytest.mark.slow
@pytest.mark.parametrize(("share", "slides"), [(0.85, False), (1.2, True)])
def test_a_soft_block_slides_iff_the_slope_beats_static_friction(lab, share, slides):
    """It stays iff tan(a) <= mu = 0.5, and slides with g (sin a - mu_d cos a)."""
    angle = np.arctan(0.5 * share)
    gravity = lab.gravity * np.array([np.sin(angle), 0.0, -np.cos(angle)])
    block = lab.soft("block", lab.Box(np.array([0.1, 0.1, 0.05])), [-0.1, 0, 0.0252], E=1e5, rho=300.0, cell=0.0125,
                     mu=(0.5, 0.5))  # fmt: skip
    result = drop(lab, block, lab.floor(mu=(0.5, 0.5)), gravity=gravity, step_limit=40)
    time, speed = result.history.time, result.history.linear_speed
    if slides:
        late = time > 0.1
        expected = lab.gravity * (np.sin(angle) - 0.5 * np.cos(angle))
        # single nodes at the edge leave and return, each carrying less than a percent of the load
        assert np.polyfit(time[late], speed[late], 1)[0] == pytest.approx(expected, rel=0.05)
    else:
        assert result.verdict == "at_rest"


@pytest.mark.slow
def test_two_runs_give_the_same_bytes(lab):
    """Nothing that decides the result is added in a varying order."""
    results = [drop(lab, blob(lab, 0.052), lab.floor(), step_limit=15) for _ in range(2)]
    assert np.array_equal(results[0].bodies[0].vertices, results[1].bodies[0].vertices)


@pytest.mark.slow
@pytest.mark.long
def test_the_result_does_not_depend_on_the_number_of_threads():
    """1, 2 and 4 threads, each in a process of its own, give identical bytes."""
    program = (
        "import hashlib, sys; import numpy as np; sys.path.insert(0, sys.argv[1]); import conftest as lab\n"
        "from solver.config import SolverConfig; from solver.model.bodies import Model\n"
        "from solver.settle import settle\n"
        "b = lab.soft('blob', lab.Capsule(0.05, 0.0), [0, 0, 0.052], E=3e4, cell=0.0125)\n"
        "r = lab.rigid('ball', lab.Capsule(0.03, 0.0), [0.01, 0, 0.15], mass=0.1)\n"
        "c = SolverConfig(threads=int(sys.argv[2]), method='mls', step_limit=15)\n"
        "out = settle(Model((b, r, lab.floor()), np.array([0, 0, -9.81])), c)\n"
        "print(hashlib.sha256(b''.join(o.vertices.tobytes() for o in out.bodies)).hexdigest())\n"
    )
    digests = {
        subprocess.run(
            [sys.executable, "-c", program, str(Path(__file__).parent), str(threads)],
            capture_output=True, text=True, check=True,
        ).stdout.split()[-1]
        for threads in (1, 2, 4)
    }  # fmt: skip
    assert len(digests) == 1


@pytest.mark.slow
def test_a_soft_body_rests_on_the_surface_of_a_soft_body(lab):
    """The lower one carries the upper one's weight where their surfaces meet, to a tenth of a millimetre."""
    base = lab.soft("base", lab.Box(np.array([0.2, 0.2, 0.05])), [0, 0, 0.025], E=5e4, rho=60.0, cell=0.025,
                    held=np.s_[:, :, 0], fixed=True, loaded=True)  # fmt: skip
    pillow = lab.soft("pillow", lab.Box(np.array([0.1, 0.1, 0.05])), [0, 0, 0.0785], E=3e4, rho=100.0, cell=0.0125)
    result = drop(lab, pillow, base)
    weight = 100.0 * 0.1 * 0.1 * 0.05 * lab.gravity
    assert result.verdict == "at_rest"
    row = result.contacts[0]
    assert row.normal_force_n == pytest.approx(weight, rel=0.02)
    assert row.max_penetration_m < 1e-4
    assert row.area_m2 == pytest.approx(0.01, rel=0.2)


@pytest.mark.slow
def test_a_bond_carries_what_hangs_on_it(lab):
    """A soft pad under a rigid beam that stands still: the bond holds its weight, and stretches by nothing seen."""
    beam = lab.rigid("beam", lab.Box(np.array([0.2, 0.2, 0.02])), [0, 0, 0.01], fixed=True)
    pad = lab.soft("pad", lab.Box(np.array([0.1, 0.1, 0.05])), [0, 0, -0.0255], E=3e4, rho=100.0, cell=0.0125)
    model = Model((pad, beam), np.array([0.0, 0.0, -9.81]), (), (("pad", "beam"),))
    result = settle(model, SolverConfig(threads=2, method="mls"))
    held = result.forces.force[result.forces.bonded].sum(axis=0)
    sign = 1.0 if result.forces.a[0] == 0 else -1.0
    assert result.verdict == "at_rest"
    assert sign * held == pytest.approx([0.0, 0.0, 100.0 * 5e-4 * lab.gravity], abs=0.02)
    assert result.bodies[0].vertices[:, 2].max() == pytest.approx(-0.0005, abs=2e-4)


@pytest.mark.long
@pytest.mark.slow
def test_a_light_pad_under_a_heavy_weight_comes_to_rest(lab):
    """A body moves as a whole with its true mass, and all of its springs together may not throw that."""
    pad = lab.soft("pad", lab.Box(np.array([0.08, 0.08, 0.03])), [0, 0, 0.0155], E=1e4, rho=100.0, cell=0.0075,
                   edge=0.003)  # fmt: skip
    weight = lab.rigid("weight", lab.Box(np.array([0.08, 0.08, 0.04])), [0, 0, 0.051], mass=1.0)
    model = Model((pad, weight, lab.floor()), np.array([0.0, 0.0, -9.81]), (), (("pad", "weight"),))
    result = settle(model, SolverConfig(threads=2, method="mls", step_limit=150))
    assert result.verdict == "at_rest"
    carried = (1.0 + 100.0 * 0.08 * 0.08 * 0.03) * lab.gravity
    assert result.contacts[0].normal_force_n == pytest.approx(carried, rel=0.02)


def test_a_contact_that_cells_cannot_tell_is_named(lab):
    """Smaller than two of them; contacts of rigid bodies alone have no cells."""
    one = stepping(lab, blob(lab), lab.floor())
    row = ContactRow("blob", "floor", (1.9 * one.cell) ** 2, 1.0, 0.0, 0.0, 0.0, 3, 0)
    wide, rigid = replace(row, area_m2=(2.1 * one.cell) ** 2), replace(row, a="box")
    said = one._unresolved(SimpleNamespace(contacts=(row, wide, rigid)))
    assert ["contact of blob and floor" in line for line in said] == [True]


@pytest.mark.long
@pytest.mark.slow
def test_a_light_plate_is_not_thrown_by_its_many_springs(lab):
    """20 g on 2400 points, each as stiff as one alone may be."""
    slab = lab.soft("slab", lab.Box(np.array([0.2, 0.2, 0.05])), [0, 0, 0.025], E=5e4, rho=60.0, cell=0.0125,
                    fixed=True, held=np.s_[:, :, 0], loaded=True, edge=0.005)  # fmt: skip
    plate = lab.rigid("plate", lab.Box(np.array([0.15, 0.15, 0.004])), [0, 0, 0.0525], mass=0.02, edge=0.004)
    result = drop(lab, plate, slab, step_limit=60)
    assert result.verdict == "at_rest"
    assert result.bodies[0].vertices[:, 2].min() == pytest.approx(0.05, abs=1e-4)


@pytest.mark.slow
@pytest.mark.long
def test_what_springs_give_is_taken_back(lab):
    """A ball on a slab: no point lies deeper than three times what is aimed at in the mean."""
    slab = lab.soft("slab", lab.Box(np.array([0.2, 0.2, 0.075])), [0, 0, 0.0375], E=2e4, cell=0.0125, fixed=True,
                    held=np.s_[:, :, 0], loaded=True, rolling=1e-3)  # fmt: skip
    ball = lab.rigid("ball", lab.Capsule(0.05, 0.0), [0, 0, 0.1255], mass=0.5, edge=0.004, rolling=1e-3)
    result = drop(lab, ball, slab)
    assert result.verdict == "at_rest"
    assert result.contacts[0].max_penetration_m < 3.0 * SolverConfig().penetration_target


def test_a_point_comes_to_its_full_stiffness_late_and_loses_it_sooner(lab):
    """Held at a depth d, a point whose spring has a quarter of its stiffness is pushed as if at 4 d. Where it comes out
    it loses three times the way, so that what has rolled on is not pushed from behind."""
    touch = stepping(lab, blob(lab, 0.051), lab.floor()).contacts.touches[0]
    touch.near = np.arange(3)
    touch.allowed[:], touch.stiffness[:] = 100.0, 400.0
    touch.memory = replace(touch.memory, stiffness=np.full(len(touch.stiffness), 100.0))
    depth = np.array([1e-4, 2e-4, 0.0])
    touch.touched[:3], touch.gap[:3] = True, -depth
    for _ in range(400):
        touch.follow(-depth, 1e-3)
    assert touch.offset[:3] == pytest.approx(3.0 * depth, rel=1e-3, abs=1e-12)
    touch.follow(-depth + 1e-5, 1e-3)
    assert touch.offset[:2] == pytest.approx(3.0 * (depth[:2] - 1e-5), rel=1e-2)


def test_a_pair_is_stiffened_until_its_mean_penetration_is_the_one_aimed_at(lab):
    """Points that carry more count for more; a pair that is stiff enough stays as it is."""
    touch = stepping(lab, blob(lab, 0.051), lab.floor()).contacts.touches[0]
    touch.load[:2], touch.gap[:2] = (3.0, 1.0), (-4e-4, -2e-4)
    before = touch.stiffness.copy()
    touch.stiffen(1e-4, 1.0)
    assert touch.stiffness == pytest.approx(3.5 * before)
    touch.stiffen(3.4e-4, 1.0)
    assert touch.stiffness == pytest.approx(3.5 * before)
    assert np.all(touch.memory.stiffness <= touch.allowed)


@pytest.mark.long
@pytest.mark.slow
def test_what_springs_give_back_does_not_drive_a_ball_that_rolls(lab):
    """Nothing resists rolling but the foam, and part of each force comes late: the ball still gets slower."""
    slab = lab.soft("slab", lab.Box(np.array([0.4, 0.2, 0.05])), [0, 0, 0.025], E=2e4, rho=60.0, cell=0.0125,
                    fixed=True, held=np.s_[:, :, 0], loaded=True)  # fmt: skip
    speed, radius = 0.2, 0.05
    ball = lab.rigid("ball", lab.Capsule(radius, 0.0), [-0.1, 0, 0.1005], mass=3.0, edge=0.004,
                     velocity=np.array([speed, 0, 0]), angular_velocity=np.array([0, speed / radius, 0]))  # fmt: skip
    rolling = stepping(lab, ball, slab)
    speeds = [speed]
    for _ in range(10):
        for _ in range(24):
            rolling.step(5e-4)
        speeds.append(float(rolling.rigid.state.velocity[0][0]))
    assert max(speeds) < 1.01 * speed  # it falls by half a millimetre first
    assert speeds[-1] < 0.8 * speed


@pytest.mark.slow
@pytest.mark.long
def test_a_soft_ball_on_a_soft_slab_stops_bouncing(lab):
    """Nothing but the dashpot between the two takes the energy of its hops; it rests within half a second.

    Both resist rolling: a ball that does not rolls for seconds over the waves that cells of half its dent's width leave
    in the slab.
    """
    h = 0.0125
    slab = lab.soft("slab", lab.Box(np.array([0.2, 0.2, 0.05])), [0, 0, -0.025], E=2e4, rho=60.0, cell=h, fixed=True,
                    held=np.s_[:, :, 0], loaded=True, rolling=1e-3)  # fmt: skip
    ball = lab.soft("ball", lab.Capsule(0.06, 0.0), [0.003, 0.0012, 0.065], E=2e4, cell=h, rolling=1e-3)
    result = drop(lab, ball, slab, step_limit=63)
    assert result.verdict == "at_rest"
    assert result.contacts[0].normal_force_n == pytest.approx(200.0 * 4 / 3 * np.pi * 0.06**3 * lab.gravity, rel=0.02)


@pytest.mark.long
@pytest.mark.slow
def test_rigid_bodies_stand_on_each_other_beside_the_material(lab):
    """A rigid cube on a rigid floor comes to rest on it while a soft body rests elsewhere."""
    cube = lab.rigid("cube", lab.Box(np.full(3, 0.05)), [0.2, 0, 0.0255], mass=0.5)
    result = drop(lab, cube, blob(lab, 0.051), lab.floor())
    assert result.verdict == "at_rest"
    # springs carry the weight at the penetration target of 0.05 mm
    assert abs(result.bodies[0].vertices[:, 2].min()) < 1e-4
    row = next(c for c in result.contacts if {c.a, c.b} == {"cube", "floor"})
    assert row.normal_force_n == pytest.approx(0.5 * lab.gravity, rel=5e-3)


@pytest.mark.slow
def test_a_rigid_block_on_a_rigid_slope_below_static_friction_comes_to_rest(lab):
    """tan(a) = 0.85 mu: friction's anchors hold it where it is, without creep; the material lies elsewhere."""
    angle = np.arctan(0.85 * 0.5)
    gravity = lab.gravity * np.array([np.sin(angle), 0.0, -np.cos(angle)])
    block = lab.rigid("block", lab.Box(np.full(3, 0.05)), [-0.1, 0, 0.0251], mass=0.5, mu=(0.5, 0.5))
    pad = lab.soft("pad", lab.Box(np.full(3, 0.05)), [0.2, 0.2, 0.025], E=5e4, cell=0.025, fixed=True,
                   held=np.s_[:, :, 0], loaded=True)  # fmt: skip
    result = drop(lab, block, pad, lab.floor(mu=(0.5, 0.5)), gravity=gravity, step_limit=30)
    assert result.verdict == "at_rest"
    assert result.bodies[0].speed < 1e-6  # springs are implicit: what is left decays by a factor in every step


def test_a_broken_state_is_named(lab):
    """A step beyond the bound of the wave speed ends in UnstableStep with time, body and bound, not in nonsense."""
    one = stepping(lab, blob(lab))
    shaken(one.soft[0])

    def overstep():
        for _ in range(200):
            one.step(5e-3)  # waves cross six cells in it

    with pytest.raises(UnstableStep, match=r"t = .*body 'blob'.*mls_cfl"):
        overstep()


def test_bodies_that_start_inside_each_other_are_refused(lab):
    """No rest state can be reached honestly from there."""
    with pytest.raises(ModelError, match="inside each other"):
        drop(lab, blob(lab, 0.03), lab.floor())


def test_a_body_with_too_few_particles_is_refused_and_one_that_shows_only_its_top_is_not(lab):
    """Two particles through a pad of 10 mm in one cell; a block of which only the flat top can be touched has many."""
    low = np.array([0.0, 0.01])
    with pytest.raises(ModelError, match=r"2 particles across body 'pad' \(10 mm along z\).* 0\.0067 m or finer"):
        stepping(lab, lab.soft("pad", lab.Box(np.array([0.06, 0.06, 0.01])), [0, 0, 0.005], E=2e4,
                               planes=(*[np.linspace(-0.03, 0.03, 7)] * 2, low)))  # fmt: skip
    block = lab.soft("block", lab.Box(np.full(3, 0.06)), [0, 0, 0.03], E=2e4, cell=0.01)
    top = block.faces[(block.vertices[block.faces][..., 2] > 0.06 - 1e-9).all(axis=1)]
    used, faces = np.unique(top, return_inverse=True)
    stepping(lab, replace(block, vertices=block.vertices[used], faces=faces.reshape(-1, 3).astype(np.int32)))


@pytest.mark.slow
def test_the_stress_of_a_block_carries_its_weight(lab):
    """A block on a clamp that sags under itself: the virial of its stress, the integral of sigma_zz over its volume, is
    minus the moment of its weight about the clamp (the balance of momentum times z, integrated by parts)."""
    block = lab.soft("block", lab.Box(np.array([0.1, 0.1, 0.1])), [0, 0, 0.05], E=2e4, cell=0.0125,
                     held=np.s_[:, :, 0], fixed=True, loaded=False)  # fmt: skip
    result = drop(lab, block)
    material = result.material["block"]
    place = material.start + material.displacement
    weight = 9.81 * block.interior.density[0] * material.volume
    expected = -(weight * place[:, 2]).sum()
    assert (material.stress[:, 2] * material.volume * material.volume_ratio).sum() == pytest.approx(expected, rel=0.05)
    assert material.volume.sum() == pytest.approx(1e-3, rel=1e-3)
