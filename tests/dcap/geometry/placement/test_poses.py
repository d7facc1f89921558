"""Stable poses, symmetry and fronts of shapes whose answers are known."""

import numpy as np
import pytest
import trimesh

from dcap.geometry.pieces import is_closed
from dcap.geometry.placement.poses import (
    about_z,
    center_of_mass,
    front_of,
    stable_poses,
    symmetry_about_z,
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


@pytest.mark.parametrize("yaw", [0, 90, 180, 270])
def test_front_is_where_the_lower_half_reaches_out(yaw):
    """A seat before its backrest, in each of four directions."""
    chair = Mesh.concatenate([box(0.4, 0.4, 0.1, at=(0, 0, 0.05)), box(0.4, 0.05, 0.4, at=(0, 0.175, 0.3))])
    pose = np.eye(4)
    pose[:3, :3] = about_z(np.radians(yaw))
    front, known = front_of(chair.transformed(pose))
    assert known
    assert np.allclose(front, about_z(np.radians(yaw)) @ (0, -1, 0), atol=1e-9)


def test_round_things_have_no_front():
    """Then it is -y by convention."""
    front, known = front_of(mesh_of(trimesh.creation.icosphere(subdivisions=3)))
    assert (front.tolist(), known) == ([0.0, -1.0, 0.0], False)
