"""Pictures of attention checks beside those that a benchmark takes of the same placement."""

import json
from pathlib import Path

import numpy as np
import pytest
from dented_bed import anchor, ball, scene_of, settled
from forged_pictures import huge
from PIL import Image
from placed_folder import placed_folder

from dcap.evaluation.study.placed_surface import read_placed_surface
from dcap.evaluation.study.placements import ShownPlacement, views_of
from dcap.scene.errors import FormatError
from dcap.scene.types.intent import Intent, OrientationRequest, RegionRequest
from dcap.scene.types.judged_views import PLACED, JudgedViews
from dcap.scene.types.paint import SourceSurface
from dcap.scene.types.segmentation import SegmentedObject, SegmentedScene
from flows.study.check_views import check_pictures, size_of, views_config
from tasks.measure.judge_cameras import ViewsConfig
from tasks.measure.views import judged_views

SMALL = ViewsConfig(size=40)


@pytest.fixture(scope="module")
def placement(tmp_path_factory: pytest.TempPathFactory) -> ShownPlacement:
    """A ball on a bed between two walls, with the pictures that a judge sees of it."""
    folder = placed_folder(tmp_path_factory.mktemp("placed"))
    bare = SourceSurface.untextured()
    asked = Intent("bed", "bed", "ball", np.full(3, 0.2), 0.4, False, 1.0, OrientationRequest("any", "", ""),
                   RegionRequest("", (), (), ""), (), ())  # fmt: skip
    views = judged_views(
        SegmentedScene(scene_of()), SegmentedObject(ball()), asked, anchor(), settled(), bare, bare, SMALL
    )
    (folder / "views").mkdir()
    for name in JudgedViews.__slots__:
        Image.fromarray(getattr(views, name)).save(folder / "views" / f"{name}.png")
    return ShownPlacement("dcap", "ball", folder, tuple(views_of(folder / "views")), "at_rest")


def test_the_side_at_rest_is_what_the_run_shows(placement: ShownPlacement) -> None:
    """Names, order, sizes, cameras, walls that are cut away and shading: pictures of the same things, but for what
    writing them to a file rounds."""
    assert placement.scene_model is not None
    surface = read_placed_surface(placement.scene_model)
    found = check_pictures(placement, surface, surface, SMALL)
    assert tuple(found) == PLACED
    for path in placement.pictures:
        own = np.asarray(Image.open(path), int)
        assert found[path.stem].shape == own.shape
        differs = np.abs(found[path.stem] - own).max(axis=2)
        assert (differs > 8).mean() < 0.01, path.stem


def test_a_picture_that_says_it_is_huge_is_refused(tmp_path: Path) -> None:
    """Pictures of checks are drawn as large as a run's, so its headers are not believed beyond what images may have."""
    (tmp_path / "front.png").write_bytes(huge())
    with pytest.raises(FormatError, match=r"front\.png: an image of 60000 x 60000 pixels"):
        size_of(tmp_path / "front.png")


def test_a_floating_object_is_in_the_middle_of_its_own_pictures(placement: ShownPlacement) -> None:
    """As a method's own would be that let it float; the room and the view from above stay where they are."""
    assert placement.scene_model is not None
    surface = read_placed_surface(placement.scene_model)
    found = check_pictures(placement, surface, surface.lifted(0.3), SMALL)
    for name, rgb in found.items():
        red = rgb[..., 1] < 0.5 * rgb[..., 0]
        off = np.hypot(*(np.argwhere(red).mean(axis=0) + 0.5 - SMALL.size / 2)) / SMALL.size
        assert (off < 0.05) == (name not in ("room", "top")), name


def test_cameras_are_those_of_the_run(tmp_path: Path) -> None:
    """As its configuration has them; what it does not say is the default."""
    (tmp_path / "run.json").write_text(json.dumps({"config": {"views": {"near": 4.0, "older": 1}}}))
    assert views_config(tmp_path) == ViewsConfig(near=4.0)
    (tmp_path / "run.json").write_text("{}")
    assert views_config(tmp_path) == ViewsConfig()


def test_a_scene_that_says_nonsense_is_refused(placement: ShownPlacement, tmp_path: Path) -> None:
    """The study goes on without that check."""
    assert placement.scene_model is not None
    surface = read_placed_surface(placement.scene_model)
    (tmp_path / "scene.json").write_text('{"version": 1}')
    other = ShownPlacement("dcap", "ball", tmp_path, placement.pictures, "at_rest")
    with pytest.raises(FormatError, match=r"scene\.json"):
        check_pictures(other, surface, surface, SMALL)
