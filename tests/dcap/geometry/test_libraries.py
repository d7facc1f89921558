"""Where libraries that we have do something else than we need; when one of these fails, the library may take over."""

import numpy as np
import pytest
import shapely
import trimesh

from dcap.geometry.pieces import hole_loops, is_closed, signed_volume
from dcap.geometry.placement.polygons import smallest_rectangle
from dcap.geometry.placement.poses import LEAST_SHARE, stable_poses
from dcap.geometry.solid.closing import capped
from dcap.geometry.solid.repair import split_edges
from dcap.geometry.solid.repair_log import RepairLog
from dcap.scene.types.boxes import min_area_box
from dcap.scene.types.mesh import Mesh

JITTER = 1e-12  # [m]: the last digits of coordinates in metres
CORNERS = 64
CIRCLE = np.array([[np.cos(a), np.sin(a)] for a in 2.0 * np.pi * np.arange(CORNERS) / CORNERS])


def shapely_axis(points: np.ndarray) -> np.ndarray:
    """Direction of the first side of shapely's smallest rectangle."""
    ring = shapely.get_coordinates(shapely.minimum_rotated_rectangle(shapely.multipoints(points)))
    return (ring[1] - ring[0]) / np.linalg.norm(ring[1] - ring[0])


def test_rectangles_of_round_things_do_not_turn_with_the_last_digits() -> None:
    """Of 64 equally small rectangles about a circle ours are always the same one; shapely's is any of them."""
    rng = np.random.default_rng(0)
    shaken = [CIRCLE + JITTER * rng.standard_normal(CIRCLE.shape) for _ in range(8)]
    ours = np.array([smallest_rectangle(points)[0] for points in shaken])
    boxes = np.array([min_area_box(np.c_[points, np.zeros(CORNERS)]).axes for points in shaken])
    assert np.ptp(ours, axis=0).max() < 1e-9
    assert np.allclose(boxes, np.eye(3))
    # directions are the same up to quarter turns: compare the fourfold angle
    theirs = np.array([4.0 * np.arctan2(*shapely_axis(points)[::-1]) for points in shaken])
    assert np.abs(np.exp(1j * theirs) - np.exp(1j * theirs[0])).max() > 0.1


def test_a_smooth_foot_is_one_stable_pose() -> None:
    """A lens rests on either side, half of the time each; trimesh sees a pose on each of the hull's small faces."""
    ball = trimesh.creation.icosphere(subdivisions=3)
    lens = trimesh.Trimesh(ball.vertices * (1.0, 1.0, 0.3), ball.faces, process=False)
    ours = stable_poses(Mesh.of(lens.vertices, lens.faces))
    assert [pose.probability for pose in ours[:2]] == pytest.approx([0.5, 0.5], abs=0.02)
    _, theirs = trimesh.poses.compute_stable_poses(lens, threshold=LEAST_SHARE)
    assert len(theirs) > 2


def test_a_ball_has_a_stable_pose() -> None:
    """All faces of a ball are alike and rare: ours has one all the same, trimesh none."""
    ball = trimesh.creation.icosphere(subdivisions=3)
    assert len(stable_poses(Mesh.of(ball.vertices, ball.faces))) >= 1
    assert len(trimesh.poses.compute_stable_poses(ball, threshold=LEAST_SHARE)[1]) == 0


def c_prism() -> tuple[Mesh, float]:
    """The sides of a prism over a C, open above and below, and the area of the C [m^2]."""
    ring = np.array([[0, 0], [1, 0], [1, 0.2], [0.2, 0.2], [0.2, 0.8], [1, 0.8], [1, 1], [0, 1.0]])
    n = len(ring)
    here, onward = np.arange(n), (np.arange(n) + 1) % n
    sides = np.concatenate([np.c_[here, onward, onward + n], np.c_[here, onward + n, here + n]])
    return Mesh.of(np.concatenate([np.c_[ring, np.zeros(n)], np.c_[ring, np.ones(n)]]), sides), 0.52


def test_caps_stay_within_holes_that_are_not_convex() -> None:
    """Both ends of a C are capped by its area; trimesh leaves them open, or folds a fan over them twice."""
    sides, area = c_prism()
    ours = capped(sides, hole_loops(sides), RepairLog())
    assert is_closed(ours)
    assert ours.face_areas.sum() - sides.face_areas.sum() == pytest.approx(2.0 * area)
    assert signed_volume(ours.vertices, ours.faces) == pytest.approx(area)
    for fan, added in ((False, 0.0), (True, 2.32)):
        theirs = trimesh.Trimesh(sides.vertices, sides.faces, process=False)
        trimesh.repair.fill_holes(theirs, use_fan=fan)
        assert theirs.area - sides.face_areas.sum() == pytest.approx(added)


def test_refining_a_face_leaves_no_crack() -> None:
    """Where one face of a closed box is split, ours stays closed; trimesh puts vertices on its neighbours' edges."""
    box = trimesh.creation.box()
    marked = np.zeros((len(box.faces), 3), dtype=bool)
    marked[0] = True
    assert is_closed(split_edges(Mesh.of(box.vertices, box.faces), marked)[0])
    assert not is_closed(Mesh.of(*trimesh.remesh.subdivide(box.vertices, box.faces, face_index=[0])))
