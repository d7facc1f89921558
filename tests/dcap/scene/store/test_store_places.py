"""What stands in an artifact's place and is none is noticed, and gives way to it."""

import os
from pathlib import Path

import pytest

from dcap.scene.store.artifacts import Store
from dcap.scene.types.sample import SourceOptions

VALUE = SourceOptions()


@pytest.mark.parametrize(
    "what", ["link", "loop", "file", "pipe inside", "parent is a file", "parent is a broken link", "parent is a link"]
)
def test_what_stands_in_an_artifacts_place_is_mended(tmp_path: Path, what: str) -> None:
    store = Store(tmp_path / "store")
    ref = store.save(VALUE)
    folder, kept = store.folder(ref), tmp_path / "kept"
    if what in ("link", "loop", "file"):
        os.rename(folder, kept)
    if what == "link":
        folder.symlink_to(kept)
    elif what == "loop":
        folder.symlink_to(folder.name)
    elif what == "file":
        folder.write_text("no folder")
    elif what == "pipe inside":
        os.mkfifo(folder / "pipe")
    else:
        os.rename(folder.parent, kept)
        if what == "parent is a file":
            folder.parent.write_text("no folder")
        elif what == "parent is a link":  # to where all is well, but perhaps inside another artifact
            folder.parent.symlink_to(kept)
        else:
            folder.parent.symlink_to("nowhere")
    fresh = Store(store.root)
    assert not fresh.has(ref)
    assert fresh.save(VALUE) == ref
    assert fresh.has(ref)
    assert not folder.is_symlink()
    assert not folder.parent.is_symlink()
    assert fresh.load(ref) == VALUE
    assert not kept.exists() or list(kept.iterdir())  # what a link led to is left alone


def test_a_link_to_where_an_artifact_was_moved_is_noticed(tmp_path: Path) -> None:
    """Also by the process that has read its bytes: names, sizes and times are the same through the link."""
    store = Store(tmp_path / "store")
    ref = store.save(VALUE)
    assert store.has(ref)
    os.rename(store.folder(ref), tmp_path / "moved")
    store.folder(ref).symlink_to(tmp_path / "moved")
    assert not store.has(ref)
    assert store.save(VALUE) == ref
    assert not store.folder(ref).is_symlink()
