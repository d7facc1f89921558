"""Reads a YAML file of recipes into its model, or reports a mistake with its place."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TypeVar

from pydantic import TypeAdapter, ValidationError
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from dcap.scene.checks.places import yaml_lines
from dcap.scene.errors import InputError
from dcap.scene.problems import Place, short
from dcap.scene.settings import resource

RECIPES = resource("data/recipes")
"""The embedded recipes: colors.yaml, objects.yaml, and a file per room in rooms/."""


T = TypeVar("T")


def check_file(path: Path, kind: type[T], palette: Mapping[str, object] | None = None) -> T:
    """The checked content of a file; raises InputError with file, line, key and value."""
    try:
        text = path.read_text(encoding="utf-8")
        tree: object = YAML(typ="safe", pure=True).load(text)
    except OSError as broken:
        raise InputError(f"{path}: cannot be read: {broken.strerror}") from broken
    except (YAMLError, ValueError, RecursionError) as broken:
        raise InputError(f"{path}: is not YAML: {' '.join(str(broken).split())}") from broken
    try:
        return TypeAdapter(kind).validate_python(tree, context=palette)
    except ValidationError as broken:
        place, what = _complaint(broken, tree)
        where = ".".join(str(step) for step in place)
        raise InputError(f"{path}:{yaml_lines(text)(place)}: {f'{where}: ' if where else ''}{what}") from broken


def _complaint(broken: ValidationError, tree: object) -> tuple[Place, str]:
    """Place and description of the first mistake."""
    first = broken.errors(include_url=False)[0]
    place = _in_tree(first["loc"], tree)
    if first["type"] == "missing":
        return place, f"key {first['loc'][-1]!r} is missing"
    if first["type"] == "value_error":
        return place, first["msg"].removeprefix("Value error, ")
    return place, f"{first['msg']} (got {short(first['input'])})"


def _in_tree(steps: Sequence[str | int], tree: object) -> Place:
    """The steps that are keys or indices of the tree; pydantic adds some for its own branches."""
    place: list[str | int] = []
    for step in steps:
        if isinstance(tree, Mapping):
            known = step in tree
        else:
            known = isinstance(tree, list) and isinstance(step, int) and step < len(tree)
        if known:
            tree = tree[step]  # type: ignore[index]
            place.append(step)
    return tuple(place)
