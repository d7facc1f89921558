"""A shared store gives every machine what another has computed, and nothing but that."""

import socket
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from s3_server import S3, s3_server
from small_stages import CHAIN, chain, computed, ends_of

from dcap.scene.errors import MissingArtifactError, StoreError
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.sample import SourceOptions
from tasks.artifact import Ref, Store
from tasks.run_context import Event, Mode
from tasks.shared_store import SharedStore

VALUE = Mesh.of(np.random.default_rng(0).random((50, 3)), [[0, 1, 2]])
OTHER = SourceOptions("y")


@pytest.fixture(scope="module")
def s3() -> Iterator[S3]:
    """A server of the S3 protocol."""
    with s3_server() as server:
        yield server


@pytest.fixture(params=["folder", "memory", "s3"])
def url(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """An empty shared store of each kind."""
    if request.param == "s3":
        return str(request.getfixturevalue("s3").bucket())
    return {"folder": str(tmp_path / "shared"), "memory": f"memory://{tmp_path.name}"}[request.param]


def machine(folder: Path, url: str) -> Store:
    """The store of one machine."""
    return Store(folder / "store", SharedStore(url))


def test_what_one_saves_another_loads(url: str, tmp_path: Path) -> None:
    """The second machine gets the same bytes, keeps them, and mends what is damaged there; what nobody has is missing,
    and leaves nothing behind."""
    first, second = machine(tmp_path / "one", url), machine(tmp_path / "two", url)
    ref = first.save(VALUE)
    assert not second.is_here(ref)
    assert second.has(ref)
    loaded = Store(second.root).load(ref)
    assert isinstance(loaded, Mesh)
    assert loaded.vertices.tobytes() == VALUE.vertices.tobytes()
    other = first.save(OTHER)
    assert second.load(other) == OTHER
    (second.folder(other) / "value.json").write_text("{}")
    assert second.load(other) == OTHER
    with pytest.raises(MissingArtifactError):
        second.load(Ref("Mesh", "ab" * 32))
    assert set(second.refs()) == {ref, other}
    assert list((second.root / "building").iterdir()) == []


def test_a_stage_runs_once_for_all_machines(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Computed by the first, cached for the second in a plan and for the third in a run; after the shared store was
    damaged computed once more, with the same result for everybody."""
    shared = tmp_path / "shared"
    monkeypatch.setenv("DCAP_STORE", str(shared))
    monkeypatch.setenv("DCAP_DATA", str(tmp_path / "one"))
    first = chain()
    assert computed() == CHAIN
    for name, mode in (("two", Mode.LOOKUP), ("three", Mode.DIRECT)):
        monkeypatch.setenv("DCAP_DATA", str(tmp_path / name))
        assert ends_of(chain, mode=mode) == (first, dict.fromkeys(CHAIN, Event.CACHED))
    monkeypatch.delenv("DCAP_STORE")
    assert ends_of(chain) == (first, dict.fromkeys(CHAIN, Event.CACHED))  # everything is here
    monkeypatch.setenv("DCAP_STORE", str(shared))
    damages: tuple[Callable[[Path], object], ...] = (
        Path.unlink, lambda path: path.write_bytes(path.read_bytes()[:-9]), lambda path: path.write_bytes(b"x" * 700),
    )  # fmt: skip
    for number, damage in enumerate(damages):
        for path in (path for path in shared.rglob("*") if path.is_file()):
            damage(path)
        monkeypatch.setenv("DCAP_DATA", str(tmp_path / f"damaged {number}"))
        assert chain() == first
        assert computed() == CHAIN, number
        monkeypatch.setenv("DCAP_DATA", str(tmp_path / f"mended {number}"))
        assert ends_of(chain) == (first, dict.fromkeys(CHAIN, Event.CACHED)), number


def test_a_look_may_bring_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A plan of many samples says what is cached without copying it."""
    monkeypatch.setenv("DCAP_STORE", str(tmp_path / "shared"))
    monkeypatch.setenv("DCAP_DATA", str(tmp_path / "one"))
    first = chain()
    monkeypatch.setenv("DCAP_DATA", str(tmp_path / "two"))
    assert ends_of(chain, mode=Mode.LOOKUP, bring=False) == (first, dict.fromkeys(CHAIN, Event.CACHED))
    assert list(Store.default().refs()) == []


def test_what_is_no_store(s3: S3, tmp_path: Path) -> None:
    """An unknown protocol, no folder at all, one that cannot be written, no bucket: a line that names the variable."""
    for url, words in (
        ("nonsense://x/y", "cannot be opened"),
        ("memory://", "names no bucket or folder"),
        ("/proc/nothing/here", "cannot be written"),
        ("s3://no-such-bucket/x", "there is no bucket no-such-bucket"),
    ):
        with pytest.raises(StoreError, match=words) as caught:
            machine(tmp_path, url).save(OTHER)
        assert f"DCAP_STORE={url}" in str(caught.value)
        assert "\n" not in str(caught.value)


def test_no_server(s3: S3, monkeypatch: pytest.MonkeyPatch) -> None:
    """An endpoint that nobody answers at is one line."""
    import s3fs

    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    monkeypatch.setenv("AWS_ENDPOINT_URL", f"http://127.0.0.1:{port}")
    monkeypatch.setattr(s3fs.S3FileSystem, "retries", 1)
    monkeypatch.setenv("AWS_MAX_ATTEMPTS", "1")
    s3fs.S3FileSystem.clear_instance_cache()
    with pytest.raises(StoreError, match=r"^DCAP_STORE=s3://b/x: cannot be opened: .*127\.0\.0\.1") as caught:
        SharedStore("s3://b/x")
    assert "\n" not in str(caught.value)
    s3fs.S3FileSystem.clear_instance_cache()
