"""Every setting with its meaning, default and option; and the values in force with where each came from."""

import ast
import inspect
import os
import textwrap
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache

from pydantic import BaseModel
from pydantic_core import to_jsonable_python

from dcap.scene.secrets import redacted_url
from dcap.scene.settings import data_root
from flows.given_settings import Origin, given_settings
from flows.options import KEYS, AllSettings, setting_of
from flows.place import PlaceConfig
from flows.settings.effective import OWN_KEYS
from flows.settings.stages import stage_keys, stage_settings

SECRETS = ("ANTHROPIC_API_KEY", "OPENAI_API_KEY", "PREFECT_API_KEY", "PREFECT_API_AUTH_STRING", "AWS_SECRET_ACCESS_KEY")
"""Variables with secrets: only whether they are set is shown, never their values; no file of ours holds them."""
DATA = "paths.data"
"""Keys whose default depends on how dcap was installed."""


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
