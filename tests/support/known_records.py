"""Records of stages that nobody has run, as a run would leave them."""

import hashlib
from collections.abc import Mapping
from typing import Any

from dcap.scene.settings import cache_root
from dcap.scene.types.scan import FileScale
from dcap.scene.written_files import canonical_json
from tasks import code
from tasks.artifact import Record, Ref, Store
from tasks.cache import plain_input
from tasks.records import key_of, write_record


def known_code(files: Mapping[str, str]) -> str:
    """The digest of a list of files with their digests, which the cache knows."""
    data = canonical_json(dict(files))
    digest = hashlib.sha256(data).hexdigest()
    path = cache_root() / code.LISTS / f"{digest}.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)
    return digest


def recipe(stage: str, inputs: Mapping[str, Any], **other: Any) -> dict[str, Any]:
    """What a result of a stage is made of; references are inputs, and so are plain values."""
    given = {name: plain_input(name, value) for name, value in inputs.items()}
    plain = {"stage": stage, "function": stage, "code": "0" * 64, "libraries": {"numpy": "2.3.0"}, "config": None}
    return {**plain, "inputs": given, **other}


def known_result(stage: str, number: float, inputs: Mapping[str, Any] = {}, **other: Any) -> Ref[Any]:
    """What a stage has returned: a scale of its own for each number; its record says 2 s."""
    tree, store = recipe(stage, inputs, **other), Store.default()
    ref = store.save(FileScale(number, "a test"))
    found: Ref[Any] = Ref(ref.kind, ref.sha256, Record(key_of(tree), 2.0, store.size(ref), tree))
    write_record(key_of(tree), found)
    return found
