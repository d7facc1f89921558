"""The tree of errors that a person can act on, and problems of files with their severity.

The tree of errors that a person can act on.

Every message says what went wrong, where, which value and which knob. `exit_code` is what the command line returns.

What is wrong with a file, and how bad it is.

A reader's functions tell a `Report` of each problem that they meet and go on. Whoever reads to use the file gives
`refusing`, which raises at the first error; whoever checks it gives a list. So both follow the same rules.
"""

import reprlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path

Place = tuple[str | int, ...]
"""Where in a tree of JSON or YAML: the keys and indices that lead there."""


class DcapError(Exception):
    """Root of all errors raised on purpose outside of `solver`."""

    exit_code = 2


class InputError(DcapError):
    """A path, option, key or value that the user gave cannot be used."""


class FormatError(InputError):
    """A file breaks the format it claims to have; names the file and the offset, element or key."""


class GeometryError(DcapError):
    """A mesh or point set cannot be used for what was asked."""


class NothingBeneathError(GeometryError):
    """A base has no surface where an object is to be dropped onto it."""


class LanguageError(DcapError):
    """A prompt was not understood, or a model's reply was invalid to the end."""


class RefusedError(LanguageError):
    """A model's API has told that it does not take a call: nothing was done, nothing is charged."""


class BudgetError(LanguageError):
    """What may be spent on a model is spent."""


class StoreError(DcapError):
    """An artifact is missing or does not match its digest."""


class MissingArtifactError(StoreError):
    """An artifact that a cache record names is gone or damaged: recompute it."""


class MachineError(DcapError):
    """What the program needs of its machine is not to be had: room on a disk, rights, memory, open files, a server."""


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
