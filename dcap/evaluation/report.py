"""The static page of a run: the outcome of each sample, method next to method, and the run's provenance.

In: the rows of a run and the files in its folder. Out: `report.html`, which needs nothing but that folder, and its
files: `metrics.csv|tex` and `placeit3d.csv|tex` in `tables/`, `figures/supports.svg`, `artifacts.sha256`, and
`view3d.html` with `view3d/`. The same files give the same page. A run of one method shows a card per sample; a run of
several methods shows a strip of cards per sample.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from dcap.evaluation.method_report import TITLES
from dcap.evaluation.methods import DCAP, METHODS, shown_name
from dcap.evaluation.outcome_table import AS_POSED, SampleOutcome
from dcap.evaluation.pages import rendered
from dcap.evaluation.run_folder import RunSummary, placement_folder
from dcap.evaluation.run_page.placeit3d_table import placeit3d_table
from dcap.evaluation.run_page.placement_files import (
    certificate_text,
    facts_of,
    kind_of,
    materials_of,
    notes_of,
    read_placement,
    stage_bars,
    views_of,
)
from dcap.evaluation.run_page.sections import (
    HASHES,
    KINDS,
    Timings,
    costs_table,
    failure_of,
    failures_of,
    provenance_of,
    read_run,
    score_cells,
    supports_figure,
    timings_of,
)
from dcap.evaluation.run_page.tables import ShownTable, metrics_table, table_from_csv
from dcap.evaluation.view3d import PAGE, ShownModel, write_view3d
from dcap.language.model.ledger import in_words
from dcap.scene.types.pictures import BEFORE
from dcap.scene.written_files import write_whole

PICTURES = (
    ("clean", "before"),
    ("asked", "as asked"),
    ("settled", "after"),
    ("closeup", "from nearby"),
    ("contact", "contact"),
)
MOST_TILES = 120
"""Most failures in the gallery [-]; the filter finds all of them."""


@dataclass(frozen=True, slots=True)
class Card:
    """Content of the page for one placement."""

    row: SampleOutcome
    name: str
    """The method's shown name."""
    kind: str
    """rest, posed, infeasible or failed: chooses the colour."""
    pictures: tuple[tuple[str, str], ...]
    """(path relative to the page, caption)."""
    views: tuple[str, ...]
    """Pictures that exist for all methods, relative to `folder`."""
    before: tuple[tuple[str, str], ...]
    """Pictures of scene and asset alone: (path, caption)."""
    stages: tuple[tuple[str, float, float], ...]
    """(name, seconds, share of the longest stage of this sample in percent)."""
    facts: tuple[tuple[str, str], ...]
    materials: tuple[tuple[str, str, str], ...]
    """(part, material, reason)."""
    warnings: tuple[str, ...]
    certificate: str
    scores: Mapping[str, str]
    """Scores and their deciding metrics; empty if nothing was measured."""
    marks: tuple[str, ...]
    """Kinds of failure for the filter, which also uses method, verdict and support."""
    folder: str
    timings: Timings


@dataclass(frozen=True, slots=True)
class Strip:
    """A sample by all methods."""

    sample: str
    prompt: str
    scene: str
    object: str
    expected: str
    before: tuple[tuple[str, str], ...]
    cards: tuple[Card, ...]
    views: tuple[str, ...]
    """Names of the views of any method."""
    models: bool
    """Whether it can be shown in 3D."""


def write_report(folder: Path, rows: Sequence[SampleOutcome], summary: RunSummary) -> Path:
    """Write report.html into a run's folder from the files of its samples."""
    names = names_of(folder, rows)
    cards = [card_of(folder, row, names[row.method]) for row in rows]
    models = models_of(folder, cards)
    strips = strips_of(cards, models)
    by_method = {name: [card for card in cards if card.row.method == name] for name in names}
    failures = failures_of(rows)
    several = len(names) > 1
    values = {
        "title": folder.name, "summary": summary, "tiles": tiles_of(summary, rows), "asked": model_use(summary),
        "offline": is_offline(folder),
        "names": names, "cards": cards, "strips": strips, "several": several,
        "supports": sorted({row.base for row in rows if row.base}), "kinds": KINDS,
        "verdicts": sorted({kind_of(row) for row in rows}), "views": ordered(strips),
        "tables": shown_tables(folder, rows, names), "figure": supports_figure(folder, rows),
        "failures": failures[:MOST_TILES], "all_failures": len(failures),
        "card_of": {(one.row.sample, one.row.method): one for one in cards},
        "page3d": PAGE, "models": models, "hashes": HASHES,
        "costs": costs_table({name: [one.timings for one in own] for name, own in by_method.items()}, names),
        "provenance": provenance_of(folder, [placement_folder(folder, row.method, row.sample) for row in rows]),
    }  # fmt: skip
    path = folder / "report.html"
    write_whole(path, rendered("report.html.j2", values).encode())
    return path


def shown_tables(folder: Path, rows: Sequence[SampleOutcome], names: Mapping[str, str]) -> list[ShownTable]:
    """The tables of a run; also writes its metrics tables to the folder."""
    several = len(names) > 1
    rows_by_method = {name: [row for row in rows if row.method == name] for name in names}
    tables = [
        *(table_from_csv(folder, name, title) for name, title in TITLES.items() if several),
        table_from_csv(folder, "comparisons_by_method", "Comparisons by the judge") if several else None,
        table_from_csv(folder, "table2", "Table 2: human study"),
        metrics_table(folder, rows_by_method, names),
        placeit3d_table(folder, rows_by_method, names),
    ]
    return [one for one in tables if one]


def names_of(folder: Path, rows: Sequence[SampleOutcome]) -> dict[str, str]:
    """Shown names of the methods of a run, in the order of tables."""
    there, offline = {row.method for row in rows}, is_offline(folder)
    return {name: shown_name(name, offline=offline) for name in METHODS if name in there}


def is_offline(folder: Path) -> bool:
    """Whether the embedded reader answered the questions of a run."""
    config = read_run(folder).get("config")
    intent = config.get("intent") if isinstance(config, Mapping) else None
    language = intent.get("language") if isinstance(intent, Mapping) else None
    return isinstance(language, Mapping) and language.get("client") == "offline"


def card_of(folder: Path, row: SampleOutcome, name: str) -> Card:
    """The card of one placement."""
    kept = placement_folder(folder, row.method, row.sample)
    link = kept.relative_to(folder).as_posix()
    tree = read_placement(kept) if not row.error else {}
    failure = failure_of(row)
    measured = any(one is not None for one in (row.right_place, row.physics_naturalness, row.penetration_m))
    return Card(
        row=row,
        name=name,
        kind=kind_of(row),
        pictures=tuple(
            (f"{link}/{picture}.png", caption)
            for picture, caption in PICTURES
            if not row.error and (kept / f"{picture}.png").is_file()
        ),
        views=() if row.error else views_of(kept),
        before=tuple((f"{link}/views/{one}.png", one) for one in BEFORE if (kept / "views" / f"{one}.png").is_file()),
        stages=stage_bars(tree.get("timings")),
        facts=facts_of(row, tree),
        materials=materials_of(tree),
        warnings=notes_of(tree),
        certificate=certificate_text(tree),
        scores=score_cells(row) if measured else {},
        marks=failure.kinds if failure else (),
        folder=link,
        timings=timings_of(tree),
    )


def models_of(folder: Path, cards: Sequence[Card]) -> dict[str, tuple[str, ...]]:
    """Write the 3D page; returns the methods that it shows, by sample."""
    samples: dict[str, tuple[str, list[ShownModel]]] = {}
    for card in cards:
        _, models = samples.setdefault(card.row.sample, (card.row.prompt, []))
        if not card.row.error:
            models.append(ShownModel(card.row.method, card.name, folder / card.folder, card.folder))
    return write_view3d(folder, samples)


def strips_of(cards: Sequence[Card], models: Mapping[str, tuple[str, ...]]) -> list[Strip]:
    """The placements sample by sample."""
    found: dict[str, list[Card]] = {}
    for card in cards:
        found.setdefault(card.row.sample, []).append(card)
    strips = []
    for sample, own in found.items():
        row = own[0].row
        views = tuple(dict.fromkeys(view for card in own for view in card.views))
        expected = next((card.row.expected for card in own if card.row.expected), "")
        before = next((card.before for card in own if card.before), ())
        before = before or next((card.pictures[:1] for card in own if card.pictures), ())
        strips.append(
            Strip(sample, row.prompt, row.scene, row.object, expected, before, tuple(own), views, sample in models)
        )
    return strips


def ordered(strips: Sequence[Strip]) -> tuple[str, ...]:
    """All views of a run."""
    return tuple(dict.fromkeys(view for strip in strips for view in strip.views))


def model_use(summary: RunSummary) -> str:
    """The model that was asked, with tokens and cost; empty without one."""
    spent = summary.language
    return f"{', '.join(spent.models)}: {in_words(spent)}" if spent else ""


def tiles_of(summary: RunSummary, rows: Sequence[SampleOutcome]) -> list[tuple[str, str, str]]:
    """(number, words, kind) of the tiles at the top."""
    posed = sum(row.verdict == AS_POSED for row in rows)
    methods = len({row.method for row in rows})
    counted = [(str(len({row.sample for row in rows})), "samples", "plain"), (str(methods), "methods", "plain")]
    tiles = [
        *(counted if methods > 1 else [(str(summary.samples), "samples", "plain")]),
        (str(summary.at_rest), "at rest", "rest"),
        *([(str(posed), "as posed", "posed")] if posed else []),
        (str(summary.infeasible), "infeasible", "infeasible"),
        (str(summary.failed), "failed", "failed" if summary.failed else "plain"),
    ]
    ours = [row for row in rows if row.method == DCAP] if methods > 1 else rows
    whose = "DCAP: " if methods > 1 else ""
    for feasible, words in ((True, "feasible: at rest as intended"), (False, "infeasible: right reason")):
        meant = [row for row in ours if row.feasible_intended is feasible]
        if meant:
            tiles.append((f"{sum(bool(row.as_expected) for row in meant)}/{len(meant)}", f"{whose}{words}", "plain"))
    return tiles
