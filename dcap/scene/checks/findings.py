"""Findings of a check: problems with their file and line."""

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

from dcap.scene.checks.places import Lines
from dcap.scene.problems import Problem, Report, Severity

MOST_PER_FILE = 1000
"""Most problems of one file that are listed one by one; more are counted [-]."""


@dataclass(frozen=True, slots=True)
class Finding:
    """A problem and where it is."""

    path: Path
    line: int
    """From 1; 0 for a file without lines."""
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
    """Problems beyond MOST_PER_FILE by file and severity."""
    _taken: Counter[Path] = field(default_factory=Counter)

    def report(self, path: Path, lines: Lines | None = None) -> Report:
        """A report for the problems of one file; `lines` finds those of places."""

        def report(problem: Problem) -> None:
            self._taken[path] += 1
            if self._taken[path] > MOST_PER_FILE:
                self.unlisted[path, problem.severity] += 1
                return
            line = problem.line or (lines(problem.place) if lines is not None else 0)
            self.listed.append(Finding(path, line, problem.severity, problem.what))

        return report

    def all(self) -> tuple[Finding, ...]:
        """All findings in order of path and line, and a line for problems that are only counted."""
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
