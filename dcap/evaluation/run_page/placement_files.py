"""Reads the files of one placement: facts, stage times, materials, certificate, pictures.

In: the folder of a placement in a run, and its row. Out: texts for the page. A file that is missing or invalid leaves
its part of the page empty.
"""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path

from dcap.evaluation.outcome_table import AS_POSED, AT_REST, SampleOutcome
from dcap.scene.types.pictures import PLACED
from dcap.scene.written_files import JsonObject

PLACEMENT = "placement.json"
MOST_NOTES, MOST_LETTERS = 20, 300
"""Most notes of a placement on the page, and most letters of one [-]: the page of a thousand placements must open."""


def kind_of(row: SampleOutcome) -> str:
    """rest, posed, infeasible or failed: chooses the colour."""
    if row.error:
        return "failed"
    return {AT_REST: "rest", AS_POSED: "posed"}.get(row.verdict, "infeasible")


def read_placement(folder: Path) -> JsonObject:
    """placement.json of a sample, empty if there is none."""
    path = folder / PLACEMENT
    try:
        tree = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    except ValueError:
        return {}
    return tree if isinstance(tree, dict) else {}


def views_of(folder: Path) -> tuple[str, ...]:
    """Paths of the pictures that compare a placement with others, below its folder: after judging those that judges
    see, until then its own."""
    judged, own = [f"views/{name}.png" for name in PLACED], ["settled.png", "closeup.png"]
    names = judged if all((folder / name).is_file() for name in judged) else own
    return tuple(name for name in names if (folder / name).is_file())


def stage_bars(timings: object) -> tuple[tuple[str, float, float], ...]:
    """Stage times [s] with the length of their bars [%]."""
    if not isinstance(timings, Mapping) or not timings:
        return ()
    longest = max(*timings.values(), 1e-3)
    return tuple((str(name), float(value), 100.0 * float(value) / longest) for name, value in timings.items())


def facts_of(row: SampleOutcome, tree: Mapping[str, object]) -> tuple[tuple[str, str], ...]:
    """Names and values of the main facts."""
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
    """Materials of each part of object, base and neighbours, with reasons; equal rows appear once."""
    rows = tree.get("materials")
    found = [one for one in rows if isinstance(one, Mapping)] if isinstance(rows, list) else []
    named = ((f"{one['body']}, {one['part']}", str(one["material"]), str(one.get("reason", ""))) for one in found)
    return tuple(dict.fromkeys(named))[:MOST_NOTES]


def notes_of(tree: Mapping[str, object]) -> tuple[str, ...]:
    """The warnings of a placement, cut if they are many or long."""
    found = tree.get("warnings")
    notes = [shortened(str(one)) for one in found] if isinstance(found, list) else []
    more = len(notes) - MOST_NOTES
    return (*notes[:MOST_NOTES], *((f"{more} more in {PLACEMENT}",) if more > 0 else ()))


def shortened(text: str) -> str:
    """A text cut to a largest number of letters."""
    return text if len(text) <= MOST_LETTERS else f"{text[:MOST_LETTERS].rstrip()} …"


def certificate_text(tree: Mapping[str, object]) -> str:
    """The certificate of a placement as lines of text, and its contacts; empty without a rest state."""
    lines = list(certificate_lines("", tree.get("certificate")))
    contacts = tree.get("contacts")
    if lines and isinstance(contacts, list):
        lines += [(f"contact {number}", in_a_line(one)) for number, one in enumerate(contacts, 1)]
    wide = max((len(name) for name, _ in lines), default=0)
    return "\n".join(f"{name:{wide}}  {shortened(value)}" for name, value in lines)


def certificate_lines(name: str, value: object) -> Iterator[tuple[str, str]]:
    """Name and value of each entry of a certificate; an entry with a threshold is one line."""
    if isinstance(value, Mapping) and "threshold" not in value:
        for key, inner in value.items():
            yield from certificate_lines(f"{name}.{key}" if name else str(key), inner)
    elif isinstance(value, list) and value and isinstance(value[0], Mapping):
        for number, inner in enumerate(value[:MOST_NOTES], 1):
            yield f"{name} {number}", in_a_line(inner)
    elif value is not None:
        yield name, in_a_line(value)


def in_a_line(value: object) -> str:
    """A value of a certificate for people."""
    if isinstance(value, Mapping):
        if "value" in value:
            rest = {key: one for key, one in value.items() if key != "value"}
            return f"{in_a_line(value['value']):>10}   {in_a_line(rest)}".rstrip()
        return ", ".join(f"{key} {in_a_line(one)}" for key, one in value.items())
    if isinstance(value, list):
        return ", ".join(in_a_line(one) for one in value) or "none"
    if isinstance(value, bool) or value is None:
        return {True: "yes", False: "no", None: "unknown"}[value]
    return f"{value:.4g}" if isinstance(value, float) else str(value)
