"""Pictures of attention checks beside those that judges see of the same placement."""

import json
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
from dented_bed import anchor, ball, scene_of, settled
from PIL import Image
from placed_folder import placed_folder

from dcap.evaluation.judging.cameras import SIZE, sample_cameras
from dcap.evaluation.study.attention import read_placed_surface
from dcap.evaluation.study.design import ShownPlacement, views_of
from dcap.scene.errors import FormatError, InputError
from dcap.scene.types.choices import Intent, OrientationRequest, RegionRequest
from dcap.scene.types.mesh import SourceSurface
from dcap.scene.types.pictures import PLACED
from dcap.scene.types.segmentation import SegmentedObject, SegmentedScene
from flows.judge_views import CAMERAS, VIEWS
from flows.study.app import check_pictures
from tasks.measure.views import judged_views, sights


@pytest.fixture(scope="module")
def placement(tmp_path_factory: pytest.TempPathFactory) -> ShownPlacement:
    """A ball on a bed between two walls, with the pictures that a judge sees of it."""
    folder = placed_folder(tmp_path_factory.mktemp("placed"))
    scene, item, bare = SegmentedScene(scene_of()), SegmentedObject(ball()), SourceSurface.untextured()
    asked = Intent("bed", "bed", "ball", np.full(3, 0.2), 0.4, False, 1.0, OrientationRequest("any", "", ""),
                   RegionRequest("", (), (), ""), (), ())  # fmt: skip
    seen = sights(scene, item, asked, anchor(), settled())
    cameras = sample_cameras([seen])
    views = judged_views(scene, item, anchor(), settled(), bare, bare, cameras.overview, cameras.closeup(seen))
    (folder / VIEWS).mkdir()
    for name in PLACED:
        Image.fromarray(getattr(views, name)).save(folder / VIEWS / f"{name}.png")
    tree = {"states": {}, **asdict(cameras), "contact": list(seen.contact[cameras.direction])}
    (folder / VIEWS / CAMERAS).write_text(json.dumps(tree))
    return ShownPlacement("dcap", "ball", folder, views_of(folder / VIEWS), "at_rest")


@pytest.mark.slow
def test_the_side_at_rest_is_what_the_run_shows(placement: ShownPlacement) -> None:
    """Names, order, sizes, cameras, walls that are cut away and shading: pictures of the same things, but for what
    writing them to a file rounds."""
    assert placement.scene_model is not None
    surface = read_placed_surface(placement.scene_model)
    found = check_pictures(placement, surface, surface.lifted(0.0))
    assert tuple(found) == PLACED
    for path in placement.pictures:
        own = np.asarray(Image.open(path), int)
        assert found[path.stem].shape == own.shape == (SIZE, SIZE, 3)
        differs = np.abs(found[path.stem] - own).max(axis=2)
        assert (differs > 8).mean() < 0.01, path.stem


@pytest.mark.slow
def test_the_close_up_follows_a_floating_object(placement: ShownPlacement) -> None:
    """As that of a method's own would that let it float: its lowest point is below the middle and in the picture. The
    overview stays where it is."""
    assert placement.scene_model is not None
    surface = read_placed_surface(placement.scene_model)
    floating = check_pictures(placement, surface, surface.lifted(0.3))
    resting = check_pictures(placement, surface, surface)
    lowest = {}
    for name, pictures in (("floating", floating), ("resting", resting)):
        for view, rgb in pictures.items():
            red = (rgb[..., 1] < 0.5 * rgb[..., 0]).any(axis=1)
            lowest[name, view] = float(np.flatnonzero(red).max()) / SIZE
    assert 0.5 < lowest["floating", "closeup"] < 0.75
    assert lowest["floating", "overview"] < lowest["resting", "overview"] - 0.02


def test_a_placement_of_unknown_cameras_is_refused(placement: ShownPlacement, tmp_path: Path) -> None:
    """It is told; the study goes on without that check."""
    assert placement.scene_model is not None
    surface = read_placed_surface(placement.scene_model)
    other = ShownPlacement("dcap", "ball", tmp_path, placement.pictures, "at_rest")
    with pytest.raises(InputError, match=r"cameras\.json: not there"):
        check_pictures(other, surface, surface)
    (tmp_path / "scene.json").write_text('{"version": 1}')
    with pytest.raises(FormatError, match=r"scene\.json"):
        check_pictures(other, surface, surface)
