"""The tree of errors that a person can act on, and problems of files with their severity.

Every message says what went wrong, where, with which value, and which setting to change. `exit_code` is returned by the
command line.

Readers of meshes, splats and points raise at the first problem of a file. Annotations have many small entries, so their
readers pass each problem to a `Report` and continue: `refusing` raises at the first error, a check collects all.
"""

import reprlib
from collections.abc import Callable
from dataclasses import dataclass
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

    problem: "Problem | None" = None
    """The problem without the file's name, if its line or place is known."""


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


def format_error(path: Path, what: str, place: Place = (), line: int = 0) -> FormatError:
    """The error for a problem at a line or place of a file."""
    broken = FormatError(f"{path}: line {line}: {what}" if line else f"{path}: {what}")
    broken.problem = error(what, place, line)
    return broken


def refusing(path: Path) -> Report:
    """A report that raises FormatError at the first error and ignores everything else."""

    def report(problem: Problem) -> None:
        if problem.severity is Severity.ERROR:
            raise format_error(path, problem.what, problem.place, problem.line)

    return report


_SHORT = reprlib.Repr()
_SHORT.maxlevel = 3  # six values on each level: the default of six levels would fill pages


def short(value: object) -> str:
    """A value for a message, shortened if it is long."""
    try:
        return _SHORT.repr(value)
    except ValueError:  # Python prints no integer of more than 4300 digits, but hexadecimal YAML may contain one
        return f"<{type(value).__name__} that is too long to write>"
