"""Stable poses, symmetry and fronts of shapes whose answers are known."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from dcap.geometry.pieces import is_closed
from dcap.geometry.placement.poses import (
    about_z,
    center_of_mass,
    front_of,
    stable_poses,
    symmetry_about_z,
    turn_between,
)
from dcap.scene.types.mesh import Mesh


def mesh_of(shape: trimesh.Trimesh) -> Mesh:
    return Mesh.of(shape.vertices, shape.faces)


def box(*size: float, at: tuple[float, float, float] = (0, 0, 0)) -> Mesh:
    return mesh_of(trimesh.creation.box(size, np.array(trimesh.transformations.translation_matrix(at))))


def side_share(a: float, b: float, c: float) -> float:
    """Solid angle of the face b x c of a box seen from its middle over 4 pi (rectangle at distance a / 2)."""
    x, y, d = b / 2, c / 2, a / 2
    return 4 * np.arctan2(x * y, d * np.sqrt(x * x + y * y + d * d)) / (4 * np.pi)


@pytest.mark.parametrize("size", [(1, 1, 1), (0.3, 0.2, 0.1), (0.1, 0.1, 0.5)])
def test_box_rests_on_each_side_as_often_as_its_solid_angle_says(size):
    """Six poses, each with the closed-form share of its face."""
    poses = stable_poses(box(*size))
    found = {tuple(np.round(p.down).astype(int)): p.probability for p in poses}
    assert len(poses) == 6
    for axis in range(3):
        a, b, c = size[axis], size[(axis + 1) % 3], size[(axis + 2) % 3]
        down = tuple(int(k == axis) for k in range(3))
        assert found[down] == pytest.approx(side_share(a, b, c), abs=1e-9)


def test_leaning_prism_does_not_rest_on_its_small_face():
    """A sheared prism whose centre of mass lies beyond its base has no stable pose there; shares sum to 1."""
    shape = trimesh.creation.box((0.1, 0.1, 0.6))
    sheared = np.array(shape.vertices)
    sheared[:, 0] += 0.5 * sheared[:, 2]  # the centre is 0.15 m beside the middle of a base 0.1 m wide
    poses = stable_poses(Mesh.of(sheared, shape.faces))
    assert all(p.down[2] > -0.99 for p in poses)
    assert sum(p.probability for p in poses) == pytest.approx(1.0, abs=1e-6)


def test_hemisphere_rests_on_its_round_side_or_face():
    """Every pose has the centre of mass over the resting face: its height is the face's distance."""
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.1)
    mesh = mesh_of(trimesh.convex.convex_hull(ball.vertices[ball.vertices[:, 2] >= -1e-9]))
    center = center_of_mass(mesh)
    for pose in stable_poses(mesh)[:3]:
        lowest = ((mesh.vertices - center) @ pose.rotation.T)[:, 2].min()
        # 8 degrees of merged faces on a ball of 0.1 m move the lowest point by 0.1 (1 - cos 8) = 1 mm
        assert lowest == pytest.approx(-pose.height, abs=1e-3)


def test_a_smooth_foot_is_one_stable_pose():
    """A lens rests on either side, half of the time each; a ball, all of whose faces are alike and rare, rests too."""
    ball = trimesh.creation.icosphere(subdivisions=3)
    poses = stable_poses(Mesh.of(ball.vertices * (1.0, 1.0, 0.3), ball.faces))
    assert [pose.probability for pose in poses[:2]] == pytest.approx([0.5, 0.5], abs=0.02)
    assert len(stable_poses(mesh_of(ball))) >= 1


@settings(max_examples=40, deadline=None)
@given(st.lists(st.floats(-1, 1), min_size=6, max_size=6))
def test_turn_between_is_a_rotation_that_takes_one_to_the_other(numbers):
    """R a = b, R R^T = I, det R = 1."""
    a, b = np.array(numbers[:3]), np.array(numbers[3:])
    if min(np.linalg.norm(a), np.linalg.norm(b)) < 1e-3:
        return
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    turn = turn_between(a, b)
    # 1 / (1 + cos) amplifies rounding up to 1e9 near opposite directions
    assert np.allclose(turn @ a, b, atol=1e-6)
    assert np.allclose(turn @ turn.T, np.eye(3), atol=1e-6)
    assert np.linalg.det(turn) == pytest.approx(1.0, abs=1e-6)


@settings(max_examples=15, deadline=None)
@given(st.floats(0, 6.28), st.floats(0.5, 2.0))
def test_shares_do_not_depend_on_where_the_mesh_stands(angle, scale):
    """Probabilities of a box are the same for the box turned, moved and scaled."""
    mesh = box(0.3, 0.2, 0.1)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = scale * about_z(angle), (1.0, -2.0, 3.0)
    before = sorted(p.probability for p in stable_poses(mesh))
    after = sorted(p.probability for p in stable_poses(mesh.transformed(pose)))
    assert np.allclose(before, after, atol=1e-6)


def test_flat_mesh_has_a_pose():
    """A sheet without thickness still rests on its two sides."""
    sheet = Mesh.of([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    poses = stable_poses(sheet)
    assert abs(poses[0].down[2]) == pytest.approx(1.0, abs=1e-3)


def test_center_of_mass_is_of_the_volume_for_closed_meshes():
    """A cone's centre lies at a quarter of its height, its surface's at a third without the base."""
    cone = trimesh.creation.cone(radius=0.1, height=0.4, sections=64)
    closed = mesh_of(cone)
    assert is_closed(closed)
    assert center_of_mass(closed)[2] == pytest.approx(0.1, abs=1e-3)
    torn = Mesh.concatenate([closed.submesh(np.arange(64)), closed.submesh(np.arange(64, len(closed.faces)))])
    assert len(torn.vertices) > len(closed.vertices)  # two colours have two vertices at their border
    assert center_of_mass(torn)[2] == pytest.approx(0.1, abs=1e-3)
    side = Mesh.of(cone.vertices, cone.faces[cone.face_normals[:, 2] > -0.9])
    assert not is_closed(side)
    assert center_of_mass(side)[2] == pytest.approx(0.4 / 3, abs=1e-3)


@pytest.mark.parametrize(
    ("shape", "order"),
    [
        (trimesh.creation.cylinder(radius=0.1, height=0.2, sections=64), 0),
        (trimesh.creation.box((0.2, 0.2, 0.1)), 4),
        (trimesh.creation.box((0.4, 0.2, 0.1)), 2),
        (trimesh.creation.cylinder(radius=0.1, height=0.2, sections=3), 3),
    ],
    ids=["cylinder", "square", "rectangle", "triangle"],
)
def test_symmetry_about_the_vertical(shape, order):
    """0 for round things, n for n-fold ones."""
    assert symmetry_about_z(mesh_of(shape)) == order


def test_handle_breaks_the_symmetry():
    """A cylinder with a handle has none."""
    body = mesh_of(trimesh.creation.cylinder(radius=0.04, height=0.1, sections=48))
    handle = box(0.04, 0.012, 0.06, at=(0.06, 0, 0))
    assert symmetry_about_z(Mesh.concatenate([body, handle])) == 1


@pytest.mark.parametrize("yaw", [0, 90, 180, 270])
def test_front_is_where_the_lower_half_reaches_out(yaw):
    """A seat before its backrest, in each of four directions."""
    chair = Mesh.concatenate([box(0.4, 0.4, 0.1, at=(0, 0, 0.05)), box(0.4, 0.05, 0.4, at=(0, 0.175, 0.3))])
    pose = np.eye(4)
    pose[:3, :3] = about_z(np.radians(yaw))
    front, known = front_of(chair.transformed(pose))
    assert known
    assert np.allclose(front, about_z(np.radians(yaw)) @ (0, -1, 0), atol=1e-9)


def test_overhanging_head_is_the_front():
    """An animal on four legs looks where its head overhangs."""
    legs = [box(0.04, 0.04, 0.2, at=(x, y, 0.1)) for x in (-0.05, 0.05) for y in (-0.12, 0.12)]
    animal = Mesh.concatenate([*legs, box(0.15, 0.3, 0.1, at=(0, 0, 0.25)), box(0.1, 0.14, 0.1, at=(0, -0.2, 0.3))])
    front, known = front_of(animal)
    assert known
    assert front.tolist() == [0.0, -1.0, 0.0]


def test_round_things_have_no_front():
    """Then it is -y by convention."""
    front, known = front_of(mesh_of(trimesh.creation.icosphere(subdivisions=3)))
    assert (front.tolist(), known) == ([0.0, -1.0, 0.0], False)
