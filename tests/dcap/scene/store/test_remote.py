"""A shared store gives every machine what another has computed, and nothing but that."""

import io
import os
import socket
import tarfile
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from s3_server import S3, s3_server

from dcap.scene.errors import MissingArtifactError, StoreError
from dcap.scene.redaction import redacted_url, without_secrets
from dcap.scene.store import remote
from dcap.scene.store.artifacts import Store
from dcap.scene.store.ref import Ref
from dcap.scene.store.remote import RemoteStore, pack, unpack
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.sample import SourceOptions

VALUE = Mesh.of(np.random.default_rng(0).random((50, 3)), [[0, 1, 2]])
OTHER = SourceOptions("y")


@pytest.fixture(params=["folder", "file", "memory", "s3"])
def url(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """An empty shared store of each kind."""
    if request.param == "s3":
        return str(request.getfixturevalue("bucket"))
    shared = tmp_path / "shared"
    return {"folder": str(shared), "file": shared.as_uri(), "memory": f"memory://{tmp_path.name}"}[request.param]


@pytest.fixture(scope="module")
def s3() -> Iterator[S3]:
    """A server of the S3 protocol."""
    with s3_server() as server:
        yield server


@pytest.fixture
def bucket(s3: S3) -> str:
    """URL of an empty bucket with a prefix."""
    return s3.bucket()


def machine(folder: Path, url: str) -> Store:
    """The store of one machine."""
    return Store(folder / "store", RemoteStore(url))


def objects(url: str) -> dict[str, bytes]:
    """Everything in a shared store."""
    shared = RemoteStore(url)
    found: list[str] = shared._filesystem.find(shared._root)
    return {one: bytes(shared._filesystem.cat_file(one)) for one in found}


def put(url: str, name: str, data: bytes) -> None:
    """Write over one object of a shared store."""
    RemoteStore(url)._filesystem.pipe_file(name, data)


def test_what_one_saves_another_loads(url: str, tmp_path: Path) -> None:
    """The second machine gets the same bytes, keeps them, and needs the shared store no more."""
    first, second = machine(tmp_path / "one", url), machine(tmp_path / "two", url)
    ref = first.save(VALUE)
    assert not second.is_here(ref)
    assert second.has(ref)
    loaded = Store(second.root).load(ref)
    assert isinstance(loaded, Mesh)
    assert loaded.vertices.tobytes() == VALUE.vertices.tobytes()
    assert list((second.root / "building").iterdir()) == []


def test_loading_brings_what_is_not_here(url: str, tmp_path: Path) -> None:
    """`load` alone is enough, also where what is here is damaged."""
    ref = machine(tmp_path / "one", url).save(OTHER)
    second = machine(tmp_path / "two", url)
    assert second.load(ref) == OTHER
    (second.folder(ref) / "value.json").write_text("{}")
    assert second.load(ref) == OTHER


def test_what_nobody_has_is_missing(url: str, tmp_path: Path) -> None:
    """An artifact that is nowhere is an error of the store, and leaves nothing behind."""
    store = machine(tmp_path, url)
    with pytest.raises(MissingArtifactError):
        store.load(Ref("Mesh", "ab" * 32))
    assert not list(store.refs())
    assert list((store.root / "building").iterdir()) == []


@pytest.mark.parametrize("damage", ["cut", "flip", "empty", "another's", "no archive"])
def test_a_damaged_object_is_never_taken_and_is_written_over(url: str, tmp_path: Path, damage: str) -> None:
    """Whatever stands under an artifact's name is refused unless it is that artifact, and goes when it is saved."""
    first = machine(tmp_path / "one", url)
    ref, other = first.save(VALUE), first.save(OTHER)
    held = objects(url)
    name, data = next((name, data) for name, data in held.items() if ref.sha256 in name)
    others = next(data for name, data in held.items() if other.sha256 in name)
    flipped = bytes([*data[:700], data[700] ^ 1, *data[701:]])
    wrong = {"cut": data[:800], "flip": flipped, "empty": b"", "another's": others, "no archive": b"x" * 99}
    put(url, name, wrong[damage])
    second = machine(tmp_path / "two", url)
    assert not second.has(ref)
    assert second.save(VALUE) == ref
    assert machine(tmp_path / "three", url).has(ref)
    assert objects(url) == held


def test_many_machines_save_the_same(url: str, tmp_path: Path) -> None:
    """Workers that compute the same artifact at once leave one sound object, and nobody reads half of it."""
    stores = [machine(tmp_path / str(number), url) for number in range(6)]
    refs: list[Ref[Any]] = []
    threads = [threading.Thread(target=lambda one=one: refs.append(one.save(VALUE))) for one in stores]
    for one in threads:
        one.start()
    for one in threads:
        one.join()
    assert len(refs) == 6
    assert len(objects(url)) == 1
    assert machine(tmp_path / "reader", url).has(refs[0])


def archive(name: str, *, kind: bytes = tarfile.REGTYPE, link: str = "") -> bytes:
    """A tar with one member."""
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w:") as tar:
        about = tarfile.TarInfo(name)
        about.type, about.linkname, about.size = kind, link, 1 if kind == tarfile.REGTYPE else 0
        tar.addfile(about, io.BytesIO(b"x"))
    return buffer.getvalue()


@pytest.mark.parametrize(
    "data",
    [
        archive("../../escaped"), archive("/tmp/escaped-dcap"), archive("a/b"), archive(".."), archive("nul\0name"),
        archive("link", kind=tarfile.SYMTYPE, link="/etc/passwd"), archive("pipe", kind=tarfile.FIFOTYPE),
        archive("hard", kind=tarfile.LNKTYPE, link="/etc/passwd"), archive("device", kind=tarfile.CHRTYPE),
    ],
    ids=["up", "absolute", "folder", "dots", "nul", "link", "pipe", "hard link", "device"],
)  # fmt: skip
def test_no_archive_writes_outside(tmp_path: Path, data: bytes) -> None:
    """Of a foreign archive nothing but plain files with plain names is unpacked, and nothing of it stays."""
    url = str(tmp_path / "shared")
    ref: Ref[object] = Ref("Mesh", "ab" * 32)
    put(url, f"{url}/objects/Mesh/ab/{ref.sha256}.tar", data)
    store = machine(tmp_path / "one", url)
    assert not store.has(ref)
    left = [path for path in (tmp_path / "one").rglob("*") if not path.is_dir()]
    assert left == []
    assert not os.path.lexists("/tmp/escaped-dcap")
    assert not os.path.lexists(tmp_path / "escaped")


def entries(*members: tarfile.TarInfo, form: int = tarfile.PAX_FORMAT, about: dict[str, str] | None = None) -> bytes:
    """A tar of empty files, with entries for all of it."""
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w:", format=form, pax_headers=about) as tar:
        for one in members:
            tar.addfile(one)
    return buffer.getvalue()


def member(name: str, **about: str) -> tarfile.TarInfo:
    """An empty file with entries of its own."""
    found = tarfile.TarInfo(name)
    found.pax_headers = about
    return found


@pytest.mark.parametrize(
    "data",
    [
        entries(member("a", comment="x" * 2**20)),
        entries(member("a"), about={"comment": "x"}),
        entries(member("a" * 200), form=tarfile.GNU_FORMAT),
        entries(member("a", **{"GNU.sparse.major": "1", "GNU.sparse.minor": "0"})),
        entries(member("a", size="99")),
        entries(member("a" * 256)),
    ],
    ids=["large entry", "entry for all", "GNU's long name", "hole", "another size", "name of 256 bytes"],
)
def test_an_archive_of_another_form_is_not_unpacked(tmp_path: Path, data: bytes) -> None:
    """Headers that ours do not have are not read: Python's reader holds in memory what they promise."""
    (tmp_path / "archive").write_bytes(data)
    (tmp_path / "folder").mkdir()
    assert not unpack(tmp_path / "archive", tmp_path / "folder")


@pytest.mark.parametrize("name", ["a", "a" * 100, "a" * 101, "a" * 255, "Tür.ply", "ü" * 127])
def test_any_name_of_a_file_survives_the_archive(tmp_path: Path, name: str) -> None:
    """Names of up to 255 bytes come back, and Python's own reader knows them."""
    one, two = tmp_path / "one", tmp_path / "two"
    for folder in (one, two):
        folder.mkdir()
    for place, size in ((name, 513), ("b", 0), ("c", 512)):
        (one / place).write_bytes(os.urandom(size))
    pack(one, tmp_path / "archive")
    with tarfile.open(tmp_path / "archive") as tar:
        assert sorted(tar.getnames()) == sorted([name, "b", "c"])
    assert unpack(tmp_path / "archive", two)
    assert {path.name: path.read_bytes() for path in two.iterdir()} == {
        path.name: path.read_bytes() for path in one.iterdir()
    }


def test_what_is_larger_than_ours_is_not_fetched(url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An artifact counts as missing by its size alone, before anything of it is here, and none such is written."""
    first = machine(tmp_path / "one", url)
    points = Mesh.of(np.random.default_rng(0).random((1000, 3)), [[0, 1, 2]])
    ref, larger = first.save(OTHER), first.save(points)
    size = max(len(data) for name, data in objects(url).items() if ref.sha256 in name)
    assert any(len(data) > size for data in objects(url).values())
    monkeypatch.setattr(remote, "MOST_ARCHIVE_BYTES", size)
    second = machine(tmp_path / "two", url)
    assert second.has(ref)
    assert second.remote is not None
    monkeypatch.setattr(second.remote._filesystem, "get_file", lambda *_, **__: pytest.fail("it was fetched"))
    assert not second.has(larger)
    held = objects(url)
    with pytest.raises(StoreError, match=rf"Mesh {larger.sha256[:12]} takes .* GiB > .*DCAP_STORE") as caught:
        second.save(points)
    assert "\n" not in str(caught.value)
    assert objects(url) == held
    assert list((second.root / "building").iterdir()) == []


def test_a_pipe_in_a_shared_folder_is_no_object(tmp_path: Path) -> None:
    """It would be read for ever: neither a record nor an artifact is there."""
    shared = tmp_path / "shared"
    ref: Ref[object] = Ref("Mesh", "ab" * 32)
    for path in (shared / "records" / "key.json", shared / "objects" / "Mesh" / "ab" / f"{ref.sha256}.tar"):
        path.parent.mkdir(parents=True)
        os.mkfifo(path)
    assert RemoteStore(str(shared)).record("key") is None
    assert not machine(tmp_path / "one", str(shared)).has(ref)


def test_sources_stay_on_their_machine(url: str, tmp_path: Path) -> None:
    """A foreign file is not handed on: it may be large, and not ours to give."""
    (tmp_path / "mug.obj").write_text("v 0 0 0\n")
    store = machine(tmp_path / "one", url)
    ref = store.add_source(tmp_path / "mug.obj")
    assert objects(url) == {}
    assert not machine(tmp_path / "two", url).has(ref)


def test_a_bucket_that_is_not_there(bucket: str) -> None:
    """One line names the variable and the bucket."""
    with pytest.raises(StoreError, match=r"^DCAP_STORE=s3://no-such-bucket/x: there is no bucket no-such-bucket"):
        RemoteStore("s3://no-such-bucket/x")


def test_no_server(bucket: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """An endpoint that nobody answers at is one line."""
    import s3fs

    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    monkeypatch.setenv("AWS_ENDPOINT_URL", f"http://127.0.0.1:{port}")
    monkeypatch.setattr(s3fs.S3FileSystem, "retries", 1)
    s3fs.S3FileSystem.clear_instance_cache()
    with pytest.raises(StoreError, match=r"^DCAP_STORE=s3://b/x: cannot be opened: .*127\.0\.0\.1") as caught:
        RemoteStore("s3://b/x")
    assert "\n" not in str(caught.value)
    s3fs.S3FileSystem.clear_instance_cache()


@pytest.mark.parametrize(
    ("url", "words"),
    [
        ("nonsense://x/y", r"DCAP_STORE=nonsense://x/y: cannot be opened: .*nonsense"),
        ("memory://", "names no bucket or folder"),
        ("/proc/nothing/here", r"DCAP_STORE=/proc/nothing/here: .* cannot be written: "),
    ],
)
def test_what_is_no_store(url: str, words: str, tmp_path: Path) -> None:
    """An unknown protocol, no folder at all and one that cannot be written are one line."""
    with pytest.raises(StoreError, match=words) as caught:
        machine(tmp_path, url).save(OTHER)
    assert "\n" not in str(caught.value)


def test_secrets_are_not_shown() -> None:
    """Neither a URL nor a library's message about it tells a password, a token or a query."""
    url = "s3://user:p%40ssword@host.example/bucket?token=abcdef"
    assert redacted_url(url) == "s3://***@host.example/bucket?***"
    assert redacted_url("s3://bucket/prefix") == "s3://bucket/prefix"
    told = without_secrets(f"cannot open {url}: p@ssword is wrong for host.example", url)
    assert told == "cannot open s3://***@host.example/bucket?***: *** is wrong for host.example"
