"""A packed run: what is in it, what is not, and the same bytes for the same files."""

import hashlib
import json
import os
import tarfile
from dataclasses import asdict
from pathlib import Path

import pytest

from dcap.scene.types.sample import Sample
from flows.cli.app import main
from flows.configure import LanguageOptions
from flows.dataset_pack import OWN, UNKNOWN, pack_run
from flows.find_run import ASKED_VERSION
from flows.place import PlaceConfig
from flows.samples import EMBEDDED


def run_of(folder: Path, dataset: Path, samples: dict[str, str]) -> Path:
    """A run with samples by id: a verdict, or why one failed, or nothing at all."""
    run = folder / "rooms-1"
    asked = [
        Sample(one, f"{folder}/rooms/den", f"{folder}/objects/cup.glb", f"put it there ({one})") for one in samples
    ]
    for sample in asked:
        own = run / "samples" / sample.id
        own.mkdir(parents=True)
        told = samples[sample.id]
        if told.startswith("error"):
            (own / "error.txt").write_text(f"{sample.scene}: torn\nmore")
        elif told:
            tree = {"schema": 1, "verdict": told, "reason": None, "base": {"id": "1", "label": "bed"}, "mass": 0.2}
            (own / "placement.json").write_text(json.dumps(tree))
            (own / "placement.schema.json").write_text("{}")
            (own / "scene.glb").write_bytes(b"glTF")
            (own / "object.ply").write_bytes(b"ply")
            (own / "maps").mkdir()
            (own / "maps" / "depth.npy").write_bytes(b"0")
            (own / "sample.json").write_text(f'{{"scene": "{folder}"}}')
            (own / "notes.txt").write_text("mine")
            (own / "settled.png").symlink_to(own / "notes.txt")
    tree = {
        "version": ASKED_VERSION, "dataset": str(dataset), "config": PlaceConfig().model_dump(mode="json"),
        "language": asdict(LanguageOptions()), "samples": [asdict(one) for one in asked],
    }  # fmt: skip
    run.mkdir(exist_ok=True)
    (run / "run.json").write_text(json.dumps(tree))
    return run


def unpacked(run: Path, folder: Path) -> Path:
    """The content of a run's pack, in a folder."""
    with tarfile.open(pack_run(str(run), folder / "out.tar.gz").path) as tar:
        tar.extractall(folder, filter="data")
    return folder / "out"


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """Three samples: at rest, infeasible, failed."""
    dataset = tmp_path / "rooms.yaml"
    rows = [{"id": "b", "room": "den", "object": "cup", "prompt": "p", "licence": "CC-BY-4.0"}, {"id": "a"}]
    dataset.write_text(json.dumps(rows))
    return run_of(tmp_path, dataset, {"b": "at_rest", "a": "infeasible", "c": "error"})


def test_a_link_to_a_folder_is_not_packed(run: Path, tmp_path: Path) -> None:
    """What lies behind it is another's, also where its name is that of a folder that is packed."""
    own = run / "samples" / "b"
    (own / "maps").rename(tmp_path / "elsewhere")
    (own / "maps").symlink_to(tmp_path / "elsewhere")
    out = unpacked(run, tmp_path)
    assert not (out / "placements" / "b" / "maps").exists()
    assert (out / "placements" / "a" / "maps" / "depth.npy").is_file()


def test_what_is_packed(run: Path, tmp_path: Path) -> None:
    """Results with their files and hashes; what a person laid there, links, paths and failures stay out."""
    out = unpacked(run, tmp_path)
    manifest = json.loads((out / "manifest.json").read_text())
    assert manifest["counts"] == {"samples": 2, "at_rest": 1, "infeasible": 1, "left_out": 1}
    assert [(one["id"], one["licence"], one["verdict"]) for one in manifest["samples"]] == [
        ("a", UNKNOWN, "infeasible"), ("b", "CC-BY-4.0", "at_rest"),
    ]  # fmt: skip
    assert manifest["left_out"] == [{"id": "c", "why": "failed: den: torn"}]
    own = {"placement.json", "scene.glb", "object.ply", "maps/depth.npy"}
    listed = {one["path"] for one in manifest["files"]}
    assert listed == {"README.md", "prompts.jsonl", "placement.schema.json"} | {
        f"placements/{name}/{file}" for name in "ab" for file in own
    }
    for one in manifest["files"]:
        data = (out / one["path"]).read_bytes()
        assert (len(data), hashlib.sha256(data).hexdigest()) == (one["bytes"], one["sha256"])
        assert str(tmp_path) not in data.decode()
    assert str(tmp_path) not in json.dumps(manifest)
    text = (out / "README.md").read_text()
    assert "- unknown: 1" in text
    assert "- c: failed: den: torn" in text


def test_same_files_same_bytes(run: Path, tmp_path: Path) -> None:
    """Times, owners and the order on the disk do not count."""
    first = pack_run(str(run), tmp_path / "one" / "set.tar.gz").path.read_bytes()
    for path in run.rglob("*.glb"):
        os.utime(path, (1e9, 1e9))
        path.chmod(0o600)
    second = pack_run(str(run), tmp_path / "two" / "set.tar.gz").path
    assert second.read_bytes() == first
    assert [path.name for path in second.parent.iterdir()] == ["set.tar.gz"]
    with tarfile.open(second) as tar:
        entries = tar.getmembers()
    assert [one.name for one in entries] == sorted(one.name for one in entries)
    assert {(one.mtime, one.uid, one.gid, one.uname, one.mode) for one in entries} == {(0, 0, 0, "", 0o644)}
    assert all(one.name.startswith("set/") for one in entries)


def test_the_embedded_dataset_has_the_projects_licence(tmp_path: Path) -> None:
    run = run_of(tmp_path, EMBEDDED.resolve(), {"b": "at_rest"})
    pack = pack_run(str(run), None)
    assert pack.path == run / "dataset.tar.gz"
    assert pack.manifest["licences"] == {OWN: 1}
    assert pack.warnings == ()


def test_nothing_to_pack_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Exit 2 and one line, for a run whose samples failed, and for what is no run; nothing is left behind."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path / "data"))
    run = run_of(tmp_path, tmp_path / "none.yaml", {"b": "error", "c": ""})
    for name in (str(run), "nothing"):
        assert main(["dataset", "pack", name, "--out", str(tmp_path / "out.tar.gz")]) == 2
        assert capsys.readouterr().err.count("\n") == 1
    assert not (tmp_path / "out.tar.gz").exists()


def test_the_command_tells_what_is_left_out(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["dataset", "pack", str(run)]) == 0
    captured = capsys.readouterr()
    assert captured.out.splitlines()[0] == "2 samples, 1 at rest, 1 infeasible, 1 left out"
    assert "left out: c" in captured.err
    assert "is unknown" in captured.err
