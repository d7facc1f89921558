"""Findings of a check: problems with their file and line, and the lines of values in JSON and YAML.

The ordinary parsers read the trees; this module scans the same text again, only when a line number is requested. Works
for any text that those parsers accept, without recursion for JSON and without expanding YAML aliases.
"""

import json
import re
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError
from ruamel.yaml.nodes import MappingNode, SequenceNode

from dcap.scene.errors import Place, Problem, Report, Severity

TOKEN = re.compile(r'"(?:[^"\\]|\\.)*"|[{}\[\],:]|\n|[^\s{}\[\],:"]+')
"""Strings, marks, ends of lines, and everything else (numbers, true, false, null)."""

Lines = Callable[[Place], int]
"""Function that returns the line of a place, counted from 1; for a missing place the line of its nearest ancestor."""
MOST_PER_FILE = 1000
"""Maximum number of problems listed individually per file; the rest are only counted [-]."""


def json_lines(text: str) -> Lines:
    """Lines of the values of valid JSON text."""
    found: dict[Place, int] = {}

    def line(place: Place) -> int:
        if not found:
            found.update((where, number) for where, number, _ in json_places(text))
        return next(found[place[:end]] for end in range(len(place), -1, -1) if place[:end] in found)

    return line


def repeated_keys(text: str) -> Iterator[tuple[Place, int]]:
    """Places and lines of keys that occur repeatedly in one object of valid JSON text: only the last one counts."""
    seen: set[Place] = set()
    for place, line, is_key in json_places(text):
        if is_key and place in seen:
            yield place, line
        seen.add(place)


@dataclass(slots=True)
class _Open:
    """An object or list that has not been closed yet."""

    place: Place
    is_object: bool
    step: str | int | None
    """Key or index of the next value; None if a key must come first."""
    line: int = 0
    """Line of the key."""


def json_places(text: str) -> Iterator[tuple[Place, int, bool]]:
    """Every value of valid JSON text: its place, its line (in an object the line of its key) and whether it has a
    key."""
    line = 1
    around: list[_Open] = []
    for match in TOKEN.finditer(text):
        token, inner = match.group(), around[-1] if around else None
        if token == "\n":
            line += 1
        elif token in "]}":
            around.pop()
        elif token == "," and inner is not None:
            inner.step = inner.step + 1 if isinstance(inner.step, int) else None
        elif token == ":":
            continue
        elif inner is not None and inner.step is None:
            inner.step, inner.line = json.loads(token), line
        else:
            place = () if inner is None or inner.step is None else (*inner.place, inner.step)
            has_key = inner is not None and inner.is_object
            yield place, inner.line if inner is not None and has_key else line, has_key
            if token in "[{":
                around.append(_Open(place, token == "{", None if token == "{" else 0))


def yaml_lines(text: str) -> Lines:
    """Lines of the values of YAML text; always 0 if it cannot be parsed."""
    root: list[Any] = []

    def line(place: Place) -> int:
        if not root:
            try:
                root.append(YAML(typ="safe", pure=True).compose(text))
            except (YAMLError, RecursionError, ValueError):
                root.append(None)
        node, number = root[0], 1 if root[0] is not None else 0
        for step in place:
            found = _yaml_child(node, step)
            if found is None:
                break
            node, number = found
        return number

    return line


def _yaml_child(node: object, step: str | int) -> tuple[object, int] | None:
    """The value for a key, with the line of the key, or at an index, with its own line."""
    if isinstance(node, SequenceNode) and isinstance(step, int) and step < len(node.value):
        child = node.value[step]
        return child, child.start_mark.line + 1
    if isinstance(node, MappingNode):
        pairs = ((key, value) for key, value in node.value if str(key.value) == str(step))
        return next(((value, key.start_mark.line + 1) for key, value in pairs), None)
    return None


@dataclass(frozen=True, slots=True)
class Finding:
    """A problem and its location."""

    path: Path
    line: int
    """Line number from 1; 0 for a file without lines."""
    severity: Severity
    what: str

    def __str__(self) -> str:
        line = f":{self.line}" if self.line else ""
        return f"{self.path}{line}: {self.severity}: {' '.join(self.what.split())}"


@dataclass(slots=True)
class Findings:
    """Collects the problems of many files."""

    listed: list[Finding] = field(default_factory=list)
    unlisted: Counter[tuple[Path, Severity]] = field(default_factory=Counter)
    """Number of problems beyond MOST_PER_FILE, by file and severity."""
    _taken: Counter[Path] = field(default_factory=Counter)

    def report(self, path: Path, lines: Lines | None = None) -> Report:
        """A report for the problems of one file; `lines` finds the lines of places."""

        def report(problem: Problem) -> None:
            self._taken[path] += 1
            if self._taken[path] > MOST_PER_FILE:
                self.unlisted[path, problem.severity] += 1
                return
            line = problem.line or (lines(problem.place) if lines is not None else 0)
            self.listed.append(Finding(path, line, problem.severity, problem.what))

        return report

    def all(self) -> tuple[Finding, ...]:
        """All findings in order of path and line, and a line for problems that were only counted."""
        more = [
            Finding(path, 0, severity, f"{count} more problems of this kind are not listed")
            for (path, severity), count in self.unlisted.items()
        ]
        order = list(Severity)
        return tuple(sorted(self.listed, key=lambda f: (str(f.path), f.line, order.index(f.severity)))) + tuple(more)

    def count(self, severity: Severity) -> int:
        """Number of findings of a severity."""
        return sum(one.severity is severity for one in self.listed) + sum(
            count for (_, of), count in self.unlisted.items() if of is severity
        )
