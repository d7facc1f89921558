"""A record counts only in just the form that we write, and is handed on between machines in it."""

import base64
import json
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from forged_pictures import FORGED, forged

from dcap.scene.errors import StoreError
from dcap.scene.store.artifacts import Store
from dcap.scene.store.ref import Ref
from dcap.scene.store.remote import RemoteStore
from dcap.scene.types.sample import SourceOptions
from tasks.runner.damage import DamagedThing, damages
from tasks.runner.records import (
    Deciders,
    Record,
    key_in,
    read_record,
    records_root,
    usable_key,
    write_record,
)

DECIDERS = Deciders("mesh", {"a.py": "1"}, {"size": 1}, {"seed": {"value": 3}}, {"numpy": "2"})


@pytest.fixture
def store(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Store:
    """A store, and records beside it."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path / "data"))
    return Store(tmp_path / "data" / "cache" / "store")


def recorded(store: Store, deciders: Deciders = DECIDERS) -> tuple[Path, Record]:
    """A record of a small artifact, written."""
    ref = store.save(SourceOptions())
    record = Record(deciders.key, ref, 0.5, store.size(ref), deciders.to_json())
    records_root().mkdir(parents=True, exist_ok=True)
    write_record(records_root() / record.key, record, store)
    return records_root() / record.key, record


def test_a_record_is_read_as_it_was_written(store: Store) -> None:
    """What was written counts under its own name and those that follow it."""
    path, record = recorded(store)
    assert read_record(path) == record
    assert usable_key(record.key, store) == (path.name, record)
    assert key_in(f"{record.key}-r12") == record.key == key_in(record.key)
    assert list((store.root / "building").iterdir()) == []


def test_prefect_reads_it_as_its_own(store: Store) -> None:
    """Prefect makes the same of the file that is written here as of one of its own."""
    from prefect._internal.result_records import ResultRecord, ResultRecordMetadata
    from prefect.serializers import JSONSerializer

    path, record = recorded(store)
    read: ResultRecord[Any] = ResultRecord.deserialize(path.read_bytes())
    assert read.result == record.to_json()
    own: ResultRecord[Any] = ResultRecord(
        metadata=ResultRecordMetadata(serializer=JSONSerializer(), storage_key=str(path)), result=record.to_json()
    )
    assert json.loads(own.serialize()) == json.loads(path.read_bytes())


def changed(path: Path, **values: object) -> None:
    """Change values of the inner record."""
    tree = json.loads(path.read_text())
    tree["result"] = json.dumps(json.loads(tree["result"]) | values)
    path.write_text(json.dumps(tree))


def metadata(path: Path, **values: object) -> None:
    """Change values of Prefect's part."""
    tree = json.loads(path.read_text())
    tree["metadata"] |= values
    path.write_text(json.dumps(tree))


OTHER_REF = {"kind": "Mesh", "sha256": "ab" * 32}
DAMAGES: dict[str, Callable[[Path], object]] = {
    "another's reference": lambda path: changed(path, ref=OTHER_REF),
    "other seconds": lambda path: changed(path, seconds=9.5),
    "a key more": lambda path: changed(path, x={"__class__": "os.path", "data": 1}),
    "a reference with more": lambda path: changed(path, ref={**OTHER_REF, "__class__": "x"}, check=None),
    "huge size": lambda path: changed(path, size=10**300),
    "infinite seconds": lambda path: path.write_text(path.read_text().replace("0.5", "1e999")),
    "not a number": lambda path: changed(path, deciders=DECIDERS.to_json() | {"config": float("nan")}),
    "half a character": lambda path: path.write_text(path.read_text().replace("a.py", "\\\\ud800")),
    "deep": lambda path: changed(path, deciders=json.loads('{"a":' * 300 + "1" + "}" * 300)),
    "deeper than a parser goes": lambda path: path.write_text('{"metadata": ' + "[" * 100_000),
    "a list": lambda path: path.write_text("[]"),
    "nothing": lambda path: path.write_bytes(b""),
    "no text": lambda path: path.write_bytes(b"\xff\xfe\x00"),
    "number of 5000 digits": lambda path: path.write_text('{"metadata": {}, "result": ' + "9" * 5000 + "}"),
    "no metadata": lambda path: path.write_text(json.dumps({"result": json.loads(path.read_text())["result"]})),
    "old form": lambda path: path.write_text(json.dumps({"data": "gASV", "serializer": {"type": "pickle"}})),
    "pickle": lambda path: metadata(path, serializer={"type": "pickle"}),
    "a decoder of another's": lambda path: metadata(path, serializer={"type": "json", "object_decoder": "os.system"}),
    "expired": lambda path: metadata(path, expiration="2020-01-01T00:00:00Z"),
}


@pytest.mark.parametrize("damage", DAMAGES.values(), ids=DAMAGES.keys())
def test_anything_else_is_passed_over(store: Store, damage: Callable[[Path], object]) -> None:
    """It is no record, the next name is free, and nobody trips over it."""
    path, record = recorded(store)
    damage(path)
    assert usable_key(record.key, store) == (f"{record.key}-r1", None)


@pytest.mark.parametrize("what", FORGED)
def test_a_record_of_a_picture_that_the_store_would_not_write_is_passed_over(store: Store, what: str) -> None:
    """Its artifact counts as damaged, so that it is computed again; `dcap cache verify` says which picture it is."""
    ref, files = forged(FORGED[what]())
    store.folder(ref).mkdir(parents=True)
    for name, data in files.items():
        (store.folder(ref) / name).write_bytes(data)
    record = Record(DECIDERS.key, ref, 0.5, store.size(ref), DECIDERS.to_json())
    write_record(records_root() / record.key, record, store)
    assert usable_key(record.key, store) == (f"{record.key}-r1", None)
    [told] = [one.why for one in damages(store) if one.what is DamagedThing.ARTIFACT]
    assert told.startswith("clean.png: ")
    assert "\n" not in told


class Payload:
    """Runs when it is unpickled."""

    def __init__(self, mark: Path) -> None:
        self.mark = mark

    def __reduce__(self) -> tuple[object, tuple[Path, str]]:
        """Write a file."""
        return Path.write_text, (self.mark, "executed")


def test_a_record_that_is_also_a_pickle_is_not_executed(store: Store, tmp_path: Path) -> None:
    """Prefect unpickles a result whose file says so; a text that is both a record and a pickle is passed over."""
    from prefect._internal.result_records import ResultRecord

    path, record = recorded(store)
    mark = tmp_path / "mark"
    code = base64.b64encode(pickle.dumps(Payload(mark))).decode().rstrip("=")
    both = json.dumps({code + "A" * (-len(code) % 4): 0} | record.to_json())
    data = {"metadata": {"serializer": {"type": "pickle"}}, "result": both}
    path.write_text(json.dumps(data))
    assert usable_key(record.key, store) == (f"{record.key}-r1", None)
    assert not mark.exists()
    for padding in range(4):  # the danger is real: what Prefect does with such a file
        path.write_text(json.dumps(data | {"result": both[:-1] + "/" * padding}))
        try:
            ResultRecord.deserialize(path.read_bytes())
        except Exception:
            continue
    assert mark.exists()


def test_records_of_earlier_versions_count(store: Store) -> None:
    """A record without a digest of its own is still one."""
    path, record = recorded(store)
    tree = json.loads(path.read_text())
    result = json.loads(tree["result"])
    del result["check"]
    path.write_text(json.dumps(tree | {"result": json.dumps(result)}))
    assert usable_key(record.key, store) == (path.name, record)


def test_too_many_damaged_records_are_one_line(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    """The line says how to get rid of them."""
    monkeypatch.setattr("tasks.runner.records.MOST_REPEATS", 3)
    path, record = recorded(store)
    for name in (path.name, f"{path.name}-r1", f"{path.name}-r2"):
        (records_root() / name).write_text("x")
    with pytest.raises(StoreError, match=r"3 records are damaged; `dcap cache verify --repair`"):
        usable_key(record.key, store)


@pytest.fixture
def shared(tmp_path: Path) -> RemoteStore:
    """A store that machines share."""
    return RemoteStore(str(tmp_path / "shared"))


def on_machine(name: str, tmp_path: Path, shared: RemoteStore, monkeypatch: pytest.MonkeyPatch) -> Store:
    """The store of one of several machines, whose records are looked up from now on."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path / name))
    return Store(tmp_path / name / "cache" / "store", shared)


def test_a_record_of_another_machine_counts(
    tmp_path: Path, shared: RemoteStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It comes with its artifact, lies here then, and needs the shared store no more."""
    from tasks.runner.records import share_record

    first = on_machine("one", tmp_path, shared, monkeypatch)
    _, record = recorded(first)
    share_record(record, first)
    second = on_machine("two", tmp_path, shared, monkeypatch)
    assert usable_key(record.key, second) == (record.key, record)
    assert usable_key(record.key, Store(second.root)) == (record.key, record)


@pytest.mark.parametrize("damage", ["another's", "no text", "unsound artifact", "no artifact", "huge"])
def test_a_shared_record_is_checked_like_our_own(
    tmp_path: Path, shared: RemoteStore, monkeypatch: pytest.MonkeyPatch, damage: str
) -> None:
    """One that is not this key's, no record, or without a sound artifact is as good as none, and is written over."""
    from tasks.runner.records import share_record

    first = on_machine("one", tmp_path, shared, monkeypatch)
    _, record = recorded(first)
    _, other = recorded(first, Deciders("mesh", {}, None, {}, {}))
    share_record(record, first)
    place, object_place = shared._record(record.key), Path(shared._object(record.ref))
    if damage == "another's":
        share_record(other, first)
        Path(place).write_bytes(Path(shared._record(other.key)).read_bytes())
    elif damage == "no text":
        Path(place).write_bytes(b"\xff")
    elif damage == "unsound artifact":
        object_place.write_bytes(object_place.read_bytes()[:600])
    elif damage == "huge":
        with Path(place).open("r+b") as file:
            file.truncate(1 << 40)
    else:
        object_place.unlink()
    second = on_machine("two", tmp_path, shared, monkeypatch)
    assert usable_key(record.key, second) == (record.key, None)
    again = second.save(SourceOptions())
    share_record(Record(record.key, again, 0.5, 10, record.deciders), second)
    third = on_machine("three", tmp_path, shared, monkeypatch)
    assert usable_key(record.key, third)[1] is not None


def test_references_of_inputs_are_found() -> None:
    """What a stage was made from is read from its record, whatever else its inputs are."""
    from tasks.runner.collection import inputs_of

    ref: Ref[object] = Ref("Mesh", "ab" * 32)
    inputs: dict[str, object] = {"mesh": {"ref": ref.to_json()}, "seed": {"value": 3}, "odd": "text"}
    assert inputs_of(Record("key", ref, 0.0, 1, {"inputs": inputs})) == {ref}
    assert inputs_of(Record("key", ref, 0.0, 1, {})) == set()
