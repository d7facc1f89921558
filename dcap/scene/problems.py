"""What is wrong with a file, and how bad it is.

A reader's functions tell a `Report` of each problem that they meet and go on. Whoever reads to use the file gives
`refusing`, which raises at the first error; whoever checks it gives a list. So both follow the same rules.
"""

import reprlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path

from dcap.scene.errors import FormatError

Place = tuple[str | int, ...]
"""Where in a tree of JSON or YAML: the keys and indices that lead there."""


class Severity(StrEnum):
    """How bad a problem is."""

    ERROR = "error"
    """The file, or what is told of, cannot be used."""
    WARNING = "warning"
    """It is used, and most likely not as it was meant."""
    NOTE = "note"
    """Worth knowing; such files are common and are read as they are meant."""


@dataclass(frozen=True, slots=True)
class Problem:
    """One thing that is wrong in a file."""

    severity: Severity
    what: str
    """What is wrong, which value, and what to do."""
    place: Place = ()
    line: int = 0
    """Line number where it is known, from 1; else the place, or the field that `what` names, tells."""


Report = Callable[[Problem], None]
"""Takes in one problem."""


def error(what: str, place: Place = (), line: int = 0) -> Problem:
    """A problem that makes the file unusable."""
    return Problem(Severity.ERROR, what, place, line)


def warning(what: str, place: Place = (), line: int = 0) -> Problem:
    """A problem that is worked around."""
    return Problem(Severity.WARNING, what, place, line)


def note(what: str, place: Place = (), line: int = 0) -> Problem:
    """Something worth knowing."""
    return Problem(Severity.NOTE, what, place, line)


def refusing(path: Path) -> Report:
    """A report that raises FormatError at the first error and lets everything else pass."""

    def report(problem: Problem) -> None:
        if problem.severity is Severity.ERROR:
            line = f"line {problem.line}: " if problem.line else ""
            raise FormatError(f"{path}: {line}{problem.what}")

    return report


def lenient(report: Report) -> Report:
    """A report that takes errors as warnings."""

    def lowered(problem: Problem) -> None:
        report(replace(problem, severity=Severity.WARNING) if problem.severity is Severity.ERROR else problem)

    return lowered


_SHORT = reprlib.Repr()
_SHORT.maxlevel = 3  # six values on each level: the usual six levels make pages


def short(value: object) -> str:
    """A value for a message, cut where it is long."""
    try:
        return _SHORT.repr(value)
    except ValueError:  # Python writes no integer of more than 4300 digits, which hexadecimal YAML may hold
        return f"<{type(value).__name__} that is too long to write>"
