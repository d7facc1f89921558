"""The stages' sections of `dcap.yaml`: every setting of every stage, checked by the stage's own configuration.

In: what was given. Out: a `PlaceConfig`, the same for the same values however they were given. What follows from an
option that concerns several stages (who answers, threads, where the solver runs) has no key of its own here.
"""

from collections.abc import Iterator, Mapping, MutableMapping
from dataclasses import dataclass
from typing import Any

from pydantic import BaseModel, ValidationError

from flows.given_settings import Given, check_underscores, given_settings, refused, section_of, unknown
from flows.options import KEYS
from flows.place import PlaceConfig
from flows.settings.effective import OWN, as_json, check_empty, plain, reason

ELSEWHERE = {
    "threads": "run.threads",
    "solver.seed": "the sample's seed",
    "drop.solver.arch": "run.arch",
}
"""Ends of keys that are set elsewhere, and where."""
LANGUAGE = "language"
"""The part of a stage's settings that says who answers."""


def stage_settings() -> PlaceConfig:
    """Return the stages' settings: what was given over their defaults."""
    check_underscores(one.key for one in stage_keys())
    given = {key: one for key, one in given_settings().items() if section_of(key) not in OWN}
    return PlaceConfig() if not given else checked_stages(given)


def checked_stages(given: Given) -> PlaceConfig:
    """Return the configuration with these values, each refused by its place if it cannot be."""
    tree = PlaceConfig().model_dump(mode="json")
    known = {one.key: one for one in settings_of(PlaceConfig)}
    settable = [one.key for one in stage_keys()]
    for key, one in given.items():
        if key in known and known[key].is_section:
            check_empty(one)
        elif key in known and (place := set_by(key)):
            raise refused(one, f"is set by {place}")
        elif key not in settable:
            raise unknown(one, [*settable, *KEYS, *OWN, *(name for name in known if known[name].is_section)])
        else:
            put(tree, key, plain(one))
    return validated(tree, given)


def validated(tree: Mapping[str, object], given: Given) -> PlaceConfig:
    """Return the configuration that a tree holds; the first value that cannot be is told by its place."""
    try:
        return PlaceConfig.model_validate_json(as_json(tree), strict=True)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        words = [str(word) for word in first["loc"]]
        starts = (".".join(words[:count]) for count in range(len(words), 0, -1))  # an item of a list has no key
        key = next(start for start in starts if start in given)
        raise refused(given[key], reason(first)) from None


def put(tree: MutableMapping[str, Any], key: str, value: object) -> None:
    """Set a value by its dotted key."""
    *path, name = key.split(".")
    for word in path:
        tree = tree[word]
    tree[name] = value


def set_by(key: str) -> str:
    """Return what sets a key that has no place of its own in the file; empty if it has."""
    if LANGUAGE in key.split("."):
        return "run.language and run.model"
    return next((place for end, place in ELSEWHERE.items() if f".{key}".endswith(f".{end}")), "")


def stage_keys() -> Iterator["StageKey"]:
    """Yield the settings of the stages that can be set in the file, in the order of the stages."""
    return (one for one in settings_of(PlaceConfig) if "." in one.key and not one.is_section and not set_by(one.key))


@dataclass(frozen=True, slots=True)
class StageKey:
    """One field of the stages' configurations."""

    key: str
    """Dotted."""
    kind: type[BaseModel]
    """Whose field it is."""
    name: str
    is_section: bool
    """Whether it holds others."""


def settings_of(kind: type[BaseModel], prefix: str = "") -> Iterator[StageKey]:
    """Yield every field of a configuration, and all that is in it."""
    for name, field in kind.model_fields.items():
        inner, key = field.annotation, f"{prefix}{name}"
        if isinstance(inner, type) and issubclass(inner, BaseModel):
            yield StageKey(key, kind, name, is_section=True)
            yield from settings_of(inner, f"{key}.")
        else:
            yield StageKey(key, kind, name, is_section=False)
