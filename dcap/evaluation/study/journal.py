"""The votes of a study: a file with one JSON line per vote, which stays intact if the server is killed.

A vote counts once it is on the disk (`fsync`), before its rater gets the reply. Bytes after the last end of line were
never acknowledged, and are cut off when the journal is opened again. The key of a vote is (rater, item, axis): of
repeated lines the last one counts, so no vote counts twice. A journal is open in one process at a time.
"""

import fcntl
import json
import os
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from typing import Self

from dcap.evaluation.statistics.comparisons import AXES, JudgedAxis
from dcap.evaluation.study.design import Side
from dcap.scene.errors import InputError

JOURNAL = "votes.jsonl"
VoteKey = tuple[str, str, JudgedAxis]
"""Rater, item and axis."""


@dataclass(frozen=True, slots=True)
class StudyVote:
    """One rater's answer to one question of one comparison."""

    rater: str
    item: str
    sample: str
    axis: JudgedAxis
    left: str
    """Method of the placement on the left."""
    right: str
    winner: Side
    lifted: Side | None
    """The side with the floating copy of an attention check; None: a true comparison."""
    seconds: float
    """Time from showing the two placements to the answer of the whole page [s]."""

    @property
    def key(self) -> VoteKey:
        """Unique key of a vote."""
        return self.rater, self.item, self.axis

    @property
    def winning_method(self) -> str:
        """The method that was preferred."""
        return self.left if self.winner is Side.LEFT else self.right

    def line(self) -> bytes:
        """The vote as a line of the journal."""
        tree = {name: getattr(self, name) for name in self.__slots__}
        return (json.dumps(tree, ensure_ascii=False) + "\n").encode()


def vote_of_line(line: bytes, where: str) -> StudyVote:
    """The vote in a line; InputError if it is invalid."""
    try:
        tree = json.loads(line)
        lifted = tree["lifted"]
        return StudyVote(
            rater=str(tree["rater"]), item=str(tree["item"]), sample=str(tree["sample"]), axis=JudgedAxis(tree["axis"]),
            left=str(tree["left"]), right=str(tree["right"]), winner=Side(tree["winner"]),
            lifted=None if lifted is None else Side(lifted), seconds=float(tree["seconds"]),
        )  # fmt: skip
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(f"{where} is no vote ({type(error).__name__}: {error}); repair or remove that line") from None


def whole_lines(data: bytes) -> bytes:
    """The bytes up to and including the last end of line."""
    return data[: data.rfind(b"\n") + 1]


def counted(votes: Iterable[StudyVote]) -> tuple[StudyVote, ...]:
    """The last vote on each question by each rater, in the order of their first votes."""
    last = {vote.key: vote for vote in votes}
    return tuple(last.values())


def parsed(data: bytes, path: Path) -> tuple[StudyVote, ...]:
    """The votes that count in a journal's bytes; an incomplete last line is left out."""
    rows = whole_lines(data).splitlines()
    return counted(vote_of_line(row, f"{path}: line {number}") for number, row in enumerate(rows, 1))


def read_votes(folder: Path) -> tuple[StudyVote, ...]:
    """The votes of a study so far, even while it is served; none if nobody has voted yet."""
    path = folder / JOURNAL
    return parsed(path.read_bytes(), path) if path.is_file() else ()


class VoteJournal:
    """The open journal of a study; votes may be added from several threads."""

    def __init__(self, folder: Path, questions: Sequence[JudgedAxis] = AXES) -> None:
        """Open the journal; `questions` are those of each comparison."""
        self._questions = tuple(questions)
        self._path, self._lock = folder / JOURNAL, Lock()
        self._votes: dict[VoteKey, StudyVote] = {}
        self._answered: defaultdict[str, set[str]] = defaultdict(set)
        self._file = os.open(self._path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            data = self._path.read_bytes()
            self._count(parsed(data, self._path))
            self._size = len(whole_lines(data))
            os.ftruncate(self._file, self._size)
            os.fsync(self._file)
            sync_folder(folder)
        except BlockingIOError:
            os.close(self._file)
            raise InputError(f"{folder.parent}: its study is served already; stop that server first") from None
        except BaseException:
            os.close(self._file)
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        os.close(self._file)

    @property
    def votes(self) -> tuple[StudyVote, ...]:
        """The votes that count, in the order in which they were given."""
        with self._lock:
            return tuple(self._votes.values())

    def answered(self, rater: str) -> frozenset[str]:
        """The items whose questions a rater has all answered."""
        with self._lock:
            return frozenset(self._answered.get(rater, ()))

    def add(self, votes: Sequence[StudyVote]) -> bool:
        """Write the votes of one comparison to the disk; False if that rater has answered it before.

        OSError if they cannot be written; none of them counts then.
        """
        with self._lock:
            if all(vote.key in self._votes for vote in votes):
                return False
            data = b"".join(vote.line() for vote in votes)
            try:
                written = os.pwrite(self._file, data, self._size)
                if written < len(data):
                    raise OSError(f"only {written} of {len(data)} bytes could be written to {self._path}")
                os.fsync(self._file)
            except OSError:
                os.ftruncate(self._file, self._size)
                raise
            self._size += len(data)
            self._count(votes)
            return True

    def _count(self, votes: Sequence[StudyVote]) -> None:
        """Count votes, and note the comparisons that they complete: every page needs these."""
        self._votes.update({vote.key: vote for vote in votes})
        for rater, item in {(vote.rater, vote.item) for vote in votes}:
            if all((rater, item, axis) in self._votes for axis in self._questions):
                self._answered[rater].add(item)


def sync_folder(folder: Path) -> None:
    """Make sure that a new file's name is on the disk, too."""
    opened = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(opened)
    finally:
        os.close(opened)
