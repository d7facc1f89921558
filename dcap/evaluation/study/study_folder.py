"""The folder `study/` of a run: the design, the raters' links, and the export of the votes.

`study.json` holds each rater's comparisons; `tokens.json` (readable by its owner alone) the secret link of each rater.
Both are written once and only ever extended: a rater who joins later changes nothing for the earlier ones.
"""

import json
import os
import secrets
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from dcap.evaluation.statistics.comparisons import JudgedAxis
from dcap.evaluation.study.design import MethodPairs, Side, StudyItem, questions_of, rater_items, showings_of
from dcap.evaluation.study.journal import StudyVote, sync_folder
from dcap.scene.errors import InputError
from dcap.scene.json_tree import whole_file

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
class StudyDesign:
    """The common design, and the comparisons of each rater."""

    seed: int
    per_pair: int
    """Number of times a rater compares each pair of methods [-]."""
    pairs: MethodPairs
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
            rater_name(n): rater_items(self.pairs, self.checks, self.per_pair, n, self.seed, before)
            for n in range(len(self.raters), count)
        }
        return replace(self, raters={**self.raters, **items})


def rater_name(number: int) -> str:
    """Name under which a rater's votes are stored; it does not identify the person."""
    return f"r{number + 1:02d}"


def read_design(folder: Path) -> StudyDesign | None:
    """The design in the folder of a study; None if there is none yet."""
    path = folder / DESIGN
    if not path.is_file():
        return None
    try:
        tree = json.loads(path.read_text(encoding="utf-8"))
        if tree["version"] != VERSION:
            raise InputError(f"{path}: version {tree['version']} of a study, this dcap reads {VERSION}")
        return StudyDesign(
            seed=int(tree["seed"]),
            per_pair=int(tree["per_pair"]),
            pairs={(one["methods"][0], one["methods"][1]): tuple(one["samples"]) for one in tree["pairs"]},
            checks=tuple((str(method), str(sample)) for method, sample in tree["checks"]),
            left_out=dict(tree["left_out"]),
            raters={str(name): tuple(map(item_of_tree, items)) for name, items in tree["raters"].items()},
            states={str(name): str(state) for name, state in tree.get("states", {}).items()},
            asks_overall=bool(tree["asks_overall"]),
        )
    except (OSError, ValueError, KeyError, TypeError, IndexError) as error:
        raise InputError(f"{path}: not a study's design ({type(error).__name__}: {error})") from None


def item_of_tree(tree: Mapping[str, str | None]) -> StudyItem:
    """A comparison that `asdict` wrote."""
    lifted = tree["lifted"]
    item, sample, left, right = (str(tree[name]) for name in ("item", "sample", "left", "right"))
    return StudyItem(item, sample, left, right, None if lifted is None else Side(lifted))


def write_design(folder: Path, design: StudyDesign) -> None:
    """Keep the design."""
    tree = {
        "version": VERSION,
        "seed": design.seed,
        "per_pair": design.per_pair,
        "pairs": [{"methods": list(pair), "samples": list(samples)} for pair, samples in design.pairs.items()],
        "checks": [list(one) for one in design.checks],
        "left_out": dict(design.left_out),
        "raters": {name: [asdict(item) for item in items] for name, items in design.raters.items()},
        "states": dict(design.states),
        "asks_overall": design.asks_overall,
    }
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
