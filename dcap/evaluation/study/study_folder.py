"""The folder `study/` of a run: the design, the raters' links, the journal of votes, and their export.

`study.json` holds each rater's comparisons; `tokens.json` (readable by its owner alone) the secret link of each rater.
Both are written once and only ever extended: a rater who joins later changes nothing for the earlier ones.

`votes.jsonl` has one JSON line per vote and stays intact if the server is killed. A vote counts once it is on the disk
(`fsync`), before its rater gets the reply. Bytes after the last end of line were never acknowledged, and are cut off
when the journal is opened again. The key of a vote is (rater, item, axis): of repeated lines the last one counts, so no
vote counts twice. A journal is open in one process at a time.
"""

import fcntl
import json
import os
import secrets
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from threading import Lock
from typing import Annotated, Any, Self

import pyarrow as pa
import pyarrow.parquet as pq
from pydantic import BeforeValidator, PlainSerializer, TypeAdapter, ValidationError

from dcap.evaluation.statistics.comparisons import AXES, JudgedAxis
from dcap.evaluation.study.design import MethodPairs, Side, StudyItem, questions_of, rater_items, showings_of
from dcap.scene.errors import InputError
from dcap.scene.text import first_mistake
from dcap.scene.written_files import whole_file

JOURNAL = "votes.jsonl"
VoteKey = tuple[str, str, JudgedAxis]
"""Rater, item and axis."""
STUDY_FOLDER, DESIGN, TOKENS, VOTES = "study", "study.json", "tokens.json", "votes.parquet"
VERSION = 2
TOKEN_BYTES = 24
"""Random bytes in a rater's link: nobody guesses 192 bits."""
VOTE_COLUMNS = pa.schema([
    ("rater", pa.string()), ("item", pa.string()), ("sample", pa.string()), ("axis", pa.string()),
    ("left_method", pa.string()), ("right_method", pa.string()), ("winner", pa.string()), ("judge", pa.string()),
    ("attention_check", pa.bool_()), ("expected", pa.string()), ("seconds", pa.float64()),
])  # fmt: skip
JUDGE = "human"


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
        return VOTE.dump_json(self) + b"\n"


VOTE = TypeAdapter(StudyVote)


def vote_of_line(line: bytes, where: str) -> StudyVote:
    """The vote in a line; InputError if it is invalid."""
    try:
        return VOTE.validate_json(line)
    except ValidationError as error:
        raise InputError(f"{where} is no vote ({first_mistake(error)}); repair or remove that line") from None


def whole_lines(data: bytes) -> bytes:
    """The bytes up to and including the last end of line."""
    return data[: data.rfind(b"\n") + 1]


def parsed(data: bytes, path: Path) -> tuple[StudyVote, ...]:
    """The votes that count in a journal's bytes, the last on each question by each rater, in the order of their first
    votes; an incomplete last line is left out."""
    rows = whole_lines(data).splitlines()
    votes = (vote_of_line(row, f"{path}: line {number}") for number, row in enumerate(rows, 1))
    return tuple({vote.key: vote for vote in votes}.values())


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


def pairs_of_rows(rows: Sequence[Mapping[str, Any]]) -> dict[tuple[str, ...], tuple[str, ...]]:
    """Pairs of methods from the rows of study.json: JSON has no pairs as keys."""
    return {tuple(row["methods"]): tuple(row["samples"]) for row in rows}


def rows_of_pairs(pairs: MethodPairs) -> list[dict[str, list[str]]]:
    """Pairs of methods as rows of study.json."""
    return [{"methods": list(pair), "samples": list(samples)} for pair, samples in pairs.items()]


@dataclass(frozen=True, slots=True)
class StudyDesign:
    """The common design, and the comparisons of each rater."""

    seed: int
    per_pair: int
    """Number of times a rater compares each pair of methods [-]."""
    pairs: Annotated[MethodPairs, BeforeValidator(pairs_of_rows), PlainSerializer(rows_of_pairs)]
    checks: tuple[tuple[str, str], ...]
    """(method, sample) of the placements with a floating copy, in the order of its folders."""
    left_out: Mapping[str, str]
    """Placements that are not shown, METHOD/SAMPLE, and why."""
    raters: Mapping[str, tuple[StudyItem, ...]]
    states: Mapping[str, str] = field(default_factory=dict)
    """Fingerprint of the final state of each placement that may be shown, by the name of its sample, when the study
    began."""
    asks_overall: bool = False
    """Whether there is a third question, which of the two is better overall; without it overall is the composite."""

    @property
    def questions(self) -> tuple[JudgedAxis, ...]:
        """Questions of each comparison."""
        return questions_of(self.asks_overall)

    def with_raters(self, count: int) -> "StudyDesign":
        """The design with at least `count` raters."""
        before = showings_of(self.pairs, (item for given in self.raters.values() for item in given))
        items = {
            f"r{n + 1:02d}": rater_items(self.pairs, self.checks, self.per_pair, n, self.seed, before)
            for n in range(len(self.raters), count)
        }
        return replace(self, raters={**self.raters, **items})


DESIGNS = TypeAdapter(StudyDesign)


def read_design(folder: Path) -> StudyDesign | None:
    """The design in the folder of a study; None if there is none yet."""
    path = folder / DESIGN
    if not path.is_file():
        return None
    try:
        tree = json.loads(path.read_text(encoding="utf-8"))
        if tree["version"] != VERSION:
            raise InputError(f"{path}: version {tree['version']} of a study, this dcap reads {VERSION}")
        return DESIGNS.validate_python(tree)
    except ValidationError as error:
        raise InputError(f"{path}: not a study's design ({first_mistake(error)})") from None
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(f"{path}: not a study's design ({type(error).__name__}: {error})") from None


def write_design(folder: Path, design: StudyDesign) -> None:
    """Keep the design."""
    tree = {"version": VERSION, **DESIGNS.dump_python(design, mode="json")}
    write_lasting(folder / DESIGN, json.dumps(tree, indent=1, ensure_ascii=False).encode() + b"\n")


def tokens_for(folder: Path, raters: Sequence[str]) -> dict[str, str]:
    """The secret word of each rater's link, by rater; made and stored for those without one."""
    path = folder / TOKENS
    try:
        known = json.loads(path.read_bytes()) if path.is_file() else {}
        tokens = {str(rater): str(token) for rater, token in known.items()}
    except (OSError, ValueError, AttributeError) as error:
        raise InputError(f"{path}: not the links of a study ({error})") from None
    tokens.update({rater: secrets.token_urlsafe(TOKEN_BYTES) for rater in raters if rater not in tokens})
    write_lasting(path, json.dumps(tokens, indent=1).encode() + b"\n", mode=0o600)
    return tokens


def write_lasting(path: Path, data: bytes, mode: int = 0o644) -> None:
    """Write a file atomically; it is on the disk when this returns."""
    with whole_file(path, mode) as draft, draft.open("wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())
    sync_folder(path.parent)


def export_votes(folder: Path, votes: Sequence[StudyVote]) -> Path:
    """Write votes.parquet: a row for each vote that counts, attention checks marked."""
    rows = [
        {
            "rater": vote.rater, "item": vote.item, "sample": vote.sample, "axis": vote.axis.value,
            "left_method": vote.left, "right_method": vote.right, "winner": vote.winner.value, "judge": JUDGE,
            "attention_check": vote.lifted is not None,
            "expected": vote.lifted.other.value if vote.lifted else None, "seconds": vote.seconds,
        }
        for vote in votes
    ]  # fmt: skip
    with whole_file(folder / VOTES) as draft:
        pq.write_table(pa.Table.from_pylist(rows, schema=VOTE_COLUMNS), draft)
    return folder / VOTES
