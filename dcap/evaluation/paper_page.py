"""The page of a whole evaluation: each statement of the paper with its files, and facts of the scenes.

In: a finished run with its rows, facts of its scenes, and notes on the study. Out: `index.html`, which lists the
paper's sections 4.1 to 4.4 statement by statement with the files of the run that answer each, or why none does;
`tables/dataset.csv|tex`, `tables/figure3.csv|tex`, `figures/deformable_supports.png` and
`figures/deformable_materials.png`. Figure 3 has two counts: labelled supports that give way, and the different
deformable materials of the parts of all supports, which is how we read the paper's figure. The pictures and tables of
single placements stay in `report.html`.
"""

import csv
import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from dcap.evaluation.judging.judge import read_record
from dcap.evaluation.judging.rubric import RUBRIC
from dcap.evaluation.outcome_table import SampleOutcome
from dcap.evaluation.pages import rendered
from dcap.evaluation.report import card_of, model_use, names_of, shown_tables, strips_of, tiles_of
from dcap.evaluation.run_folder import RunSummary
from dcap.evaluation.run_page.sections import KINDS, costs_table, failures_of, read_run
from dcap.evaluation.run_page.tables import YES_OR_NO, ShownTable
from dcap.evaluation.supports_plot import MATERIALS, SUPPORTS, is_support, save_supports_plot, summary
from dcap.evaluation.table_files import TABLES, csv_of, table_links, tex_escaped, tex_of, write_table
from dcap.knowledge.kinds import deformable_materials, deformable_supports
from dcap.language.protocol.client import ClientName
from dcap.scene.written_files import write_whole

SENTENCES = Path(__file__).with_name("paper_sentences.csv")
MOST_LINKS = 4
"""Most linked files of one statement [-]."""
DATASET, FIGURE3 = "dataset", "figure3"
FIGURES = {SUPPORTS: "figures/deformable_supports.png", MATERIALS: "figures/deformable_materials.png"}
INDEX = "index.html"
TABLE1, TABLE2 = (table_links(name)[0] for name in ("table1", "table2"))
SHOWN_SETTINGS = {
    "solver": "drop.solver.method", "clearance at the start [m]": "anchor.clearance",
    "rigid above [Pa]": "materials.rigid_above", "limits of the paper": "materials.paper_limits",
}  # fmt: skip
"""Settings of the stages on the page, by name."""
MOST_STRIPS = 60
"""Samples in the gallery [-]; report.html has all."""


@dataclass(frozen=True, slots=True)
class PaperSentence:
    """A statement and its files in a run."""

    section: str
    topic: str
    """In our words."""
    files: tuple[str, ...]
    """Existing files, relative to the run; the first MOST_LINKS."""
    more: int
    """Number of further files."""
    lacking: tuple[str, ...]
    """Patterns that no file of the run fits."""
    note: str
    """A note, or why there is no file."""


def paper_sentences(run: Path) -> list[PaperSentence]:
    """All statements, in the paper's order, each with its files."""
    found = []
    with SENTENCES.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    for row in rows:
        files: list[str] = []
        more, lacking = 0, []
        for pattern in row["files"].split():
            there = sorted(one.relative_to(run).as_posix() for one in run.glob(pattern))
            if not there:
                lacking.append(pattern)
            files += there[:1] if "*" in pattern else there
            more += max(len(there) - 1, 0) if "*" in pattern else 0
        shown = tuple(files[:MOST_LINKS])
        found.append(PaperSentence(row["section"], row["topic"], shown, more, tuple(lacking), row["note"]))
    return found


@dataclass(frozen=True, slots=True)
class SceneFacts:
    """One scene after the stages that read it."""

    scene: str
    """Its name, or path."""
    mesh: str
    """Origin of its mesh: given, SuGaR, or reconstructed from the splats."""
    file: str
    """Path of that mesh, or of the splats."""
    faces: int
    open_edges: int
    """Edges of the mesh without an opposite; 0: it is closed [-]."""
    things: tuple[tuple[str, tuple[str, ...]], ...]
    """Label and names of the parts of each instance."""

    @property
    def supports(self) -> list[tuple[str, tuple[str, ...]]]:
        """Instances that can carry things."""
        return [(label, parts) for label, parts in self.things if is_support(label)]

    @property
    def kinds(self) -> Counter[str]:
        """Deformable supports by kind."""
        return deformable_supports(label for label, _ in self.things)

    @property
    def materials(self) -> Counter[str]:
        """Deformable materials of its supports, each counted once."""
        return Counter(dict.fromkeys(deformable_materials(self.supports), 1))


@dataclass(frozen=True, slots=True)
class ShownFigure:
    """One count of figure 3."""

    title: str
    path: str
    """Relative to the run."""
    words: str


def write_scene_facts(run: Path, scenes: Sequence[SceneFacts]) -> tuple[list[ShownTable], list[ShownFigure]]:
    """Write tables and figures into a run, and return them for its page; nothing if no scene could be read."""
    if not scenes:
        return [], []
    tables = [
        written(run, DATASET, "Data set", [dataset_row(one) for one in scenes], dataset_words(scenes)),
        written(run, FIGURE3, "The numbers of figure 3", [figure_row(one) for one in scenes], FIGURE_NOTE),
    ]
    counts = {SUPPORTS: [one.kinds for one in scenes], MATERIALS: [one.materials for one in scenes]}
    figures = []
    for what, found in counts.items():
        save_supports_plot(found, run / FIGURES[what], what)
        figures.append(ShownFigure(f"{what.capitalize()} per scene", FIGURES[what], summary(found)))
    return tables, figures


FIGURE_NOTE = (
    "deformable: E of the usual material is at most 1 GPa. Materials: different ones among the parts of all supports. "
    "Both follow from labels and parts by the lexicon; nothing is measured."
)


def dataset_words(scenes: Sequence[SceneFacts]) -> str:
    """Content of the data set, in a line."""
    sources = Counter(one.mesh for one in scenes)
    closed = sum(one.open_edges == 0 for one in scenes)
    return (
        f"{len(scenes)} scenes; meshes: {', '.join(f'{count} {name}' for name, count in sorted(sources.items()))}; "
        f"{closed} closed as a whole"
    )


def dataset_row(one: SceneFacts) -> Mapping[str, object]:
    """The mesh of a scene."""
    return {
        "scene": one.scene, "mesh": one.mesh, "file": one.file, "faces": one.faces, "open_edges": one.open_edges,
        "instances": len(one.things), "supports": len(one.supports),
    }  # fmt: skip


def figure_row(one: SceneFacts) -> Mapping[str, object]:
    """Both counts of a scene, and the counted things."""
    kinds = "; ".join(f"{count} {kind}" for kind, count in one.kinds.most_common())
    return {
        "scene": one.scene, "supports": len(one.supports), "deformable_supports": one.kinds.total(),
        "deformable_materials": one.materials.total(), "kinds": kinds, "materials": " ".join(one.materials),
    }  # fmt: skip


def written(run: Path, name: str, title: str, rows: Sequence[Mapping[str, object]], note: str) -> ShownTable:
    """Write a table into a run, and return it for the page."""
    head = tuple(rows[0])
    cells = [tuple(str(row[column]) for column in head) for row in rows]
    tex = [[tex_escaped(cell) for cell in row] for row in (head, *cells)]
    write_table(run / TABLES, name, csv_of(rows), tex_of(tex[0], tex[1:], "l" * len(head)))
    return ShownTable(title, tuple(one.replace("_", " ") for one in head), tuple(cells), table_links(name), note)


@dataclass(frozen=True, slots=True)
class PaperNotes:
    """Notes that no file of the run contains."""

    study: str
    """How to serve the study, or why there is none."""
    left_out: Mapping[str, str]
    """Unused scenes and objects, and why."""
    choice: str
    """Choice of the samples, in a sentence."""


def write_paper_page(
    run: Path, rows: Sequence[SampleOutcome], summary: RunSummary, scenes: Sequence[SceneFacts], notes: PaperNotes
) -> Path:
    """Write index.html into the folder of a run, with the tables and figures of its scenes."""
    names = names_of(run, rows)
    cards = [card_of(run, row, names[row.method]) for row in rows]
    strips = strips_of(cards, {})
    facts, figures = write_scene_facts(run, scenes)
    tables = {one.files[0]: one for one in shown_tables(run, rows, names)}
    failures = failures_of(rows)
    times = {name: [card.timings for card in cards if card.row.method == name] for name in names}
    values = {
        "title": run.name, "summary": summary, "tiles": tiles_of(summary, rows), "notes": notes,
        "table1": tables.pop(TABLE1, None) if judged_by_model(run) else None, "table2": tables.pop(TABLE2, None),
        "tables": [one for path, one in tables.items() if path != TABLE1],
        "figures": figures, "facts": facts, "strips": strips[:MOST_STRIPS], "all_strips": len(strips),
        "failures": {kind: sum(one.kinds[0] == kind for one in failures) for kind in KINDS}, "all": len(rows),
        "failed_by_method": Counter(names[one.row.method] for one in failures), "names": names,
        "costs": costs_table(times, names), "asked": model_use(summary), "settings": settings_of(run, names),
        "config": json.dumps(read_run(run).get("config", {}), indent=2, ensure_ascii=False),
        "sentences": paper_sentences(run),
    }  # fmt: skip
    write_whole(run / INDEX, rendered("paper.html.j2", values).encode())
    return run / INDEX


def judged_by_model(run: Path) -> bool:
    """Whether a model has judged the run."""
    record = read_record(run)
    return record is not None and record.judge != RUBRIC


def settings_of(run: Path, names: Mapping[str, str]) -> list[tuple[str, str]]:
    """The request, for people; values missing in run.json are left out."""
    tree = read_run(run)
    record = read_record(run)
    versions = tree.get("versions")
    versions = versions if isinstance(versions, dict) else {}
    client, model = (value_at(tree, f"config.intent.language.{key}") for key in ("client", "model"))
    told = [
        ("dataset", value_at(tree, "dataset")),
        ("methods", ", ".join(names.values())),
        ("language", client if client == ClientName.OFFLINE else f"{client} {model}"),
        ("judge", record.judge if record else ""),
        *((words, value_at(tree, f"config.{key}")) for words, key in SHOWN_SETTINGS.items()),
        ("versions", ", ".join(f"{name} {one}" for name, one in versions.items())),
    ]
    return [(name, value) for name, value in told if value.strip()]


def value_at(tree: Mapping[str, object], key: str) -> str:
    """The value under a dotted key; empty without one."""
    value: object = tree
    for word in key.split("."):
        value = value.get(word) if isinstance(value, Mapping) else None
    return "" if value is None else YES_OR_NO.get(str(value), str(value))
