"""The tree of errors that a person can act on, and problems of files with their severity.

Every message says what went wrong, where, with which value, and which setting to change. `exit_code` is returned by the
command line.

Problems of a file and their severity.

The functions of a reader pass each problem to a `Report` and continue. To use a file, pass `refusing`, which raises at
the first error; to check a file, pass one that collects. Both follow the same rules.
"""

import reprlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path

Place = tuple[str | int, ...]
"""Place in a tree of JSON or YAML: the keys and indices that lead there."""


class DcapError(Exception):
    """Root of all errors raised deliberately outside `solver`."""

    exit_code = 2


class InputError(DcapError):
    """A path, option, key or value given by the user cannot be used."""


class FormatError(InputError):
    """A file violates its format; names the file and the offset, element or key."""


class GeometryError(DcapError):
    """A mesh or point set cannot be used for the requested purpose."""


class NothingBeneathError(GeometryError):
    """A base has no surface below the start of the drop."""


class LanguageError(DcapError):
    """A prompt was not understood, or a model's replies remained invalid."""


class RefusedError(LanguageError):
    """The API of a model has rejected a call: nothing was done, nothing is charged."""


class BudgetError(LanguageError):
    """The budget for calls of a model is exhausted."""


class StoreError(DcapError):
    """An artifact is missing or does not match its digest."""


class MissingArtifactError(StoreError):
    """An artifact named by a cache record is missing or damaged: recompute it."""


class MachineError(DcapError):
    """A resource of the machine is not available: disk space, permissions, memory, open files, a server."""


class Severity(StrEnum):
    """Severity of a problem."""

    ERROR = "error"
    """The file, or the entry in question, cannot be used."""
    WARNING = "warning"
    """It is used, but probably not as intended."""
    NOTE = "note"
    """Worth knowing; such files are common and are read as intended."""


@dataclass(frozen=True, slots=True)
class Problem:
    """One problem of a file."""

    severity: Severity
    what: str
    """The problem, the value, and what to do."""
    place: Place = ()
    line: int = 0
    """Line number if known, from 1; otherwise 0, and the place, or the field named in `what`, locates the problem."""


Report = Callable[[Problem], None]
"""Function that receives a problem."""


def error(what: str, place: Place = (), line: int = 0) -> Problem:
    """A problem that makes the file unusable."""
    return Problem(Severity.ERROR, what, place, line)


def warning(what: str, place: Place = (), line: int = 0) -> Problem:
    """A problem with a workaround."""
    return Problem(Severity.WARNING, what, place, line)


def note(what: str, place: Place = (), line: int = 0) -> Problem:
    """A fact worth knowing."""
    return Problem(Severity.NOTE, what, place, line)


def refusing(path: Path) -> Report:
    """A report that raises FormatError at the first error and ignores everything else."""

    def report(problem: Problem) -> None:
        if problem.severity is Severity.ERROR:
            line = f"line {problem.line}: " if problem.line else ""
            raise FormatError(f"{path}: {line}{problem.what}")

    return report


def lenient(report: Report) -> Report:
    """A report that turns errors into warnings."""

    def lowered(problem: Problem) -> None:
        report(replace(problem, severity=Severity.WARNING) if problem.severity is Severity.ERROR else problem)

    return lowered


_SHORT = reprlib.Repr()
_SHORT.maxlevel = 3  # six values on each level: the default of six levels would fill pages


def short(value: object) -> str:
    """A value for a message, shortened if it is long."""
    try:
        return _SHORT.repr(value)
    except ValueError:  # Python prints no integer of more than 4300 digits, but hexadecimal YAML may contain one
        return f"<{type(value).__name__} that is too long to write>"
