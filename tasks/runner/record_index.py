"""All records of this machine, read once per process: of a stage, and those that made an artifact.

A record tells some hundred files by their digests; whatever is equal in many is held once. The folder is looked at
again when a record has come or gone.
"""

import json
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from dcap.scene.store.ref import Ref
from tasks.runner.records import Record, read_record, records_root

SHARED = ("code", "config", "libraries")
"""What many records of a stage have in common."""


class RecordIndex:
    """The readable records of one folder, newest first."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self._seen_ns = -1
        self._read: dict[str, Record | None] = {}
        self._pool: dict[str, Any] = {}
        self._stages: dict[str, list[Record]] = {}
        self._alike: dict[str, dict[str, list[Record]]] = {}
        self._makers: dict[Ref[Any], list[Record]] | None = None
        self._names: tuple[str, ...] = ()

    def of_stage(self, stage: str) -> list[Record]:
        """Records of a stage."""
        self._look_again()
        if stage not in self._stages:
            mine = self._records(name for name in self._names if name.startswith(f"{stage}-"))
            self._stages[stage] = [one for one in mine if one.deciders.get("stage") == stage]
        return self._stages[stage]

    def alike(self, deciders: Mapping[str, Any]) -> list[Record]:
        """Records of a stage for the same plain values: most likely of the same sample."""
        stage = str(deciders.get("stage"))
        known = self.of_stage(stage)
        if stage not in self._alike:
            found: dict[str, list[Record]] = defaultdict(list)
            for record in known:
                found[plain_inputs(record.deciders)].append(record)
            self._alike[stage] = dict(found)
        return self._alike[stage].get(plain_inputs(deciders), [])

    def making(self, ref: Ref[Any]) -> list[Record]:
        """Records of whatever stage that name an artifact."""
        return self._all_makers().get(ref, [])

    def refs(self) -> list[Ref[Any]]:
        """All artifacts that records name."""
        return list(self._all_makers())

    def shared(self, deciders: Mapping[str, Any]) -> dict[str, Any]:
        """The same deciders, with those parts that a record has as well held once: equal ones are one object."""
        own = {name: self._one(deciders[name]) for name in SHARED if name in deciders}
        return {**deciders, **own}

    def _all_makers(self) -> dict[Ref[Any], list[Record]]:
        self._look_again()
        if self._makers is None:
            found: dict[Ref[Any], list[Record]] = defaultdict(list)
            for record in self._records(self._names):
                found[record.ref].append(record)
            self._makers = dict(found)
        return self._makers

    def _one(self, part: Any) -> Any:
        return self._pool.setdefault(json.dumps(part, sort_keys=True), part)

    def _records(self, names: Iterable[str]) -> list[Record]:
        for name in (names := list(names)):
            if name not in self._read:
                record = read_record(self.root / name)
                whole = record and replace(record, deciders=self.shared(record.deciders))
                self._read[name] = whole
        return [record for name in names if (record := self._read[name]) is not None]

    def _look_again(self) -> None:
        """Forget what was sorted if a record has come or gone."""
        try:
            now = self.root.stat().st_mtime_ns
            if now == self._seen_ns:
                return
            ages = {path.name: path.lstat().st_mtime_ns for path in self.root.iterdir()}
        except OSError:  # no folder yet, or one that is being emptied
            now, ages = -1, {}
        self._names = tuple(sorted(ages, key=lambda name: (-ages[name], name)))
        self._read = {name: record for name, record in self._read.items() if name in ages}
        self._seen_ns, self._stages, self._alike, self._makers = now, {}, {}, None


def plain_inputs(deciders: Mapping[str, Any]) -> str:
    """The inputs that are no artifacts: the sentence, a seed, a mass."""
    inputs = deciders.get("inputs")
    values = inputs if isinstance(inputs, Mapping) else {}
    plain = {name: one for name, one in values.items() if not (isinstance(one, Mapping) and "ref" in one)}
    return json.dumps(plain, sort_keys=True)


def record_index() -> RecordIndex:
    """The index of this machine's records, one per process and folder."""
    return _opened(records_root())


@lru_cache(maxsize=4)
def _opened(root: Path) -> RecordIndex:
    return RecordIndex(root)
