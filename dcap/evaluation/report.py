"""The static page of a benchmark run: one card per sample, counts on top, nothing loaded from elsewhere."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from dcap.evaluation.outcome_table import AT_REST, SampleOutcome
from dcap.evaluation.run_folder import sample_folder
from dcap.evaluation.run_summary import RunSummary
from dcap.language.model.ledger import in_words
from dcap.scene.json_tree import JsonObject

TEMPLATES = Path(__file__).parent / "templates"
PICTURES = (
    ("clean", "before"),
    ("asked", "as asked"),
    ("settled", "after"),
    ("closeup", "from nearby"),
    ("contact", "contact"),
)


@dataclass(frozen=True, slots=True)
class Card:
    """What the page shows of one sample."""

    row: SampleOutcome
    kind: str
    """rest, infeasible or failed: chooses the colour."""
    pictures: tuple[tuple[str, str], ...]
    """(path relative to the page, caption)."""
    stages: tuple[tuple[str, float, float], ...]
    """(name, seconds, share of the longest stage of this sample in percent)."""
    facts: tuple[tuple[str, str], ...]
    materials: tuple[tuple[str, str, str], ...]
    """(part, material, reason)."""
    warnings: tuple[str, ...]
    folder: str


def write_report(folder: Path, rows: Sequence[SampleOutcome], summary: RunSummary) -> Path:
    """Write report.html into a run's folder from the files of its samples."""
    cards = [card_of(folder, row) for row in rows]
    environment = Environment(
        loader=FileSystemLoader(TEMPLATES),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    page = environment.get_template("report.html.j2").render(
        title=folder.name, cards=cards, summary=summary, tiles=tiles_of(summary), asked=asked_of(summary)
    )
    path = folder / "report.html"
    draft = folder / ".report.html"
    draft.write_text(page, encoding="utf-8")
    draft.replace(path)
    return path


def card_of(folder: Path, row: SampleOutcome) -> Card:
    """The card of one sample."""
    kept = sample_folder(folder, row.sample)
    link = kept.relative_to(folder).as_posix()
    tree = read_placement(kept) if not row.error else {}
    pictures = tuple(
        (f"{link}/{name}.png", caption)
        for name, caption in PICTURES
        if not row.error and (kept / f"{name}.png").is_file()
    )
    warnings = tree.get("warnings")
    return Card(
        row=row,
        kind="failed" if row.error else ("rest" if row.verdict == AT_REST else "infeasible"),
        pictures=pictures,
        stages=stage_bars(tree.get("timings")),
        facts=facts_of(row, tree),
        materials=materials_of(tree),
        warnings=tuple(str(one) for one in warnings) if isinstance(warnings, list) else (),
        folder=link,
    )


def read_placement(folder: Path) -> JsonObject:
    """placement.json of a sample, empty if there is none."""
    path = folder / "placement.json"
    tree = json.loads(path.read_text()) if path.is_file() else {}
    return tree if isinstance(tree, dict) else {}


def stage_bars(timings: object) -> tuple[tuple[str, float, float], ...]:
    """Stage times with the length of their bars."""
    if not isinstance(timings, Mapping) or not timings:
        return ()
    longest = max(*timings.values(), 1e-3)
    return tuple((str(name), float(value), 100.0 * float(value) / longest) for name, value in timings.items())


def facts_of(row: SampleOutcome, tree: Mapping[str, object]) -> tuple[tuple[str, str], ...]:
    """Name and value of what is worth a glance."""
    facts = [("support", " · ".join(word for word in (row.base, row.part) if word)), ("region", row.region)]
    if row.region_missed:
        facts.append(("region", "missed"))
    if row.mass:
        facts.append(("mass", f"{row.mass:.3g} kg"))
    if row.scale:
        facts.append(("scale", f"{row.scale:.3g}"))
    if row.visible_fraction:
        facts.append(("visible", f"{100 * row.visible_fraction:.0f} %"))
    contacts = tree.get("contacts")
    if isinstance(contacts, list) and contacts:
        forces = [float(one.get("normal_force_n", 0.0)) for one in contacts if isinstance(one, Mapping)]
        areas = [float(one.get("area_m2", 0.0)) for one in contacts if isinstance(one, Mapping)]
        facts.append(("contact", f"{1e4 * sum(areas):.1f} cm², {sum(forces):.2f} N"))
    materials = tree.get("materials")
    if isinstance(materials, list):
        names = [f"{one['part']}: {one['material']}" for one in materials if isinstance(one, Mapping)]
        facts.append(("materials", ", ".join(dict.fromkeys(names))))
    return tuple((name, value) for name, value in facts if value)


def materials_of(tree: Mapping[str, object]) -> tuple[tuple[str, str, str], ...]:
    """What each part of object, base and neighbours is taken to be made of, and why; what is alike once."""
    rows = tree.get("materials")
    found = [one for one in rows if isinstance(one, Mapping)] if isinstance(rows, list) else []
    named = ((f"{one['body']}, {one['part']}", str(one["material"]), str(one.get("reason", ""))) for one in found)
    return tuple(dict.fromkeys(named))


def asked_of(summary: RunSummary) -> str:
    """Who was asked, and what that took; empty where no model was."""
    spent = summary.language
    return f"{', '.join(spent.models)}: {in_words(spent)}" if spent else ""


def tiles_of(summary: RunSummary) -> list[tuple[str, str, str]]:
    """(number, words, kind) of the tiles on top."""
    tiles = [
        (str(summary.samples), "samples", "plain"),
        (str(summary.at_rest), "at rest", "rest"),
        (str(summary.infeasible), "infeasible", "infeasible"),
        (str(summary.failed), "failed", "failed" if summary.failed else "plain"),
    ]
    if summary.feasible_intended:
        found = f"{summary.feasible_as_intended}/{summary.feasible_intended}"
        tiles.append((found, "feasible: at rest as intended", "plain"))
    if summary.infeasible_intended:
        found = f"{summary.infeasible_with_right_reason}/{summary.infeasible_intended}"
        tiles.append((found, "infeasible: right reason", "plain"))
    return tiles
