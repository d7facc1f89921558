"""Settings from `dcap.yaml` and the environment, by dotted keys, each with its file and line or its variable.

The file is $DCAP_CONFIG; else `dcap.yaml` of the working directory; else that of the clone, or for an installed dcap
that of the user's data folder. Only the first one that exists is read. A key `drop.solver.step_limit` is
$DCAP_DROP__SOLVER__STEP_LIMIT in the environment, which wins over the file. Callers check keys and values;
`unknown_key` and `invalid_value` build their errors.
"""

import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from dcap.scene.checks.findings import yaml_lines
from dcap.scene.errors import InputError, short
from dcap.scene.readers.files import BROKEN_YAML, parse_yaml, yaml_fault
from dcap.scene.settings import home
from dcap.scene.text import did_you_mean
from tasks.machine_errors import API_URL

FILE = "dcap.yaml"
FILE_VARIABLE = "DCAP_CONFIG"
PREFIX, BETWEEN = "DCAP_", "__"
VARIABLES = {"paths.data": "DCAP_DATA", "paths.store": "DCAP_STORE", "server.api_url": API_URL}
"""Keys whose environment variables do not follow the pattern."""
EXPORTED: dict[str, str] = {}
"""Values from the file that this process has exported into such variables for its child processes."""
PATHS = ("run.record", "run.replay", "run.dataset", "run.objects", "run.sugar", "paths.data", "paths.store")
"""Keys whose values in the file are relative to the file's folder."""
DEEPEST = 4
"""Deepest nesting of keys that is read; no section is that deep."""
MOST_BYTES = 1 << 20
MOST_VALUES = 1000


class Origin(StrEnum):
    """Origin of a value; each wins over those before it."""

    DEFAULT = "default"
    FILE = "file"
    ENVIRONMENT = "environment"
    FLAG = "flag"


@dataclass(frozen=True, slots=True)
class GivenSetting:
    """One value from the file, the environment or a flag."""

    key: str
    value: object
    origin: Origin
    where: str
    """PATH:LINE of the file, or the variable's name."""


Given = Mapping[str, GivenSetting]


def settings_file() -> Path | None:
    """Return the settings file in force; None without one."""
    named = os.environ.get(FILE_VARIABLE)
    if named is not None:
        if named and not Path(named).is_file():
            raise InputError(f"{FILE_VARIABLE}={named}: no such file")
        return Path(named) if named else None
    return next((path for path in (Path(FILE), home() / FILE) if path.is_file()), None)


def given_settings() -> Given:
    """Return all values of the file and the environment; the environment wins."""
    path = settings_file()
    found = {one.key: one for one in in_file(path)} if path else {}
    return found | {one.key: one for one in in_environment()}


def in_file(path: Path) -> Iterator[GivenSetting]:
    """Yield the values of a file."""
    if path.stat().st_size > MOST_BYTES:
        raise InputError(f"{path}: {path.stat().st_size} bytes > {MOST_BYTES}; this is not a file of settings")
    try:
        text = path.read_text(encoding="utf-8")
        tree = parse_yaml(text)
    except (OSError, *BROKEN_YAML) as broken:
        raise InputError(f"{path}: cannot be read as YAML: {yaml_fault(broken)}") from broken
    if tree is None:
        return
    if not isinstance(tree, Mapping):
        raise InputError(f"{path}: expected sections of keys and values, found {short(tree)}")
    line_of = yaml_lines(text)
    for count, (place, value) in enumerate(leaves(tree)):
        if count == MOST_VALUES:
            raise InputError(f"{path}: more than {MOST_VALUES} values; there are not that many settings")
        key = ".".join(place)
        yield GivenSetting(key, resolve_path(path, key, value), Origin.FILE, f"{path}:{line_of(place)}")


def leaves(tree: Mapping[object, object], place: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], object]]:
    """Yield values with the keys that lead to them."""
    for name, value in tree.items():
        here = (*place, str(name))
        if isinstance(value, Mapping) and len(here) < DEEPEST:
            yield from leaves(value, here)
        else:
            yield here, value


def resolve_path(path: Path, key: str, value: object) -> object:
    """Return a value of the file; a path relative to the file's folder becomes absolute."""
    if key not in PATHS or not isinstance(value, str) or not value or "://" in value:
        return value
    return str((path.parent / value).resolve())


def in_environment() -> Iterator[GivenSetting]:
    """Yield the values of environment variables; an empty one counts as none."""
    for key, name in VARIABLES.items():
        value = os.environ.get(name, "")
        if value and EXPORTED.get(name) != value:
            yield GivenSetting(key, value, Origin.ENVIRONMENT, name)
    ours = sorted(name for name in os.environ if name.startswith(PREFIX))
    for name in (name for name in ours if BETWEEN not in name and os.environ[name]):
        check_spelling(name)
    for name in (name for name in ours if BETWEEN in name):
        if (key := key_of(name)) in VARIABLES:
            raise InputError(f"{name}: set {VARIABLES[key]} for {key}")
        if os.environ[name]:
            yield GivenSetting(key, parse_variable(name, os.environ[name]), Origin.ENVIRONMENT, name)


def check_spelling(name: str) -> None:
    """Refuse a variable without a section whose name has two letters swapped, or one missing."""
    for one in (FILE_VARIABLE, VARIABLES["paths.data"], VARIABLES["paths.store"]):
        shorter = (one[:place] + one[place + 1 :] for place in range(len(PREFIX), len(one)))
        if name != one and (sorted(name) == sorted(one) or name in shorter):
            raise InputError(f"{name}: unknown variable; did you mean {one!r}?")


def check_underscores(keys: Iterable[str]) -> None:
    """Refuse an environment variable that would name a key if it had two underscores between the words. Ignore
    variables that a cluster sets for a service called dcap-server (DCAP_SERVER_PORT=tcp://...)."""
    for one in map(variable_of, keys):
        single = one.replace(BETWEEN, "_")
        value = os.environ.get(single, "")
        if BETWEEN in one and value and not (single.endswith("_PORT") and "://" in value):
            raise InputError(f"{single}: unknown variable; did you mean {one!r}?")


def key_of(variable: str) -> str:
    """Return the key that an environment variable sets."""
    return variable.removeprefix(PREFIX).lower().replace(BETWEEN, ".")


def variable_of(key: str) -> str:
    """Return the environment variable that sets a key."""
    return VARIABLES.get(key) or PREFIX + key.upper().replace(".", BETWEEN)


def parse_variable(name: str, text: str) -> object:
    """Return the value of a variable, written as in the file."""
    try:
        return parse_yaml(text)
    except BROKEN_YAML as broken:
        raise InputError(f"{name}={text}: cannot be read as a value of YAML: {yaml_fault(broken)}") from broken


def unknown_key(one: GivenSetting, known: Iterable[str]) -> InputError:
    """Return the error for an unknown key; it names the nearest one, preferably the same name in another section."""
    known = list(known)
    namesakes = [key for key in known if last_word(key) == last_word(one.key)]
    hint = did_you_mean(one.key, namesakes) or did_you_mean(one.key, known)
    if not hint and namesakes:
        hint = f"; did you mean {namesakes[0]!r}?"
    return InputError(f"{one.where}: unknown key {one.key!r}{hint or '; `dcap config show --all` lists them'}")


def section_of(key: str) -> str:
    """Return the first word of a key."""
    return key.partition(".")[0]


def last_word(key: str) -> str:
    """Return a key without its sections."""
    return key.rpartition(".")[2]


def invalid_value(one: GivenSetting, why: str) -> InputError:
    """Return the error for an invalid value."""
    return InputError(f"{one.where}: {one.key} is {short(one.value)}: {why}")
