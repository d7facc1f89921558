"""Turns the pure function of a stage into a cached task."""

from collections.abc import Callable
from typing import Any


class Stage:
    """A stage as the flows call it: references in, a reference out."""

    def __init__(self, function: Callable[..., Any], *, process: bool, name: str) -> None:
        self.function = function
        self.process = process
        self.name = name


def stage(function: Callable[..., Any], *, process: bool = False, name: str | None = None) -> Stage:
    """The task of a pure function; `process` gives each run a fresh process of its own."""
    return Stage(function, process=process, name=name or function.__name__)
