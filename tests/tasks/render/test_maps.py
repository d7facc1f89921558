"""Conditioning maps: passes that agree pixel by pixel, masks with closed forms, a composite that is the picture."""

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from dented_bed import DEPTH, RADIUS, TOP, anchor, ball, box_mesh, scene_of, settled
from PIL import Image

from dcap.geometry.camera import Camera, looking_at
from dcap.geometry.camera_file import read_camera
from dcap.geometry.rendering.coverage import composite
from dcap.geometry.rendering.map_files import write_maps
from dcap.geometry.rendering.picture import picture
from dcap.scene.errors import InputError
from dcap.scene.types.mesh import PaintedMesh
from dcap.scene.types.pictures import HIDDEN_CONTACT, SEEN_CONTACT, ConditioningMaps
from tasks.render.config import RenderConfig
from tasks.render.maps import SettledView, conditioning_maps, placed
from tasks.render.settled_meshes import untouched

CENTER = np.array([0.0, 0.0, TOP - DEPTH + RADIUS])
"""Of the ball at rest [m]."""
HIGHER = np.array([0.0, 0.0, 0.2])
CONFIG = RenderConfig(size=240)


def camera(position: tuple[float, float, float] = (0.3, -1.2, 1.1), size: int = 240) -> Camera:
    return looking_at(np.array(position), CENTER, size, size, fov_deg=35.0)


@cache
def what() -> SettledView:
    return placed(scene_of(), ball(), anchor(), None, settled())


@cache
def taken() -> ConditioningMaps:
    return conditioning_maps(what(), camera(), CONFIG, cutaway=False)


def positions(maps: ConditioningMaps, view: Camera) -> np.ndarray:
    """World points of the pixels' middles, from depth [m], shape (h, w, 3)."""
    ways = view.directions(view.pixel_centers)
    along = maps.depth.ravel() / (ways @ view.world_from_camera[:, 2])
    return (view.position + along[:, None] * ways).reshape(*maps.depth.shape, 3)


def test_passes_agree_by_reprojection():
    """Seen from a second camera, points of the first one's depth have the same ids and normals where nothing hides
    them."""
    other = camera((-0.2, -1.1, 1.2))
    second = conditioning_maps(what(), other, CONFIG, cutaway=False)
    points = positions(taken(), camera()).reshape(-1, 3)
    column, row, depth = other.project(points).T
    inside = (column > 1) & (column < 239) & (row > 1) & (row < 239)
    x, y = column[inside].astype(int), row[inside].astype(int)
    same_depth = np.abs(second.depth[y, x] - depth[inside]) < 2e-3
    assert same_depth.mean() > 0.6  # the rest is hidden from one of the two
    first = taken().part.ravel()[inside]
    assert (first == second.part[y, x])[same_depth].mean() > 0.98
    turn = np.einsum("ni,ni->n", taken().normal_world.reshape(-1, 3)[inside], second.normal_world[y, x])
    assert np.median(turn[same_depth]) > 0.999


def test_mask_has_the_area_of_a_sphere_seen_in_perspective():
    """A disc of tangent r / sqrt(d^2 - r^2) about the line to its centre."""
    open_air = SettledView(untouched(scene_of()), ball(), floating(), np.zeros((0, 3)), None, bare_look())
    view = camera()
    found = conditioning_maps(open_air, view, CONFIG, cutaway=False)
    middle = CENTER + HIGHER
    distance = float(np.linalg.norm(view.position - middle))
    tangent = RADIUS / np.sqrt(distance**2 - RADIUS**2)
    height = view.project(middle[None])[0]
    off = np.hypot(height[0] - 120, height[1] - 120) / view.focal
    # off the axis the disc is an ellipse, longer by 1 / cos^3 of its angle in all
    expected = np.pi * (tangent * view.focal) ** 2 * (1.0 + off**2) ** 1.5
    assert abs(found.object_mask.sum() / 255.0 / expected - 1.0) < 0.02
    assert found.hidden_mask.max() == 0
    assert found.contact.max() == 0


def bare_look() -> PaintedMesh:
    return PaintedMesh(scene_of().mesh)


def floating() -> PaintedMesh:
    """The ball 20 cm over its place."""
    pose = np.eye(4)
    pose[:3, 3] = CENTER + HIGHER
    return PaintedMesh(ball().mesh.transformed(pose))


def test_what_hides_the_object_is_in_the_matte():
    """A board before the lower half: visible and hidden shares make up the whole silhouette."""
    board = box_mesh((-0.3, -0.6, TOP), (0.3, -0.58, TOP + 0.06))
    level = camera((0.0, -1.6, CENTER[2]))
    hidden = conditioning_maps(
        placed(scene_of(board=board), ball(), anchor(), None, settled()), level, CONFIG, cutaway=False
    )
    free = conditioning_maps(what(), level, CONFIG, cutaway=False)
    whole = free.object_mask.astype(int) + free.hidden_mask
    both = hidden.object_mask.astype(int) + hidden.hidden_mask
    assert np.abs(whole - both).max() <= 1
    assert hidden.object_mask.sum() < 0.8 * free.object_mask.sum()
    assert not ((hidden.object_mask == 255) & (hidden.hidden_mask > 0)).any()


def test_contact_map_is_the_patch():
    """From above the ball hides all of its patch: a disc of the contact's radius."""
    above = looking_at(CENTER + np.array([0.0, 1e-3, 1.0]), CENTER, 240, 240, fov_deg=30.0)
    found = conditioning_maps(what(), above, CONFIG, cutaway=False)
    patch = found.contact == HIDDEN_CONTACT
    contact = settled().contact_points
    radius = float(np.linalg.norm(contact[:, :2], axis=1).max())
    depth = 1.0 + CENTER[2] - contact[:, 2].mean()
    expected = np.pi * (radius * above.focal / depth) ** 2
    assert 0.9 < patch.sum() / expected < 1.5  # contact points stand for discs, and a pixel beside them counts
    assert not (found.contact == SEEN_CONTACT).any()
    assert (found.object_mask[patch] == 255).all()


def test_dent_is_the_depth_of_the_sphere():
    """Where the dent can be seen it is as deep as the sphere that made it, along the bed's normal."""
    bare = SettledView(what().around, ball(), floating(), np.zeros((0, 3)), None, what().look)
    side = camera((0.0, -0.8, 1.2))
    found = conditioning_maps(bare, side, CONFIG, cutaway=False)
    points = positions(found, side)
    away = np.linalg.norm(points[..., :2], axis=-1)
    middle = (away < 0.02) & (found.object_mask == 0)
    assert middle.sum() > 50
    sphere = np.sqrt(RADIUS**2 - away[middle] ** 2) - (RADIUS - DEPTH)
    # chords over edges of 15 mm of a sphere of 0.1 m, in two directions; normals lean by 0.2 at 2 cm
    assert np.abs(found.dent[middle] + sphere).max() < 2 * 0.015**2 / (8 * RADIUS) + 0.03 * DEPTH
    assert np.abs(found.dent[away > 0.2]).max() < 1e-4


def test_composite_over_the_empty_room_is_the_picture():
    """The room before, darkened and with the object put in, differs from the rendered room only in its dent."""
    before = picture([scene_of().mesh], camera()).rgb
    over = composite(taken(), before).astype(float)
    error = np.abs(over - taken().rgb).max(axis=2)
    dented = np.abs(taken().dent) > 1e-5
    assert np.percentile(error[~dented], 99.0) <= 6.0
    assert error[taken().object_mask == 255].max() <= 2.0  # bytes are rounded twice
    plain = np.abs(before.astype(float) - taken().rgb).max(axis=2)
    assert error.mean() < 0.2 * plain.mean()


def test_files_come_back(tmp_path):
    write_maps(tmp_path / "maps", taken(), camera())
    folder = tmp_path / "maps"
    assert np.array_equal(np.load(folder / "depth.npy"), taken().depth)
    millimetres = np.array(Image.open(folder / "depth.png")).astype(float)
    seen = np.isfinite(taken().depth)
    assert np.abs(millimetres[seen] / 1000.0 - taken().depth[seen]).max() <= 5.1e-4
    assert np.array_equal(np.array(Image.open(folder / "instance.png")), taken().instance)
    names = json.loads((folder / "ids.json").read_text())["instance"]
    number = taken().instance[taken().object_mask == 255]
    assert {names[str(one)] for one in np.unique(number)} == {"ball"}
    again = read_camera(folder / "camera.json", camera().target)
    points = np.array([[0.1, 0.2, 0.5], [-0.3, 0.1, 0.7]])
    assert again.project(points) == pytest.approx(camera().project(points), abs=1e-9)
    assert (folder / "colmap" / "points3D.txt").is_file()


def changed(path: Path, **more: object) -> Path:
    """camera.json with other values."""
    tree = json.loads(path.read_text()) | more
    path.write_text(json.dumps(tree))
    return path


BAD_CAMERAS: list[tuple[dict[str, object], str]] = [
    ({"fx": 0}, "fx"),
    ({"width": 10**6}, "width"),
    ({"world_from_camera": [[1, 0, 0, 0], [0, 2, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}, "rigid"),
    ({"world_from_camera": [[1, 0, 0]]}, "world_from_camera"),
    ({"width": 9000, "height": 9000}, "more than"),
    ({"fx": 1e-3}, "fx = 0.001"),
    ({"cx": 1e9}, "cx = 1e"),
    ({"k1": 0.1}, "undistort"),
    ({"distortion": [0.0, 0.2]}, "undistort"),
]
"""Values of camera.json that no pinhole of such pictures has, and what is said of each."""


def test_bad_cameras_are_told(tmp_path):
    """A file that is not there and one with a distortion, too; a distortion of nought is none."""
    for number, (more, told) in enumerate(BAD_CAMERAS):
        write_maps(tmp_path / str(number), taken(), camera())
        with pytest.raises(InputError, match=told):
            read_camera(changed(tmp_path / str(number) / "camera.json", **more), CENTER)
    with pytest.raises(InputError, match="No such file"):
        read_camera(tmp_path / "none.json", CENTER)
    write_maps(tmp_path / "sound", taken(), camera())
    assert read_camera(changed(tmp_path / "sound" / "camera.json", k1=0, distortion=[0.0, 0.0]), CENTER).width == 240


def test_camera_inside_the_object_is_refused():
    with pytest.raises(InputError, match="inside the object"):
        conditioning_maps(what(), looking_at(CENTER, CENTER + HIGHER, 32, 32), CONFIG, cutaway=False)


def test_photo_of_another_size_is_refused():
    with pytest.raises(InputError, match="100 x 50 pixels"):
        composite(taken(), np.zeros((50, 100, 3), dtype=np.uint8))
