"""Laws of rigid bodies: rest, friction, toppling."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation


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
    assert result.contacts[0]["normal_force_n"] == pytest.approx(mass * lab.gravity, rel=5e-3)
    # the penalty lets it sink by at most the penetration target of 0.05 mm
    assert abs(result.bodies[0].vertices[:, 2].min()) < 5e-5
    assert np.degrees(Rotation.from_matrix(result.bodies[0].rotation).magnitude()) < 0.1


@pytest.mark.parametrize(("share", "verdict"), [(0.9, "at_rest"), (1.1, "left_target")])
def test_a_block_slides_iff_the_slope_beats_static_friction(lab, share, verdict):
    """It stays iff tan(a) <= mu = 0.5; mu_d = mu_s, since some points slip while the load builds up."""
    angle = np.arctan(0.5 * share)
    result = lab.drop(cube(lab, mu=(0.5, 0.5)), lab.floor(mu=(0.5, 0.5)), gravity=slope(angle))
    assert result.verdict == verdict


def test_a_sliding_block_accelerates_by_gravity_minus_dynamic_friction(lab):
    """a = g (sin a - mu_d cos a)."""
    angle = np.arctan(0.8)
    result = lab.drop(cube(lab, velocity=np.array([0.2, 0.0, 0.0])), lab.floor(), gravity=slope(angle), step_limit=60)
    time, speed = result.history["time"], result.history["linear_speed"]
    expected = 9.81 * (np.sin(angle) - 0.4 * np.cos(angle))
    late = (time > 0.05) & (time < 0.15)
    measured = np.polyfit(time[late], speed[late], 1)[0]
    # backward Euler is exact for constant acceleration; 2 % covers the settling of the 1 mm fall
    assert measured == pytest.approx(expected, rel=0.02)


def test_a_cube_does_not_creep_on_a_slope_below_the_friction_angle(lab):
    """Remembered friction: after rest nothing moves; bound 0.1 mm over the 0.5 s after the kick."""
    result = lab.drop(cube(lab), lab.floor(), gravity=slope(np.arctan(0.4)))
    assert result.verdict == "at_rest"
    assert result.certificate["kick"]["distance_m"]["value"] < 1e-4


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


def test_a_cylinder_balanced_on_its_rim_is_not_a_rest_state(lab):
    """A balance that a kick of 1 mm/s destroys is reported as a fall, not as rest where it stood."""
    solid = lab.Cylinder(0.03, 0.1)
    turn = Rotation.from_euler("y", np.arctan(0.03 / 0.05)).as_matrix()  # centre of mass above the rim
    lowest = 0.05 * abs(turn[2, 2]) + 0.03 * np.hypot(turn[2, 0], turn[2, 1])
    rim = lab.rigid("rim", solid, [0, 0, lowest + 1e-4], rotation=turn)
    result = lab.drop(rim, lab.floor())
    turned = np.degrees(Rotation.from_matrix(result.bodies[0].rotation).magnitude())
    assert turned > 20.0
