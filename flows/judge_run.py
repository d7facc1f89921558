"""Judges a run (scores, comparisons, tables), and measures how often a judge is right.

In: a run of several methods with its rows, and a judge. Out: `judging/` (scores, comparisons, judge.json), the three
columns of results.parquet that a judge makes, `tables/table1.csv|tex` of a model, `tables/metric_scores.csv|tex` of the
rubric, and `tables/comparisons_by_method.csv|tex`.
dcap/evaluation/judging/judge.py decides which samples are judged, and the scores of the others. Nothing is written
before every question is answered.

Its accuracy is measured on pairs whose better one is known, asked in both orders.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from dcap.evaluation.judging.judge import (
    COMPARISONS,
    JUDGING,
    JudgedPlacement,
    Judgement,
    JudgeRecord,
    Standing,
    comparisons,
    judge_name,
    lowest_scores,
    pairs,
    pictures_in,
    read_record,
    read_scores,
    same_family,
    scores,
    side_tree,
    standing_of,
    with_judged_scores,
    write_judging,
)
from dcap.evaluation.judging.known_answers import JudgeAccuracy, judge_accuracy, known_answers
from dcap.evaluation.judging.rubric import RUBRIC, Metrics, row_metrics, rubric_scores
from dcap.evaluation.method_report import MethodTable, method_table, write_method_table
from dcap.evaluation.methods import OFFLINE, joined_id, split_id
from dcap.evaluation.outcome_table import SampleOutcome
from dcap.evaluation.preference_report import write_comparison_table
from dcap.evaluation.run_folder import sample_folder
from dcap.evaluation.statistics.comparisons import Comparison, read_comparisons
from dcap.language.connect import connect
from dcap.language.model.batch import batch_queue
from dcap.language.model.ledger import spending_of
from dcap.language.offline.placing import object_name
from dcap.language.protocol.client import ClientName, LanguageConfig
from dcap.language.protocol.requests import Picture
from dcap.language.protocol.session import Session
from dcap.scene.errors import FormatError, InputError
from dcap.scene.settings import runs_root
from dcap.scene.types.pictures import BEFORE, PLACED
from dcap.scene.written_files import whole_file, write_whole
from flows.configure import LanguageOptions
from flows.find_run import RUN, find_run, input_errors, read_request
from flows.judge_views import VIEWS, take_views
from flows.output import readable_json
from flows.run_files import chooser_of
from flows.scoring import changed_since, states_of

RESULTS = "results.parquet"
ROOMS = ("bedroom_01", "bedroom_02", "bedroom_03", "kids_01", "kids_02")
"""Embedded rooms with a bed and free floor next to it."""
VALIDATION = "validation.json"
WITHOUT_RUN = "judge"
"""Folder among the runs for a judge that is validated without one."""


@dataclass(frozen=True, eq=False, slots=True)
class JudgedRun:
    """A run that was judged."""

    folder: Path
    rows: tuple[SampleOutcome, ...]
    """With the judge's scores."""
    table: MethodTable
    csv: Path


def judge_run(run: str, options: LanguageOptions, say: Callable[[str], None] = lambda text: None) -> JudgedRun:
    """Judge a run and write scores, comparisons and the table; InputError where it cannot be judged."""
    folder, config = find_run(run), options.config()
    rows = read_rows(folder)
    judged = judgement_of(folder, rows, config, options, say)
    write_judging(folder, judged)
    rows = with_judged_scores(rows, judged.scores)
    write_rows(folder, rows)
    table, csv = write_tables(folder, rows, judged.comparisons, judged.record)
    return JudgedRun(folder, rows, table, csv)


def judged_rows(folder: Path, rows: Sequence[SampleOutcome]) -> tuple[tuple[SampleOutcome, ...], MethodTable | None]:
    """Write and return the rows of a run with the scores of its judge, by default the metric rubric, and their table.

    A run of one method stays as it is, and so does one that the rubric cannot judge: nothing is compared there.
    """
    record = read_record(folder)
    if record is None or record.judge == RUBRIC:
        if not pairs(with_metrics(rows)):
            return tuple(rows), None
        judged = judgement_of(folder, rows, LanguageConfig(), LanguageOptions())
        write_judging(folder, judged)
        found, compared, record = list(judged.scores), list(judged.comparisons), judged.record
    else:
        found, compared = read_scores(folder), read_comparisons(folder / JUDGING / COMPARISONS)
    scored = with_judged_scores(rows, found)
    write_rows(folder, scored)
    return scored, write_tables(folder, scored, compared, record, changed_since(folder, record.states))[0]


def judgement_of(
    folder: Path,
    rows: Sequence[SampleOutcome],
    config: LanguageConfig,
    options: LanguageOptions,
    say: Callable[[str], None] = lambda text: None,
) -> Judgement:
    """Ask a judge about the rows of a run; InputError where nothing can be compared."""
    methods = tuple(dict.fromkeys(row.method for row in rows))
    if len(methods) < 2:
        raise InputError(
            f"{folder.name}: the run has only {' '.join(methods) or 'no method'}, and a judge compares methods; "
            "dcap benchmark --methods all"
        )
    rubric = config.client is ClientName.OFFLINE
    if not rubric:
        take_views(folder, rows, say)
    placements = with_metrics(rows) if rubric else with_pictures(folder, rows, methods)
    if not pairs(placements):
        raise InputError(
            f"{folder.name}: no sample has a final state of two methods that "
            + (f"the {RUBRIC} can score (no metric of it is known); " if rubric else "can be shown; ")
            + "see the verdicts in results.parquet"
        )
    name = judge_name(config)
    session = options.session(folder / JUDGING) if not rubric else Session()
    with asking(session, say):
        client = connect(config, session)
        found = scores(client, placements, name)
        compared = comparisons(client, placements, name)
    lowest = lowest_scores(rows, name)
    record = record_of(folder, config, rows, placements, len(lowest))
    ordered = sorted([*found, *lowest], key=lambda one: (one.sample, one.method))
    ledger = Path(session.ledger) if session.ledger else None
    asked = config.client not in (ClientName.OFFLINE, ClientName.REPLAY)
    spending = spending_of(ledger) if asked and ledger and ledger.is_file() else None
    return Judgement(record, tuple(ordered), tuple(compared), spending)


def record_of(
    folder: Path,
    config: LanguageConfig,
    rows: Sequence[SampleOutcome],
    placements: Sequence[JudgedPlacement],
    lowest: int,
) -> JudgeRecord:
    """Record of the judge and of the judged samples."""
    chooser = chooser_of(folder)
    judged = sorted(joined_id(one.method, one.sample) for one in placements)
    return JudgeRecord(
        judge=judge_name(config),
        client=config.client.value,
        same_family=same_family(config, chooser),
        chooser=OFFLINE.strip(" ()") if chooser.client is ClientName.OFFLINE else judge_name(chooser),
        questions=len(placements) + 2 * len(pairs(placements)),
        judged=len(placements),
        lowest=lowest,
        left_out=len(rows) - len(placements) - lowest,
        states=states_of(folder, judged),
    )


def asking(session: Session, say: Callable[[str], None]) -> AbstractContextManager[None]:
    """Batch queue for the questions, if they are asked in batches."""
    return batch_queue(Path(session.batch), session, say) if session.batch else nullcontext()


def with_metrics(rows: Sequence[SampleOutcome]) -> list[JudgedPlacement]:
    """Final states that the metric rubric can score: those with known metrics on at least one axis."""
    found = []
    for row in rows:
        metrics = row_metrics(row)
        if standing_of(row) is Standing.JUDGED and rubric_scores(metrics) != (None, None):
            found.append(judged_placement(row, metrics, (), ()))
    return found


def with_pictures(folder: Path, rows: Sequence[SampleOutcome], methods: Sequence[str]) -> list[JudgedPlacement]:
    """Final states with the pictures that a model judges; InputError for a missing picture."""
    judged = [row for row in rows if standing_of(row) is Standing.JUDGED]
    first: dict[str, tuple[Picture, ...]] = {}
    names = object_names(folder)
    for row in sorted(judged, key=lambda one: methods.index(one.method)):
        if row.sample not in first:
            first[row.sample] = pictures_in(views_of(folder, row), BEFORE)
    found = []
    for row in judged:
        views = pictures_in(views_of(folder, row), PLACED)
        found.append(judged_placement(row, row_metrics(row), first[row.sample], views, names.get(row.sample, "")))
    return found


def object_names(folder: Path) -> dict[str, str]:
    """Names of the objects in the requests of a run, by sample; samples without a name are left out."""
    tree = read_request(folder / RUN)
    with input_errors(folder / RUN):
        labels = {split_id(one["id"])[1]: one.get("object_options", {}).get("label", "") for one in tree["samples"]}
    return {sample: label for sample, label in labels.items() if label}


def views_of(folder: Path, row: SampleOutcome) -> Path:
    """Folder with the pictures of a row."""
    return sample_folder(folder, joined_id(row.method, row.sample)) / VIEWS


def judged_placement(
    row: SampleOutcome, metrics: Metrics, before: tuple[Picture, ...], views: tuple[Picture, ...], name: str = ""
) -> JudgedPlacement:
    """A row in the form that a judge takes."""
    thing = object_name(Path(row.object), row.prompt, name)
    return JudgedPlacement(row.sample, row.method, row.prompt, thing, metrics, before, views)


def write_tables(
    folder: Path, rows: Sequence[SampleOutcome], compared: Sequence[Comparison], record: JudgeRecord,
    changed: tuple[str, ...] = (),
) -> tuple[MethodTable, Path]:  # fmt: skip
    """Write the table of scores and the table of comparisons."""
    offline = chooser_of(folder).client is ClientName.OFFLINE
    table = method_table(rows, compared, record, offline=offline, changed=changed)
    write_comparison_table(folder, compared, record, offline=offline)
    return table, write_method_table(folder, table)[0]


def write_rows(folder: Path, rows: Sequence[SampleOutcome]) -> None:
    """Write results.parquet."""
    with whole_file(folder / RESULTS) as draft:
        pq.write_table(pa.Table.from_pylist([asdict(row) for row in rows]), draft)


def read_rows(folder: Path) -> tuple[SampleOutcome, ...]:
    """Rows of results.parquet; FormatError for a file of another version."""
    path = folder / RESULTS
    if not path.is_file():
        raise FormatError(f"{folder.name}: the run did not finish, it has no {RESULTS}; run the benchmark again")
    try:
        rows: list[Mapping[str, object]] = pq.read_table(path).to_pylist()
        return tuple(SampleOutcome(**{one.name: row[one.name] for one in fields(SampleOutcome)}) for row in rows)  # type: ignore[arg-type]
    except (OSError, pa.ArrowInvalid, KeyError) as error:
        raise FormatError(
            f"{path}: no results that can be judged ({type(error).__name__}: {error}); run the benchmark again"
        ) from None


@dataclass(frozen=True, slots=True)
class JudgeValidation:
    """Accuracy of a judge, and the file that records it."""

    accuracy: JudgeAccuracy
    path: Path


def validate_judge(
    run: str | None,
    options: LanguageOptions,
    say: Callable[[str], None] = lambda text: None,
    rooms: Sequence[str] = ROOMS,
) -> JudgeValidation:
    """Ask a judge questions with known answers about some rooms. validation.json goes into the `judging` of a run, if
    one is named, else into the folder `judge` next to the runs."""
    folder = find_run(run) / JUDGING if run else runs_root() / WITHOUT_RUN
    config = options.config()
    session = Session() if config.client is ClientName.OFFLINE else options.session(folder)
    with asking(session, say):
        client, judge = connect(config, session), judge_name(config)
        answers = list(known_answers(rooms[0]))
        if not options.batch:  # a model that cannot be asked is an error before all rooms are prepared
            judge_accuracy(client, answers[:1], judge)
        answers += [one for name in rooms[1:] for one in known_answers(name)]
        found = judge_accuracy(client, answers, judge)
    folder.mkdir(parents=True, exist_ok=True)
    tree = {**asdict(found), "sides": side_tree(found.sides), "accuracy": found.accuracy}
    tree |= {"rooms": list(rooms), "client": config.client.value}
    write_whole(folder / VALIDATION, readable_json(tree))
    return JudgeValidation(found, folder / VALIDATION)
