"""`dcap dataset check`: every problem of a dataset by path and line, and the contents of its scenes.

In: a dataset file (YAML), a folder of scenes, one scene or one mesh. Nothing is written. Scenes are checked in
dcap/scene/checks; this module checks the dataset file and the intended outcomes next to it, and reports as text, JSON
and plot.
"""

import os
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from dcap.evaluation.outcome_table import read_truth
from dcap.evaluation.supports_plot import SHOWN, save_supports_plot, summary, supports_table
from dcap.knowledge.kinds import deformable_supports
from dcap.knowledge.lexicon import is_a, thing_of
from dcap.scene.checks.findings import Finding, Findings, yaml_lines
from dcap.scene.checks.scene_folder import SceneFacts, check_scene, layout_of
from dcap.scene.errors import InputError, Place, Report, Severity, error, short, warning
from dcap.scene.readers.scenes.sugar import MESH_SUFFIXES
from dcap.scene.settings import data_root
from dcap.scene.text import did_you_mean
from dcap.scene.types.sample import Sample
from dcap.scene.written_files import JsonObject, write_whole
from flows.samples import EMBEDDED, TRUTH, find, load_yaml, samples_of

YAML_SUFFIXES = (".yaml", ".yml")
COLUMNS = ("scene", "instances", "objects", "deformable", "faces", "splats", "problems", "")


@dataclass(frozen=True, slots=True)
class SceneRow:
    """One scene in the table."""

    facts: SceneFacts
    kinds: Counter[str]
    """Deformable supports by kind."""
    things: int
    """Instances that are not part of the building."""
    problems: int
    """Errors and warnings in its files."""
    counted: bool
    """Whether its contents are known: some of them were read, or no error hides them."""


@dataclass(frozen=True, slots=True)
class DatasetReport:
    """Everything that a check found."""

    path: Path
    findings: tuple[Finding, ...]
    counts: Mapping[Severity, int]
    scenes: tuple[SceneRow, ...]
    objects: tuple[SceneFacts, ...]
    """Meshes to place: those that a dataset file names as objects, or several in one folder."""

    @property
    def failed(self) -> bool:
        """Whether any finding is an error."""
        return self.counts[Severity.ERROR] > 0


def check_dataset(path: Path | None) -> DatasetReport:
    """Check a dataset file, folder, scene or mesh; by default the embedded dataset."""
    if path is None and not (data_root() / "rooms").is_dir():
        raise InputError(f"{data_root()}: the embedded dataset is not there; make it with `dcap dataset make`")
    path = path or EMBEDDED
    if not os.path.exists(path):  # False, not an exception, for a name that no file can have
        raise InputError(f"{path}: no such file or folder")
    findings = Findings()
    if path.suffix.lower() in YAML_SUFFIXES:
        scenes, objects = _named(path, findings)
    else:
        found = layout_of(path, findings)
        scenes, objects = (found.scenes, found.meshes) if path.is_dir() else (found.meshes, [])
    facts = [check_scene(one, findings) for one in scenes]
    meshes = tuple(check_scene(one, findings) for one in objects)
    listed, counts = findings.all(), {one: findings.count(one) for one in Severity}
    return DatasetReport(path, listed, counts, tuple(_row(one, listed) for one in facts), meshes)


def _named(path: Path, findings: Findings) -> tuple[list[Path], list[Path]]:
    """Scenes and objects that a dataset file names, each once, after checking the file itself."""
    rows, report = _yaml(path, findings)
    samples = samples_of(rows, path.parent, report) if rows is not None else []
    found: dict[str, dict[Path, None]] = {"rooms": {}, "objects": {}}
    for index, row in enumerate(rows if isinstance(rows, list) else []):
        for key, kind in (("room", "rooms"), ("scene", "rooms"), ("object", "objects")):
            given = row.get(key) if isinstance(row, Mapping) else None
            if not isinstance(given, str) or not given.strip():
                continue  # absent, or already reported as not being text
            place = find(given, path.parent, kind)
            if os.path.exists(place):
                found[kind][Path(place)] = None
                continue
            hint = _nearest(given, kind) or "; `dcap dataset make` makes the embedded ones"
            what = f"{key} {short(given)} is neither next to the file nor in {data_root() / kind}{hint}"
            report(error(f"sample {index}: {what}", (index, key)))
    _check_truth(path.with_name(TRUTH), [sample for _, sample in samples], findings)
    return list(found["rooms"]), list(found["objects"])


def _nearest(name: str, kind: str) -> str:
    folder = data_root() / kind
    files = folder.iterdir() if folder.is_dir() else ()
    return did_you_mean(name, [one.stem if one.suffix in MESH_SUFFIXES else one.name for one in files])


def _yaml(path: Path, findings: Findings) -> tuple[object | None, Report]:
    """The tree of a YAML file, None where it cannot be read, and a report with its line numbers."""
    try:
        tree = load_yaml(path)
    except InputError as broken:
        cause = broken.__cause__
        mark, detail = getattr(cause, "problem_mark", None), getattr(cause, "problem", None)
        what = f"cannot be read as YAML: {detail}" if detail else str(broken).removeprefix(f"{path}: ")
        findings.report(path)(error(what, line=mark.line + 1 if mark else 0))
        return None, findings.report(path)
    return [] if tree is None else tree, findings.report(path, yaml_lines(path.read_text("utf-8")))


def _check_truth(path: Path, samples: Iterable[Sample], findings: Findings) -> None:
    """Check that each intended outcome is readable and has a sample."""
    if not path.is_file():
        return
    tree, report = _yaml(path, findings)
    if tree is None:
        return
    rows = tree if isinstance(tree, Mapping) else {}
    parts: list[tuple[object, Place]] = [({key: row}, (str(key),)) for key, row in rows.items()]
    for part, place in parts or [(tree, ())]:
        try:
            read_truth(part, str(path))
        except InputError as broken:
            report(error(str(broken).removeprefix(f"{path}: "), place))
    if path.parent == EMBEDDED.parent:
        return  # the embedded datasets share one file
    ids = {sample.id for sample in samples}
    for key in rows:
        if str(key) not in ids:
            report(warning(f"no sample has the id {str(key)!r}{did_you_mean(key, ids)}", (str(key),)))


def _row(facts: SceneFacts, findings: Iterable[Finding]) -> SceneRow:
    things = sum(not _is_structure(label) for label in facts.labels)
    own = [one for one in findings if one.path == facts.path or facts.path in one.path.parents]
    problems = sum(one.severity is not Severity.NOTE for one in own)
    counted = bool(facts.labels) or all(one.severity is not Severity.ERROR for one in own)
    return SceneRow(facts, deformable_supports(facts.labels), things, problems, counted)


def _is_structure(label: str) -> bool:
    """Whether a label names a part of the building."""
    thing = thing_of(label)
    return thing is not None and is_a(thing.id, "structure")


def write_plot(report: DatasetReport, path: Path) -> None:
    """Plot the distribution of deformable supports as PNG or SVG."""
    save_supports_plot(_counted(report), path)


def write_table(report: DatasetReport, path: Path) -> None:
    """Write the numbers as a table, one row per scene; InputError where nothing can be written."""
    names = _short_names([row.facts.path for row in report.scenes]) if report.scenes else {}
    text = supports_table({names[row.facts.path]: row.facts.labels for row in report.scenes if row.counted})
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, text.encode())
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from None


def _counted(report: DatasetReport) -> list[Counter[str]]:
    """Kinds of supports in the scenes that could be read; the contents of the others are unknown."""
    return [row.kinds for row in report.scenes if row.counted]


def as_tree(report: DatasetReport) -> JsonObject:
    """The report as JSON."""
    return {
        "path": str(report.path),
        **{f"{one}s": report.counts[one] for one in Severity},
        "findings": [
            {"path": str(one.path), "line": one.line or None, "severity": one.severity, "what": one.what}
            for one in report.findings
        ],
        "scenes": [
            {
                "scene": str(row.facts.path),
                "instances": len(row.facts.labels),
                "objects": row.things,
                "deformable_supports": row.kinds.total(),
                "deformable_kinds": {kind: row.kinds[kind] for kind in SHOWN if row.kinds[kind]},
                "faces": row.facts.faces,
                "splats": row.facts.splats,
                "problems": row.problems,
            }
            for row in report.scenes
        ],
        "objects": [{"object": str(one.path), "faces": one.faces, "splats": one.splats} for one in report.objects],
        "totals": totals(report),
    }


def totals(report: DatasetReport) -> JsonObject:
    """Return sums over the scenes and single meshes; `objects` counts instances that are not part of the building."""
    rows = report.scenes
    kinds: Counter[str] = sum((row.kinds for row in rows), Counter())
    return {
        "scenes": len(rows),
        "scenes_unreadable": sum(not row.counted for row in rows),
        "scenes_with_deformable_supports": sum(row.kinds.total() > 0 for row in rows),
        "instances": sum(len(row.facts.labels) for row in rows),
        "objects": sum(row.things for row in rows),
        "deformable_supports": kinds.total(),
        "deformable_kinds": {kind: kinds[kind] for kind in SHOWN if kinds[kind]},
        "faces": sum(row.facts.faces for row in rows),
        "splats": sum(row.facts.splats for row in rows),
        "object_meshes": len(report.objects),
        "object_faces": sum(one.faces for one in report.objects),
    }


def in_words(report: DatasetReport) -> str:
    """The report as text: findings, table, sums."""
    parts = ["\n".join(str(one) for one in report.findings)]
    if report.scenes:
        lost = sum(not row.counted for row in report.scenes)
        left_out = f" ({lost} unreadable, left out)" if lost else ""
        parts += [_table(report.scenes), f"deformable supports: {summary(_counted(report))}{left_out}"]
    if report.objects:
        parts.append(f"single meshes: {len(report.objects)}, {sum(one.faces for one in report.objects)} faces")
    parts.append(", ".join(f"{report.counts[one]} {one}{'s' * (report.counts[one] != 1)}" for one in Severity))
    return "\n\n".join(part for part in parts if part)


def _table(rows: Sequence[SceneRow]) -> str:
    """One line per scene and one of sums; numbers are right-aligned."""
    numbers = [
        (len(row.facts.labels), row.things, row.kinds.total(), row.facts.faces, row.facts.splats, row.problems)
        for row in rows
    ]
    names = _short_names([row.facts.path for row in rows])
    cells: list[tuple[str, ...]] = [COLUMNS]
    for row, values in zip(rows, numbers, strict=True):
        kinds = ", ".join(f"{row.kinds[kind]} {kind}" for kind in SHOWN if row.kinds[kind])
        cells.append((names[row.facts.path], *map(str, values), kinds))
    cells.append(("total", *(str(sum(column)) for column in zip(*numbers, strict=True)), ""))
    widths = [max(len(line[i]) for line in cells) for i in range(len(COLUMNS))]
    return "\n".join(
        "  ".join([line[0].ljust(widths[0]), *map(str.rjust, line[1:-1], widths[1:-1]), line[-1]]).rstrip()
        for line in cells
    )


def _short_names(paths: Sequence[Path]) -> dict[Path, str]:
    """Paths without the folder that all of them share."""
    common = Path(os.path.commonpath([path.absolute().parent for path in paths]))
    return {path: path.absolute().relative_to(common).as_posix() for path in paths}
