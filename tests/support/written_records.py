"""Records as a finished stage leaves them, written by hand: what was computed from what, without computing."""

import json
from collections.abc import Mapping
from typing import Any

from dcap.scene.store.ref import Ref
from tasks.runner.records import Deciders, Record, records_root

SERIALIZER = {
    "type": "json", "jsonlib": "json", "object_encoder": "prefect.serializers.prefect_json_object_encoder",
    "object_decoder": "prefect.serializers.prefect_json_object_decoder", "dumps_kwargs": {}, "loads_kwargs": {},
}  # fmt: skip
"""How Prefect says of a file that it holds JSON."""
CODE = {"tasks/one.py": "a" * 64, "function": "one"}


def deciders(
    stage: str,
    inputs: Mapping[str, object],
    config: object = None,
    code: Mapping[str, str] | None = None,
    libraries: Mapping[str, str] | None = None,
) -> Deciders:
    """What decides a stage's result; references among the inputs as a record has them."""
    told = {name: {"ref": one.to_json()} if isinstance(one, Ref) else {"value": one} for name, one in inputs.items()}
    return Deciders(stage, dict(code or CODE), config, dict(told), dict(libraries or {"numpy": "2.3.0"}))


def write_record(made_from: Deciders, ref: Ref[Any], seconds: float = 1.5) -> Record:
    """Leave a record in the cache."""
    record = Record(made_from.key, ref, seconds, 100, made_from.to_json())
    records_root().mkdir(parents=True, exist_ok=True)
    file = {"metadata": {"serializer": SERIALIZER, "expiration": None}, "result": json.dumps(record.to_json())}
    (records_root() / made_from.key).write_text(json.dumps(file))
    return record


def ref_of(kind: str, letter: str) -> Ref[Any]:
    """A reference whose digest is one letter, 64 times."""
    return Ref(kind, letter * 64)
