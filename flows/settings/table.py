"""Every setting with its meaning, default, variable and option; and the values in force with where each came from."""

import ast
import inspect
import json
import os
import textwrap
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from urllib.parse import urlsplit, urlunsplit

from pydantic import BaseModel
from pydantic_core import to_jsonable_python

from dcap.scene.settings import data_root
from flows.place import PlaceConfig
from flows.settings.given import Origin, given_settings, variable_of
from flows.settings.own import OPTIONS, OWN, section
from flows.settings.stages import stage_keys, stage_settings

SECRETS = ("ANTHROPIC_API_KEY", "OPENAI_API_KEY", "PREFECT_API_KEY", "PREFECT_API_AUTH_STRING", "AWS_SECRET_ACCESS_KEY")
"""Variables that are told to be set or not, never their values; no file of ours holds them."""
HIDDEN = "***"
DATA = "paths.data"
"""Whose default depends on how dcap was installed."""


@dataclass(frozen=True, slots=True)
class SettingKey:
    """One setting that there is."""

    key: str
    default: object
    meaning: str
    variable: str
    """Environment variable that sets it."""
    option: str
    """Option of the command line that sets it; empty if none does."""


@dataclass(frozen=True, slots=True)
class ShownSetting:
    """One setting as it is in force."""

    key: str
    value: object
    origin: Origin
    where: str
    """PATH:LINE, the variable or the option; empty for a default."""


def setting_keys() -> Iterator[SettingKey]:
    """All settings, section by section."""
    options = {key: "--" + name.replace("_", "-") for name, key in OPTIONS.items()}
    for name, kind in OWN.items():
        for field in kind.model_fields:
            yield setting_key(f"{name}.{field}", kind, kind(), options)
    defaults = PlaceConfig()
    for one in stage_keys():
        holder: object = defaults
        for word in one.key.split(".")[:-1]:
            holder = getattr(holder, word)
        yield setting_key(one.key, one.kind, holder, options)


def setting_key(key: str, kind: type[BaseModel], holder: object, options: Mapping[str, str]) -> SettingKey:
    """What is known of a setting; `holder` has its default."""
    name = key.rpartition(".")[2]
    default = to_jsonable_python(getattr(holder, name))
    return SettingKey(key, default, meanings(kind).get(name, ""), variable_of(key), options.get(key, ""))


@cache
def meanings(kind: type[BaseModel]) -> Mapping[str, str]:
    """The docstrings of a configuration's fields, each on one line."""
    (node,) = ast.parse(textwrap.dedent(inspect.getsource(kind))).body
    assert isinstance(node, ast.ClassDef)
    found = {}
    for field, text in zip(node.body, node.body[1:], strict=False):
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name) and isinstance(text, ast.Expr):
            found[field.target.id] = " ".join(str(ast.literal_eval(text.value)).split())
    return found


def settings_in_force(flags: Mapping[str, object]) -> list[ShownSetting]:
    """Every setting with its value and where that came from; `flags` are options of the command line by name."""
    given = given_settings()
    own = {name: section(name, kind, given).model_dump(mode="json") for name, kind in OWN.items()}
    values = {**stage_settings().model_dump(mode="json"), **own}
    typed = {OPTIONS[name]: value for name, value in flags.items() if name in OPTIONS}
    found = []
    for one in setting_keys():
        value, origin, where = value_at(values, one.key), Origin.DEFAULT, ""
        if one.key == DATA:
            value = str(data_root())
        if one.key in given:
            origin, where = given[one.key].origin, given[one.key].where
        if one.key in typed:
            value, origin, where = typed[one.key], Origin.FLAG, one.option
        found.append(ShownSetting(one.key, redacted(value), origin, where))
    return found


def value_at(tree: Mapping[str, object], key: str) -> object:
    """The value under a dotted key."""
    value: object = tree
    for word in key.split("."):
        assert isinstance(value, Mapping)
        value = value[word]
    return value


def redacted(value: object) -> object:
    """A value without what must not be seen: who signs in at an address, and with what."""
    if not isinstance(value, str) or "://" not in value:
        return value
    parts = urlsplit(value)
    host = parts.netloc.rpartition("@")[2]
    netloc = f"{HIDDEN}@{host}" if "@" in parts.netloc else host
    return urlunsplit((parts.scheme, netloc, parts.path, HIDDEN if parts.query else "", ""))


def secrets() -> dict[str, str]:
    """Whether each variable with a secret is set."""
    return {name: "set, not shown" if os.environ.get(name) else "not set" for name in SECRETS}


def key_table(name: str) -> str:
    """The settings of a section as the table of docs/configuration.md."""
    head = "| key | default | option | meaning |\n|---|---|---|---|\n"
    rows = (one for one in setting_keys() if one.key.partition(".")[0] == name)
    return head + "".join(
        f"| `{one.key}` | {in_code(one.default)} | {in_code(one.option)} | {escaped(one.meaning)} |\n" for one in rows
    )


def in_code(value: object) -> str:
    """A value as YAML has it; nothing for an empty text."""
    return "" if value == "" else f"`{value if isinstance(value, str) else json.dumps(value)}`"


def escaped(text: str) -> str:
    """Text for a cell: a bar would end it."""
    return text.replace("|", "\\|")
