"""Errors about what was copied into the store name what a person gave."""

from pathlib import Path

import pytest

from dcap.scene.types.sample import Sample
from flows.sample_run import in_users_words
from tasks.artifact import Store


@pytest.mark.parametrize("where", ["", "things"])
def test_a_file_beside_the_mesh_is_the_users(where: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As the mesh itself is, whatever folder it was given by."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path / "data"))
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / where
    folder.mkdir(exist_ok=True)
    (folder / "cup.obj").write_text("mtllib cup.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (folder / "cup.mtl").write_text("newmtl a\nmap_Kd t.png\n")
    (folder / "t.png").write_bytes(b"no picture")
    given = str(Path(where) / "cup.obj")
    store = Store.default()
    inside = store.folder(store.add_source(given)) / "files"
    sample = Sample("one", "room", given, "put it there")
    assert in_users_words(f"{inside / 'cup.obj'}: broken", sample) == f"{given}: broken"
    assert in_users_words(f"{inside / 't.png'}: broken", sample) == f"{Path(where) / 't.png'}: broken"


def test_a_folder_is_the_users(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """And what lies in it."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path / "data"))
    (room := tmp_path / "room").mkdir()
    (room / "mesh.ply").write_text("ply")
    store = Store.default()
    inside = store.folder(store.add_source(str(room))) / "files"
    sample = Sample("one", str(room), "ball", "put it there")
    assert in_users_words(f"{inside / 'mesh.ply'}: broken; {inside}", sample) == f"{room / 'mesh.ply'}: broken; {room}"
