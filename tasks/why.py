"""Explains why a stage would run: differences between its recipe and the closest recipe of an earlier result."""

from collections.abc import Callable, Iterator, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

from dcap.scene.spelling import first_of
from tasks.artifact import Record
from tasks.code import files_behind
from tasks.records import every_record, key_of, modified_ns, records_root

ABSENT = "absent"
DAMAGED = "its result is missing or damaged"
SHOWN = 3
"""Most settings, files or libraries that a line names."""
LONGEST = 60
"""Most characters of a value that a line shows."""
KeyOf = Callable[[str, str], str]
"""Returns the name of a setting for a person, from the stage and the stage's own name for it."""


def why_not_cached(recipe: Mapping[str, Any], key_of_setting: KeyOf) -> str:
    """Return which parts of a recipe differ from the closest earlier one: input, setting, code, data file, library."""
    if (records_root() / key_of(recipe)).exists():
        return DAMAGED
    record = closest_record(recipe)
    if record is None:
        return "no earlier result"
    old = record.recipe
    parts = [
        *changed_inputs(old, recipe),
        *named("", changed_values(old["config"], recipe["config"]), lambda key: key_of_setting(recipe["stage"], key)),
        *changed_code(old, recipe),
        *named("library ", changed_values(old["libraries"], recipe["libraries"])),
    ]
    return "; ".join(parts) or DAMAGED


def closest_record(recipe: Mapping[str, Any]) -> Record | None:
    """Return the record of the same stage with the most in common, the newest of several.

    Plain inputs (the sentence, a seed, a mass) identify the sample, so they count first.
    """

    def likeness(record: Record) -> tuple[int, int, int]:
        old = record.recipe
        same = [name for name, value in recipe["inputs"].items() if old["inputs"].get(name) == value]
        plain = sum("ref" not in recipe["inputs"][name] for name in same)
        return plain, len(same), sum(old[part] == recipe[part] for part in ("config", "code", "libraries"))

    records = _records_by_stage(records_root(), modified_ns(records_root())).get(recipe["stage"], [])
    return max(records, key=likeness, default=None)


def changed_inputs(old: Mapping[str, Any], new: Mapping[str, Any]) -> Iterator[str]:
    """Yield the differences of the inputs: an artifact by its name, a value by both values."""
    for name in sorted(new["inputs"].keys() | old["inputs"].keys()):
        before, now = old["inputs"].get(name, {}), new["inputs"].get(name, {})
        if before == now:
            continue
        if "ref" in before or "ref" in now:
            yield f"input {name} differs"
        else:
            yield from named("input ", changed_values({name: before.get("value")}, {name: now.get("value")}))


def changed_code(old: Mapping[str, Any], new: Mapping[str, Any]) -> Iterator[str]:
    """Yield the source and data files that differ."""
    if old["code"] == new["code"]:
        return
    before, now = files_behind(old["code"]), files_behind(new["code"])
    if before is None or now is None:
        yield "code has changed"
        return
    files = sorted(name for name in before.keys() | now.keys() if before.get(name) != now.get(name))
    for kind, suffixes in (("code", True), ("data file", False)):
        some = [name for name in files if name.endswith(".py") is suffixes]
        if some:
            yield f"{kind} {first_of(some, SHOWN)}"


def changed_values(old: Any, new: Any) -> dict[str, tuple[object, object]]:
    """Return the values that differ between two trees, by dotted key."""
    before, now = dict(flattened(old)), dict(flattened(new))
    keys = dict.fromkeys((*now, *before))
    pairs = {key: (before.get(key, ABSENT), now.get(key, ABSENT)) for key in keys}
    return {key: pair for key, pair in pairs.items() if pair[0] != pair[1]}


def named(
    kind: str, changes: Mapping[str, tuple[object, object]], name_of: Callable[[str], str] = lambda key: key
) -> Iterator[str]:
    """Yield the first changes in words, and the number of further ones."""
    words = [f"{name_of(key)} {short(old)} -> {short(new)}" for key, (old, new) in changes.items()]
    if words:
        yield kind + first_of(words, SHOWN)


def short(value: object) -> str:
    """Return a shortened value."""
    text = str(value)
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 1]}…"


def flattened(tree: Any, prefix: str = "") -> Iterator[tuple[str, object]]:
    """Yield the leaves of a tree by dotted key."""
    if isinstance(tree, Mapping) and tree:
        for key, value in tree.items():
            yield from flattened(value, f"{prefix}.{key}" if prefix else str(key))
    elif prefix:
        yield prefix, tree


@lru_cache(maxsize=1)
def _records_by_stage(root: Path, changed_ns: int | None) -> dict[str, list[Record]]:
    """Return all records by stage, newest first; read again when one has come or gone."""
    found: dict[str, list[tuple[int, Record]]] = {}
    for path, ref in every_record():
        if ref is not None and ref.record is not None:
            found.setdefault(ref.record.recipe["stage"], []).append((modified_ns(path) or 0, ref.record))
    return {stage: [record for _, record in sorted(some, key=lambda one: -one[0])] for stage, some in found.items()}
