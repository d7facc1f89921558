"""Foreign files are taken into the store with what they name, and nothing that is not theirs."""

import json
import os
from pathlib import Path

import pytest

from dcap.scene.errors import InputError
from dcap.scene.readers.files import absence
from tasks.artifact import Source, Store


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    """A folder with one file, beside one that is not its own."""
    (tmp_path / "private.txt").write_text("private")
    folder = tmp_path / "scene"
    folder.mkdir()
    (folder / "room.obj").write_text("v 0 0 0\n")
    return folder


@pytest.mark.parametrize("target", ["../private.txt", "/etc/hostname", "truth.yaml", ".hidden"])
def test_a_link_out_of_the_scene_is_refused(store: Store, scene: Path, target: str) -> None:
    """What lies elsewhere, the truth and hidden files do not come along under another name; the line names the link."""
    (scene / "truth.yaml").write_text("feasible: true")
    (scene / ".hidden").write_text("hidden")
    (scene / "notes.txt").symlink_to(target)
    with pytest.raises(InputError, match=r"notes\.txt: a link to .*cp -rL") as caught:
        store.add_source(scene)
    assert "\n" not in str(caught.value)
    assert list(store.refs()) == []


def test_a_link_within_the_scene_is_taken(store: Store, scene: Path) -> None:
    """A link to another file of the same scene is that file."""
    (scene / "same.obj").symlink_to("room.obj")
    source = store.load(store.add_source(scene))
    assert isinstance(source, Source)
    copied = source.path / "same.obj"
    assert copied.read_text() == "v 0 0 0\n"
    assert not copied.is_symlink()


def test_a_texture_that_is_a_link_to_elsewhere_is_refused(store: Store, scene: Path) -> None:
    """Files that a mesh names are held to the same; the mesh itself may be a link, for a person has named it."""
    (scene / "room.obj").write_text("mtllib room.mtl\nv 0 0 0\n")
    (scene / "room.mtl").symlink_to("../private.txt")
    with pytest.raises(InputError, match=r"room\.mtl: a link to"):
        store.add_source(scene / "room.obj")
    (scene / "room.mtl").unlink()
    (scene.parent / "link.obj").symlink_to("scene/room.obj")
    source = store.load(store.add_source(scene.parent / "link.obj"))
    assert isinstance(source, Source)
    assert source.path.read_bytes() == (scene / "room.obj").read_bytes()


def gltf(uri: str) -> str:
    """A document that names one file."""
    return json.dumps({"buffers": [{"uri": uri}]})


def sog(name: str) -> str:
    """A description of Gaussians that names one picture."""
    return json.dumps({"means": {"files": [name]}, "quats": {}, "scales": {}})


NAMING = {
    "library": {"room.obj": "mtllib l/private.txt\nv 0 0 0\n"},
    "texture": {"room.obj": "mtllib room.mtl\nv 0 0 0\n", "room.mtl": "newmtl a\nmap_Kd l/private.txt\n"},
    "texture beside its library": {
        "room.obj": "mtllib m/room.mtl\nv 0 0 0\n", "m/room.mtl": "newmtl a\nmap_Kd ../l/private.txt\n"
    },
    "buffer": {"room.gltf": gltf("l/private.txt")},
    "picture": {"meta.json": sog("l/private.txt")},
    "layer": {"room.usda": "#usda 1.0\n(subLayers = [@l/private.txt@])\n"},
}  # fmt: skip
"""Meshes whose first file names one through a link to a folder."""


def naming(scene: Path, files: dict[str, str]) -> Path:
    """Write such a mesh."""
    for name, text in files.items():
        (scene / name).parent.mkdir(exist_ok=True)
        (scene / name).write_text(text)
    return scene / next(iter(files))


@pytest.mark.parametrize(("files", "target"), [
    (files, target) for files in NAMING.values() for target in ("../beyond", ".hidden")
])  # fmt: skip
def test_a_name_through_a_link_to_a_folder_elsewhere_is_refused(
    store: Store, scene: Path, files: dict[str, str], target: str
) -> None:
    """The whole way to a file counts, not its end alone; the line names the link that leaves, and nothing is taken."""
    path = naming(scene, files)
    (scene / "m").mkdir(exist_ok=True)
    for folder in (scene.parent / "beyond", scene / ".hidden"):
        folder.mkdir()
        (folder / "private.txt").write_text("private")
    (scene / "l").symlink_to(target)
    with pytest.raises(InputError, match=r"l(/private\.txt)?: a link to .*cp -rL") as caught:
        store.add_source(path)
    assert "\n" not in str(caught.value)
    assert list(store.refs()) == []


@pytest.mark.parametrize("name", [".ssh/id", "truth.yaml"])
def test_hidden_files_and_truth_are_not_taken_by_their_name(store: Store, scene: Path, name: str) -> None:
    """What no link may show is not shown to a mesh that names it outright; its reader says why it is not there."""
    (scene / name).parent.mkdir(exist_ok=True)
    (scene / name).write_text("secret")
    for path, text in ((scene / "room.obj", f"mtllib {name}\nv 0 0 0\n"), (scene / "room.gltf", gltf(name))):
        path.write_text(text)
        source = store.load(store.add_source(path))
        assert isinstance(source, Source)
        assert [one.name for one in source.path.parent.iterdir()] == [path.name]
    assert absence(name) == "is a hidden file or ground truth, which no mesh may name"


def test_an_obj_takes_its_textures_along(store: Store, tmp_path: Path) -> None:
    """The artifact of an OBJ holds its MTL files and their textures, so changing a texture changes the reference."""
    folder = tmp_path / "mug"
    folder.mkdir()
    (folder / "mug.obj").write_text("mtllib my mug.mtl\nv 0 0 0\n")
    (folder / "my mug.mtl").write_text("newmtl a\nmap_Kd -s 1 1 1 skin.png\n")
    (folder / "skin.png").write_bytes(b"one")
    (folder / "other.png").write_bytes(b"not named")
    ref = store.add_source(folder / "mug.obj")
    source = store.load(ref)
    assert isinstance(source, Source)
    assert sorted(path.name for path in source.path.parent.iterdir()) == ["mug.obj", "my mug.mtl", "skin.png"]
    (folder / "other.png").write_bytes(b"changed")
    assert store.add_source(folder / "mug.obj") == ref
    (folder / "skin.png").write_bytes(b"two")
    assert store.add_source(folder / "mug.obj") != ref


def test_a_gltf_takes_its_buffers_along(store: Store, tmp_path: Path) -> None:
    """Buffers and images that a glTF names come along, data URIs and paths outside of its folder do not."""
    folder = tmp_path / "deep"
    folder.mkdir()
    (tmp_path / "secret.bin").write_bytes(b"x")
    buffers = [{"uri": "my%20data.bin"}, {"uri": "data:;base64,AA=="}, {"uri": "../secret.bin"}]
    (folder / "a.gltf").write_text(json.dumps({"buffers": buffers, "images": [{"uri": "i.png"}]}))
    (folder / "my data.bin").write_bytes(b"x")
    (folder / "i.png").write_bytes(b"x")
    source = store.load(store.add_source(folder / "a.gltf"))
    assert isinstance(source, Source)
    assert sorted(path.name for path in source.path.parent.iterdir()) == ["a.gltf", "i.png", "my data.bin"]


def test_ground_truth_stays_outside(store: Store, tmp_path: Path) -> None:
    """A truth file in a scene folder neither reaches a stage nor changes the reference."""
    scene = tmp_path / "room"
    scene.mkdir()
    (scene / "labels.json").write_text("[]")
    ref = store.add_source(scene)
    (scene / "truth.yaml").write_text("feasible: true")
    assert store.add_source(scene) == ref


def test_absurd_sources_are_refused(store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Missing, empty, far too large and far too many files are errors that name the path."""
    with pytest.raises(InputError, match="no such file"):
        store.add_source(tmp_path / "nothing.obj")
    (tmp_path / "empty.ply").touch()
    with pytest.raises(InputError, match="empty file"):
        store.add_source(tmp_path / "empty.ply")
    with (tmp_path / "huge.ply").open("wb") as file:
        file.truncate(5 << 30)
    with pytest.raises(InputError, match=r"5\.0 GiB > 4 GiB"):
        store.add_source(tmp_path / "huge.ply")
    monkeypatch.setattr("dcap.scene.readers.source_files.MOST_FILES", 3)
    many = tmp_path / "many"
    many.mkdir()
    for index in range(4):
        (many / f"{index}.txt").write_text("x")
    with pytest.raises(InputError, match="more than 3 files"):
        store.add_source(many)


def test_what_is_not_a_mesh_file_is_refused_unread(store: Store, tmp_path: Path) -> None:
    """A device, a film, a name too long for any file and a file without permission are one line, before any copy."""
    film = tmp_path / "film.mp4"
    film.write_bytes(b"x")
    for path, words in (
        (Path("/dev/zero"), "neither a file nor a folder"),
        (film, r"\.mp4 is not a mesh format"),
        (tmp_path / ("x" * 300 + ".obj"), "cannot be read"),
    ):
        with pytest.raises(InputError, match=words) as caught:
            store.add_source(path)
        assert "\n" not in str(caught.value)
    assert list(store.refs()) == []


def test_loops_pipes_and_links_to_folders_are_no_files(store: Store, scene: Path) -> None:
    """They are passed over: nothing is read for ever and no other folder comes along."""
    (scene / "loop").symlink_to("loop")
    (scene / "up").symlink_to("..")
    os.mkfifo(scene / "pipe")
    os.mkfifo(scene / "a_vh_clean_2.ply")  # as the mesh of ScanNet's folders is called
    source = store.load(store.add_source(scene))
    assert isinstance(source, Source)
    assert [path.name for path in source.path.iterdir()] == ["room.obj"]
