"""Frozen values as JSON: what is typed inside becomes plain where a file is written for people and other programs."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from enum import Enum
from math import isfinite, isnan
from typing import TypeAlias

import numpy as np
from pydantic import BaseModel

JsonValue: TypeAlias = "bool | int | float | str | Sequence[JsonValue] | Mapping[str, JsonValue] | None"
"""Any tree of JSON."""
JsonObject: TypeAlias = dict[str, JsonValue]
"""An object of JSON: the content of a file such as placement.json."""


def to_json(value: object, name: str = "value") -> JsonValue:
    """A value as JSON: dataclasses become objects in the order of their fields, arrays lists, enums their values.

    A field whose default is None is left out while it is None; infinite numbers become null, for JSON has none. A
    configuration becomes an object of all its fields. Raises TypeError for what is none of these, and ValueError with
    the name for NaN: that is a mistake of ours, which null would hide.
    """
    if isinstance(value, Enum):
        return to_json(value.value, name)
    if isinstance(value, np.ndarray | np.generic):
        return to_json(value.tolist(), name)
    if isinstance(value, float):
        if isnan(value):
            raise ValueError(f"{name} is NaN")
        return value if isfinite(value) else None
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, tuple | list):
        return [to_json(item, name) for item in value]
    return object_to_json(value)


def object_to_json(value: object) -> JsonObject:
    """A dataclass, mapping or configuration as an object of JSON, as `to_json` does it."""
    if isinstance(value, BaseModel):
        value = value.model_dump(mode="json")
    if isinstance(value, Mapping):
        return {str(key): to_json(item, str(key)) for key, item in value.items()}
    if not is_dataclass(value) or isinstance(value, type):
        raise TypeError(f"a {type(value).__name__} cannot be written as JSON")
    found = {one.name: (getattr(value, one.name), one.default) for one in fields(value)}
    return {
        name: to_json(item, name) for name, (item, default) in found.items() if item is not None or default is not None
    }


def sorted_keys(tree: Mapping[str, JsonValue]) -> JsonObject:
    """The same object with its keys, and those of all that is in it, in alphabetical order."""
    return {key: _sorted(tree[key]) for key in sorted(tree)}


def _sorted(tree: JsonValue) -> JsonValue:
    if isinstance(tree, Mapping):
        return sorted_keys(tree)
    return [_sorted(item) for item in tree] if isinstance(tree, list) else tree


def canonical_json(tree: object, *, indent: int | None = None) -> bytes:
    """JSON with sorted keys and without NaN: equal trees give equal bytes."""
    text = json.dumps(tree, sort_keys=True, allow_nan=False, ensure_ascii=False, indent=indent)
    return text.encode()
