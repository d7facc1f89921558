"""A picture of an artifact is decoded only if the store would have written it, also where its digest is right."""

import io
import tarfile
from pathlib import Path

import numpy as np
import pytest
from forged_pictures import FORGED, PICTURE, forged, saved_as

from dcap.scene.errors import MissingArtifactError
from dcap.scene.store import pictures
from dcap.scene.store.artifacts import Store
from dcap.scene.store.ref import Ref
from dcap.scene.store.remote import RemoteStore
from dcap.scene.types.renders import Overview


@pytest.fixture
def store(tmp_path: Path) -> Store:
    """An empty store."""
    return Store(tmp_path / "store")


def put(store: Store, ref: Ref[Overview], files: dict[str, bytes]) -> None:
    """Write an artifact as it is."""
    store.folder(ref).mkdir(parents=True)
    for name, data in files.items():
        (store.folder(ref) / name).write_bytes(data)


@pytest.mark.parametrize("what", FORGED)
def test_a_picture_that_the_store_would_not_write_is_damage(store: Store, what: str) -> None:
    """It is neither there nor loaded, and the line says which picture it is."""
    ref, files = forged(FORGED[what]())
    put(store, ref, files)
    assert not store.has(ref)
    with pytest.raises(MissingArtifactError, match=r"Overview .*clean\.png: ") as caught:
        store.load(ref)
    assert "\n" not in str(caught.value)


def test_a_picture_by_another_name_is_not_decoded(store: Store) -> None:
    """Names tell what the headers of an artifact are read of, so a picture has no other."""
    ref, files = forged(saved_as("PNG"), "clean.txt")
    put(store, ref, files)
    with pytest.raises(MissingArtifactError, match=r"clean\.txt is no name of a picture"):
        store.load(ref)


@pytest.mark.parametrize("what", FORGED)
def test_such_a_picture_is_not_taken_from_the_shared_store(tmp_path: Path, what: str) -> None:
    """Nothing of it stays on this machine."""
    shared = tmp_path / "shared"
    ref, files = forged(FORGED[what]())
    path = shared / "objects" / "Overview" / ref.sha256[:2] / f"{ref.sha256}.tar"
    path.parent.mkdir(parents=True)
    with tarfile.open(path, "w:") as tar:
        for name, data in files.items():
            about = tarfile.TarInfo(name)
            about.size = len(data)
            tar.addfile(about, io.BytesIO(data))
    store = Store(tmp_path / "store", RemoteStore(str(shared)))
    assert not store.has(ref)
    assert [one for one in store.root.rglob("*") if not one.is_dir()] == []


def test_what_is_too_large_for_a_picture_is_kept_all_the_same(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    """One pixel more than can be read again is a table, and comes back bit for bit."""
    monkeypatch.setattr(pictures, "MAX_PIXELS", PICTURE.shape[0] * PICTURE.shape[1])
    larger = np.concatenate([PICTURE, PICTURE[:1]])
    for picture, suffix in ((PICTURE, ".png"), (larger, ".parquet")):
        ref = store.save(Overview(picture, None))
        assert {path.suffix for path in store.folder(ref).iterdir()} == {".json", suffix}
        loaded = store.load(ref)
        assert isinstance(loaded, Overview)
        np.testing.assert_array_equal(loaded.clean, picture)
