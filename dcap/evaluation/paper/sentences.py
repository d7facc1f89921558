"""The paper's sections 4.1 to 4.4, statement by statement: which files of a run answer each, or why none does."""

import csv
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

SENTENCES = Path(__file__).with_name("sentences.csv")
MOST_LINKS = 4
"""Files of one statement that are linked [-]."""


@dataclass(frozen=True, slots=True)
class PaperSentence:
    """A statement and what a run has of it."""

    section: str
    topic: str
    """In our words."""
    files: tuple[str, ...]
    """That are there, relative to the run; the first MOST_LINKS."""
    more: int
    """How many more there are."""
    lacking: tuple[str, ...]
    """Patterns that no file of the run fits."""
    note: str
    """What to know, or why there is no file."""


def paper_sentences(run: Path) -> list[PaperSentence]:
    """All statements, in the paper's order."""
    return list(found_in(run))


def found_in(run: Path) -> Iterator[PaperSentence]:
    """Look each up."""
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
