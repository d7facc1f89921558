"""The paper's sections 4.1 to 4.4, statement by statement, with the files of a run that answer each, or why none
does."""

import csv
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

SENTENCES = Path(__file__).with_name("sentences.csv")
MOST_LINKS = 4
"""Most linked files of one statement [-]."""


@dataclass(frozen=True, slots=True)
class PaperSentence:
    """A statement and its files in a run."""

    section: str
    topic: str
    """In our words."""
    files: tuple[str, ...]
    """Existing files, relative to the run; the first MOST_LINKS."""
    more: int
    """Number of further files."""
    lacking: tuple[str, ...]
    """Patterns that no file of the run fits."""
    note: str
    """A note, or why there is no file."""


def paper_sentences(run: Path) -> list[PaperSentence]:
    """All statements, in the paper's order."""
    return list(found_in(run))


def found_in(run: Path) -> Iterator[PaperSentence]:
    """Find the files of each statement."""
    with SENTENCES.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    for row in rows:
        files: list[str] = []
        more, lacking = 0, []
        for pattern in row["files"].split():
            there = sorted(one.relative_to(run).as_posix() for one in run.glob(pattern))
            if not there:
                lacking.append(pattern)
            files += there[:1] if "*" in pattern else there
            more += max(len(there) - 1, 0) if "*" in pattern else 0
        yield PaperSentence(row["section"], row["topic"], tuple(files[:MOST_LINKS]), more, tuple(lacking), row["note"])
