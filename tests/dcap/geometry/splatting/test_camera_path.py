"""Cameras through a room of splats: inside, clear of everything, upright, and all furniture in the pictures."""

from typing import Any

import numpy as np
import pytest

from dcap.geometry.camera import Camera
from dcap.geometry.distance import MeshDistance
from dcap.geometry.raycast import Raycaster
from dcap.geometry.segmentation.labels import category_of
from dcap.geometry.splatting.camera_path import FURNITURE, PathConfig, camera_path
from dcap.geometry.splatting.discs import splats_on_mesh
from dcap.geometry.splatting.filled_cells import CELL
from dcap.scene.readers.scenes.interiorgs import read_labels, read_structure
from dcap.scene.readers.scenes.occupancy import read_occupancy
from dcap.scene.types.floor_plan import OCCUPIED, Occupancy
from dcap.scene.types.gaussians import Gaussians
from dcap.scene.writers.interiorgs import write_interiorgs
from dcap.synthetic.rooms import BuiltRoom, build_room
from dcap.synthetic.shapes import rounded_box

SMALL = PathConfig(views=48, width=64, height=48)


@pytest.fixture(scope="module")
def built() -> BuiltRoom:
    return build_room("hall_01", 0)


@pytest.fixture(scope="module")
def splats(built: BuiltRoom) -> Gaussians:
    return splats_on_mesh(built.record.mesh, 0.05, seed=0)


@pytest.fixture(scope="module")
def known(built: BuiltRoom, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What the room's folder says."""
    folder = tmp_path_factory.mktemp("room")
    write_interiorgs(folder, built.record, 0)
    rooms = read_structure(folder)[0]
    return {"boxes": read_labels(folder)[0], "rooms": rooms, "occupancy": read_occupancy(folder, rooms)[0]}


@pytest.fixture(scope="module")
def cameras(splats: Gaussians, known: dict[str, Any]) -> tuple[Camera, ...]:
    path = camera_path(splats, SMALL, **known)
    assert path.notes == ()
    return path.cameras


def in_the_room(cameras: tuple[Camera, ...], built: BuiltRoom) -> bool:
    """Whether all are within the walls, above the floor and below the ceiling."""
    low, high = built.record.profile.min(axis=0), built.record.profile.max(axis=0)
    places = np.array([camera.position for camera in cameras])
    flat = (places[:, :2] > low).all() and (places[:, :2] < high).all()
    return bool(flat and places[:, 2].min() > 0 and places[:, 2].max() < built.record.mesh.bounds[1, 2])


def test_cameras_are_inside_clear_and_upright(cameras: tuple[Camera, ...], built: BuiltRoom) -> None:
    """As far from the true surface as asked, but for a cell's half diagonal and what a Gaussian spans; the horizon is
    level."""
    assert len(cameras) == SMALL.views
    assert in_the_room(cameras, built)
    places = np.array([camera.position for camera in cameras])
    coarse = 0.5 * np.sqrt(3.0) * CELL + 0.05
    assert MeshDistance(built.record.mesh).unsigned(places).min() > SMALL.clearance - coarse
    axes = np.array([camera.world_from_camera for camera in cameras])
    assert np.abs(axes[:, 2, 0]).max() < 1e-12
    assert axes[:, 2, 1].max() < 0.0


def test_every_piece_of_furniture_is_in_several_pictures(cameras: tuple[Camera, ...], built: BuiltRoom) -> None:
    """At least one per cent of four pictures or more, by rays to the true mesh."""
    caster, count = Raycaster(built.record.mesh), np.zeros(len(built.instance_labels), dtype=int)
    for camera in cameras:
        ways = camera.directions(camera.pixel_centers)
        face = caster.cast(np.broadcast_to(camera.position, ways.shape), ways).face
        share = np.bincount(built.face_instance[face[face >= 0]], minlength=len(count)) / len(ways)
        count += share > 0.01
    furniture = [k for k, label in enumerate(built.instance_labels) if category_of(label) in FURNITURE]
    assert len(furniture) >= 3
    assert count[furniture].min() >= 4


@pytest.mark.slow
def test_without_a_map_cameras_stand_inside(splats: Gaussians, built: BuiltRoom, known: dict[str, Any]) -> None:
    """By the splats alone, with and without labels; a map without room for a camera is reported."""
    labelled = camera_path(splats, SMALL, boxes=known["boxes"])
    assert in_the_room(labelled.cameras, built)
    blocked = Occupancy(np.full((9, 9), OCCUPIED, np.uint8), np.zeros(2), np.array([-0.1, 0.1]))
    path = camera_path(splats, SMALL, occupancy=blocked)
    assert "no free cell" in path.notes[0]
    assert len(path.cameras) == SMALL.views
    assert in_the_room(path.cameras, built)


@pytest.mark.parametrize("size", [(0.6, 0.4, 0.3), (1.0, 0.04, 0.03)])
def test_what_has_no_inside_is_looked_at_from_all_sides(size: tuple[float, float, float]) -> None:
    """All eight corners in every picture, from below and above; however thin it is."""
    thing = splats_on_mesh(rounded_box(size, 0.01), 0.01, seed=0)
    config = PathConfig(views=20, width=80, height=60)
    cameras = camera_path(thing, config).cameras
    assert len(cameras) == 20
    corners = 0.5 * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * size
    for camera in cameras:
        x, y, z = ((corners - camera.position) @ camera.world_from_camera).T
        assert (z > 0).all()
        assert (np.abs(x / z) * camera.focal < 40).all()
        assert (np.abs(y / z) * camera.focal < 30).all()
    height = [camera.position[2] for camera in cameras]
    assert min(height) < 0 < max(height)
