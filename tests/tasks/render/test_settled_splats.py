"""Gaussians of a scene with a ball sunk into its bed: what is written, what goes, and how alike the pictures are."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from dented_bed import DEPTH, RADIUS, TOP, anchor, ball, box_mesh, scene_of, settled
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from dcap.geometry.camera import Camera, looking_at
from dcap.geometry.raycast import Raycaster
from dcap.geometry.rendering.picture import psnr, unlit
from dcap.geometry.solid.repair import subdivide_near
from dcap.geometry.splatting.discs import splats_on_mesh
from dcap.geometry.splatting.render import Splatter
from dcap.scene.errors import InputError
from dcap.scene.readers.splats.splats import read_splats
from dcap.scene.types.gaussians import DC, Gaussians, joined_splats
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.segmentation import Segmentation
from dcap.scene.writers.gaussians import write_splat_parts
from solver.runtime import start
from tasks.render.settled_meshes import settled_item, settled_scene
from tasks.render.settled_splats import SettledSplats, settled_splats

SPACING = 0.02
HEIGHTS = (TOP - 0.1, TOP + 0.1)
"""Heights that colours stand for, black to white [m]."""


def centimetres() -> NDArray[np.float64]:
    """World from a file in centimetres that is turned about z and lies elsewhere."""
    out = np.eye(4)
    out[:3, :3] = 0.01 * Rotation.from_euler("z", 30, degrees=True).as_matrix()
    out[:3, 3] = [1.0, 2.0, 0.0]
    return out


def in_file(splats: Gaussians) -> Gaussians:
    return splats.transformed(np.asarray(np.linalg.inv(centimetres())))


@pytest.fixture(autouse=True)
def coarse(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Few discs on the object, but where pictures are compared."""
    if request.node.get_closest_marker("slow") is None:
        monkeypatch.setattr("dcap.geometry.splatting.discs.DETAIL", 60.0)


@cache
def striped() -> Segmentation:
    """The bed alone, its top fine enough for stripes of 25 cm."""
    bed = box_mesh((-0.8, -1.0, 0.0), (0.8, 1.0, TOP))
    fine = subdivide_near(bed, np.array([[-0.9, -1.1, TOP - 0.01], [0.9, 1.1, TOP + 0.01]]), 0.03)
    stripes = np.where(np.floor(fine.vertices[:, :1] / 0.25) % 2 == 0, [220, 220, 230], [120, 140, 190])
    whole = scene_of()
    faces = np.zeros(len(fine.faces), dtype=np.int32)
    painted = Mesh(fine.vertices, fine.faces, stripes.astype(np.uint8))
    return replace(whole, mesh=painted, instances=whole.instances[:1], face_instance=faces, face_part=faces)


@cache
def before(spacing: float = SPACING) -> Gaussians:
    return splats_on_mesh(striped().mesh, spacing, seed=0)


def placed(splats: Gaussians) -> SettledSplats:
    return settled_splats(splats, centimetres(), striped(), ball(), anchor(), settled())


def everything(made: SettledSplats) -> Gaussians:
    return joined_splats(list(made.parts())).transformed(centimetres())


def of_scene(made: SettledSplats) -> Gaussians:
    """Without the object."""
    return joined_splats(list(made.parts())[:-1]).transformed(centimetres())


def test_the_file_holds_what_was_made_and_the_rest_bit_by_bit(tmp_path: Path) -> None:
    """Read back: the scene's Gaussians in their order, those off the dent as they were, pieces and the object at the
    end; harmonics padded to 45."""
    given = in_file(before())
    made = placed(given)
    write_splat_parts(tmp_path / "a.ply", made.parts(), len(made), 3, made.comments)
    head = (tmp_path / "a.ply").read_bytes()[:2000].decode("latin1")
    assert (
        f"comment {len(given)} Gaussians of the scene in its order; {len(made.carried.index)} moved, 0 dropped" in head
    )
    assert f"comment {len(made.item)} Gaussians of the object" in head
    assert head.count("property float f_rest_") + (tmp_path / "a.ply").read_bytes()[2000:4000].count(b"f_rest_") >= 44
    read, wanted = read_splats(tmp_path / "a.ply"), joined_splats(list(made.parts()))
    assert len(read) == len(made) == len(given) + len(made.carried.more) + len(made.item)
    assert read.degree == 3
    assert not read.rest.any()
    for one in ("position", "log_scale", "rotation", "logit", "dc"):
        assert np.array_equal(getattr(read, one), getattr(wanted, one))
    still = np.setdiff1d(np.arange(len(given)), made.carried.index)
    assert len(still) > 0.9 * len(given)
    for one in ("position", "log_scale", "rotation", "logit", "dc"):
        assert np.array_equal(getattr(read, one)[still], getattr(given, one)[still])
    moved = given.position[made.carried.index] @ centimetres()[:3, :3].T + centimetres()[:3, 3]
    assert np.abs(moved[:, :2]).max() < 0.25
    write_splat_parts(tmp_path / "b.ply", placed(given).parts(), len(made), 3, made.comments)
    assert (tmp_path / "a.ply").read_bytes() == (tmp_path / "b.ply").read_bytes()


def test_the_object_lies_where_it_rests() -> None:
    """Its discs are on the ball, in metres of the world, and red."""
    found = placed(in_file(before())).item.transformed(centimetres())
    away = np.linalg.norm(found.position - [0.0, 0.0, TOP - DEPTH + RADIUS], axis=1)
    assert (away < RADIUS + 1e-5).all()
    assert (away > 0.98 * RADIUS).all()
    assert (found.color == [200, 60, 40]).all()


def test_gaussians_of_another_frame_are_refused() -> None:
    """A folder's mesh and its splats need not agree; nothing is guessed."""
    with pytest.raises(InputError, match="not in its frame"):
        settled_splats(before(), centimetres(), striped(), ball(), anchor(), settled())


@cache
def camera() -> Camera:
    return looking_at(np.array([0.35, -0.75, TOP + 0.6]), np.array([0.0, 0.0, TOP]), 320, 320, fov_deg=35.0)


def seen(mesh: Mesh) -> NDArray[np.int64]:
    """Faces in the pixels' middles, -1 for none."""
    ways = camera().directions(camera().pixel_centers)
    hits = Raycaster(mesh).cast(np.broadcast_to(camera().position, ways.shape), ways)
    return hits.face.reshape(320, 320).astype(np.int64)


def shown(splats: Gaussians) -> NDArray[np.float32]:
    return np.clip(Splatter(splats).view(camera()).image, 0.0, 1.0)


@pytest.mark.slow
def test_pictures_of_settled_splats_are_those_of_the_settled_mesh() -> None:
    """25 dB and more over support and object against the mesh in its own colours.

    Without the object, whose rim a picture of splats widens by a pixel, hardly less than before: what they lacked of
    the mesh's sharpness they still lack. Left undented, they miss the dented mesh by more.
    """
    start(2)
    given = before(0.01)
    made = placed(in_file(given))
    dented = settled_scene(striped(), settled(), "bed").scene.mesh
    both = Mesh.concatenate([dented, settled_item(ball(), anchor(), settled().bodies[0])])
    face = seen(both)
    support, on_object = (face >= 0) & (face < len(dented.faces)), face >= len(dented.faces)
    assert on_object.sum() > 5000
    picture, reference = shown(everything(made)), unlit(both, camera())
    assert psnr(picture[support], reference[support]) > 25.0
    assert psnr(picture[on_object], reference[on_object]) > 25.0
    bare = seen(dented) >= 0
    alone = psnr(shown(of_scene(made))[bare], unlit(dented, camera())[bare])
    reachable = psnr(shown(given)[bare], unlit(striped().mesh, camera())[bare])
    stale = psnr(shown(given)[bare], unlit(dented, camera())[bare])
    assert alone > reachable - 0.5
    assert stale < alone - 0.5


@pytest.mark.slow
def test_the_dent_is_as_deep_as_the_meshs_and_closed() -> None:
    """With heights for colours the splats' picture is a map of heights, in the dent the mesh's; no light comes through.

    Most of it to a splat's thickness, 1 mm, and what pieces may bend, 0.5 mm.
    """
    start(2)
    made = placed(in_file(before(0.01)))
    bed = of_scene(made)
    low, high = HEIGHTS
    height = np.clip((bed.position[:, 2:] - low) / (high - low), 0.0, 1.0)
    tinted = replace(bed, dc=np.repeat((height - 0.5) / DC, 3, axis=1).astype(np.float32))
    view = Splatter(tinted).view(camera())
    after = settled_scene(striped(), settled(), "bed").scene.mesh
    ways = camera().directions(camera().pixel_centers)
    hits = Raycaster(after).cast(np.broadcast_to(camera().position, ways.shape), ways)
    where = hits.position.reshape(320, 320, 3)
    rim = np.sqrt(RADIUS**2 - (RADIUS - DEPTH) ** 2)
    inside = np.linalg.norm(where[..., :2], axis=-1) < 1.2 * rim
    assert inside.sum() > 3000
    assert view.light[inside].max() < 0.05
    off = low + (high - low) * view.image[..., 0] - where[..., 2]
    assert np.median(np.abs(off[inside])) < 1.5e-3
    assert np.quantile(np.abs(off[inside]), 0.9) < 0.2 * DEPTH  # the rim is a crease, which hides a pixel or two
    assert where[..., 2][inside].min() < TOP - 0.9 * DEPTH
