"""Laws of the method mls: what its transfers keep, and that it agrees with tl within what its cells resolve."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from solver.config import SolverConfig
from solver.errors import ModelError, UnstableStep
from solver.kernels.mls_moments import ANGULAR_MOMENTUM, MOMENTUM
from solver.mls.drop import ExplicitDrop
from solver.mls.particles import lattice_particles
from solver.mls.soft_pairs import soft_contact
from solver.model.bodies import Model
from solver.reference.mls import grid_to_particles, particles_to_grid
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
    """Give the particles of a drop velocities, affine matrices and strains of no symmetry."""
    random, p = np.random.default_rng(seed), one.soft.particles
    p.v[:] = 0.1 * random.normal(size=p.v.shape)
    p.C[:] = random.normal(size=p.C.shape)
    p.F[:] = np.eye(3).ravel() + 0.05 * random.normal(size=p.F.shape)
    one.soft.lay_out()
    return one


def momentum(one):
    """Momentum and angular momentum about the world's origin, affine part included."""
    return one.soft.sums[:, MOMENTUM : ANGULAR_MOMENTUM + 3].sum(axis=0)


@pytest.mark.slow
def test_a_step_keeps_momentum_and_angular_momentum_of_a_free_soft_body(lab):
    """Internal stress and both transfers change neither, to float precision, whatever the strains (APIC)."""
    one = shaken(stepping(lab, blob(lab), gravity=(0, 0, 0), damping_ratio=0.0))
    before = momentum(one)
    size = np.abs(one.soft.particles.constant[:, 0] @ np.abs(one.soft.particles.v)).max()
    one._damp_strain = lambda: None  # the transfers alone
    one.step(1e-4)
    # 2440 particles of 27 nodes each, double precision: sqrt(66000) * 2.2e-16 of the sum of absolute values
    assert np.abs(momentum(one)[:3] - before[:3]).max() < 1e-13 * size
    # angular momentum is taken at the new positions: the position update x + dt v keeps x cross v of each particle,
    # the affine transfer the rest; stress is symmetric
    assert np.abs(momentum(one)[3:] - before[3:]).max() < 1e-12 * size


def test_kinetic_damping_keeps_momentum_and_takes_only_strain_motion(lab):
    """What it leaves is the rigid motion of the same momentum and angular momentum."""
    one = shaken(stepping(lab, blob(lab), gravity=(0, 0, 0)))
    before = momentum(one)
    one.peak[:] = 1e9
    one._damp_strain()
    assert momentum(one) == pytest.approx(before, rel=1e-10, abs=1e-12)
    # a difference of energies that are 1e-4 J: rounding of that
    assert abs(one.soft.motion(0).strain_motion_energy) < 1e-15


def test_the_transfers_agree_with_their_definition(lab):
    """Grid momentum, mass, and what particles take back, against a plain loop written from the paper's equations."""
    one = shaken(stepping(lab, lab.soft("bit", lab.Box(np.full(3, 0.05)), [0, 0, 0], E=3e4, cell=0.025)))
    p, g = one.soft.particles, one.soft.grid
    given = {k: getattr(p, k).copy() for k in ("x", "v", "C", "F", "constant")}
    dt = 1e-4
    expected = particles_to_grid(given, dt, g.cell, g.low, tuple(g.shape), one.gravity)
    velocity = np.divide(
        expected[:, :3], expected[:, 3:], out=np.zeros_like(expected[:, :3]), where=expected[:, 3:] > 0
    )
    moved = grid_to_particles(given, velocity, dt, g.cell, g.low, tuple(g.shape))
    one._damp_strain = lambda: None
    one.step(dt)
    # the polar rotation is known to 1e-6: a stress of 2 mu 1e-6, which acts over |x_i - x_p| <= 1.5 h (docs/physics.md)
    volume = given["constant"][0, 0] / 200.0
    speed = dt * 6.0 / g.cell * 2e-6 * given["constant"][0, 1] / volume / 200.0
    near = {"x": dt * speed, "v": speed, "C": 6.0 / g.cell * speed, "F": dt * 6.0 / g.cell * speed}
    for name, error in near.items():
        assert getattr(p, name) == pytest.approx(moved[name], rel=1e-9, abs=error), name


def test_a_soft_body_falls_freely(lab):
    """v = g t to float precision: symplectic steps are exact for constant acceleration, and no damping acts."""
    result = drop(lab, blob(lab), step_limit=10)
    time, speed = result.history.time, result.history.linear_speed
    assert speed == pytest.approx(lab.gravity * time, rel=1e-9)
    # a rigid motion strains nothing: its surface has kept its size
    assert np.ptp(result.bodies[0].vertices[:, 2]) == pytest.approx(0.1, abs=1e-6)


def test_rigid_body_and_grid_exchange_equal_impulses(lab):
    """Momentum of a free ball and a free soft block that it hits, without gravity, is kept to float precision."""
    block = lab.soft("block", lab.Box(np.full(3, 0.1)), [0, 0, 0], E=5e4, cell=0.0125)
    ball = lab.rigid("ball", lab.Capsule(0.03, 0.0), [0.01, 0, 0.081], mass=0.05, velocity=np.array([0.1, 0, -0.5]))
    one = stepping(lab, block, ball, gravity=(0, 0, 0), mls_cell=0.0125)
    start_momentum = momentum(one)[:3] + 0.05 * one.rigid.state.velocity[1]
    for _ in range(60):
        one.step(2e-4)
    given = 0.05 * np.linalg.norm(one.rigid.state.velocity[1] - [0.1, 0, -0.5])
    total = momentum(one)[:3] + 0.05 * one.rigid.state.velocity[1]
    assert given > 0.01  # it did hit
    assert total == pytest.approx(start_momentum, abs=1e-12)


@pytest.mark.parametrize(("mass", "friction", "settles"), [(0.05, 0.5, True), (1e-3, 5.0, False)])
def test_a_result_says_where_contact_did_not_settle(lab, mass, friction, settles):
    """A cube of a two-hundredth of the block's mass that is thrown on it with a spin, and sticks, makes nodes come into
    touch and leave it in turn; one of a quarter of its mass does not."""
    mu = (friction, friction)
    block = lab.soft("block", lab.Box(np.full(3, 0.1)), [0, 0, 0], E=5e4, cell=0.0125, mu=mu)
    cube = lab.rigid("cube", lab.Box(np.full(3, 0.06)), [0.01, 0, 0.081], mass=mass, mu=mu,
                     velocity=np.array([0.3, 0, -0.5]), angular_velocity=np.array([5.0, 20.0, 3.0]))  # fmt: skip
    result = drop(lab, block, cube, mls_cell=0.0125, step_limit=6)
    assert any("'cube'" in line and "did not settle" in line for line in result.warnings) is not settles


@pytest.mark.slow
def test_a_soft_ball_on_a_plane_agrees_with_static_finite_elements(lab):
    """Top at 195.24 mm (static finite elements), within what a cell resolves, and the floor carries the weight."""
    h = 0.0125
    ball = lab.soft("soft", lab.Capsule(0.1, 0.0), [0, 0, 0.105], E=5e4, rho=200.0, cell=0.02)
    result = drop(lab, ball, lab.floor(), mls_cell=h)
    weight = 200.0 * 4.0 / 3.0 * np.pi * 0.1**3 * lab.gravity
    assert result.verdict == "at_rest"
    # contact is felt where the centroid at a node says so, exact for a plane of material; particles sample it at h / 2
    # and nodes up to a cell away carry it: the surface is known to a fifth of a cell
    assert result.bodies[0].vertices[:, 2].max() == pytest.approx(0.195243, abs=0.2 * h)
    # of the weight 0.4 % is the change of momentum that the rest threshold allows, 1 % the volume of the facets
    assert result.contacts[0].normal_force_n == pytest.approx(weight, rel=0.02)


@pytest.mark.slow
@pytest.mark.long
def test_a_ball_on_a_slab_agrees_with_tl_within_a_fifth_of_a_cell(lab):
    """Depth 12.17 mm (tl and static finite elements agree on it within 2 %)."""
    h = 0.4 / 30
    slab = lab.soft("slab", lab.Box(np.array([0.4, 0.4, 0.15])), [0, 0, 0.075], E=2e4, cell=0.02, fixed=True,
                    held=np.s_[:, :, 0], loaded=True, edge=0.01)  # fmt: skip
    ball = lab.rigid("ball", lab.Capsule(0.05, 0.0), [0, 0, 0.202], mass=1.0, edge=0.004, spacing=0.0015)
    result = drop(lab, ball, slab, mls_cell=h)
    depth = 0.15 - result.bodies[0].vertices[:, 2].min()
    assert result.verdict == "at_rest"
    assert depth == pytest.approx(12.166e-3, abs=0.2 * h)
    assert result.certificate.signals.force_residual.value < 5e-3


@pytest.mark.slow
@pytest.mark.parametrize(("share", "slides"), [(0.85, False), (1.2, True)])
def test_a_soft_block_slides_iff_the_slope_beats_static_friction(lab, share, slides):
    """It stays iff tan(a) <= mu = 0.5, and slides with g (sin a - mu_d cos a)."""
    angle = np.arctan(0.5 * share)
    gravity = lab.gravity * np.array([np.sin(angle), 0.0, -np.cos(angle)])
    block = lab.soft("block", lab.Box(np.array([0.1, 0.1, 0.05])), [-0.1, 0, 0.0252], E=1e5, rho=300.0, cell=0.0125,
                     mu=(0.5, 0.5))  # fmt: skip
    result = drop(lab, block, lab.floor(mu=(0.5, 0.5)), gravity=gravity, mls_cell=0.0125, step_limit=40)
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
    results = [drop(lab, blob(lab, 0.052), lab.floor(), step_limit=15, mls_cell=0.0125) for _ in range(2)]
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
        "c = SolverConfig(threads=int(sys.argv[2]), method='mls', mls_cell=0.01, step_limit=15)\n"
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
def test_a_soft_body_rests_on_a_soft_body_through_the_grid(lab):
    """The shared grid carries the upper body's weight; gap and penetration stay within a cell."""
    h = 0.0125
    base = lab.soft("base", lab.Box(np.array([0.2, 0.2, 0.05])), [0, 0, 0.025], E=5e4, rho=60.0, cell=0.025,
                    held=np.s_[:, :, 0], fixed=True, loaded=True)  # fmt: skip
    pillow = lab.soft("pillow", lab.Box(np.array([0.1, 0.1, 0.05])), [0, 0, 0.0785], E=3e4, rho=100.0, cell=0.0125)
    result = drop(lab, pillow, base, mls_cell=h)
    weight = 100.0 * 0.1 * 0.1 * 0.05 * lab.gravity
    assert result.verdict == "at_rest"
    assert result.contacts[0].normal_force_n == pytest.approx(weight, rel=0.02)
    # the bodies feel each other once their supports of 1.5 h overlap at a node: at most three cells apart
    assert -0.5 * h < result.bodies[0].vertices[:, 2].min() - 0.05 < 3.0 * h


@pytest.mark.slow
@pytest.mark.long
def test_a_soft_ball_on_a_soft_slab_stops_bouncing(lab):
    """Nothing but the dashpot between the two takes the energy of its hops; it rests within half a second."""
    h = 0.0125
    slab = lab.soft("slab", lab.Box(np.array([0.2, 0.2, 0.05])), [0, 0, -0.025], E=2e4, rho=60.0, cell=h, fixed=True,
                    held=np.s_[:, :, 0], loaded=True)  # fmt: skip
    ball = lab.soft("ball", lab.Capsule(0.06, 0.0), [0.003, 0.0012, 0.065], E=2e4, cell=h)
    result = drop(lab, ball, slab, mls_cell=h, step_limit=63)
    assert result.verdict == "at_rest"
    assert result.contacts[0].normal_force_n == pytest.approx(200.0 * 4 / 3 * np.pi * 0.06**3 * lab.gravity, rel=0.02)


@pytest.mark.parametrize("clamped", [False, True])
def test_the_dashpot_of_two_soft_bodies_keeps_momentum_and_takes_energy(lab, clamped):
    """Of two blocks that meet slantwise, momentum and angular momentum stay unless one is clamped; the approach slows
    down, and bodies that move as one feel nothing."""
    h = 0.0125
    side = np.full(3, 0.05)
    under = lab.soft("under", lab.Box(side), [0, 0, 0], E=2e4, cell=h, fixed=clamped,
                     held=np.s_[:, :, 0] if clamped else None)  # fmt: skip
    over = lab.soft("over", lab.Box(side), [0.02, 0.01, 0.052], E=2e4, cell=h)
    over = replace(over, velocity=np.array([0.05, 0.0, -0.2]))
    one = stepping(lab, under, over, gravity=(0, 0, 0), mls_cell=h)
    before, approach = momentum(one), one.soft.motion(1).velocity[2] - one.soft.motion(0).velocity[2]
    one.soft_pairs.damp(1e-3)
    after = one.soft.motion(1).velocity[2] - one.soft.motion(0).velocity[2]
    assert 0.2 * approach > after > approach
    if not clamped:
        assert momentum(one) == pytest.approx(before, rel=1e-9, abs=1e-12)
        for part in (0, 1):
            turn, center = np.array([0.3, -0.2, 0.1]), one.soft.motion(part).center
            one.soft.move(2 * part, keep=0.0, old=one.soft.motion(part),
                          velocity=np.array([0.1, 0.2, 0.3]) + np.cross(turn, center), spin=turn)  # fmt: skip
        together = momentum(one)
        v = one.soft.particles.v.copy()
        one.soft_pairs.damp(1e-3)
        assert one.soft.particles.v == pytest.approx(v, abs=1e-12)
        assert momentum(one) == pytest.approx(together, abs=1e-12)


def ring(lab, share):
    """A soft ring of 15 mm around a hole of 40 mm; of less than all of it, what lies within `share` of a half turn
    from the x axis."""
    solid = lab.Cylinder(0.035, 0.05)

    def distance(points):
        radius, angle = np.hypot(points[..., 0], points[..., 1]), np.arctan2(points[..., 1], points[..., 0])
        cut = radius * (np.abs(angle) - share * np.pi) if share < 1.0 else -np.ones_like(radius)
        return np.maximum.reduce([solid.distance(points), 0.02 - radius, cut])

    shape = SimpleNamespace(distance=distance, surface=solid.surface, volume=solid.volume)
    return lab.soft("ring", shape, [0, 0, 0], E=2e4, cell=0.00625, fixed=True, held=np.s_[:, :, 0])


@pytest.mark.parametrize(("share", "determined"), [(0.3, True), (1.0, False)])
def test_soft_bodies_around_each_other_have_no_common_normal(lab, share, determined):
    """In a third of a ring a rod's normals have a common direction, which the ring's symmetry gives; in a whole one
    they cancel, the result says that no part of the force is the normal one, and gives all of it."""
    h = 0.00625
    rod = lab.soft("rod", lab.Cylinder(0.018, 0.05), [0, 0, 0.006], E=2e4, cell=h)
    one = stepping(lab, ring(lab, share), rod, mls_cell=h, step_limit=1)
    result, contact = one.run(None), soft_contact(one.soft, 1, 0)
    said = [line for line in result.warnings if "'ring' and 'rod'" in line and "not determined" in line]
    row = result.contacts[0]
    assert contact is not None
    if determined:
        assert contact.normal == pytest.approx([-1.0, 0.0, 0.0], abs=0.1)
        assert not said
        assert row.tangential_force_n > 0.0
    else:
        assert contact.normal is None
        assert len(said) == 1
        assert row.normal_force_n > 0.0
        assert row.tangential_force_n == pytest.approx(0.0, abs=1e-12)


@pytest.mark.slow
def test_rigid_bodies_stand_on_each_other_beside_the_material(lab):
    """A rigid cube on a rigid floor comes to rest on it while a soft body rests elsewhere."""
    cube = lab.rigid("cube", lab.Box(np.full(3, 0.05)), [0.2, 0, 0.0255], mass=0.5)
    result = drop(lab, cube, blob(lab, 0.051), lab.floor(), mls_cell=0.0125)
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
    result = drop(lab, block, pad, lab.floor(mu=(0.5, 0.5)), gravity=gravity, mls_cell=0.0125, step_limit=30)
    assert result.verdict == "at_rest"
    assert result.bodies[0].speed < 1e-6  # springs are implicit: what is left decays by a factor in every step


def test_a_broken_state_is_named(lab):
    """A step beyond the bound of the wave speed ends in UnstableStep with time, body and bound, not in nonsense."""
    one = shaken(stepping(lab, blob(lab)))

    def overstep():
        for _ in range(200):
            one.step(5e-3)  # waves cross six cells in it

    with pytest.raises(UnstableStep, match=r"t = .*body 'blob'.*mls_cfl"):
        overstep()


def test_bodies_that_start_inside_each_other_are_refused(lab):
    """No rest state can be reached honestly from there."""
    with pytest.raises(ModelError, match="inside each other"):
        drop(lab, blob(lab, 0.03), lab.floor())


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


def test_a_base_of_which_only_the_top_is_known_is_filled_to_its_bottom(lab):
    """The surface of a wide base is its top near the contact; its material goes on below."""
    slab = lab.soft("slab", lab.Box(np.array([0.2, 0.2, 0.1])), [0, 0, 0], E=3e4, cell=0.02)
    on_top = slab.vertices[:, 2] > slab.vertices[:, 2].max() - 1e-9
    number = np.cumsum(on_top) - 1
    faces = number[slab.faces[on_top[slab.faces].all(axis=1)]].astype(np.int32)
    top = replace(slab, vertices=slab.vertices[on_top], faces=faces)
    whole, found = (lattice_particles(one, 0.04, np.zeros(3)) for one in (slab, top))
    assert np.ptp(top.vertices[:, 2]) < 1e-6
    assert len(found.volume) == len(whole.volume) > 100
    assert np.allclose(found.position, whole.position)
