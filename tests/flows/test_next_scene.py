"""What a placement wrote is a scene for the next: names, masses, materials and unloaded shapes survive."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from box_rooms import block
from dented_bed import DEPTH, RADIUS, TOP
from placed_folder import MASS, PROMPT, placed_folder, read_placed, values

from dcap.language.connect import connect
from dcap.language.protocol.client import LanguageConfig
from dcap.language.protocol.session import Session
from dcap.scene.errors import InputError
from dcap.scene.readers.frame import Role
from dcap.scene.readers.source import read_scan
from dcap.scene.readers.source_files import source_files
from dcap.scene.types.sample import SourceOptions
from flows.cli.app import main
from flows.next_scene import next_scene_files
from tasks.freed.stage import unloaded
from tasks.segment.stage import SegmentConfig, segment


def test_names_masses_and_materials_survive(tmp_path: Path) -> None:
    """The ball is an instance that may move, with its label, part, mass and material; the bed keeps its own."""
    scan = read_placed(placed_folder(tmp_path))
    scene = segment(scan, SegmentConfig(), connect(LanguageConfig(), Session()))
    assert scan.earlier is not None
    assert (scan.up, scan.unit_metres) == ("z", 1.0)
    np.testing.assert_array_equal(scan.world_from_file, np.eye(4))
    assert [one.id for one in scene.instances] == ["bed", "floor", "wall_back", "wall_front", "placed_1"]
    thing = scene.instances[-1]
    assert (thing.label, thing.placed, [part.name for part in thing.parts]) == ("ball", True, ["body"])
    assert [(one.mass, one.carried_by, one.prompt) for one in scan.earlier.placed] == [(MASS, ("bed",), PROMPT)]
    assert [(row.body, row.material.id, row.model) for row in scan.earlier.materials] == [
        ("bed", "foam_mattress", "mpm"), ("placed_1", "rubber_soft", "mpm"),
    ]  # fmt: skip
    assert scan.earlier.touching == (("bed", "placed_1"),)
    np.testing.assert_allclose(scene.instance_mesh(4).bounds[0, 2], TOP - DEPTH, atol=1e-6)
    np.testing.assert_array_equal(scene.instances[0].front, [0.0, -1.0, 0.0])


def test_a_dent_can_be_undone(tmp_path: Path) -> None:
    """Without its load the top of the bed is as flat as before, to the float32 of the file."""
    scan = read_placed(placed_folder(tmp_path))
    scene = segment(scan, SegmentConfig(), connect(LanguageConfig(), Session()))
    assert scan.earlier is not None
    bed = scene.instance_mesh(0)
    under = np.linalg.norm(bed.vertices[:, :2], axis=1) < 0.01
    dented = bed.vertices[under & (bed.vertices[:, 2] > 0.3), 2]
    np.testing.assert_allclose(dented.min(), TOP - DEPTH, atol=5e-4)  # the vertex nearest to the middle
    flat = unloaded(scene, scan.earlier.deformations).instance_mesh(0).vertices
    top = flat[flat[:, 2] > 0.3, 2]
    np.testing.assert_allclose(top, TOP, atol=2e-6)
    np.testing.assert_array_equal(unloaded(scene, []).mesh.vertices, scene.mesh.vertices)


def test_the_same_scene_gives_the_same_bytes() -> None:
    assert next_scene_files(values(), PROMPT) == next_scene_files(values(), PROMPT)


def test_a_placement_that_failed_leaves_the_scene(tmp_path: Path) -> None:
    """Without a rest state nothing is placed, and what was there before stays."""
    scan = read_placed(placed_folder(tmp_path))
    told = values()
    told.final, told.scan = None, scan
    facts = json.loads(next_scene_files(told, "put the piano on the bed")["scene.json"])
    assert facts["object"] is None
    assert [one["id"] for one in facts["instances"] if one["placed"]] == ["placed_1"]


def test_ids_of_the_scene_are_not_taken_again(tmp_path: Path) -> None:
    folder = placed_folder(tmp_path, placed_1=block((1.5, -1.5, 0.0), (1.7, -1.3, 0.2)))
    facts = json.loads((folder / "scene.json").read_text())
    assert [one["id"] for one in facts["instances"] if one["placed"]] == ["placed_2"]
    assert facts["object"] == "placed_2"


def test_only_the_scene_is_read(tmp_path: Path) -> None:
    """Pictures and timings of the folder do not decide what is cached."""
    name, files = source_files(placed_folder(tmp_path))
    assert name == "."
    assert set(files) == {"scene.glb", "scene.json", "object.ply", "deformed_1.ply"}


def edited(change: Callable[[dict], object]) -> Callable[[Path], object]:  # type: ignore[type-arg]
    """Damage to scene.json."""

    def damage(folder: Path) -> None:
        path = folder / "scene.json"
        tree = json.loads(path.read_text())
        change(tree)
        path.write_text(json.dumps(tree))

    return damage


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (lambda folder: (folder / "scene.json").unlink(), "scene.json is missing"),
        (lambda folder: (folder / "scene.glb").unlink(), "scene.glb is missing"),
        (lambda folder: (folder / "object.ply").unlink(), "object.ply is missing"),
        (lambda folder: (folder / "deformed_1.ply").unlink(), "deformed_1.ply is missing"),
        (lambda folder: (folder / "scene.json").write_text("{"), "broken JSON"),
        (edited(lambda tree: tree.update(version=7)), "version 7 of the format"),
        (edited(lambda tree: tree["instances"][-1]["placed"].update(mass=-1.0)), r"placed\.mass -1\.0"),
        (edited(lambda tree: tree["instances"][-1]["placed"].update(carried_by=["sofa"])), "names 'sofa'"),
        (edited(lambda tree: tree["instances"][-1].update(id="bed")), "'bed' is given twice"),
        (edited(lambda tree: tree.update(colour="red")), "colour"),
        (edited(lambda tree: tree["deformations"][0].update(file="../x.ply")), "pattern"),
        (edited(lambda tree: tree["instances"].pop(0)), "names 'bed'"),
        (edited(lambda tree: tree["instances"].pop(1)), "not an instance of scene.json"),
    ],
)
def test_a_damaged_folder_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], damage: Callable[[Path], object], words: str
) -> None:
    """Exit 2 and one line that names the file and the place; nothing is written."""
    folder = placed_folder(tmp_path / "first")
    damage(folder)
    with pytest.raises(InputError, match=words) as raised:
        read_placed(folder)
    assert "\n" not in str(raised.value)
    assert str(folder) in str(raised.value)


def test_a_damaged_folder_ends_the_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DCAP_DATA", str(tmp_path / "data"))
    folder = placed_folder(tmp_path / "first")
    (folder / "scene.json").unlink()
    out = tmp_path / "second"
    assert main(["place", str(folder), str(folder / "object.ply"), "put it on the bed", "--out", str(out)]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert not out.exists()


def test_what_the_folder_says_is_not_overruled(tmp_path: Path) -> None:
    folder = placed_folder(tmp_path)
    for options in (SourceOptions(up="y"), SourceOptions(unit="cm"), SourceOptions(label="bed")):
        with pytest.raises(InputError, match="omit it"):
            read_scan(folder, options, Role.SCENE)
    with pytest.raises(InputError, match="give the mesh of an object"):
        read_scan(folder, SourceOptions(), Role.OBJECT)


def test_the_scene_is_not_written_over(tmp_path: Path) -> None:
    assert main(["place", str(tmp_path), "ball.ply", "put it on the bed", "--out", str(tmp_path)]) == 2
    assert list(tmp_path.iterdir()) == []


def test_radius_of_the_ball_is_kept(tmp_path: Path) -> None:
    """What follows a turned body without deforming is no deformation."""
    scan = read_placed(placed_folder(tmp_path))
    assert scan.earlier is not None
    assert [one.instance for one in scan.earlier.deformations] == ["bed"]
    size = np.ptp(
        scan.mesh.vertices[np.unique(scan.mesh.faces[scan.face_node == scan.node_names.index("placed_1/body")])], axis=0
    )
    np.testing.assert_allclose(size, 2.0 * RADIUS, rtol=0.02)  # an icosphere of 1280 faces
