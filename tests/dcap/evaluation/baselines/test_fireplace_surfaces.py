"""Planar surfaces, and the surfaces of an object and of an anchor, on shapes whose answers are known."""

import numpy as np
import pytest
from box_rooms import ROOM, ball, block, box_of, toy

from dcap.evaluation.baselines.fireplace.anchors import box_side, item_surfaces, surface_towards, surfaces_of_part
from dcap.evaluation.baselines.fireplace.placement import SurfaceFrame, posed, resting
from dcap.evaluation.baselines.fireplace.planar import planar_surfaces
from dcap.evaluation.baselines.fireplace.problem import SupportArea
from dcap.geometry.placement.named_regions import viewer_frame
from dcap.geometry.raycast import Raycaster
from dcap.scene.types.mesh import Mesh

UP = np.array([0.0, 0.0, 1.0])


def test_a_box_has_its_six_sides() -> None:
    """Each with its area, middle and outward normal, the largest first."""
    found = planar_surfaces(block((0, 0, 0), (3, 2, 1)))
    assert [one.area for one in found] == pytest.approx([6, 6, 3, 3, 2, 2])
    for one in found:
        assert np.abs(one.normal).max() == pytest.approx(1.0)
        assert (one.center - (1.5, 1.0, 0.5)) @ one.normal > 0
        assert len(one.outline) == 4


def test_pieces_in_one_plane_are_one_surface() -> None:
    """Two blocks of one height have one top; 2 cm between them make two."""
    level = Mesh.concatenate([block((0, 0, 0), (1, 1, 0.5)), block((2, 0, 0), (3, 1, 0.5))])
    assert planar_surfaces(level)[0].area == pytest.approx(2.0)
    stepped = Mesh.concatenate([block((0, 0, 0), (1, 1, 0.5)), block((2, 0, 0), (3, 1, 0.52))])
    tops = [one for one in planar_surfaces(stepped) if one.normal[2] > 0.99]
    assert [one.area for one in tops] == pytest.approx([1.0, 1.0])


def test_a_ball_rests_on_the_outermost_part_of_its_shape() -> None:
    """It has no planar surface; what stands in lies in the tangent plane about its lowest point."""
    bottom = surface_towards(ball(0.1), -UP, "bottom")
    assert len(bottom.faces) == 0
    assert bottom.points[:, 2] == pytest.approx(-0.1, abs=1e-6)
    # a cap of height 2 R * 8 % has a radius of R sqrt(1 - 0.84^2) = 0.054; the mesh is inscribed in the ball
    assert np.linalg.norm(bottom.points[:, :2], axis=1).max() == pytest.approx(0.054, abs=0.004)


def test_the_object_s_sides_follow_its_front() -> None:
    """The toy's legs reach to -y: its front looks there, its bottom down, its left to +x."""
    sides = item_surfaces(toy(), "toy").sides
    assert sides["front"].normal == pytest.approx((0, -1, 0), abs=1e-6)
    assert sides["bottom"].normal == pytest.approx((0, 0, -1), abs=1e-6)
    assert sides["left"].normal == pytest.approx((1, 0, 0), abs=1e-6)


def test_what_is_covered_is_no_surface_to_rest_on() -> None:
    """The bed's frame is covered by its mattress, whose top is open."""
    caster = Raycaster(ROOM.mesh)
    tops = {}
    for part in (0, 1):
        faces = np.flatnonzero((ROOM.face_instance == 0) & (ROOM.face_part == part))
        tops[part] = surfaces_of_part(ROOM.mesh, faces, part, UP, "top", caster)
    assert max((one.open_area for one in tops[0]), default=0.0) < 0.5
    mattress = max(tops[1], key=lambda one: one.open_area)
    assert mattress.kind == "planar"
    assert mattress.surface.center[2] == pytest.approx(0.5)


def test_sides_are_those_of_who_looks_at_the_front() -> None:
    """Whose front is -y has its left side at -x and its front side at -y; normals look out."""
    box = box_of(block((-1, -2, 0), (1, 2, 0.5)))
    frame = viewer_frame(box, np.array([0.0, -1.0, 0.0]), np.zeros(3))
    for side, way in (("left", (-1, 0, 0)), ("right", (1, 0, 0)), ("front", (0, -1, 0)), ("back", (0, 1, 0))):
        found = box_side(box, frame, side)
        assert found.normal == pytest.approx(way)
        assert (found.center - box.center) @ np.array(way) == pytest.approx(1.0 if way[0] else 2.0)


def test_a_rim_has_a_hole_and_a_scan_has_none() -> None:
    """A ring of 0.1 m about 0.8 x 0.8 m is open inside; a gap of 5 x 5 cm in a surface is filled."""
    x, y = (grid.ravel() for grid in np.meshgrid(np.linspace(0, 1, 401), np.linspace(0, 1, 401)))
    middle = np.maximum(np.abs(x - 0.5), np.abs(y - 0.5))
    ring, torn = (SupportArea.of(np.c_[x, y][middle > half], 0.00625) for half in (0.4, 0.025))
    at = np.array([[0.5, 0.5]])
    assert ring.depth_at(at)[0] == pytest.approx(-0.4, abs=2 * 0.00625)
    assert torn.depth_at(at)[0] == pytest.approx(0.5, abs=2 * 0.00625)


def test_depth_is_the_distance_from_the_rim() -> None:
    """Inside positive, outside negative, to a cell."""
    x, y = np.meshgrid(np.linspace(0, 2, 401), np.linspace(0, 1, 201))
    area = SupportArea.of(np.c_[x.ravel(), y.ravel()], 0.0125)
    points = np.array([[1.0, 0.5], [0.25, 0.5], [1.0, -0.3]])
    assert area.depth_at(points) == pytest.approx([0.5, 0.25, -0.3], abs=2 * 0.0125)
    assert area.share_inside(np.array([points[[0, 2]]]))[0] == pytest.approx(0.5)


@pytest.mark.parametrize("slope_deg", [0.0, 30.0])
def test_the_contact_surface_looks_into_what_carries_it_at_every_pose(slope_deg: float) -> None:
    """Whichever surface it rests on, wherever it is and however it is turned: n_a . n_b is -1, so that the contact's
    loss has no angle."""
    slope = np.radians(slope_deg)
    turn = np.eye(4)
    turn[:3, :3] = [[np.cos(slope), 0, np.sin(slope)], [0, 1, 0], [-np.sin(slope), 0, np.cos(slope)]]
    board = max(planar_surfaces(block((-1, -1, 0), (1, 1, 0.02)).transformed(turn)), key=lambda one: one.normal[2])
    to_world = np.linalg.inv(SurfaceFrame.of(board).from_world)
    surfaces = item_surfaces(toy(), "toy")
    for view in surfaces.poses:
        item = resting(toy(), 1.0, np.array(view.rotation), surfaces.sides, surfaces.up)
        for pose in ((0.0, 0.0, 0.0), (0.3, -0.2, 1.0), (-0.1, 0.4, 4.0)):
            facing = (to_world @ posed(np.array(pose), 0.0))[:3, :3] @ item.contact.normal
            assert facing @ board.normal == pytest.approx(-1.0, abs=1e-9)
