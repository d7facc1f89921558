"""Contents, damage and unneeded artifacts of the cache: `dcap cache ls|du|gc|verify`."""

import os
import sys
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from contextlib import nullcontext
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.table import Table

from dcap.scene.errors import InputError
from dcap.scene.settings import cache_root, runs_root
from flows.cli.checks import note, print_result
from flows.display import console_on
from flows.find_run import RUN, EarlierRunError
from flows.run_files import PLACEMENT
from tasks.artifact import Ref, Store, exclusive_use
from tasks.records import every_record
from tasks.upkeep import CacheUsage, Unneeded, damages, delete, repair, unneeded, usages

DAMAGED = 4
DAY_S = 86_400.0
SHOWN = 5
"""Maximum number of failed look-ups to print."""


def cache_listing(*, as_json: bool) -> int:
    """Print number and size of the artifacts by kind."""
    store = Store.default()
    rows: dict[str, dict[str, int]] = defaultdict(lambda: {"artifacts": 0, "bytes": 0})
    for ref in store.refs():
        rows[ref.kind]["artifacts"] += 1
        rows[ref.kind]["bytes"] += store.size(ref)
    if as_json:
        print_result({"folder": str(store.root), "kinds": rows}, "", as_json=True)
        return 0
    table = Table("kind", "artifacts", "MiB", title=str(store.root))
    for kind, row in sorted(rows.items()):
        table.add_row(kind, str(row["artifacts"]), mebibytes(row["bytes"]))
    artifacts, size = (sum(row[column] for row in rows.values()) for column in ("artifacts", "bytes"))
    table.add_row("total", str(artifacts), mebibytes(size), style="bold")
    console_on(sys.stdout).print(table)
    return 0


def cache_sizes(*, as_json: bool) -> int:
    """Print the size of each stage's results in the cache."""
    rows = usages()
    if as_json:
        tree = {"folder": str(cache_root()), "stages": as_rows(rows), "bytes": sum(row.size for row in rows)}
        print_result(tree, "", as_json=True)
    else:
        console_on(sys.stdout).print(usage_table(rows, str(cache_root())))
    return 0


def cache_collection(older_than_days: float, others: Sequence[Path], *, delete_it: bool, as_json: bool) -> int:
    """Print artifacts that no run needs; delete them if `delete_it`."""
    with exclusive_use(cache_root()) if delete_it else nullcontext():
        folders, needed, unknown = kept_runs(others)
        what = unneeded(needed, older_than_days * DAY_S)
        young = unneeded(needed, 0.0).count - what.count if older_than_days > 0.0 else 0
        if delete_it:
            delete(what)
    if as_json:
        tree = {
            "runs": [str(folder) for folder in folders], "unknown": unknown,
            "records": len(what.records), "artifacts": len(what.artifacts), "litter": len(what.litter),
            "bytes": what.size, "stages": as_rows(what.usage), "young": young, "deleted": delete_it,
        }  # fmt: skip
        print_result(tree, "", as_json=True)
    else:
        show_collection(what, len(folders), unknown, young, older_than_days, deleted=delete_it)
    return 0


def show_collection(
    what: Unneeded, runs: int, unknown: Sequence[str], young: int, older_than_days: float, *, deleted: bool
) -> None:
    """Print as text which artifacts can be deleted, or were."""
    console = console_on(sys.stdout)
    for line in [
        *unknown[:SHOWN],
        *([f"and {len(unknown) - SHOWN} more"] if len(unknown) > SHOWN else []),
    ]:
        note(f"cannot be looked up: {line}")
    if what.usage:
        console.print(usage_table(what.usage, "deleted" if deleted else "no run needs"))
    hours = 24.0 * older_than_days
    age = f"; changed in the last {hours:g} hours, and not needed: {young}" if young else ""
    console.print(f"runs and placements that are kept: {runs}{age}")
    if what.count:
        words = "were deleted" if deleted else "would be deleted; --yes does it"
        console.print(f"not needed: {what.count}, {mebibytes(what.size)} MiB, {words}")
    else:
        console.print("nothing to delete")


def kept_runs(others: Sequence[Path]) -> tuple[list[Path], set[Ref[Any]], list[str]]:
    """Return the folders of all runs and placements, the artifacts they need, and the samples that cannot be looked up.

    A placement lists the artifacts it needs in `records.json`. For a failed or unfinished one, the cache is searched.
    """
    from flows.output import RECORDS, read_needs
    from flows.run_files import (  # imports all stages, which the other commands need not wait for
        find_request,
        load_run_request,
    )
    from flows.sample_run import plan_sample

    for folder in others:
        if not any(run_folders(folder)):
            raise InputError(f"--keep {folder}: contains no run and no placement; give the folder of one")
    found = sorted({folder for root in (runs_root(), *others) for folder in run_folders(root)})
    folders, needed, unknown = list[Path](), set[Ref[Any]](), list[str]()
    for folder in found:
        try:
            asked = load_run_request(folder) if (folder / RUN).is_file() else find_request(str(folder), None)[0]
        except EarlierRunError as error:
            unknown.append(f"{error}; nothing is kept for it")
            continue
        except (InputError, OSError, ValueError) as error:
            # written by a later version, or damaged; records.json of its samples still lists their artifacts
            unknown.append(str(error))
            folders.append(folder)
            needed |= {ref for one in folder.rglob(RECORDS) for ref in read_needs(one.parent) or ()}
            continue
        folders.append(folder)
        for sample in asked.samples.values():
            refs = read_needs(asked.folder_of(sample.id))
            if refs is None:
                plan = plan_sample(sample, asked.config, bring=False)
                refs = {one.ref for one in plan.found}
                unknown += [f"{folder.name} {sample.id}: {plan.why}"] if plan.failed else []
            needed |= refs
    return folders, needed, unknown


def run_folders(root: Path) -> Iterator[Path]:
    """Yield `root` and folders below it that hold a run or a placement; links are not followed."""
    for place, _, files in os.walk(root):
        if RUN in files or PLACEMENT in files:
            yield Path(place).resolve()


def cache_verification(*, repair_it: bool, as_json: bool) -> int:
    """Check everything in the cache; return 4 if damage remains."""
    # checked under the lock, since another program may have repaired artifacts
    with exclusive_use(cache_root()) if repair_it else nullcontext():
        counts = {"artifacts": sum(1 for _ in Store.default().refs()), "records": sum(1 for _ in every_record())}
        found = damages()
        if repair_it:
            repair(found)
    if as_json:
        tree = {
            **counts,
            "damaged": [{"kind": one.ref.kind, "sha256": one.ref.sha256} for one in found if one.ref],
            "damaged_records": [{"path": str(one.path), "why": one.why} for one in found if one.ref is None],
            "repaired": repair_it and bool(found),
        }
        print_result(tree, "", as_json=True)
    else:
        console = console_on(sys.stdout)
        for one in found:
            console.print(f"damaged: {one.path}: {one.why}", soft_wrap=True)
        console.print(", ".join(f"{number} {name}" for name, number in counts.items()) + f", {len(found)} damaged")
        if repair_it and found:
            console.print("damaged artifacts were deleted and will be computed again when needed")
    return DAMAGED if found and not repair_it else 0


def usage_table(rows: Iterable[CacheUsage], title: str) -> Table:
    """Return the rows of stages with their sum as a table."""
    every = list(rows)
    table = Table("stage", "records", "artifacts", "MiB", "computed in [s]", title=title)
    for row in every:
        table.add_row(row.stage, str(row.records), str(row.artifacts), mebibytes(row.size), f"{row.seconds:.1f}")
    artifacts, size, seconds = (sum(getattr(row, name) for row in every) for name in ("artifacts", "size", "seconds"))
    table.add_row("total", "", str(artifacts), mebibytes(size), f"{seconds:.1f}", style="bold")
    return table


def as_rows(rows: Iterable[CacheUsage]) -> list[dict[str, object]]:
    """Return rows for `--json`."""
    return [{("bytes" if key == "size" else key): value for key, value in asdict(row).items()} for row in rows]


def mebibytes(size: int) -> str:
    """Return a size in MiB."""
    return f"{size / 2**20:.1f}"
