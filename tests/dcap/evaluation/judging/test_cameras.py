"""Cameras of judged pictures: alike for all methods, with everything in the picture and nothing before the contact."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from dcap.evaluation.judging.cameras import (
    BELOW_MIDDLE,
    CLOSEUPS,
    FRONT,
    GRAZING,
    SIZE,
    WIDEST,
    PlacedThing,
    along,
    box_corners,
    camera_of,
    sample_cameras,
    sights_of,
)
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.pictures import Sights

RADIUS, TOP = 0.1, 0.5


def box(low: tuple[float, float, float], high: tuple[float, float, float]) -> Mesh:
    a, b = np.array(low), np.array(high)
    one = trimesh.creation.box(b - a).subdivide().subdivide()
    return Mesh.of(one.vertices + (a + b) / 2, one.faces, (200, 200, 200))


TABLE = box((-0.6, -0.6, 0.0), (0.6, 0.6, TOP))


def ball(x: float = 0.0, height: float = 0.0, radius: float = RADIUS) -> Mesh:
    """Over the table by a height [m]."""
    one = trimesh.creation.icosphere(4, radius)
    return Mesh.of(one.vertices + np.array([x, 0.0, TOP + radius + height]), one.faces, (200, 60, 40))


def seen(thing: Mesh, *more: Mesh) -> Sights:
    """What can be seen of a thing over the table in the middle of a scene, with more around."""
    scene = Mesh.concatenate([TABLE, *more])
    placed = PlacedThing.of(scene, np.zeros(len(scene.faces), dtype=bool), thing)
    return sights_of(placed, box_corners(*TABLE.bounds), np.zeros(3))


def test_two_millimetres_are_four_pixels() -> None:
    """Of the widest close-up, seen along the surface: 0.002 / WIDEST * SIZE * cos(12 degrees) = 3.76, of an object of
    20 cm 0.002 / (0.9 * sqrt(3) * 0.2) * 768 * 0.978 = 4.8."""
    for thing, pixels in ((ball(), 4.8), (ball(radius=0.5), 0.002 / WIDEST * SIZE * np.cos(np.radians(GRAZING[0])))):
        view = seen(thing)
        cameras = sample_cameras([view])
        contact = view.contact[cameras.direction]
        line = camera_of(cameras.closeup(view)).project(np.array([contact, contact + np.array([0.0, 0.0, 0.002])]))
        assert CLOSEUPS[cameras.direction][1] == GRAZING[0]
        assert line[0, 1] - line[1, 1] == pytest.approx(pixels, rel=0.03)
        assert line[0, 1] == pytest.approx((0.5 + BELOW_MIDDLE * np.cos(np.radians(GRAZING[0]))) * SIZE, abs=3.0)


@pytest.mark.parametrize("height", [0.0, 0.05, -0.03], ids=["on", "over", "inside"])
def test_the_contact_is_where_it_touches_or_is_nearest(height: float) -> None:
    """In the picture: at the lowest point of a ball on the table or over it, at the near rim of one that is inside.

    Rays are 4 mm apart, and a ball's outline is a ray above its lowest point at 12 degrees, by RADIUS (1 - cos) = 2 mm.
    """
    view = seen(ball(height=height))
    step = 1.1 * 2.0 * RADIUS * np.sqrt(3.0) / 96
    rim = np.sqrt(RADIUS**2 - (RADIUS + min(height, 0.0)) ** 2)
    for number, (azimuth, elevation) in enumerate(CLOSEUPS[:16]):
        way = along((azimuth, 0.0))
        true = rim * way + np.array([0.0, 0.0, TOP + max(height, 0.0)])
        off = view.contact[number] - true
        across = off - (off @ along((azimuth, elevation))) * along((azimuth, elevation))
        assert np.linalg.norm(across) < 2.5 * step
    assert view.closeup.min() > 0.8


def test_cameras_are_alike_for_all_methods() -> None:
    """One overview; close-ups at the same way from each contact."""
    views = [seen(ball(x, height)) for x, height in ((0.0, 0.0), (0.3, 0.04), (-0.4, -0.02))]
    cameras = sample_cameras(views)
    ways = []
    for view in views:
        closeup = cameras.closeup(view)
        ways.append(np.array([closeup.position, closeup.target]) - view.contact[cameras.direction])
    assert np.ptp(ways, axis=0).max() < 3e-6  # rounded to a micrometre
    assert sample_cameras(views) == sample_cameras(views[::-1])


def test_the_overview_shows_every_final_state_and_the_support() -> None:
    views = [seen(ball(x)) for x in (0.0, 0.5, 3.0)]
    camera = camera_of(sample_cameras(views).overview)
    corners = [box_corners(*one.bounds) for one in views] + [np.clip(views[0].support, -2.0, 4.5)]
    image = camera.project(np.concatenate(corners))
    assert image[:, :2].min() > 0.0
    assert image[:, :2].max() < SIZE
    assert image[:, 2].min() > 0.0
    assert np.ptp(image[:, :2], axis=0).max() > 0.7 * SIZE


def test_nothing_hides_the_contact() -> None:
    """A board before the preferred direction, or before that of one method alone: another is taken for all."""
    free = seen(ball())
    preferred = CLOSEUPS[sample_cameras([free]).direction]
    assert abs(preferred[0] - FRONT % 360.0) <= 22.5
    board = box((-0.5, -0.32, 0.0), (0.5, -0.3, 1.2))
    hidden = seen(ball(), board)
    for views in ([hidden], [free, hidden]):
        direction = sample_cameras(views).direction
        assert CLOSEUPS[direction] != preferred
        assert min(one.closeup[direction] for one in views) == 1.0
    assert hidden.closeup[CLOSEUPS.index(preferred)] < 0.5


def test_what_is_half_buried_is_looked_at_from_the_front() -> None:
    """That it is hidden by its support from everywhere is no reason to go round it."""
    cameras = sample_cameras([seen(ball()), seen(ball(height=-RADIUS))])
    assert cameras.direction == sample_cameras([seen(ball())]).direction
    assert cameras.overview == replace(cameras.overview)
