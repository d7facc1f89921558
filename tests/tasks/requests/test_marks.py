"""Numbers on pictures: each thing has its own, they do not overlap, and nothing in the way hides what is meant."""

from dataclasses import replace

import numpy as np
import pytest
from box_rooms import bedroom, block, segmentation

from dcap.scene.types.mesh import Mesh
from tasks.requests.badges import INK, MARGIN, file_axis, numbered
from tasks.requests.marks import (
    candidates_picture,
    framed,
    hidden,
    listed,
    marked,
    plan_camera,
    plan_picture,
    room_pictures,
    thumbnail,
)

ROOM = bedroom()


def test_a_number_stands_on_its_thing() -> None:
    """In the middle of its widest place; what is hardly seen has none."""
    seen = np.full((200, 300), -1)
    seen[50:150, 180:280], seen[0, 0:3] = 4, 5
    shown = numbered(np.full((200, 300, 3), 128, np.uint8), seen, {4: 17, 5: 18})
    ink = np.argwhere((shown == INK).all(axis=2))
    assert ink.mean(axis=0) == pytest.approx([100, 230], abs=8)  # a 1 is thinner than a 7
    assert (shown[60, 20] == 128).all()


def roofed() -> Mesh:
    """A ceiling that no program took for one."""
    return block((-3, -3, 2.5), (3, 3, 2.6))


def test_neither_ceiling_nor_walls_are_in_the_way() -> None:
    """From above everything on the floor is seen, under a ceiling that nobody recognised too."""
    things = {one.id: (one.label, None, [("part", ROOM.instance_mesh(i))]) for i, one in enumerate(ROOM.instances)}
    scene = marked(segmentation(things | {"roof": ("thing", None, [("body", roofed())])}))  # type: ignore[arg-type]
    camera = plan_camera(scene, 200)
    roof = next(mark for mark in scene.marks if abs(mark.box.bottom - 2.5) < 1e-6)
    level = np.abs(scene.mesh.face_normals[roof.faces, 2]) > 0.1
    assert hidden(scene, camera)[roof.faces[level]].all()
    bed = scene.marks[0].faces
    up = scene.mesh.face_normals[bed, 2] > 0
    assert not hidden(scene, camera)[bed[up]].any()


def test_the_plan_is_as_the_room_lies() -> None:
    """World x to the right, y up, the longer side as asked; rulers add a margin and read the file's coordinates."""
    scene = marked(ROOM)
    shot = plan_picture(scene, 300)
    low, high = framed(scene)
    assert max(shot.shape[:2]) == 300
    assert shot.shape[1] / shot.shape[0] == pytest.approx((high[0] - low[0]) / (high[1] - low[1]), rel=0.02)
    camera = plan_camera(scene, 300)
    x, y, _ = camera.project(np.array([[2.0, 1.0, 0.5]]))[0]  # the table: right of the middle and above it
    assert x > 0.5 * camera.width
    assert y < 0.5 * camera.height
    file_from_world = 2.0 * np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 0.5]])  # y up, half metres
    ruled = plan_picture(scene, 300, file_from_world)
    assert ruled.shape[:2] == (shot.shape[0] + MARGIN, shot.shape[1] + MARGIN)
    assert file_axis(1, low, high, file_from_world) == ("z", (pytest.approx(-2 * low[1]), pytest.approx(-2 * high[1])))


def test_views_and_thumbnails_show_the_things() -> None:
    """Each of the size asked for, with numbers in the views; a thing alone stands out from what is around it."""
    scene = marked(ROOM)
    views = room_pictures(scene, 2, 160)
    assert [view.shape for view in views] == [(120, 160, 3)] * 2
    assert all((view == INK).all(axis=2).any() for view in views)
    assert thumbnail(scene, scene.marks[0], 64).shape == (64, 64, 3)


def test_the_picture_of_a_refusal_lists_what_there_is() -> None:
    """Number, label and certainty of each; one line per number."""
    unsure = tuple(replace(one, confidence=0.41) for one in ROOM.instances)
    lines = listed(replace(ROOM, instances=unsure))
    assert [line[:2] for line in lines][:2] == [(1, "bed 41%"), (2, "table 41%")]
    picture = candidates_picture(ROOM)
    assert picture.shape[2] == 3
    assert picture.shape[1] > 1500
