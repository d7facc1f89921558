"""The whole path on the smallest scene: a toy block on a table, through the command line."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from dcap.scene.writers.meshes import mesh_from_ply
from flows.cli.app import main
from flows.place import STAGES
from tasks.artifact import Store

TOP_M = 0.75
SIDE_M = 0.06
PROMPT = "put the toy block at the centre of the table"
PICTURES = {"clean.png", "settled.png", "closeup.png", "before_after.png", "contact.png", "profile.png"}


@pytest.fixture
def files(tmp_path: Path) -> Iterator[Path]:
    """A table 1.2 x 0.8 x 0.75 m and a block 6 cm wide, z up."""
    folder = tmp_path
    solids = [trimesh.creation.box((1.2, 0.8, 0.04), trimesh.transformations.translation_matrix((0, 0, TOP_M - 0.02)))]
    for x in (-0.55, 0.55):
        for y in (-0.35, 0.35):
            leg = trimesh.transformations.translation_matrix((x, y, (TOP_M - 0.04) / 2))
            solids.append(trimesh.creation.box((0.05, 0.05, TOP_M - 0.04), leg))
    trimesh.util.concatenate(solids).export(folder / "table.ply")
    trimesh.creation.box((SIDE_M, SIDE_M, SIDE_M)).export(folder / "block.ply")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DCAP_DATA", str(folder / "data"))
        patch.setenv("DCAP_RENDER__SIZE", "256")  # nothing here is seen in the pictures
        patch.delenv("PREFECT_API_URL", raising=False)
        yield folder


def placed(files: Path, capsys: pytest.CaptureFixture[str], *options: str) -> tuple[dict[str, Any], list[str]]:
    """The result of a placement, and the stages that were computed for it."""
    before = {path.name for path in (files / "data" / "cache" / "records").glob("*")}
    frame = ["--label", "table", "--up", "z", "--unit", "m", "--object-up", "z", "--object-unit", "m"]
    arguments = ["place", str(files / "table.ply"), str(files / "block.ply"), PROMPT, *frame]
    arguments += ["--out", str(files / "out"), "--json"]
    assert main([*arguments, *options]) == 0
    tree = json.loads(capsys.readouterr().out)
    after = {path.name for path in (files / "data" / "cache" / "records").glob("*")}
    return tree, sorted(name.split("-")[0] for name in after - before)


@pytest.mark.slow
def test_a_block_rests_on_the_table(files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The block lies flat on the middle of the table and its contact carries its weight; the same again is cached;
    after damage just the damaged stage runs, and the result is the same to the byte."""
    tree, computed = placed(files, capsys)
    assert (tree["verdict"], tree["reason"], tree["part"], tree["region_missed"]) == ("at_rest", None, "top", False)
    low, high = np.array(tree["object_aabb"])
    side = SIDE_M * float(str(tree["scale"]))
    # contact stiffness aims at 0.05 mm of penetration; ten times that is still flat to the eye
    np.testing.assert_allclose([low[2], high[2]], [TOP_M, TOP_M + side], atol=5e-4)
    assert np.abs((low + high)[:2] / 2).max() < 0.1
    contacts = tree["contacts"]
    assert isinstance(contacts, list)
    # the certificate allows 0.5 % of the weight as residual
    np.testing.assert_allclose(
        sum(one["normal_force_n"] for one in contacts), 9.81 * float(str(tree["mass"])), rtol=5e-3
    )
    out = files / "out"
    assert {path.name for path in out.iterdir()} == PICTURES | {
        "placement.json",
        "placement.schema.json",
        "records.json",
        "sample.json",
        "object.ply",
        "object.glb",
        "contacts.glb",
        "scene.glb",
        "scene.json",
    }
    np.testing.assert_allclose(mesh_from_ply((out / "object.ply").read_bytes()).bounds, tree["object_aabb"], atol=1e-9)
    assert json.loads((out / "placement.json").read_text()) == tree
    assert computed == sorted(stage.name for stage in STAGES)

    again, computed = placed(files, capsys)
    assert (again, computed) == (tree, [])

    store = Store.default()
    for ref in [ref for ref in store.refs() if ref.kind == "Anchor"]:
        (store.folder(ref) / "value.json").write_text("{}")
    again, computed = placed(files, capsys)
    assert computed == ["anchor"]
    assert {**again, "timings": 0} == {**tree, "timings": 0}


@pytest.mark.slow
@pytest.mark.long
def test_threads_do_not_decide_what_is_cached(files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Another number of threads is not another placement: nothing is computed again."""
    placed(files, capsys)
    _, computed = placed(files, capsys, "--threads", "1")
    assert computed == []
