"""Output of `dcap dataset check`: findings, one line per scene, sums; as text, as JSON, and as a plot."""

import os
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from dcap.evaluation.supports_plot import save_supports_plot, summary
from dcap.evaluation.supports_table import SHOWN, supports_table
from dcap.scene.errors import InputError, Severity
from dcap.scene.json_tree import JsonObject, write_whole
from flows.dataset_check import DatasetReport, SceneRow

COLUMNS = ("scene", "instances", "objects", "deformable", "faces", "splats", "problems", "")


def write_plot(report: DatasetReport, path: Path) -> None:
    """The distribution of deformable supports as PNG or SVG."""
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
