"""`dcap diff`."""

import json
from collections.abc import Sequence
from dataclasses import fields
from typing import TYPE_CHECKING, Annotated

import typer

from flows.cli.checks import Json

if TYPE_CHECKING:
    from dcap.evaluation.run_diff import RunDiff

SHOWN = 40
"""Rows of a table; `--json` has all."""
DIGITS = 6


def diff(
    one: Annotated[str, typer.Argument(metavar="RUN", help="Name or folder of a run, 'last', or what `place` wrote.")],
    other: Annotated[str, typer.Argument(metavar="RUN", help="What it is compared with.")],
    times: Annotated[bool, typer.Option("--times", help="Show times, too; they are no difference.")] = False,
    as_json: Json = False,
) -> int:
    """Compare verdicts, poses, metrics, settings and versions of two runs."""
    from dcap.scene.json_tree import object_to_json
    from flows.diff import diff_folders

    found = diff_folders(one, other)
    if as_json:
        tree = {"equal": found.equal, **object_to_json(found)}
        if not times:
            del tree["times"]
        print(json.dumps(tree, indent=2, ensure_ascii=False))
        return 0
    print(f"a: {found.a}\nb: {found.b}")
    if found.equal:
        print("no difference")
    for line in difference_lines(found, times=times):
        print(line)
    return 0


def difference_lines(found: "RunDiff", *, times: bool) -> list[str]:
    """All tables as lines."""
    lines = [f"only in {name}: {', '.join(samples)}" for name, samples in (("a", found.only_a), ("b", found.only_b))
             if samples]  # fmt: skip
    for name in ("outcomes", "poses", "metrics", "asked", "config", "versions", *(["times"] if times else [])):
        lines += table_lines(name, getattr(found, name))
    return lines


def table_lines(name: str, rows: Sequence[object]) -> list[str]:
    """A table with its heading; nothing for no rows."""
    if not rows:
        return []
    columns = [one.name for one in fields(rows[0])]  # type: ignore[arg-type]
    cells = [columns, *([cell(getattr(row, column)) for column in columns] for row in rows[:SHOWN])]
    widths = [max(len(row[index]) for row in cells) for index in range(len(columns))]
    lines = ["  ".join(f"{word:<{width}}" for word, width in zip(row, widths, strict=True)).rstrip() for row in cells]
    more = [f"... {len(rows) - SHOWN} more, all with --json"] if len(rows) > SHOWN else []
    return ["", f"{name} ({len(rows)})", *lines, *more]


def cell(value: object) -> str:
    """A value in a table."""
    if value is None:
        return "-"
    return f"{value:.{DIGITS}g}" if isinstance(value, float) else str(value)
