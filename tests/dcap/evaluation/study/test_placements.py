"""What of a run can be shown, and what is cut out of it for a page."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from many_methods_run import (
    HEIGHTS,
    METHODS,
    RADIUS,
    SAMPLES,
    TOP,
    change_row,
    many_methods_run,
    method_folder,
    scene_glb,
)
from PIL import Image

from dcap.evaluation.judging.cameras import SIZE
from dcap.evaluation.study.attention import (
    LEAST_LIFT,
    LIFT,
    LIFTED,
    MODEL,
    SETTLED,
    candidates,
    read_placed_surface,
    write_check,
)
from dcap.evaluation.study.design import method_pairs, read_study_run, views_of
from dcap.scene.errors import FormatError, InputError
from dcap.scene.types.pictures import PLACED
from flows.judge_run import read_rows
from flows.study.app import check_pictures


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A run of three methods."""
    return many_methods_run(tmp_path / "run")


def test_every_placement_is_found_with_its_views(run: Path) -> None:
    found = read_study_run(run, read_rows(run))
    assert len(found.shown) == 12
    for method in METHODS:
        assert [path.stem for path in found.shown[method, "sofa/3"].pictures] == list(PLACED) == ["overview", "closeup"]
    assert found.clean_picture("bed-1") == run / "samples" / "bed-1" / "views" / "clean.png"
    assert found.asset_picture("bed-1") == run / "samples" / "bed-1" / "views" / "asset.png"
    assert set(method_pairs(found)) == {("dcap", "fireplace"), ("dcap", "layoutgpt"), ("fireplace", "layoutgpt")}


def test_what_cannot_be_shown_is_left_out_and_told(run: Path) -> None:
    """A method that found no place, one that was not rendered, one that is not there."""
    change_row(run, "fireplace", "bed-1", verdict="infeasible", reason="no_region")
    bare = method_folder(run, "layoutgpt", "bed-2")
    shutil.rmtree(bare / "views")
    for name in ("settled", "closeup"):
        (bare / f"{name}.png").unlink()
    shutil.rmtree(method_folder(run, "dcap", "desk-4"))
    found = read_study_run(run, read_rows(run))
    assert set(found.left_out) == {("fireplace", "bed-1"), ("layoutgpt", "bed-2"), ("dcap", "desk-4")}
    pairs = method_pairs(found)
    assert pairs["dcap", "fireplace"] == ("bed-2", "sofa/3")
    assert pairs["fireplace", "layoutgpt"] == ("sofa/3", "desk-4")


def test_what_judges_do_not_compare_is_not_shown(run: Path) -> None:
    """What is meant to be impossible, though a method placed it; what failed; what has no row."""
    for method in METHODS:
        change_row(run, method, "bed-1", feasible_intended=False)
    change_row(run, "layoutgpt", "bed-2", error="it broke")
    rows = [row for row in read_rows(run) if (row.method, row.sample) != ("dcap", "desk-4")]
    found = read_study_run(run, rows)
    assert found.left_out == {
        **{(method, "bed-1"): "meant to be impossible" for method in METHODS},
        ("layoutgpt", "bed-2"): "no placement: it broke",
        ("dcap", "desk-4"): "not in the results",
    }
    assert all("bed-1" not in samples for samples in method_pairs(found).values())


def test_a_placement_without_a_view_is_left_out(run: Path) -> None:
    """Its other pictures are not those of all methods alike: their size tells whose they are."""
    (method_folder(run, "dcap", "bed-1") / "views" / "closeup.png").unlink()
    assert read_study_run(run, read_rows(run)).left_out["dcap", "bed-1"] == "no pictures"


def test_samples_are_known_whoever_placed_them(run: Path) -> None:
    """run.json lists METHOD/SAMPLE for those of other methods."""
    tree = json.loads((run / "run.json").read_text())
    tree["samples"] += [{**one, "id": f"fireplace/{one['id']}"} for one in tree["samples"]]
    before = read_study_run(run, read_rows(run))
    (run / "run.json").write_text(json.dumps(tree))
    after = read_study_run(run, read_rows(run))
    assert (after.prompts, after.left_out) == (before.prompts, before.left_out)


def test_one_method_is_no_study(tmp_path: Path) -> None:
    run = many_methods_run(tmp_path / "run", ("dcap",))
    with pytest.raises(InputError, match="a study compares methods, and the run has only dcap"):
        read_study_run(run, read_rows(run))


def test_a_run_without_renders_is_refused(run: Path) -> None:
    for picture in run.rglob("*.png"):
        picture.unlink()
    with pytest.raises(InputError, match=r"no pictures of placements \(.*samples/bed-1/views/\*\.png\)"):
        read_study_run(run, read_rows(run))


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"samples": [{"id": "a"}]}', '{"methods": ["../x"], "samples": []}'])
def test_a_broken_run_json_is_named(run: Path, text: str) -> None:
    (run / "run.json").write_text(text)
    with pytest.raises(InputError, match=r"run\.json: ") as error:
        read_study_run(run, read_rows(run))
    assert "\n" not in str(error.value)


def test_the_surface_is_that_of_the_file(run: Path) -> None:
    """In metres, z up: the ball's lowest point is where its method left it."""
    surface = read_placed_surface(method_folder(run, "fireplace", "bed-1") / "scene.glb")
    low, high = surface.thing_bounds
    assert low[2] == pytest.approx(TOP + HEIGHTS["fireplace"], abs=1e-6)
    assert high[2] - low[2] == pytest.approx(2 * RADIUS, abs=1e-6)


def test_a_cut_out_keeps_the_object_and_what_is_near(run: Path) -> None:
    """Fewer faces than asked for where possible, all of the object's always."""
    surface = read_placed_surface(method_folder(run, "dcap", "bed-1") / "scene.glb")
    small = surface.around_thing(most_faces=int(surface.is_thing.sum()) + 40)
    assert small.is_thing.sum() == surface.is_thing.sum()
    assert surface.is_thing.sum() < len(small.mesh.faces) <= surface.is_thing.sum() + 40
    assert len(small.mesh.faces) < len(surface.around_thing().mesh.faces) <= len(surface.mesh.faces)


def test_a_scene_without_the_object_is_refused(tmp_path: Path) -> None:
    (tmp_path / "scene.glb").write_bytes(scene_glb(0.0).replace(b'"name":"object"', b'"name":"thingy"'))
    with pytest.raises(FormatError, match="no node 'object'"):
        read_placed_surface(tmp_path / "scene.glb")


@pytest.mark.slow
def test_a_check_looks_like_the_run_and_differs_in_the_height_alone(run: Path, tmp_path: Path) -> None:
    """Both sides have the pictures that a placement of the run has, of their names and sizes. The copy floats: what
    shows the place differs around the ball alone, and models agree but for the ball."""
    placement = read_study_run(run, read_rows(run)).shown["dcap", "bed-1"]
    folder = tmp_path / "check"
    write_check(placement, folder, check_pictures)
    for name in (SETTLED, LIFTED):
        pictures = views_of(folder / name)
        assert [path.name for path in pictures] == [path.name for path in placement.pictures]
        assert {Image.open(path).size for path in pictures} == {(SIZE, SIZE)}
    settled, lifted = (read_placed_surface(folder / name / MODEL) for name in (SETTLED, LIFTED))
    rise = lifted.thing_bounds[0] - settled.thing_bounds[0]
    assert rise == pytest.approx([0.0, 0.0, max(LEAST_LIFT, LIFT * 2 * RADIUS)], abs=1e-5)
    still = settled.mesh.vertices[np.unique(settled.mesh.faces[~settled.is_thing])]
    assert np.array_equal(still, lifted.mesh.vertices[np.unique(lifted.mesh.faces[~lifted.is_thing])])
    for view in PLACED:
        one, two = (np.asarray(Image.open(folder / name / f"{view}.png"), int) for name in (SETTLED, LIFTED))
        change = (np.abs(one - two).max(axis=2) > 20).mean()
        of_place = view == "overview"  # the ball is small there
        assert (1e-4 if of_place else 5e-3) < change < (0.5 if of_place else 1.0)


def test_checks_are_made_of_placements_at_rest(run: Path) -> None:
    """One per sample, of the method that settles; the order follows from the seed."""
    found = candidates(read_study_run(run, read_rows(run)), 3)
    assert sorted(found) == sorted(("dcap", sample) for sample in SAMPLES)
    assert found == candidates(read_study_run(run, read_rows(run)), 3)
