"""The page of a whole evaluation: every table, figure and file of a run, next to the section of the paper it answers.

In: a finished run with its rows, facts of its scenes, and notes on the study. Out: `index.html`, and the files of
`write_scene_facts`. The pictures and tables of single placements stay in `report.html`.
"""

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from jinja2 import FileSystemLoader, StrictUndefined
from jinja2.sandbox import SandboxedEnvironment

from dcap.evaluation.judging.judging_folder import read_record
from dcap.evaluation.judging.rubric import RUBRIC
from dcap.evaluation.outcome_table import SampleOutcome
from dcap.evaluation.paper.scene_facts import SceneFacts, write_scene_facts
from dcap.evaluation.paper.sentences import paper_sentences
from dcap.evaluation.report import TEMPLATES, card_of, model_use, names_of, shown_tables, strips_of, tiles_of
from dcap.evaluation.run_page.costs import costs_table
from dcap.evaluation.run_page.csv_tables import YES_OR_NO
from dcap.evaluation.run_page.failures import KINDS, failures_of
from dcap.evaluation.run_page.provenance import read_run
from dcap.evaluation.run_summary import RunSummary
from dcap.evaluation.table_files import table_links
from dcap.language.protocol.client import ClientName
from dcap.scene.json_tree import write_whole

INDEX = "index.html"
TABLE1, TABLE2 = (table_links(name)[0] for name in ("table1", "table2"))
MOST_STRIPS = 60
"""Samples in the gallery [-]; report.html has all."""


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
    environment = SandboxedEnvironment(
        loader=FileSystemLoader(TEMPLATES), autoescape=True, undefined=StrictUndefined, trim_blocks=True,
        lstrip_blocks=True,
    )  # fmt: skip
    path = run / INDEX
    write_whole(path, environment.get_template("paper.html.j2").render(values).encode())
    return path


def judged_by_model(run: Path) -> bool:
    """Whether a model has judged the run."""
    record = read_record(run)
    return record is not None and record.judge != RUBRIC


def settings_of(run: Path, names: Mapping[str, str]) -> list[tuple[str, str]]:
    """The request, for people; values missing in run.json are left out."""
    tree = read_run(run)
    record = read_record(run)
    versions = tree.get("versions")
    asked = [value_at(tree, f"config.intent.language.{one}") for one in ("client", "model")]
    told = [
        ("dataset", value_at(tree, "dataset")),
        ("methods", ", ".join(names.values())),
        ("language", asked[0] if asked[0] == ClientName.OFFLINE else " ".join(asked)),
        ("judge", record.judge if record else ""),
        ("solver", value_at(tree, "config.drop.solver.method")),
        ("clearance at the start [m]", value_at(tree, "config.anchor.clearance")),
        ("rigid above [Pa]", value_at(tree, "config.materials.rigid_above")),
        ("limits of the paper", value_at(tree, "config.materials.paper_limits")),
        (
            "versions",
            ", ".join(f"{name} {one}" for name, one in versions.items()) if isinstance(versions, dict) else "",
        ),
    ]
    return [(name, value) for name, value in told if value.strip()]


def value_at(tree: Mapping[str, object], key: str) -> str:
    """The value under a dotted key; empty without one."""
    value: object = tree
    for word in key.split("."):
        value = value.get(word) if isinstance(value, Mapping) else None
    return "" if value is None else YES_OR_NO.get(str(value), str(value))
