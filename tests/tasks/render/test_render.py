"""The three pictures: same camera before and after, dents where the drop left them, contact marked, buried things
refused.
"""

from functools import cache

import numpy as np
import pytest
from dented_bed import DEPTH, RADIUS, TOP, anchor, ball, box_mesh, scene_of, settled

from dcap.geometry.camera import looking_at
from dcap.scene.types.mesh import Mesh, SourceSurface
from dcap.scene.types.outcome import HiddenObject, Infeasible, Reason
from dcap.scene.types.pictures import Renders
from dcap.scene.types.segmentation import SegmentedObject, SegmentedScene
from tasks.render.config import RenderConfig
from tasks.render.contact_picture import LEAST_GREY, lightened
from tasks.render.settled_meshes import settled_item, settled_scene, shown, shown_faces, structure_faces
from tasks.render.stage import render

SMALL = RenderConfig(size=160)
PLAIN = SourceSurface.untextured()


@cache
def taken() -> Renders:
    """The pictures in the open."""
    found = render(SegmentedScene(scene_of()), SegmentedObject(ball()), anchor(), settled(), PLAIN, PLAIN, SMALL)
    assert isinstance(found, Renders)
    return found


def test_before_and_after_differ_only_where_the_object_is() -> None:
    """Same camera, same light: away from the object, its dent and its shadow, no pixel changes visibly."""
    change = np.abs(taken().clean.astype(int) - taken().settled.astype(int)).max(axis=-1)
    camera = looking_at(taken().camera_position, taken().camera_target, 160, 160)
    column, row, depth = camera.project(np.array([[0.0, 0.0, TOP - DEPTH + RADIUS]]))[0]
    y, x = np.indices(change.shape)
    away = np.hypot(x - column, y - row) * depth / camera.focal
    assert change[away < RADIUS / 2].min() > 10
    # a shadow reaches 0.8 times the object's height under a light at 52 degrees; penumbra and filter a bit farther;
    # the ball hides less than 3 % of the sky from anything beyond
    assert change[away > 8 * RADIUS].max() <= 0.03 * 255


def test_the_camera_keeps_the_papers_distance_and_stands_in_front() -> None:
    """1.5 times the diagonal of the base part's box, clamped by the object's size, on the side that the bed looks
    to.
    """
    way = taken().camera_position - taken().camera_target
    wanted = 1.5 * np.linalg.norm([1.6, 2.0, 0.5])
    own = np.linalg.norm(np.ptp(settled_item(ball(), anchor(), settled().bodies[0]).vertices, axis=0))
    assert np.isclose(np.linalg.norm(way), np.clip(wanted, SMALL.nearest * own, SMALL.farthest * own))
    assert way[1] < -0.7 * np.linalg.norm(way[:2])
    assert np.isclose(np.degrees(np.arcsin(way[2] / np.linalg.norm(way))), SMALL.elevations_deg[0])


def test_the_wall_in_front_is_cut_and_the_rest_is_shown() -> None:
    """The ball is fully visible although a wall stands between it and the camera; the wall behind and the floor
    stay.
    """
    assert taken().visible_fraction == 1.0
    scene = scene_of()
    camera = looking_at(taken().camera_position, taken().camera_target, 160, 160)
    left = Mesh.concatenate([one.mesh for one in shown(scene, camera)])
    assert (left.vertices[:, 1] > 1.19).any()
    in_front = (left.triangles[:, :, 1] < -1.69).all(axis=1)
    assert np.abs(left.face_normals[in_front, 1]).max(initial=0.0) == 0.0  # only the wall's narrow ends are left
    assert structure_faces(scene).sum() == 36


def test_what_hangs_on_a_wall_that_is_cut_goes_with_it() -> None:
    """A picture on the inside of the wall before the camera is not left floating; one on the wall behind stays, and so
    does a cupboard before the cut wall, and what the camera looks at."""
    picture_front = box_mesh((-0.4, -1.695, 1.0), (0.4, -1.665, 1.6))
    picture_back = box_mesh((-0.4, 1.165, 1.0), (0.4, 1.195, 1.6))
    cupboard = box_mesh((1.5, -1.695, 0.0), (2.5, -1.2, 1.5))
    scene = scene_of(picture=picture_front, painting=picture_back, cupboard=cupboard)
    camera = looking_at(np.array([0.0, -4.0, 2.0]), np.array([0.0, 0.0, TOP]), 64, 64)
    left = set(np.unique(scene.face_instance[shown_faces(scene, camera)]).tolist())
    assert {scene.index_of(name) for name in ("painting", "cupboard", "bed", "wall_back")} <= left
    assert scene.index_of("picture") not in left
    at_it = looking_at(np.array([0.0, -4.0, 2.0]), np.array([0.0, -1.65, 1.3]), 64, 64)
    assert scene.index_of("picture") in scene.face_instance[shown_faces(scene, at_it)]


def test_a_ball_in_a_box_is_buried() -> None:
    """A closed box around it hides it from everywhere: the reason is `buried`, with the share that is visible."""
    found = render(
        SegmentedScene(scene_of(crate=box_mesh((-0.2, -0.2, 0.4), (0.2, 0.2, 0.9)))),
        SegmentedObject(ball()),
        anchor(),
        settled(),
        PLAIN,
        PLAIN,
        SMALL,
    )
    assert isinstance(found, Infeasible)
    assert found.reason is Reason.BURIED
    assert isinstance(found.evidence, HiddenObject)
    assert found.evidence.visible_fraction == 0.0


def test_a_ball_in_a_deep_vessel_is_looked_at_from_above() -> None:
    """Four walls around it, higher than they are apart, hide it from every usual height, not from above."""
    walls = [
        ((-0.2, -0.2), (-0.17, 0.2)),
        ((0.17, -0.2), (0.2, 0.2)),
        ((-0.2, -0.2), (0.2, -0.17)),
        ((-0.2, 0.17), (0.2, 0.2)),
    ]
    vessel = Mesh.concatenate([box_mesh((*low, TOP), (*high, TOP + 0.8)) for low, high in walls])
    found = render(
        SegmentedScene(scene_of(vessel=vessel)), SegmentedObject(ball()), anchor(), settled(), PLAIN, PLAIN, SMALL
    )
    assert isinstance(found, Renders)
    assert found.visible_fraction > 0.5
    way = found.camera_position - found.camera_target
    assert np.degrees(np.arcsin(way[2] / np.linalg.norm(way))) > 60.0


def test_the_dent_is_in_the_scene_and_the_ball_in_the_dent() -> None:
    """The two triangles of the bed's top follow the dent; the ball's lowest point meets its bottom."""
    after = settled_scene(scene_of(), settled(), "bed").scene
    bed = after.instance_mesh(0)
    inner = np.linalg.norm(bed.vertices[:, :2], axis=1) < RADIUS
    lowest = bed.vertices[inner & (bed.vertices[:, 2] > 0.1), 2].min()
    thing = settled_item(ball(), anchor(), settled().bodies[0])
    # linear interpolation between vertices 15 mm apart on a sphere of 0.1 m: h^2 / (8 R) in two directions
    assert abs(lowest - thing.bounds[0, 2]) < 2 * 0.015**2 / (8 * RADIUS)
    assert np.allclose(thing.vertices, settled().bodies[0].surface.vertices, atol=1e-9)
    assert len(after.face_instance) == len(after.mesh.faces) == len(after.face_part)


def test_same_input_same_bytes() -> None:
    """Pictures are a pure function of their input."""
    again = render(SegmentedScene(scene_of()), SegmentedObject(ball()), anchor(), settled(), PLAIN, PLAIN, SMALL)
    assert isinstance(again, Renders)
    for name in ("clean", "settled", "closeup", "before_after", "contact", "profile"):
        assert getattr(again, name).tobytes() == getattr(taken(), name).tobytes()


@pytest.mark.parametrize("level", [4.0, 30.0, 100.0])
def test_a_dark_scene_is_lightened_in_order(level: float) -> None:
    """The middle becomes readable; black and white stay, and what was lighter stays lighter."""
    rgb = np.linspace(0.0, 2.0 * level, 101)[:, None, None] * np.ones((1, 4, 3))
    scene = np.ones((101, 4), dtype=bool)
    found = lightened(rgb, scene)
    assert np.median(found) == pytest.approx(LEAST_GREY, abs=0.5)
    assert found[0].max() == 0.0
    assert (np.diff(found[:, 0, 0]) > 0.0).all()
    assert found.max() <= 255.0
