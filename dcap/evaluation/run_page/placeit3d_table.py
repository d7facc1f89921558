"""PlaceIt3D's measures by method: shares of met constraints and of samples, by its rules on our boxes.

In: rows of a run. Out: `tables/placeit3d.csv`, `tables/placeit3d.tex` and the same as a table of the page. A sample has
one physical constraint, its spatial ones, and a rotational one if it asks for it; visibility is not measured. The
measures are those of arXiv 2505.05288: of all constraints (global), samples with all (complete), with all but the
physical one (language), and of each kind. What counts:

- a measured placement, with its measurements; one without is left out;
- a sample that should have been placed and was not, as a failure with its constraints from other methods of the run, or
  only the physical one if no other has them;
- no sample that should be infeasible, as for every judge (`judging/judge.py`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from dcap.evaluation.judging.judge import Standing, standing_of
from dcap.evaluation.outcome_table import SampleOutcome
from dcap.evaluation.run_page.tables import NOTHING, ShownTable
from dcap.evaluation.table_files import TABLES, csv_of, number, table_links, tex_escaped, tex_of, write_table

TABLE = "placeit3d"
COLUMNS = {
    "Global": ("all_constraints", "all_constraints_given"), "Complete": ("complete", "complete_given"),
    "Language": ("language",), "Physical": ("physical", "physical_given"), "Spatial": ("spatial",),
    "Rotational": ("rotational",),
}  # fmt: skip
"""Shares in each column of the page; of two, the first is against the scene as it was left, the second as given."""
HEADINGS = (*COLUMNS, "n", "not placed")
NOTE = (
    "Percent of constraints (global, spatial, rotational, physical) or of samples (complete, language), by PlaceIt3D's "
    "rules on this run's boxes; where there are two, against the scene as it was left / as it was given. A sample that "
    "should have been placed and was not meets nothing. These are no results of its benchmark."
)
Shares = Mapping[str, float | None]
"""Results of a method by column of the CSV: counts, and shares [-], None if there is nothing to count."""


@dataclass(frozen=True, slots=True)
class SampleConstraints:
    """Constraints of one sample that one method meets."""

    spatial: int
    """Number of requested spatial constraints."""
    spatial_met: int
    rotational: bool
    """Whether a rotational constraint is requested."""
    rotational_met: bool
    physical: bool
    """Whether the physical constraint is met in the final scene."""
    physical_given: bool
    placed: bool

    @property
    def worded(self) -> bool:
        """Whether the sentence requests any constraint, or nothing was placed."""
        return self.spatial > 0 or self.rotational or not self.placed

    @property
    def language(self) -> bool:
        """Whether all but the physical constraint hold."""
        return self.placed and self.spatial_met == self.spatial and self.rotational_met >= self.rotational


def placeit3d_table(
    run: Path, rows: Mapping[str, Sequence[SampleOutcome]], names: Mapping[str, str]
) -> ShownTable | None:
    """Write the measures of each method into the run and return them as a table; None if nothing was measured.

    Args:
        run: its folder.
        rows: of each method.
        names: shown names of the methods.
    """
    found = shares_by_method(rows)
    if all(one["samples"] == one["not_placed"] for one in found.values()):
        return None
    shown = [(names[method], *cells(one)) for method, one in found.items()]
    text = csv_of([
        {"method": method, "name": names[method],
         **{name: value if isinstance(value, int) else number(value) for name, value in one.items()}}
        for method, one in found.items()
    ])  # fmt: skip
    tex = [[tex_escaped(cell) for cell in row] for row in shown]
    columns = f"l{'c' * len(HEADINGS)}"
    write_table(run / TABLES, TABLE, text, tex_of(("Method", *HEADINGS), tex, columns, [NOTE]))
    return ShownTable("PlaceIt3D's rules by method", ("", *HEADINGS), tuple(shown), table_links(TABLE), NOTE)


def shares_by_method(rows: Mapping[str, Sequence[SampleOutcome]]) -> dict[str, Shares]:
    """The measures of each method."""
    asked = requested_counts([row for own in rows.values() for row in own])
    found = {}
    for method, own in rows.items():
        known = [constraints_of(row, asked.get(row.sample, (0, False))) for row in own]
        found[method] = shares_of([one for one in known if one])
    return found


def requested_counts(rows: Sequence[SampleOutcome]) -> dict[str, tuple[int, bool]]:
    """Number of spatial constraints of each sample with a measured method, and whether there is a rotational one; the
    largest number if methods read a sentence differently."""
    found: dict[str, tuple[int, bool]] = {}
    for row in rows:
        if row.placeit3d_spatial_asked is not None:
            spatial, rotational = found.get(row.sample, (0, False))
            turned = rotational or row.placeit3d_rotational_met is not None
            found[row.sample] = max(spatial, row.placeit3d_spatial_asked), turned
    return found


def constraints_of(row: SampleOutcome, asked: tuple[int, bool]) -> SampleConstraints | None:
    """Constraints that a row meets; None if it does not count. `asked` are the sample's constraints for other
    methods."""
    standing = standing_of(row)
    if standing is Standing.LOWEST:
        return SampleConstraints(asked[0], 0, asked[1], False, False, False, placed=False)
    spatial, held = row.placeit3d_spatial_asked, row.placeit3d_spatial_met
    if standing is Standing.LEFT_OUT or spatial is None or held is None or row.placeit3d_physical is None:
        return None
    turned = row.placeit3d_rotational_met
    left, given = row.placeit3d_physical, bool(row.placeit3d_physical_given)
    return SampleConstraints(spatial, held, turned is not None, bool(turned), left, given, placed=True)


def shares_of(samples: Sequence[SampleConstraints]) -> Shares:
    """The measures over samples."""
    count = len(samples)
    spatial, rotational = sum(one.spatial for one in samples), sum(one.rotational for one in samples)
    spatial_met, turned = sum(one.spatial_met for one in samples), sum(one.rotational_met for one in samples)
    left, given = sum(one.physical for one in samples), sum(one.physical_given for one in samples)
    asked, worded = count + spatial + rotational, [one for one in samples if one.worded]
    return {
        "samples": count,
        "not_placed": sum(not one.placed for one in samples),
        "constraints": asked,
        "all_constraints": share(spatial_met + turned + left, asked),
        "all_constraints_given": share(spatial_met + turned + given, asked),
        "complete": share(sum(one.language and one.physical for one in samples), count),
        "complete_given": share(sum(one.language and one.physical_given for one in samples), count),
        "language": share(sum(one.language for one in worded), len(worded)),
        "physical": share(left, count),
        "physical_given": share(given, count),
        "spatial": share(spatial_met, spatial),
        "rotational": share(turned, rotational),
    }


def share(count: int, of: int) -> float | None:
    """A share; None of zero."""
    return count / of if of else None


def cells(one: Shares) -> tuple[str, ...]:
    """A method's row after its name; shares in percent."""
    shown = []
    for columns in COLUMNS.values():
        values = [one[name] for name in columns]
        known = [number(100.0 * value, 1) for value in values if value is not None]
        shown.append(" / ".join(known) or NOTHING)
    return (*shown, str(one["samples"]), str(one["not_placed"]))
