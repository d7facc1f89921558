"""Names and links of foreign files cannot take anything into the store that is not theirs."""

import os
from pathlib import Path

import pytest

from dcap.scene.errors import InputError
from dcap.scene.store.artifacts import Source, Store


@pytest.fixture
def store(tmp_path: Path) -> Store:
    """An empty store."""
    return Store(tmp_path / "store")


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
    with pytest.raises(InputError, match=r"notes\.txt: a link to .*cp -L") as caught:
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


@pytest.mark.parametrize("name", ["a\\..\\..\\evil.obj", "C:\\evil.obj", "two\nlines.txt", "\udcff.txt", "bell\a.txt"])
def test_names_that_are_paths_elsewhere_or_no_text_are_refused(store: Store, scene: Path, name: str) -> None:
    """A backslash is a folder's border on other systems, a line break one of the digest's list."""
    (scene / name).write_text("x")
    with pytest.raises(InputError, match="rename it") as caught:
        store.add_source(scene)
    str(caught.value).encode()  # can be printed
    assert list(store.refs()) == []


def test_loops_pipes_and_links_to_folders_are_no_files(store: Store, scene: Path) -> None:
    """They are passed over: nothing is read for ever and no other folder comes along."""
    (scene / "loop").symlink_to("loop")
    (scene / "up").symlink_to("..")
    os.mkfifo(scene / "pipe")
    source = store.load(store.add_source(scene))
    assert isinstance(source, Source)
    assert [path.name for path in source.path.iterdir()] == ["room.obj"]


@pytest.mark.parametrize("path", ["nul\0.obj", "../scene/room.obj", "x" * 5000 + ".obj"])
def test_a_path_is_a_file_or_one_line(store: Store, scene: Path, path: str) -> None:
    """A zero byte or a name that no file can have is bad input; dots are the person's own."""
    if path.startswith(".."):
        assert store.has(store.add_source(scene / path))
        return
    with pytest.raises(InputError) as caught:
        store.add_source(scene / path)
    assert "\n" not in str(caught.value)
