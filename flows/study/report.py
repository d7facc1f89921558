"""Results of a study's votes: Table 2, the raters, and the votes as a table."""

from dataclasses import dataclass
from pathlib import Path

from dcap.evaluation.judging.standing import without_placement
from dcap.evaluation.study.journal import StudyVote, read_votes
from dcap.evaluation.study.raters import RaterRow, rater_rows, write_raters
from dcap.evaluation.study.study_folder import STUDY_FOLDER, StudyDesign, export_votes, read_design
from dcap.evaluation.study.tables import StudyTable, study_table, write_study_table
from dcap.evaluation.table_files import TABLES
from dcap.language.protocol.client import ClientName
from dcap.scene.errors import InputError
from flows.find_run import find_run
from flows.judge_run import read_rows
from flows.measures_file import changed_since
from flows.run_files import chooser_of


@dataclass(frozen=True, slots=True)
class StudyReport:
    """The report of a study, and its files."""

    table: StudyTable
    raters: tuple[RaterRow, ...]
    csv: Path
    tex: Path
    changed: tuple[str, ...] = ()
    """Samples whose final states have changed since the study began."""


def report_study(run: str) -> StudyReport:
    """Write votes.parquet, raters.csv, and Table 2 of a study; InputError if nobody has voted."""
    found = find_run(run)
    folder = found / STUDY_FOLDER
    design = read_design(folder)
    votes = read_votes(folder)
    if design is None or not any(vote.lifted is None for vote in votes):
        raise InputError(f"{found.name}: its study has no votes yet; dcap study serve {run}")
    check_votes(found, design, votes)
    export_votes(folder, votes)
    rows = rater_rows(design, votes)
    write_raters(folder, rows)
    offline = chooser_of(found).client is ClientName.OFFLINE
    table = study_table(votes, design.seed, offline=offline, without_placement=without_placement(read_rows(found)))
    csv, tex = write_study_table(found / TABLES, table, rows)
    return StudyReport(table, rows, csv, tex, changed_since(found, design.states))


def check_votes(run: Path, design: StudyDesign, votes: tuple[StudyVote, ...]) -> None:
    """Raise InputError if a vote belongs to no rater of the study."""
    strange = sorted({vote.rater for vote in votes} - set(design.raters))
    if strange:
        raise InputError(f"{run.name}: there are votes of {strange[0]}, whom its study does not know")
