"""Table 2: what people preferred, from their votes.

The adapter between the study and the statistics: votes go in as counts of wins per scene-prompt pair, and what comes
back is laid out as the table. Attention checks are no comparisons of methods and count nowhere here. Raters who failed
one are told and stay in.
"""

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dcap.evaluation.study.design import StudyAxis
from dcap.evaluation.study.journal import StudyVote
from dcap.evaluation.study.preferences import (
    Interval,
    PreferenceCounts,
    bradley_terry_ratings,
    krippendorff_alpha,
    p_against_best,
    win_rates,
)
from dcap.evaluation.study.raters import RaterRow
from dcap.evaluation.study.study_folder import write_whole

TABLE = "table2"
SIGNIFICANT = 0.01
"""Below this p the best method is marked, as in the paper [-]."""
HEADINGS = {
    StudyAxis.OVERALL: "Overall (\\%)", StudyAxis.RIGHT_PLACE: "Right Place (\\%)",
    StudyAxis.PHYSICS: "Phys. \\& Nat. (\\%)",
}  # fmt: skip
SHOWN = {"dcap": "DCAP", "fireplace": "FirePlace*", "layoutgpt": "LayoutGPT", "holodeck": "Holodeck"}


@dataclass(frozen=True, slots=True)
class StudyRow:
    """One method of Table 2."""

    method: str
    wins: Mapping[StudyAxis, Interval]
    """Share of its comparisons that it won, by axis, with 95 % intervals over scene-prompt pairs [-]."""
    p: Mapping[StudyAxis, float]
    """That it is no better than the best of the others (paired bootstrap) [-]."""
    rating: Interval
    """Bradley-Terry, of the overall votes, on Elo's scale, mean 1500 [-]."""
    comparisons: int
    """That it was part of [-]."""

    def marked(self, axis: StudyAxis) -> bool:
        """Whether it is significantly better than every other method."""
        return self.p[axis] < SIGNIFICANT


@dataclass(frozen=True, slots=True)
class StudyTable:
    """Table 2 and what belongs to it."""

    rows: tuple[StudyRow, ...]
    """The best overall first."""
    agreement: Mapping[StudyAxis, float | None]
    """Krippendorff's alpha between raters [-]; None where no two raters answered the same comparison."""
    comparisons: int
    raters: int


def study_table(votes: Sequence[StudyVote], seed: int) -> StudyTable:
    """Table 2 of the votes on true comparisons."""
    true = [vote for vote in votes if vote.lifted is None]
    methods = sorted({name for vote in true for name in (vote.left, vote.right)})
    counts = {axis: counts_of([v for v in true if v.axis is axis], methods) for axis in StudyAxis}
    rates = {axis: win_rates(one, seed) for axis, one in counts.items()}
    best = {axis: p_against_best(one, seed) for axis, one in counts.items()}
    ratings = bradley_terry_ratings(counts[StudyAxis.OVERALL], seed)
    overall = counts[StudyAxis.OVERALL].totals
    rows = [
        StudyRow(
            name,
            {axis: rates[axis][i] for axis in StudyAxis},
            {axis: best[axis][i] for axis in StudyAxis},
            ratings[i],
            int((overall + overall.T)[i].sum()),
        )
        for i, name in enumerate(methods)
    ]
    rows.sort(key=lambda row: (-row.wins[StudyAxis.OVERALL].value, row.method))
    return StudyTable(
        rows=tuple(rows),
        agreement={axis: krippendorff_alpha(ballots(true, axis)) for axis in StudyAxis},
        comparisons=sum(vote.axis is StudyAxis.OVERALL for vote in true),
        raters=len({vote.rater for vote in true}),
    )


def counts_of(votes: Sequence[StudyVote], methods: Sequence[str]) -> PreferenceCounts:
    """How often each method beat each other one, by scene-prompt pair."""
    samples = sorted({vote.sample for vote in votes})
    wins = np.zeros((len(samples), len(methods), len(methods)))
    for vote in votes:
        loser = vote.right if vote.winning_method == vote.left else vote.left
        wins[samples.index(vote.sample), methods.index(vote.winning_method), methods.index(loser)] += 1
    return PreferenceCounts(wins)


def ballots(votes: Sequence[StudyVote], axis: StudyAxis) -> list[list[bool]]:
    """Of each comparison (sample and two methods) whether each rater preferred the method whose name comes first."""
    found: dict[tuple[str, str, str], list[bool]] = {}
    for vote in votes:
        if vote.axis is axis:
            first, second = sorted((vote.left, vote.right))
            found.setdefault((vote.sample, first, second), []).append(vote.winning_method == first)
    return list(found.values())


def shown_name(method: str) -> str:
    """A method's name as tables print it."""
    return SHOWN.get(method) or f"DCAP ({method.replace('_', ' ')})"


def write_study_table(folder: Path, table: StudyTable, raters: Sequence[RaterRow]) -> tuple[Path, Path]:
    """Write table2.csv and table2.tex into a folder."""
    folder.mkdir(exist_ok=True)
    paths = folder / f"{TABLE}.csv", folder / f"{TABLE}.tex"
    write_whole(paths[0], csv_text(table, raters).encode())
    write_whole(paths[1], tex_text(table, raters).encode())
    return paths


def csv_text(table: StudyTable, raters: Sequence[RaterRow]) -> str:
    """A row per method; what is of the whole study stands in each row."""
    study: dict[str, object] = {"raters": table.raters, "study_comparisons": table.comparisons}
    study |= {f"agreement_{axis}": number(value) for axis, value in table.agreement.items()}
    study |= {"attention_checks": sum(one.checks for one in raters)}
    study |= {"attention_failures": sum(one.checks_failed for one in raters)}
    study |= {"raters_flagged": sum(one.flagged for one in raters)}
    rows: list[dict[str, object]] = []
    for row in table.rows:
        cells: dict[str, object] = {"method": row.method, "name": shown_name(row.method)}
        for axis in reversed(StudyAxis):
            wins = row.wins[axis]
            cells |= {f"{axis}_wins": number(wins.value), f"{axis}_low": number(wins.low)}
            cells |= {f"{axis}_high": number(wins.high), f"{axis}_p": number(row.p[axis])}
            cells |= {f"{axis}_significant": row.marked(axis)}
        cells |= {
            f"bradley_terry{end}": f"{value:.1f}"
            for end, value in zip(("", "_low", "_high"), row.rating.all, strict=True)
        }
        rows.append(cells | {"comparisons": row.comparisons} | study)
    text = io.StringIO()
    out = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    out.writeheader()
    out.writerows(rows)
    return text.getvalue()


def number(value: float | None) -> str:
    """Four digits; empty where there is none."""
    return "" if value is None or not np.isfinite(value) else f"{value:.4f}"


def tex_text(table: StudyTable, raters: Sequence[RaterRow]) -> str:
    """The table as the paper lays it out."""
    order = (StudyAxis.OVERALL, StudyAxis.RIGHT_PLACE, StudyAxis.PHYSICS)
    head = " & ".join(["Method", *(HEADINGS[axis] for axis in order), "Bradley--Terry"])
    lines = [
        "% Human forced choice, side by side. Win rates with 95 % intervals of a bootstrap over scene-prompt pairs."
    ]
    lines += ["\\begin{tabular}{lcccc}", "\\hline", f"{head} \\\\", "\\hline"]
    for row in table.rows:
        cells = [tex_rate(row, axis) for axis in order]
        rating = f"${row.rating.value:.0f}$ {{\\small $[{row.rating.low:.0f}, {row.rating.high:.0f}]$}}"
        lines.append(f"{tex_escaped(shown_name(row.method))} & {' & '.join(cells)} & {rating} \\\\")
    lines += ["\\hline", "\\end{tabular}"]
    agreed = ", ".join(f"{axis.replace('_', ' ')} {number(value) or 'n/a'}" for axis, value in table.agreement.items())
    checks, failed = sum(one.checks for one in raters), sum(one.checks_failed for one in raters)
    flagged = sum(one.flagged for one in raters)
    lines += [
        f"% {table.raters} raters, {table.comparisons} comparisons. Krippendorff's alpha: {agreed}.",
        f"% Attention checks failed: {failed} of {checks}, by {flagged} raters, whose votes are included.",
        "% $\\dagger$: better than every other method (paired bootstrap, p < 0.01).",
    ]
    return "\n".join(lines) + "\n"


def tex_rate(row: StudyRow, axis: StudyAxis) -> str:
    """A win rate in percent with its interval."""
    wins, mark = row.wins[axis], "^{\\dagger}" if row.marked(axis) else ""
    value, low, high = (f"{100 * one:.1f}" for one in wins.all)
    return f"${value}{mark}$ {{\\small $[{low}, {high}]$}}"


def tex_escaped(text: str) -> str:
    """Text without what TeX takes for commands."""
    return "".join(f"\\{sign}" if sign in "_&%#$" else sign for sign in text)
