"""Values for the options of a command, from flags, environment and `dcap.yaml`; the first one wins.

Nothing heavy is imported here: options are checked before the stages are loaded. Settings of the
stages are checked with them (stages.py).
"""

import json
import math
import os
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Annotated, Any, TypeVar

from pydantic import TypeAdapter, ValidationError
from pydantic_core import ErrorDetails

from dcap.scene.errors import InputError
from dcap.scene.text import did_you_mean, not_one_of, shortened
from dcap.shared_context import SharedContext
from flows.given_settings import (
    EXPORTED,
    VARIABLES,
    Given,
    GivenSetting,
    check_underscores,
    given_settings,
    invalid_value,
    section_of,
    unknown_key,
)
from flows.options import KEYS, SHOWN, AllSettings, Options

Kind = TypeVar("Kind", bound=Options)
OWN = ("run", "paths", "server")
"""The sections of `dcap.yaml` that belong to no stage."""
WORD = re.compile(r"'([^']*)'")
"""One of the words that pydantic expected, as it quotes them."""
OWN_KEYS = tuple(key for key in KEYS if section_of(key) in OWN)


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
