"""From a sentence to a simulator: what was placed stays where it settled when MuJoCo takes over."""

import json
from pathlib import Path

import furnished as make
import mujoco
import pytest
from rested import drift

from flows.cli.app import main

STAYS = 2e-3
"""How far a settled object may move in two seconds [m]."""


def exported(folder: Path, capsys: pytest.CaptureFixture[str], kind: str) -> Path:
    """The folder that `dcap export` prints."""
    assert main(["export", str(folder), "--format", kind]) == 0
    return Path(capsys.readouterr().out.strip())


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize(("scene", "label", "thing", "name", "prompt"), [
    (make.bare_bed(0.5, 0.2), "bed", {"body": make.ball(0.108)}, "bowling_ball", "put the bowling ball on the bed"),
    (make.table(0.75), "table", {"body": make.block((-0.03, 0.03), (-0.03, 0.03), (0.0, 0.06))}, "toy_block",
     "put the toy block on the table"),
])  # fmt: skip
def test_what_was_placed_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
    scene: make.Parts, label: str, thing: make.Parts, name: str, prompt: str,
) -> None:  # fmt: skip
    """A ball in the dent of its bed and a block on its table stay within 2 mm for two seconds; the object's frame is
    the pose of placement.json; every format is written beside, and one export twice is the same."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path / "data"))
    monkeypatch.setenv("DCAP_RENDER__SIZE", "256")  # nothing here is seen in the pictures
    monkeypatch.delenv("PREFECT_API_URL", raising=False)
    files = [make.written(tmp_path / f"{label}.glb", scene), make.written(tmp_path / f"{name}.glb", thing)]
    out = tmp_path / "out"
    assert main(["place", *map(str, files), prompt, "--label", label, "--out", str(out), "--json"]) == 0
    tree = json.loads(capsys.readouterr().out)
    folder = exported(out, capsys, "mjcf")
    assert folder == out.resolve() / "export" / "mjcf"
    model = mujoco.MjModel.from_xml_path(str(folder / "scene.xml"))
    assert drift(model, 2.0) < STAYS
    body = model.body("object")
    assert body.mass[0] == pytest.approx(tree["mass"])
    assert body.pos == pytest.approx(tree["pose"]["position"], abs=1e-6)
    first = {path.name: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    exported(out, capsys, "mjcf")
    assert first == {path.name: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    assert (exported(out, capsys, "urdf") / "object.urdf").is_file()
    assert (exported(out, capsys, "usd") / "scene.usda").is_file()


@pytest.mark.slow
def test_an_infeasible_placement_is_not_exported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """There is no rest state: exit 2, the reason in the line, and no folder."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path / "data"))
    monkeypatch.setenv("DCAP_RENDER__SIZE", "256")  # nothing here is seen in the pictures
    monkeypatch.delenv("PREFECT_API_URL", raising=False)
    table, ball = make.written(tmp_path / "table.glb", make.table(0.75)), tmp_path / "ball.glb"
    make.written(ball, {"body": make.ball(0.1)})
    out = tmp_path / "out"
    assert main(["place", str(table), str(ball), "put the ball on the bed", "--label", "table", "--out", str(out)]) == 3
    capsys.readouterr()
    assert main(["export", str(out), "--format", "usd"]) == 2
    assert "target_not_found" in capsys.readouterr().err
    assert not (out / "export").exists()
