"""An artifact is there whole or not at all, and damage is noticed."""

import threading
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from dcap.scene.errors import MissingArtifactError
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.sample import SourceOptions
from tasks.artifact import Ref, Store

VALUE = SourceOptions("y")
MESH = Mesh.of(np.random.default_rng(0).random((50, 3)), [[0, 1, 2]])


DAMAGES: dict[str, Callable[[Path], object]] = {
    "flip": lambda file: file.write_bytes(bytes([file.read_bytes()[0] ^ 1]) + file.read_bytes()[1:]),
    "truncate": lambda file: file.write_bytes(file.read_bytes()[:-1]),
    "delete": Path.unlink,
}


def test_damage_is_noticed_and_mended(store: Store) -> None:
    """What is damaged is not there, cannot be loaded, and is written anew by whoever saves the value again."""
    for name, damage in DAMAGES.items():
        ref = store.save(VALUE)
        assert store.has(ref)
        damage(store.folder(ref) / "value.json")
        assert not store.has(ref), name
        assert not Store(store.root).has(ref), name
        with pytest.raises(MissingArtifactError):
            store.load(ref)
        assert store.save(VALUE) == ref
        assert Store(store.root).load(ref) == VALUE, name


def test_a_failed_write_leaves_nothing(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    """A write that dies half-way leaves no artifact and no draft."""
    write = Path.write_bytes

    def full(path: Path, data: bytes) -> int:
        if path.suffix == ".ply":
            raise OSError("no space left on device")
        return write(path, data)

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(OSError, match="no space"):
        store.save(MESH)
    assert not list(store.refs())
    assert not list((store.root / "building").iterdir())


def test_many_writers_of_one_value(store: Store) -> None:
    """Threads that save the same value at once all succeed and leave one sound artifact."""
    value, refs = MESH, list[Ref[Mesh]]()
    threads = [threading.Thread(target=lambda: refs.append(store.save(value))) for _ in range(8)]
    for one in threads:
        one.start()
    for one in threads:
        one.join()
    assert len(refs) == 8
    assert len(set(refs)) == 1
    assert list(store.refs()) == [refs[0]]
    assert Store(store.root).has(refs[0])
