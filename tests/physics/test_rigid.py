"""Laws of rigid bodies: rest, friction, toppling."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from dcap.scene.types.mesh import Mesh
from dcap.synthetic.dataset import build_object
from solver.contact.active import Contacts
from solver.model.state import ContactMemory


def slope(angle):
    """Gravity as felt on an incline of `angle` [rad] that runs down along x."""
    return (9.81 * np.sin(angle), 0.0, -9.81 * np.cos(angle))


def cube(lab, **options):
    return lab.rigid("cube", lab.Box(np.array([0.1, 0.1, 0.1])), [0, 0, 0.05], **options)


@pytest.mark.parametrize("mass", [0.001, 1.0, 50.0])
def test_a_cube_rests_flat_and_its_contact_carries_its_weight(lab, mass):
    """At rest the contact force equals the weight within the certificate's 0.5 %, whatever the mass."""
    result = lab.drop(cube(lab, mass=mass), lab.floor())
    assert result.verdict == "at_rest"
    assert result.contacts[0].normal_force_n == pytest.approx(mass * lab.gravity, rel=5e-3)
    # the penalty lets it sink by at most the penetration target of 0.05 mm
    assert abs(result.bodies[0].vertices[:, 2].min()) < 5e-5
    assert np.degrees(Rotation.from_matrix(result.bodies[0].rotation).magnitude()) < 0.1


@pytest.mark.parametrize(
    ("share", "verdict"), [(0.9, "at_rest"), pytest.param(1.1, "left_target", marks=pytest.mark.slow)]
)
def test_a_block_slides_iff_the_slope_beats_static_friction(lab, share, verdict):
    """It stays iff tan(a) <= mu = 0.5; mu_d = mu_s, since some points slip while the load builds up."""
    angle = np.arctan(0.5 * share)
    result = lab.drop(cube(lab, mu=(0.5, 0.5)), lab.floor(mu=(0.5, 0.5)), gravity=slope(angle))
    assert result.verdict == verdict


def test_a_sliding_block_accelerates_by_gravity_minus_dynamic_friction(lab):
    """a = g (sin a - mu_d cos a)."""
    angle = np.arctan(0.8)
    result = lab.drop(cube(lab, velocity=np.array([0.2, 0.0, 0.0])), lab.floor(), gravity=slope(angle), step_limit=60)
    time, speed = result.history.time, result.history.linear_speed
    expected = 9.81 * (np.sin(angle) - 0.4 * np.cos(angle))
    late = (time > 0.05) & (time < 0.15)
    measured = np.polyfit(time[late], speed[late], 1)[0]
    # backward Euler is exact for constant acceleration; 2 % covers the settling of the 1 mm fall
    assert measured == pytest.approx(expected, rel=0.02)


def test_a_cube_does_not_creep_on_a_slope_below_the_friction_angle(lab):
    """Remembered friction: after rest nothing moves; bound 0.1 mm over the 0.5 s after the kick."""
    result = lab.drop(cube(lab), lab.floor(), gravity=slope(np.arctan(0.4)))
    assert result.verdict == "at_rest"
    assert result.certificate.kick.distance_m.value < 1e-4


@pytest.mark.slow
@pytest.mark.parametrize(("lean", "stands"), [(0.8, True), (1.2, False)])
def test_a_tall_box_topples_past_its_critical_angle_and_not_before(lab, lean, stands):
    """Critical angle: tan(a) = width / height."""
    critical = np.arctan(0.05 / 0.2)
    turn = Rotation.from_euler("y", lean * critical).as_matrix()
    box = lab.Box(np.array([0.05, 0.05, 0.2]))
    lowest = (np.abs(turn[2]) * box.half_extents).sum()
    tall = lab.rigid("tall", box, [0, 0, lowest + 5e-4], rotation=turn, mu=(1.0, 0.9))
    result = lab.drop(tall, lab.floor(mu=(1.0, 0.9)))
    upright = (result.bodies[0].rotation @ turn)[2, 2] > 0.9
    assert result.verdict == "at_rest"
    assert upright == stands


@pytest.mark.slow
def test_a_cylinder_balanced_on_its_rim_is_not_a_rest_state(lab):
    """A balance that a kick of 1 mm/s destroys is reported as a fall, not as rest where it stood."""
    solid = lab.Cylinder(0.03, 0.1)
    turn = Rotation.from_euler("y", np.arctan(0.03 / 0.05)).as_matrix()  # centre of mass above the rim
    lowest = 0.05 * abs(turn[2, 2]) + 0.03 * np.hypot(turn[2, 0], turn[2, 1])
    rim = lab.rigid("rim", solid, [0, 0, lowest + 1e-4], rotation=turn)
    result = lab.drop(rim, lab.floor())
    turned = np.degrees(Rotation.from_matrix(result.bodies[0].rotation).magnitude())
    assert turned > 20.0


@pytest.mark.slow
def test_rolling_resistance_does_not_hold_up_what_a_kick_made_lose_its_balance(lab):
    """A pencil with round ends falls over and comes to rest lying: resistance to rolling gives way meanwhile."""
    pencil = lab.rigid("pencil", lab.Capsule(0.02, 0.1), [0, 0, 0.0701], mass=0.2, rolling=1e-3, edge=0.004)
    result = lab.drop(pencil, lab.floor(rolling=1e-3))
    assert result.verdict == "at_rest"
    assert abs(result.bodies[0].rotation[2, 2]) < 1e-2  # its axis is level


def test_a_body_falls_freely_over_a_centimetre(lab):
    """v = g t until the floor, exact in backward Euler, and the impact comes at t = sqrt(2 h / g) within one step."""
    ball = lab.rigid("ball", lab.Capsule(0.05, 0.0), [0, 0, 0.06])
    history = lab.drop(ball, lab.floor(), step_limit=16).history
    time, speed = history.time, history.linear_speed
    impact = np.sqrt(2 * 0.01 / lab.gravity)
    falling = time < impact - 0.004
    assert falling.sum() > 5
    assert speed[falling] == pytest.approx(lab.gravity * time[falling], rel=1e-9)
    first = time[np.flatnonzero(np.diff(speed) < 0.0)[0]]
    assert first == pytest.approx(impact, abs=np.diff(time)[:12].max())


def test_a_sliding_block_stops_where_dynamic_friction_says(lab):
    """s = v^2 / (2 mu_d g)."""
    start = np.array([0.8, 0.0, 0.0])
    block = lab.rigid("block", lab.Box(np.array([0.1, 0.1, 0.04])), [-0.2, 0, 0.0201], mu=(0.5, 0.4), velocity=start)
    result = lab.drop(block, lab.floor(mu=(0.5, 0.4)))
    expected = 0.8**2 / (2 * 0.4 * lab.gravity)
    assert result.verdict == "at_rest"
    # steps of at most 2 mm: backward Euler stops half a step early; the fall of 0.1 mm adds 4 ms x 0.8 m/s
    assert result.bodies[0].translation[0] == pytest.approx(expected, abs=0.002 + 0.0036)


def test_a_ball_rolls_down_at_five_sevenths(lab):
    """a = 5/7 g sin(a) without rolling resistance."""
    angle = np.radians(8.0)
    ball = lab.rigid("ball", lab.Capsule(0.05, 0.0), [-0.2, 0, 0.0501], mu=(0.9, 0.9), edge=0.003, spacing=0.0015)
    result = lab.drop(ball, lab.floor(mu=(0.9, 0.9)), gravity=slope(angle), step_limit=70)
    time, speed = result.history.time, result.history.linear_speed
    measured = np.polyfit(time[time > 0.1], speed[time > 0.1], 1)[0]
    assert measured == pytest.approx(5.0 / 7.0 * lab.gravity * np.sin(angle), rel=0.02)


@pytest.mark.slow
def test_a_rolling_ball_stops_where_rolling_resistance_says(lab):
    """Torque b N about the contact: a = 5/7 g b / R, so s = v^2 / (2 a)."""
    radius, length, speed = 0.05, 0.002, 0.25
    ball = lab.rigid("ball", lab.Capsule(radius, 0.0), [-0.2, 0, radius + 2e-5], mu=(0.9, 0.9), rolling=length,
                     edge=0.0015, spacing=0.0015, velocity=np.array([speed, 0.0, 0.0]),
                     angular_velocity=np.array([0.0, speed / radius, 0.0]))  # fmt: skip
    result = lab.drop(ball, lab.floor(mu=(0.9, 0.9), rolling=length))
    expected = speed**2 / (2 * 5.0 / 7.0 * lab.gravity * length / radius)
    assert result.verdict == "at_rest"
    # facets of 1.5 mm: sagitta 6 um, a hill of 5 mm/s that it must climb at the end; backward Euler: one step of 2 mm
    assert result.bodies[0].vertices[:, 0].mean() + 0.2 == pytest.approx(expected, rel=0.05)


FACES = [("x", 0), ("x", 90), ("x", 180), ("x", 270), ("y", 90), ("y", 270)]


@pytest.mark.slow
@pytest.mark.parametrize("angle", [0.0, 0.8 * np.arctan(0.5)])
@pytest.mark.parametrize(("axis", "degrees"), FACES)
def test_a_cube_does_not_creep_in_five_seconds(lab, axis, degrees, angle):
    """Flat and on 80 % of the friction angle, on any face: below 0.1 mm and 0.1 degrees after rest, unkicked."""
    turn = Rotation.from_euler(axis, degrees, degrees=True).as_matrix()
    one = lab.rigid("cube", lab.Box(np.array([0.1, 0.1, 0.1])), [0, 0, 0.05], rotation=turn, mu=(0.5, 0.5))
    result = lab.drop(one, lab.floor(mu=(0.5, 0.5)), gravity=slope(angle), kick_speed=0.0, kick_angular_speed=0.0,
                      kick_seconds=5.0, kick_segments=1)  # fmt: skip
    assert result.certificate.kick.seconds == 5.0
    assert result.certificate.kick.distance_m.largest < 1e-4
    assert np.degrees(result.certificate.kick.angle_rad.value) < 0.1


def cone(radius=0.04, height=0.1):
    """A cone on its tip, tip at the origin."""
    turned_over = trimesh.creation.cone(radius, height, sections=48)
    turned_over.apply_transform(trimesh.transformations.rotation_matrix(np.pi, [1, 0, 0]))
    turned_over.apply_translation([0, 0, -turned_over.bounds[0, 2]])
    return Mesh.of(turned_over.vertices, turned_over.faces)


@pytest.mark.slow
def test_a_cone_on_its_tip_is_not_a_rest_state(lab):
    """It balances exactly until the kick; the reported state is another one."""
    result = lab.drop(lab.rigid_mesh("cone", cone(), [0, 0, 1e-4]), lab.floor())
    assert np.degrees(Rotation.from_matrix(result.bodies[0].rotation).magnitude()) > 30.0


def test_a_mug_stands(lab):
    """A concave mesh with a handle, off its axis of symmetry, stands on its foot."""
    mesh = Mesh.concatenate([s for part in build_object("mug").parts for s in part.solids])  # in centimetres
    mesh = Mesh.of(0.01 * mesh.vertices, mesh.faces)
    low = mesh.bounds[0, 2]
    result = lab.drop(lab.rigid_mesh("mug", mesh, [0, 0, 0.002 - low], mass=0.3), lab.floor())
    assert result.verdict == "at_rest"
    assert np.degrees(Rotation.from_matrix(result.bodies[0].rotation).magnitude()) < 1.0
    touching = result.contact_points["mug"]
    foot = mesh.vertices[mesh.vertices[:, 2] < low + 0.002]
    assert np.ptp(touching[:, :2], axis=0).min() > 0.7 * np.ptp(foot[:, :2], axis=0).min()


@pytest.mark.slow
def test_a_dumbbell_rests_on_its_heads(lab):
    """Two balls on a bar: contact is under both heads and nowhere else."""
    heads = [trimesh.creation.icosphere(3, 0.04) for _ in range(2)]
    for side, head in zip((-1, 1), heads, strict=True):
        head.apply_translation([side * 0.1, 0, 0])
    bar = trimesh.creation.cylinder(0.012, 0.2, transform=trimesh.transformations.rotation_matrix(np.pi / 2, [0, 1, 0]))
    whole = trimesh.boolean.union([*heads, bar], engine="manifold")
    mesh = Mesh.of(whole.vertices, whole.faces)
    result = lab.drop(lab.rigid_mesh("dumbbell", mesh, [0, 0, 0.0405], mass=2.0, rolling=1e-3),
                      lab.floor(rolling=1e-3))  # fmt: skip
    assert result.verdict == "at_rest"
    touching = result.contact_points["dumbbell"][:, 0]
    assert (np.abs(np.abs(touching) - 0.1) < 0.02).all()
    assert {*np.sign(touching)} == {-1.0, 1.0}


@pytest.mark.slow
def test_a_stack_of_five_boxes_stands(lab):
    """Four interfaces and the floor: every box stays within a millimetre of where it was put."""
    size, gap = np.array([0.12, 0.12, 0.06]), 2e-4
    boxes = [
        lab.rigid(f"box{k}", lab.Box(size), [0.004 * (-1) ** k, 0, 0.03 + k * (0.06 + gap) + gap], edge=0.02)
        for k in range(5)
    ]
    result = lab.drop(*boxes, lab.floor())
    assert result.verdict == "at_rest"
    for body in result.bodies[:5]:
        assert np.linalg.norm(body.translation - (np.eye(3) - body.rotation) @ [0, 0, 0.15]) < 2e-3
        assert np.degrees(Rotation.from_matrix(body.rotation).magnitude()) < 0.5
    weight = {f"box{k}": (5 - k) * lab.gravity for k in range(5)}
    for row in result.contacts:
        upper = max(row.a, row.b) if "floor" not in (row.a, row.b) else "box0"
        assert row.normal_force_n == pytest.approx(weight[upper], rel=0.01)


def test_a_gram_under_ten_kilograms_comes_to_rest(lab):
    """Its unbalanced force counts over what it carries from one side to the other, not over its own weight: contacts of
    98 N cannot be solved to 5e-5 N."""
    chip = lab.rigid("chip", lab.Box(np.array([0.04, 0.04, 0.01])), [0, 0, 0.0051], mass=1e-3, edge=0.005)
    block = lab.rigid("block", lab.Box(np.array([0.04, 0.04, 0.04])), [0, 0, 0.0303], mass=10.0, edge=0.01)
    result = lab.drop(chip, block, lab.floor())
    assert result.verdict == "at_rest"
    floor = next(c for c in result.contacts if {c.a, c.b} == {"chip", "floor"})
    assert floor.normal_force_n == pytest.approx(10.001 * lab.gravity, rel=5e-3)


def test_a_body_carries_what_goes_through_it(lab):
    """Half of the sizes of its forces beyond the size of their sum: nothing for one that stands or hits."""
    force = np.array([[0.0, 0, 5], [0, 0, 4], [0, 0, 3]])
    none = np.zeros((3, 3))
    a, b = np.array([0, 0, 1]), np.array([2, 2, 0])
    contacts = Contacts((), None, force, none, none, a, b, (), {}, 0, ContactMemory())
    # body 0: 5 and 4 up from the floor, 3 down from body 1 on it; body 1: 3 up; body 2 takes 9
    assert contacts.carried_load(3) == pytest.approx([3.0, 0.0, 0.0])


@pytest.mark.slow
@pytest.mark.parametrize("gap", [0.008, 0.0095, 0.011])
def test_a_rod_stands_on_a_floor_of_which_only_the_top_is_known(lab, gap):
    """Scans show tops only, and their vertices may lie beside the object: the distance samples alone carry it."""
    floor = lab.rigid(
        "floor", lab.Box(np.array([0.6, 0.6, 0.05])), [0, 0, -0.025], fixed=True, edge=0.01, spacing=0.0017
    )
    corner = floor.vertices[floor.faces]
    seen = (np.abs(corner[:, :, 2]) < 1e-9).all(axis=1) & (np.abs(corner[:, :, :2]).max(axis=(1, 2)) > 0.011)
    used, faces = np.unique(floor.faces[seen], return_inverse=True)
    floor = replace(floor, vertices=floor.vertices[used], faces=faces.reshape(-1, 3).astype(np.int32))
    rod = lab.rigid(
        "rod", lab.Box(np.array([6e-3, 6e-3, 0.03])), [0, 0, 0.015 + gap], mass=0.02, edge=2e-3, spacing=5e-4
    )
    assert lab.drop(rod, floor).verdict == "at_rest"


def test_nothing_pulls_where_there_is_no_gravity(lab):
    """A block that drifts past the floor: no equilibrium, and no division by the missing weight."""
    block = lab.rigid("block", lab.Box(np.array([0.1, 0.1, 0.1])), [0, 0, 0.1], velocity=np.array([0.1, 0, 0]))
    assert lab.drop(block, lab.floor(), gravity=(0, 0, 0), step_limit=20).verdict != "at_rest"
