"""Settings in force: options of commands, settings of stages, and where each value came from.

Values for the options of a command, from flags, environment and `dcap.yaml`; the first one wins.

The stages' sections of `dcap.yaml`: every setting of every stage, checked by the stage's own configuration.

In: values from `dcap.yaml` and the environment. Out: a `PlaceConfig`, the same for the same values from either source.
Settings that follow from an option for several stages (language client, threads, where the solver runs) have no key
here.

Every setting with its meaning, default and option; and the values in force with where each came from.
"""

import ast
import inspect
import json
import math
import os
import re
import textwrap
from collections.abc import Iterator, Mapping, MutableMapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any, TypeVar

from pydantic import BaseModel, TypeAdapter, ValidationError
from pydantic_core import ErrorDetails, to_jsonable_python

from dcap.scene.errors import InputError
from dcap.scene.secrets import redacted_url
from dcap.scene.settings import data_root
from dcap.scene.text import did_you_mean, not_one_of, shortened
from dcap.shared_context import SharedContext
from flows.given_settings import (
    EXPORTED,
    VARIABLES,
    Given,
    GivenSetting,
    Origin,
    check_underscores,
    given_settings,
    invalid_value,
    section_of,
    unknown_key,
)
from flows.options import KEYS, SHOWN, AllSettings, Options, setting_of
from flows.place import PlaceConfig

Kind = TypeVar("Kind", bound=Options)
OWN = ("run", "paths", "server")
"""The sections of `dcap.yaml` that belong to no stage."""
WORD = re.compile(r"'([^']*)'")
"""One of the words that pydantic expected, as it quotes them."""
OWN_KEYS = tuple(key for key in KEYS if section_of(key) in OWN)
ELSEWHERE = {
    "threads": "run.threads",
    "solver.seed": "the sample's seed",
    "drop.solver.arch": "run.arch",
}
"""Ends of keys that are set by an option, and that option."""
LANGUAGE = "language"
"""Section of a stage's settings for the language client."""
SECRETS = ("ANTHROPIC_API_KEY", "OPENAI_API_KEY", "PREFECT_API_KEY", "PREFECT_API_AUTH_STRING", "AWS_SECRET_ACCESS_KEY")
"""Variables with secrets: only whether they are set is shown, never their values; no file of ours holds them."""
DATA = "paths.data"
"""Keys whose default depends on how dcap was installed."""


def effective_options(kind: type[Kind], flags: Mapping[str, object]) -> Kind:
    """Return the options of a command: its flags over the environment, that over the file, that over the defaults.

    Raises InputError with the option, or the place of the value, and the reason.
    """
    for name in flags:
        if name not in kind.model_fields:
            hint = did_you_mean(name, kind.model_fields) or f"; there are {', '.join(sorted(kind.model_fields))}"
            raise InputError(f"unknown option {name!r}{hint}")
    check_given(given_settings())
    values: Any = dict(flags)  # by names of fields, not of pydantic's own parameters
    try:
        return kind(**values)
    except ValidationError as error:
        raise InputError(complaint(error)) from None


def complaint(error: ValidationError) -> str:
    """Return the first error in the flags, in one line."""
    first = error.errors(include_url=False)[0]
    if not first["loc"]:
        return reason(first)
    option = "--" + str(first["loc"][0]).replace("_", "-")
    value = first["input"]
    shown = shortened(repr(value) if isinstance(value, str) else str(value), SHOWN)
    return f"{option} {shown}{' ' if is_ours(first) else ': '}{reason(first)}"


def reason(first: ErrorDetails) -> str:
    """Return the reason why a value is refused: in our words if there are some, else in pydantic's."""
    if first["type"] == "literal_error":
        return not_one_of(first["input"], filter(None, WORD.findall(first["ctx"]["expected"])))
    return str(first["ctx"]["error"]) if is_ours(first) else first["msg"]


def is_ours(first: ErrorDetails) -> bool:
    """Return whether the reason is in our words, which continue a sentence that starts with the value."""
    return first["type"] in ("literal_error", "value_error")


def check_given(given: Given) -> None:
    """Refuse unknown keys in sections that belong to no stage, and invalid values of options."""
    check_underscores(OWN_KEYS)
    for key, one in given.items():
        if key in KEYS:
            check_value(KEYS[key], one)
        elif key in OWN:
            check_empty(one)
        elif section_of(key) in OWN:
            raise unknown_key(one, (own for own in OWN_KEYS if section_of(own) == section_of(key)))


def check_value(name: str, one: GivenSetting) -> None:
    """Refuse an invalid value of an option; text is not converted to numbers."""
    field = AllSettings.model_fields[name]
    kind: Any = Annotated[field.annotation, *field.metadata]  # not the model, which would check all other values too
    try:
        TypeAdapter(kind).validate_json(as_json(plain(one)), strict=True)
    except ValidationError as error:
        raise invalid_value(one, reason(error.errors(include_url=False)[0])) from None


def check_empty(one: GivenSetting) -> None:
    """Refuse a value where keys are expected; a section without any is as good as none."""
    if one.value is not None:
        raise invalid_value(one, "expected keys and values")


def plain(one: GivenSetting) -> object:
    """Return a value that JSON can hold, a scalar or a list of scalars; deeper nesting is refused unread."""
    items = one.value if isinstance(one.value, list) else [one.value]
    if any(isinstance(item, list | dict | set) for item in items):
        raise invalid_value(one, "expected a value or a list of values")
    if any(isinstance(item, float) and not math.isfinite(item) for item in items):
        raise invalid_value(one, "expected a finite number")
    return one.value


def as_json(tree: object) -> str:
    """Return values as strict JSON; what JSON has no word for (a date) becomes text."""
    return json.dumps(tree, default=str)


@contextmanager
def exported_paths() -> Iterator[None]:
    """Export the file's paths and addresses into the environment of this process and its children, until the last
    thread in such a block leaves it."""
    given = given_settings()
    check_given(given)
    with _shared_paths(given):
        yield


@contextmanager
def _exported(given: Given) -> Iterator[None]:
    """Set the variables, and remove them again."""
    new = {name: str(given[key].value) for key, name in VARIABLES.items() if key in given and not os.environ.get(name)}
    os.environ.update(new)
    EXPORTED.update(new)
    try:
        yield
    finally:
        for name in new:
            EXPORTED.pop(name, None)
            os.environ.pop(name, None)


_shared_paths = SharedContext(_exported)


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


@dataclass(frozen=True, slots=True)
class SettingKey:
    """One known setting."""

    key: str
    default: object
    meaning: str
    option: str
    """Option of the command line that sets it; empty if none does."""


@dataclass(frozen=True, slots=True)
class ShownSetting:
    """One setting with its value in force."""

    key: str
    value: object
    origin: Origin
    where: str
    """PATH:LINE, the variable or the option; empty for a default."""


def setting_keys() -> Iterator[SettingKey]:
    """Yield all settings: those of options that are no stage's, then those of the stages in their order."""
    for key in OWN_KEYS:
        field = AllSettings.model_fields[KEYS[key]]
        yield SettingKey(key, to_jsonable_python(field.default), field.description or "", option_of(key))
    defaults = PlaceConfig().model_dump(mode="json")
    for one in stage_keys():
        yield SettingKey(one.key, value_at(defaults, one.key), meanings(one.kind)[one.name], option_of(one.key))


def option_of(key: str) -> str:
    """Return the option of the command line that sets a key; empty if none does."""
    name = KEYS.get(key, "")
    return "--" + name.replace("_", "-") if name and setting_of(AllSettings.model_fields[name]).is_flag else ""


@cache
def meanings(kind: type[BaseModel]) -> Mapping[str, str]:
    """Return the docstrings of a stage's fields by name, each on one line; empty for a field without."""
    (node,) = ast.parse(textwrap.dedent(inspect.getsource(kind))).body
    assert isinstance(node, ast.ClassDef)
    found = dict.fromkeys(kind.model_fields, "")
    for field, text in zip(node.body, node.body[1:], strict=False):
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name) and isinstance(text, ast.Expr):
            found[field.target.id] = " ".join(str(ast.literal_eval(text.value)).split())
    return found


def settings_in_force(options: AllSettings, flags: Mapping[str, object]) -> list[ShownSetting]:
    """Return every setting with its value and origin.

    `flags` are the typed options, by name; `options` are built from them, the file and the environment.
    """
    given, own = given_settings(), options.model_dump(mode="json")
    stages = stage_settings().model_dump(mode="json")
    found = []
    for one in setting_keys():
        name, origin, where = KEYS.get(one.key, ""), Origin.DEFAULT, ""
        if one.key in given:
            origin, where = given[one.key].origin, given[one.key].where
        if name in flags:
            origin, where = Origin.FLAG, one.option
        value = own[name] if one.key in OWN_KEYS or origin is Origin.FLAG else value_at(stages, one.key)
        if one.key == DATA:
            value = str(data_root())
        if isinstance(value, str) and "://" in value:
            value = redacted_url(value)
        found.append(ShownSetting(one.key, value, origin, where))
    return found


def value_at(tree: Mapping[str, object], key: str) -> object:
    """Return the value under a dotted key."""
    value: object = tree
    for word in key.split("."):
        assert isinstance(value, Mapping)
        value = value[word]
    return value


def secrets() -> dict[str, str]:
    """Return whether each variable with a secret is set."""
    return {name: "set, not shown" if os.environ.get(name) else "not set" for name in SECRETS}
