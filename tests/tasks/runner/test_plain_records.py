"""A record that Prefect would read through a pickle, a function or a class of the file's choice does not count."""

import base64
import json
import os
import pickle
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from dcap.scene.store.ref import Ref
from tasks.runner.records import Record, read_record


class TouchWhenRead:
    """What a pickle of it does when it is read."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[Callable[[str], int], tuple[str]]:
        return os.system, (f"touch {self.path}",)


def prefects(folder: Path) -> tuple[Path, dict[str, Any]]:
    """A record's file and its tree, as Prefect writes it."""
    from prefect._internal.result_records import ResultRecord, ResultRecordMetadata
    from prefect.serializers import JSONSerializer

    ref: Ref[object] = Ref("Mesh", "0" * 64)
    record = Record("make-1", ref, 1.0, 2, {"stage": "make"}).to_json()
    whole: Any = ResultRecord(metadata=ResultRecordMetadata(serializer=JSONSerializer()), result=record)
    (folder / "make-1").write_bytes(whole.serialize())
    return folder / "make-1", json.loads((folder / "make-1").read_bytes())


def read_by_prefect(path: Path) -> None:
    """As a stage's task does when the record is taken for a hit."""
    from prefect._internal.result_records import ResultRecord

    ResultRecord.deserialize(path.read_bytes())


@pytest.mark.slow
def test_a_record_that_is_a_pickle_too_does_not_count(tmp_path: Path) -> None:
    """Base 64 skips the signs of JSON: one text is our record and their pickle, which Prefect runs."""
    path, tree = prefects(tmp_path)
    assert read_record(path) is not None
    data = pickle.dumps(TouchWhenRead(tmp_path / "touched"), protocol=0)
    code = base64.encodebytes(data + b" " * (-len(data) % 3)).decode().replace("\n", "")
    both = json.dumps({code: 0} | json.loads(tree["result"]) | {"x": ""})
    missing = -len(re.sub("[^A-Za-z0-9+/]", "", both)) % 4
    tree["result"] = both.replace('"x": ""', f'"x": "{"A" * missing}"')
    tree["metadata"]["serializer"] = {"type": "pickle", "picklelib": "pickle"}
    path.write_text(json.dumps(tree))
    read_by_prefect(path)
    assert (tmp_path / "touched").exists()  # the danger is real: without the check it is no test
    assert read_record(path) is None


@pytest.mark.slow
@pytest.mark.parametrize(
    "serializer",
    [
        {"object_decoder": "builtins.print"}, {"jsonlib": "marshal"}, {"loads_kwargs": {"cls": "x"}},
        {"type": "compressed/pickle"}, {"type": "pickle", "picklelib": "pickle"},
    ],
)  # fmt: skip
def test_a_record_says_nothing_about_how_it_is_read(tmp_path: Path, serializer: dict[str, object]) -> None:
    """Any other serializer than the plain one is none of ours."""
    path, tree = prefects(tmp_path)
    tree["metadata"]["serializer"] |= serializer
    path.write_text(json.dumps(tree))
    assert read_record(path) is None


@pytest.mark.slow
def test_no_part_of_a_record_is_an_object(tmp_path: Path) -> None:
    """Prefect's decoder would make one of any class; keys of older formats name serializers of their own."""
    path, tree = prefects(tmp_path)
    for more in ({"__class__": "pathlib.Path", "data": "/"}, {"__exc_type__": "SystemExit", "message": ""}):
        result = json.loads(tree["result"]) | {"more": [more]}
        path.write_text(json.dumps(tree | {"result": json.dumps(result)}))
        assert read_record(path) is None
    path.write_text(json.dumps(tree | {"serializer": {"type": "pickle"}}))
    assert read_record(path) is None
