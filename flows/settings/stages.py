"""The stages' sections of `dcap.yaml`: every setting of every stage, checked by the stage's own configuration.

In: values from `dcap.yaml` and the environment. Out: a `PlaceConfig`, the same for the same values from either source.
Settings that follow from an option for several stages (language client, threads, where the solver runs) have no key
here.
"""

from collections.abc import Iterator, Mapping, MutableMapping
from dataclasses import dataclass
from typing import Any

from pydantic import BaseModel, ValidationError

from flows.given_settings import Given, check_underscores, given_settings, invalid_value, section_of, unknown_key
from flows.options import KEYS
from flows.place import PlaceConfig
from flows.settings.effective import OWN, as_json, check_empty, plain, reason

ELSEWHERE = {
    "threads": "run.threads",
    "solver.seed": "the sample's seed",
    "drop.solver.arch": "run.arch",
}
"""Ends of keys that are set by an option, and that option."""
LANGUAGE = "language"
"""Section of a stage's settings for the language client."""


def stage_settings() -> PlaceConfig:
    """Return the stages' settings: given values over their defaults."""
    check_underscores(one.key for one in stage_keys())
    given = {key: one for key, one in given_settings().items() if section_of(key) not in OWN}
    return PlaceConfig() if not given else checked_stages(given)


def checked_stages(given: Given) -> PlaceConfig:
    """Return the configuration with these values; InputError names the place of an invalid one."""
    tree = PlaceConfig().model_dump(mode="json")
    known = {one.key: one for one in settings_of(PlaceConfig)}
    settable = [one.key for one in stage_keys()]
    for key, one in given.items():
        if key in known and known[key].is_section:
            check_empty(one)
        elif key in known and (place := set_by(key)):
            raise invalid_value(one, f"is set by {place}")
        elif key not in settable:
            raise unknown_key(one, [*settable, *KEYS, *OWN, *(name for name in known if known[name].is_section)])
        else:
            put(tree, key, plain(one))
    return validated(tree, given)


def validated(tree: Mapping[str, object], given: Given) -> PlaceConfig:
    """Return the configuration in a tree; InputError names the place of the first invalid value."""
    try:
        return PlaceConfig.model_validate_json(as_json(tree), strict=True)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        words = [str(word) for word in first["loc"]]
        starts = (".".join(words[:count]) for count in range(len(words), 0, -1))  # an item of a list has no key
        key = next(start for start in starts if start in given)
        raise invalid_value(given[key], reason(first)) from None


def put(tree: MutableMapping[str, Any], key: str, value: object) -> None:
    """Set a value by its dotted key."""
    *path, name = key.split(".")
    for word in path:
        tree = tree[word]
    tree[name] = value


def set_by(key: str) -> str:
    """Return the option that sets a key without a place in the file; empty if the key has one."""
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
    """Class that has the field."""
    name: str
    is_section: bool
    """Whether it holds others."""


def settings_of(kind: type[BaseModel], prefix: str = "") -> Iterator[StageKey]:
    """Yield every field of a configuration, including nested ones."""
    for name, field in kind.model_fields.items():
        inner, key = field.annotation, f"{prefix}{name}"
        if isinstance(inner, type) and issubclass(inner, BaseModel):
            yield StageKey(key, kind, name, is_section=True)
            yield from settings_of(inner, f"{key}.")
        else:
            yield StageKey(key, kind, name, is_section=False)
