"""Why a stage would run: what differs between what decides it now and its closest earlier result.

In: the deciders of a stage that has no usable record. Out: a `Why`, as data; `in_words` tells it in a line. An input
that another stage made is followed back, record by record, to what changed there first.
"""

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from filecmp import cmp
from pathlib import Path
from typing import Any

from dcap.scene.spelling import first_of
from dcap.scene.store.artifacts import FILES_FOLDER, Source, Store, json_file
from dcap.scene.store.codec import VALUE_FILE
from dcap.scene.store.ref import Ref
from tasks.runner.record_index import SHARED, RecordIndex, record_index
from tasks.runner.records import Deciders, Record

MOST_STEPS = 30
"""Longer than any chain of stages: following inputs back ends, whatever records say."""
SHOWN = 3
"""Settings, files or libraries that a line names."""
LONGEST = 60
"""Characters of a value that a line shows."""
ABSENT = "absent"

KeyOf = Callable[[str, str], str]
"""Name of a setting for a person, from the stage and its own name for it."""


class ChangeKind(StrEnum):
    """What has changed."""

    INPUT = "input"
    SETTING = "setting"
    CODE = "code"
    LIBRARY = "library"


class Cause(StrEnum):
    """What a person gives to a sample."""

    VALUE = "value"
    FILE = "file"


@dataclass(frozen=True, slots=True)
class Change:
    """One thing that differs."""

    kind: ChangeKind
    stage: str
    """Whose it is."""
    name: str
    """Of the input, setting, file or library."""
    old: object
    new: object
    origin: "Why | None" = None
    """Why an input that another stage made differs."""

    @property
    def is_reference(self) -> bool:
        """Whether it is an input that lies in the store."""
        return any(isinstance(one, Mapping) and "ref" in one for one in (self.old, self.new))


@dataclass(frozen=True, slots=True)
class Why:
    """What keeps earlier results from being used."""

    changes: tuple[Change, ...] = ()
    """Against the closest earlier result."""
    told: str = ""
    """The reason where nothing has changed."""
    file: str = ""
    """Name of the file that a person has given, if that is it."""


def why_not_cached(wanted: Deciders, store: Store) -> Why:
    """What keeps the closest earlier record from being used."""
    index = record_index()
    new = index.shared(wanted.to_json())
    known = index.alike(new) or index.of_stage(wanted.stage)
    if not known:
        return Why(told="never computed")
    record, changes = closest(known, new)
    if not changes:
        return Why(told="artifact missing or damaged" if not store.has(record.ref) else "asked for")
    why = Why(tuple(followed(change, store, index, MOST_STEPS) for change in changes))
    given = list(given_otherwise(why))
    if {Cause.VALUE, Cause.FILE} - {cause for cause, _ in given}:
        return why
    words = dict.fromkeys(words for _, words in sorted(given, key=lambda one: one[0] is Cause.FILE))
    return Why(told=f"no earlier result with {first_of([*words], SHOWN)}")


def given_otherwise(why: Why) -> Iterator[tuple[Cause, str]]:
    """What a person gives now and the earlier record has otherwise. One with another value and another file may be of
    another sample: what it has instead is no reason then."""
    for change in why.changes:
        if change.origin is not None:
            yield from given_otherwise(change.origin)
        elif change.kind is ChangeKind.INPUT and not change.is_reference:
            yield Cause.VALUE, f"{change.name} {shown(change.new)}"
    if why.file:
        yield Cause.FILE, f"file {why.file}"


def closest(records: list[Record], new: Mapping[str, Any]) -> tuple[Record, list[Change]]:
    """The record with the fewest differences, and these; values given by a person (the prompt) count before all else:
    a record with other ones is of another sample."""

    def distance(record: Record) -> tuple[int, int, int]:
        old = record.deciders
        inputs = list(input_changes(old, new))
        others = sum(old.get(part) is not new.get(part) for part in SHARED)  # held once, so equal is the same
        return sum(not one.is_reference for one in inputs), len(inputs), others

    best = min(records, key=distance)  # the first of equals: the newest
    return best, differences(best.deciders, new)


def differences(old: Mapping[str, Any], new: Mapping[str, Any]) -> list[Change]:
    """What differs between two sets of deciders of a stage: inputs first, then code, settings, libraries."""
    return [
        *input_changes(old, new),
        *changed_keys(ChangeKind.CODE, old, new, "code"),
        *setting_changes(old, new),
        *changed_keys(ChangeKind.LIBRARY, old, new, "libraries"),
    ]


def input_changes(old: Mapping[str, Any], new: Mapping[str, Any]) -> Iterator[Change]:
    """Inputs that differ."""
    return changed_keys(ChangeKind.INPUT, old, new, "inputs")


def setting_changes(old: Mapping[str, Any], new: Mapping[str, Any]) -> Iterator[Change]:
    """Settings that differ, by dotted names."""
    if old.get("config") is new.get("config"):
        return iter(())
    flat = [{**one, "config": dict(flattened(one.get("config")))} for one in (old, new)]
    return changed_keys(ChangeKind.SETTING, flat[0], flat[1], "config")


def changed_keys(kind: ChangeKind, old: Mapping[str, Any], new: Mapping[str, Any], part: str) -> Iterator[Change]:
    """Keys of a part of the deciders whose values differ."""
    before, after = old.get(part), new.get(part)
    if before is after or not isinstance(before, Mapping) or not isinstance(after, Mapping):
        return
    for name in sorted(before.keys() | after.keys()):
        one, other = before.get(name, ABSENT), after.get(name, ABSENT)
        if one != other:
            yield Change(kind, str(new.get("stage")), name, one, other)


def flattened(tree: object, prefix: str = "") -> Iterator[tuple[str, object]]:
    """Leaves of nested settings by dotted names; lists are leaves."""
    if not isinstance(tree, Mapping):
        yield prefix, tree
        return
    for name, value in tree.items():
        yield from flattened(value, f"{prefix}.{name}" if prefix else str(name))


def followed(change: Change, store: Store, index: RecordIndex, steps: int) -> Change:
    """A change with its origin, where it is that of an input which stages have made."""
    if change.kind is not ChangeKind.INPUT or not change.is_reference or steps == 0:
        return change
    old, new = reference(change.old), reference(change.new)
    if new is None or old is None:
        return change
    if new.kind == Source.__name__:
        name = source_name(old, new, store)
        return replace(change, origin=Why(told=f"new or changed file {name}", file=name))
    makers = [one for one in index.making(new) if one.deciders.get("stage")]
    earlier = [one for maker in makers[:1] for one in index.making(old) if same_stage(one, maker)]
    if not earlier:
        return replace(change, origin=Why(told=f"another {new.kind}"))
    _, found = closest(earlier, makers[0].deciders)
    deeper = tuple(followed(one, store, index, steps - 1) for one in found)
    again = f"stage {makers[0].deciders['stage']} was computed again and gave another result"
    return replace(change, origin=Why(deeper, "" if deeper else again))


def same_stage(one: Record, other: Record) -> bool:
    """Whether two records are of one stage."""
    return one.deciders.get("stage") == other.deciders.get("stage")


def reference(value: object) -> Ref[Any] | None:
    """The artifact that an input names; None for a plain value."""
    tree = value.get("ref") if isinstance(value, Mapping) else None
    return Ref.from_json(tree) if isinstance(tree, Mapping) else None


def source_name(old: Ref[Any], new: Ref[Any], store: Store) -> str:
    """Name of the file that a person gave; of a folder those that are not as in the earlier one, or its digest."""
    try:
        main = str(json_file(store.folder(new) / VALUE_FILE)["main"])
        if main != ".":
            return main
        if not store.is_here(old):
            return f"{new.sha256[:12]} in the folder"
        changed = different_files(store.folder(old) / FILES_FOLDER, store.folder(new) / FILES_FOLDER)
    except (OSError, ValueError, KeyError):
        return new.sha256[:12]
    return f"{first_of(changed, SHOWN) or new.sha256[:12]} in the folder"


def different_files(old: Path, new: Path) -> list[str]:
    """Names of the files that are not the same in two folders, or in one of them only."""
    names = {path.relative_to(folder).as_posix() for folder in (old, new) for path in folder.rglob("*")
             if path.is_file()}  # fmt: skip
    both = {name for name in names if (old / name).is_file() and (new / name).is_file()}
    return sorted(name for name in names if name not in both or not cmp(old / name, new / name, shallow=False))


def in_words(why: Why, key_of: KeyOf = lambda stage, name: f"{stage}.{name}") -> str:
    """The reason in a line: what a person has given before what stages have made of it."""
    if why.told:
        return why.told
    inputs = sorted((one for one in why.changes if one.kind is ChangeKind.INPUT), key=lambda one: one.is_reference)
    told: dict[str, str] = {}
    for one in inputs:
        path, reason = traced(one, key_of)
        told.setdefault(reason, f"{path}: {reason}" if path else reason)
    groups = [
        first_of([*told.values()], SHOWN),
        group_words("code changed: ", ChangeKind.CODE, why, lambda one: one.name),
        group_words("settings changed: ", ChangeKind.SETTING, why,
                    lambda one: f"{key_of(one.stage, one.name)} ({arrow(one)})"),
        group_words("", ChangeKind.LIBRARY, why, lambda one: f"{one.name} {arrow(one)}"),
    ]  # fmt: skip
    return "; ".join(dict.fromkeys(one for one in groups if one))


def traced(change: Change, key_of: KeyOf) -> tuple[str, str]:
    """Through which inputs a change came, and what it was at its origin; no path for a value that was given."""
    if change.origin is None:
        return "", f"{change.name} changed ({arrow(change)})"
    path, here = [change.name], change.origin
    while (inner := only_input(here)) is not None and inner.origin is not None:
        path.append(inner.name)
        here = inner.origin
    return f"input {' <- '.join(path)}", in_words(here, key_of)


def only_input(why: Why) -> Change | None:
    """Its change, if it is a single one and that of an input."""
    return why.changes[0] if len(why.changes) == 1 and why.changes[0].kind is ChangeKind.INPUT else None


def group_words(head: str, kind: ChangeKind, why: Why, words: Callable[[Change], str]) -> str:
    """Changes of one kind; empty where there are none."""
    found = [words(one) for one in why.changes if one.kind is kind]
    return f"{head}{first_of(found, SHOWN)}" if found else ""


def arrow(change: Change) -> str:
    """Both values of a change."""
    return f"{shown(change.old)} -> {shown(change.new)}"


def shown(value: object) -> str:
    """A value in a line; what an input holds stands in a `value`."""
    if (ref := reference(value)) is not None:
        return f"{ref.kind} {ref.sha256[:12]}"
    plain = value.get("value", value) if isinstance(value, Mapping) else value
    text = json.dumps(plain, ensure_ascii=False) if isinstance(plain, Mapping | list) else str(plain)
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 3]}..."
