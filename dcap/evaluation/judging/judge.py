"""Lets a judge score placements and compare all pairs by their pictures, and writes the folder `judging/`.

In: placements with their pictures and metrics, and a client. Out: rows of scores and comparisons, in an order that
depends on the placements alone, so that recorded replies give the same tables to the last byte. Pairs are formed within
a sample only. Questions are independent of each other, so a batch may hold them all.

`scores.parquet` has a row for each placement, `comparisons.parquet` one for each axis of each comparison; `judge.json`
describes the judge and its reliability. The same judgement gives the same bytes, except for its cost.

The same rule applies to every method and judge. Samples that should be infeasible are left out, because they have no
good placement. Any other placement is judged if it has a final state. A method that finds no place, or fails, gets the
lowest score on both axes without a question, so that refusing hard samples does not pay. If no intended outcome is
stated, a method that finds no place may be right, so its sample is left out. Comparisons need a final state of both
methods.
"""

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from enum import StrEnum
from itertools import combinations, pairwise
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from dcap.evaluation.judging.questions import (
    CAPTIONS,
    JUDGE_PAIR,
    JUDGE_SCORE,
    PairRequest,
    ScoreRequest,
    example_pictures,
)
from dcap.evaluation.judging.rubric import RUBRIC, WORST, Metrics
from dcap.evaluation.outcome_table import AS_POSED, AT_REST, SampleOutcome
from dcap.evaluation.statistics.agreement import SideReport, side_report
from dcap.evaluation.statistics.comparisons import Comparison, JudgedAxis, on_axis, write_comparisons
from dcap.language.connect import Client
from dcap.language.model.ledger import Spending
from dcap.language.protocol.client import ClientName, LanguageConfig
from dcap.language.protocol.requests import Picture
from dcap.scene.errors import FormatError, InputError
from dcap.scene.readers.files import read_image
from dcap.scene.written_files import object_to_json, whole_file, write_whole

BEFORE_TITLES = ("the scene before the object is placed", "the object alone")
"""Captions for a judge of the pictures that all methods of a sample share."""
MODELS = {
    "alibaba": "qwen qwq qvq", "allen": "olmo molmo", "amazon": "nova", "anthropic": "claude", "cohere": "command aya",
    "deepseek": "deepseek", "google": "gemini gemma paligemma", "ibm": "granite", "meta": "llama", "microsoft": "phi",
    "mistral": "mistral mixtral pixtral ministral magistral codestral devstral", "moonshot": "kimi moonshot",
    "nvidia": "nemotron", "openai": "gpt chatgpt o1 o3 o4", "openbmb": "minicpm", "opengvlab": "internvl internlm",
    "xai": "grok", "zhipu": "glm chatglm cogvlm",
}  # fmt: skip
"""Names of models by maker."""
FAMILIES = {name: maker for maker, names in MODELS.items() for name in names.split()}
"""Makers by a word of a model's name."""
LEADING = re.compile(r"(?:[a-z]+\.)*([a-z]{2,})")
"""The word before the first digit, dash or colon, without dotted prefixes: `us.maker.word-7b`. A single letter is a
version: `v2`."""
JUDGING, SCORES, COMPARISONS, JUDGE = "judging", "scores.parquet", "comparisons.parquet", "judge.json"
SCORE_COLUMNS = pa.schema([
    ("sample", pa.string()), ("method", pa.string()), ("right_place", pa.float64()),
    ("physics_naturalness", pa.float64()), ("judge", pa.string()), ("analysis", pa.string()),
])  # fmt: skip


def pictures_in(folder: Path, names: Sequence[str]) -> tuple[Picture, ...]:
    """`NAME.png` of a folder of views for each name; InputError for a missing one."""
    if not names:
        raise InputError(f"{folder}: no view is named; a judge needs at least one")
    return tuple(picture_at(folder / f"{name}.png", name) for name in names)


def picture_at(path: Path, name: str) -> Picture:
    """A picture that is read on demand; InputError at once if there is none."""
    if not path.is_file():
        raise InputError(f"{path}: no such picture; a judge needs the run's views")
    return Picture(name, lambda: read_image(path.read_bytes(), str(path)))


@dataclass(frozen=True, slots=True)
class JudgedPlacement:
    """One method's placement of a sample, in the form that a judge takes."""

    sample: str
    method: str
    prompt: str
    object_name: str
    metrics: Metrics
    before: tuple[Picture, ...]
    """The clean scene and the asset alone: the same for all methods of a sample."""
    views: tuple[Picture, ...]
    """The overview, from one camera for all methods of a sample, and the close-up, centred on the contact from the same
    direction and distance."""


@dataclass(frozen=True, slots=True)
class JudgedScore:
    """A row of scores."""

    sample: str
    method: str
    right_place: float | None
    """1..10; None if no metric of the axis is known."""
    physics_naturalness: float | None
    """1..10; None likewise."""
    judge: str
    analysis: str


def judge_name(config: LanguageConfig) -> str:
    """Name of the judge in tables; a replayed model has its original name."""
    if config.client is ClientName.OFFLINE:
        return RUBRIC
    return f"{config.model}@{config.endpoint}" if config.endpoint else config.model


def model_family(model: str) -> str:
    """Maker of a model, from the first known word of its name; else the first word of the last part of its path, which
    gateways, regions and owners precede and sizes and versions follow. A name without such a word is its own family."""
    name = model.lower()
    for word in re.findall(r"[a-z]+\d?", name):
        if family := FAMILIES.get(word) or FAMILIES.get(word.rstrip("0123456789")):
            return family
    leading = LEADING.match(name.rpartition("/")[2])
    return leading[1] if leading else name


def same_family(judge: LanguageConfig, chooser: LanguageConfig) -> bool:
    """Whether judge and chooser are models of the same maker; a judge may favour its own."""
    if ClientName.OFFLINE in (judge.client, chooser.client):
        return False
    return model_family(judge.model) == model_family(chooser.model)


def scores(client: Client, placements: Sequence[JudgedPlacement], judge: str) -> list[JudgedScore]:
    """Both scores of every placement, sorted by sample and method."""
    rows = in_order(placements)
    replies = client.ask_all(JUDGE_SCORE, [score_request(one) for one in rows])
    return [
        JudgedScore(one.sample, one.method, reply.right_place, reply.physics_naturalness, judge, reply.analysis)
        for one, reply in zip(rows, replies, strict=True)
    ]


def comparisons(client: Client, placements: Sequence[JudgedPlacement], judge: str) -> list[Comparison]:
    """All pairs of methods of each sample, in both orders, on the axes that are known for both."""
    asked = [pair for one in pairs(placements) for pair in (one, one[::-1])]
    replies = client.ask_all(JUDGE_PAIR, [pair_request(left, right) for left, right in asked])
    return [
        Comparison(left.sample, axis, left.method, right.method, winner, judge)
        for (left, right), reply in zip(asked, replies, strict=True)
        for axis in JudgedAxis
        if (winner := reply.winner(axis)) is not None
    ]


def pairs(placements: Iterable[JudgedPlacement]) -> list[tuple[JudgedPlacement, JudgedPlacement]]:
    """All pairs of methods within a sample."""
    return [(a, b) for a, b in combinations(in_order(placements), 2) if a.sample == b.sample]


def in_order(placements: Iterable[JudgedPlacement]) -> list[JudgedPlacement]:
    """Placements sorted by sample and method; InputError for a duplicate."""
    rows = sorted(placements, key=lambda one: (one.sample, one.method))
    for one, after in pairwise(rows):
        if (one.sample, one.method) == (after.sample, after.method):
            raise InputError(f"sample {one.sample!r} of {one.method} is to be judged twice")
    return rows


def score_request(one: JudgedPlacement) -> ScoreRequest:
    """The question for two scores."""
    shown = (*titled(one.before), *captioned("the placement", one.views))
    return ScoreRequest(one.prompt, one.object_name, one.metrics, example_pictures(), shown)


def pair_request(left: JudgedPlacement, right: JudgedPlacement) -> PairRequest:
    """The question which placement is better; InputError if their views differ."""
    if [v.name for v in left.views] != [v.name for v in right.views] or left.prompt != right.prompt:
        raise InputError(
            f"sample {left.sample!r}: {left.method} and {right.method} have other views or prompts; "
            "a pair needs the same of both"
        )
    shown = (
        *titled(left.before), *captioned("placement A", left.views), *captioned("placement B", right.views),
    )  # fmt: skip
    return PairRequest(left.prompt, left.object_name, left.metrics, right.metrics, shown)


def captioned(which: str, views: tuple[Picture, ...]) -> tuple[Picture, ...]:
    """The views of a placement with their captions."""
    return tuple(Picture(f"{which}, {CAPTIONS.get(one.name, one.name)}", one.make) for one in views)


def titled(before: tuple[Picture, ...]) -> tuple[Picture, ...]:
    """The clean scene and the asset with their captions."""
    return tuple(Picture(name, one.make) for name, one in zip(BEFORE_TITLES, before, strict=False))


@dataclass(frozen=True, slots=True)
class JudgeRecord:
    """Judge of a run: the first keys of judge.json."""

    judge: str
    """Its name in tables."""
    client: str
    """offline, anthropic, openai or replay."""
    same_family: bool
    """Whether the judge and the model that chose the placements have the same maker, which the judge may favour."""
    chooser: str
    """Model that answered the questions of the placements; `offline rules` where none did."""
    questions: int
    """Number of questions: one for each scored placement, two for each pair."""
    judged: int
    """Placements with a final state."""
    lowest: int
    """Scores of 1 for samples without a placement although one was intended."""
    left_out: int
    """Rows of the run that are neither."""
    states: Mapping[str, str] = field(default_factory=dict)
    """Fingerprints of the judged final states, by method and sample: `dcap rerun` may change them afterwards."""


@dataclass(frozen=True, eq=False, slots=True)
class Judgement:
    """Scores and comparisons of a run by one judge."""

    record: JudgeRecord
    scores: tuple[JudgedScore, ...]
    """By sample and method."""
    comparisons: tuple[Comparison, ...]
    spending: Spending | None
    """Tokens and cost of the questions of all judges of the run; None if no model was asked."""


def write_judging(run: Path, judged: Judgement) -> None:
    """Write a judgement into a run."""
    folder, comparisons = run / JUDGING, judged.comparisons
    folder.mkdir(exist_ok=True)
    with whole_file(folder / SCORES) as draft:
        pq.write_table(pa.Table.from_pylist([asdict(one) for one in judged.scores], schema=SCORE_COLUMNS), draft)
    write_comparisons(folder / COMPARISONS, comparisons)
    sides = {axis.value: side_tree(side_report(on_axis(comparisons, axis))) for axis in JudgedAxis}
    tree = {**asdict(judged.record), "sides": sides}
    tree["language"] = object_to_json(judged.spending) if judged.spending else None
    text = json.dumps(tree, indent=2, allow_nan=False, ensure_ascii=False) + "\n"
    write_whole(folder / JUDGE, text.encode())


def side_tree(report: SideReport) -> dict[str, object]:
    """A judge's habits with their shares."""
    return {**asdict(report), "tie_rate": report.tie_rate, "left_share": report.left_share}


def read_record(run: Path) -> JudgeRecord | None:
    """Read the judge of a run; None without one; FormatError if judge.json is invalid."""
    path = run / JUDGING / JUDGE
    if not path.is_file():
        return None
    try:
        tree = json.loads(path.read_text(encoding="utf-8"))
        return JudgeRecord(**{one.name: tree[one.name] for one in fields(JudgeRecord)})
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise FormatError(f"{path}: not a judge's record ({type(error).__name__}: {error}); judge again") from None


def read_scores(run: Path) -> list[JudgedScore]:
    """Read the scores of a run; FormatError if they are invalid."""
    path = run / JUDGING / SCORES
    try:
        rows = pq.read_table(path, columns=SCORE_COLUMNS.names).to_pylist()
        return [JudgedScore(**row) for row in rows]
    except (OSError, pa.ArrowInvalid, TypeError) as error:
        raise FormatError(f"{path}: no table of scores ({type(error).__name__}); judge again") from None


class Standing(StrEnum):
    """How a judge treats a method's sample."""

    JUDGED = "judged"
    """There is a final state: it is scored and compared."""
    LOWEST = "lowest"
    """No placement although one was intended: 1 on both axes, and no comparison."""
    LEFT_OUT = "left_out"
    """Neither scored nor compared."""


def standing_of(row: SampleOutcome) -> Standing:
    """The standing of one row."""
    if row.feasible_intended is False:
        return Standing.LEFT_OUT
    if row.verdict in (AT_REST, AS_POSED) and not row.error:
        return Standing.JUDGED
    return Standing.LOWEST if row.feasible_intended else Standing.LEFT_OUT


def lowest_scores(rows: Sequence[SampleOutcome], judge: str) -> list[JudgedScore]:
    """Scores of samples with the lowest standing, without a question."""
    return [
        JudgedScore(row.sample, row.method, WORST, WORST, judge, f"no placement: {row.reason or row.error}")
        for row in rows
        if standing_of(row) is Standing.LOWEST
    ]


def without_placement(rows: Sequence[SampleOutcome]) -> dict[str, int]:
    """Samples of each method, in the order of the rows, on which it made no placement though one was intended."""
    found = dict.fromkeys((row.method for row in rows), 0)
    for row in rows:
        found[row.method] += standing_of(row) is Standing.LOWEST
    return found


def with_judged_scores(rows: Sequence[SampleOutcome], scores: Sequence[JudgedScore]) -> tuple[SampleOutcome, ...]:
    """The rows with a judge's scores; scores of earlier judges are removed."""
    known: Mapping[tuple[str, str], JudgedScore] = {(one.method, one.sample): one for one in scores}
    found = []
    for row in rows:
        one = known.get((row.method, row.sample))
        place, physics, judge = (one.right_place, one.physics_naturalness, one.judge) if one else (None, None, "")
        found.append(replace(row, right_place=place, physics_naturalness=physics, judge=judge))
    return tuple(found)
