"""Table 2, the preferences of people from their votes, and statistics of each rater.

The adapter between the study and the statistics: votes become comparisons, whose judge is the rater, and the statistics
become the table. Attention checks are not comparisons of methods and do not count here. Raters who failed one are noted
and stay in. If a method made no placement, nothing is compared: those samples are counted separately.

Overall is, as in the paper's table, a composite: the mean of the two win rates, which is the win rate of all votes on
either axis; intervals, tests and ratings are of these votes. If raters were asked a third question, it is the answer to
that.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from statistics import median

from dcap.evaluation.methods import DCAP, baselines_among, shown_name
from dcap.evaluation.preference_report import best_first, preferences_tex, row_cells
from dcap.evaluation.statistics.agreement import SIDES, krippendorff_alpha, percent_agreement, ratings_of
from dcap.evaluation.statistics.comparisons import AXES, Comparison, JudgedAxis, Winner, methods_of, on_axis
from dcap.evaluation.statistics.method_tables import PreferenceRow, preference_rows
from dcap.evaluation.study.design import Side
from dcap.evaluation.study.study_folder import StudyDesign, StudyVote, write_lasting
from dcap.evaluation.table_files import csv_of, number, tex_escaped, write_table

RATERS = "raters.csv"
TABLE = "table2"
COMPOSITE, QUESTION = "composite", "third question"
"""Kinds of overall."""


@dataclass(frozen=True, slots=True)
class RaterRow:
    """One rater's row of raters.csv."""

    rater: str
    answered: int
    """Comparisons, attention checks included [-]."""
    of: int
    checks: int
    """Attention checks among those answered [-]."""
    checks_failed: int
    """Checks in which the rater took the floating copy for the more natural one [-]."""
    flagged: bool
    """Whether any check was failed. The votes count nevertheless."""
    left_share: float | None
    """Share of the votes on true comparisons, to all questions, that went to the left side [-]; None without votes."""
    median_seconds: float | None
    """Median time per comparison [s]."""


def rater_rows(design: StudyDesign, votes: Sequence[StudyVote]) -> tuple[RaterRow, ...]:
    """A row for each rater of the design, those without votes included."""
    return tuple(rater_row(rater, len(items), votes) for rater, items in design.raters.items())


def rater_row(rater: str, items: int, votes: Sequence[StudyVote]) -> RaterRow:
    """The row of one rater."""
    given = [vote for vote in votes if vote.rater == rater]
    mine = [vote for vote in given if vote.axis is JudgedAxis.RIGHT_PLACE]
    checks = [v for v in given if v.axis is JudgedAxis.PHYSICS_NATURALNESS and v.lifted is not None]
    failed = sum(vote.winner is vote.lifted for vote in checks)
    true = [vote for vote in given if vote.lifted is None]
    return RaterRow(
        rater=rater,
        answered=len(mine),
        of=items,
        checks=len(checks),
        checks_failed=failed,
        flagged=failed > 0,
        left_share=round(sum(v.winner is Side.LEFT for v in true) / len(true), 4) if true else None,
        median_seconds=round(median(v.seconds for v in mine), 1) if mine else None,
    )


def write_raters(folder: Path, rows: Sequence[RaterRow]) -> None:
    """Write raters.csv."""
    write_lasting(folder / RATERS, csv_of([asdict(row) for row in rows]).encode())


@dataclass(frozen=True, slots=True)
class StudyAgreement:
    """Agreement of raters on an axis."""

    alpha: float | None
    """Krippendorff's alpha [-]; None if no two raters answered the same comparison."""
    share: float | None
    """Share of pairs of raters of the same comparison who chose the same method [-]; None without any."""
    comparisons: int
    """Comparisons that at least two raters answered [-]."""


@dataclass(frozen=True, slots=True)
class StudyTable:
    """Table 2 with its notes."""

    rows: tuple[PreferenceRow, ...]
    """The best overall first; methods without comparisons because they made no placement come last."""
    agreement: Mapping[JudgedAxis, StudyAgreement]
    comparisons: int
    raters: int
    offline: bool
    """Whether the baselines ran without a model; their names show it."""
    without_placement: Mapping[str, int] = field(default_factory=dict)
    """Samples of each method on which it made no placement though one was intended [-]."""
    overall: str = COMPOSITE
    """Kind of overall: COMPOSITE or QUESTION."""

    def name(self, method: str) -> str:
        """A method's name in the table."""
        return shown_name(method, offline=self.offline)

    @property
    def refusals(self) -> str:
        """Methods that made no placement though one was intended, and how often, in words; empty without any."""
        return ", ".join(f"{self.name(method)} {count}" for method, count in self.without_placement.items() if count)


def study_table(
    votes: Sequence[StudyVote], seed: int, *, offline: bool = False, without_placement: Mapping[str, int] | None = None
) -> StudyTable:
    """Table 2 of the votes on true comparisons."""
    rows, refused = [comparison_of(vote) for vote in votes if vote.lifted is None], without_placement or {}
    asked = bool(on_axis(rows, JudgedAxis.OVERALL))
    # every rater answers both axes: with both as overall comparisons the overall win rate is the mean of the two
    overall = [] if asked else [replace(one, axis=JudgedAxis.OVERALL) for one in rows]
    methods, counted = methods_of(rows), [*rows, *overall]
    table = preference_rows(methods, counted, baselines_among(methods), ours=DCAP, seed=seed)
    table = table if asked else [each_once(row) for row in table]
    table += [PreferenceRow(name, {}, {}, None) for name, n in refused.items() if n and name not in methods]
    return StudyTable(
        rows=best_first(table),
        agreement={axis: agreement_of(on_axis(rows, axis)) for axis in (*AXES, *[JudgedAxis.OVERALL] * asked)},
        comparisons=len(on_axis(rows, JudgedAxis.RIGHT_PLACE)),
        raters=len({row.judge for row in rows}),
        offline=offline,
        without_placement=refused,
        overall=QUESTION if asked else COMPOSITE,
    )


def each_once(row: PreferenceRow) -> PreferenceRow:
    """A row whose overall counts each comparison once, though it has two votes."""
    both = row.rates[JudgedAxis.OVERALL]
    rates = {**row.rates, JudgedAxis.OVERALL: replace(both, comparisons=both.comparisons // len(AXES))}
    return replace(row, rates=rates)


def agreement_of(rows: Sequence[Comparison]) -> StudyAgreement:
    """Agreement of raters in comparisons of one axis."""
    ratings = ratings_of(rows)
    alpha, share = krippendorff_alpha(ratings, SIDES), percent_agreement(ratings)
    return StudyAgreement(alpha, share, sum(len(one) > 1 for one in ratings))


def comparison_of(vote: StudyVote) -> Comparison:
    """A vote as a comparison; the judge is the rater."""
    return Comparison(vote.sample, vote.axis, vote.left, vote.right, Winner(vote.winner.value), vote.rater)


def write_study_table(folder: Path, table: StudyTable, raters: Sequence[RaterRow]) -> tuple[Path, Path]:
    """Write table2.csv and table2.tex into a folder."""
    return write_table(folder, TABLE, csv_text(table, raters), tex_text(table, raters))


def csv_text(table: StudyTable, raters: Sequence[RaterRow]) -> str:
    """A row per method; values of the whole study are repeated in each row."""
    study: dict[str, object] = {"raters": table.raters, "study_comparisons": table.comparisons}
    for axis, agreed in table.agreement.items():
        study |= {f"agreement_{axis}": number(agreed.alpha), f"percent_agreement_{axis}": percent(agreed.share)}
    study |= {"shared_comparisons": table.agreement[JudgedAxis.RIGHT_PLACE].comparisons, "overall_is": table.overall}
    study |= {"attention_checks": sum(one.checks for one in raters)}
    study |= {"attention_failures": sum(one.checks_failed for one in raters)}
    study |= {"raters_flagged": sum(one.flagged for one in raters)}
    return csv_of([row_cells(row, table.name(row.method)) | refused(row, table) | study for row in table.rows])


def refused(row: PreferenceRow, table: StudyTable) -> dict[str, object]:
    """Number of samples on which a method made no placement."""
    return {"without_placement": table.without_placement.get(row.method, 0)}


def percent(share: float | None) -> str:
    """A share in percent; empty without one."""
    return number(None if share is None else 100 * share, 1)


def tex_text(table: StudyTable, raters: Sequence[RaterRow]) -> str:
    """The table in the paper's layout."""
    before = [
        "Human forced choice, side by side. Win rates with 95 % intervals of a bootstrap over scene-prompt pairs.",
        overall_line(table),
    ]
    checks, failed = sum(one.checks for one in raters), sum(one.checks_failed for one in raters)
    flagged = sum(one.flagged for one in raters)
    plural = "" if flagged == 1 else "s"
    after = [
        f"{table.raters} raters, {table.comparisons} comparisons. {agreement_line(table)}",
        f"Attention checks failed: {failed} of {checks}, by {flagged} rater{plural}, whose votes count.",
        *([f"No placement where one was intended: {tex_escaped(table.refusals)}."] if table.refusals else []),
    ]
    return preferences_tex(table.rows, table.name, before, after)


def overall_line(table: StudyTable) -> str:
    """A sentence on the meaning of overall."""
    if table.overall == QUESTION:
        return "Overall: the answers to a third question, which of the two is better."
    return "Overall: the composite, the mean of the two win rates; its ratings are of the votes on both axes."


def agreement_line(table: StudyTable) -> str:
    """A sentence on the agreement of raters."""
    shared = table.agreement[JudgedAxis.RIGHT_PLACE].comparisons
    if not shared:
        return "No comparison was answered by two raters: their agreement is unknown."
    said = (
        f"{axis.replace('_', ' ')} {number(one.alpha, 2) or 'n/a'} ({percent(one.share)} % of pairs of raters)"
        for axis, one in table.agreement.items()
    )
    return f"Agreement on {shared} comparisons of several raters, Krippendorff's alpha: {', '.join(said)}."
