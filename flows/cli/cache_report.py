"""What the cache holds, what of it is damaged, and what nothing needs: `dcap cache ls|du|gc|verify`."""

import json
from collections import defaultdict
from collections.abc import Iterable, Sequence
from contextlib import nullcontext
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.table import Table

from dcap.scene.settings import cache_root
from dcap.scene.store.artifacts import Store
from dcap.scene.store.in_use import used_alone
from flows.cli.checks import note
from tasks.runner.cache_usage import CacheUsage, record_files, usages
from tasks.runner.collection import Unneeded, collect, unneeded
from tasks.runner.damage import Damage, DamagedThing, damages
from tasks.runner.damage import repair as moved_away

if TYPE_CHECKING:
    from flows.kept_runs import KeptRuns

DAMAGED = 4
DAY_S = 86_400.0
SHOWN = 5
"""Lines of a kind that are told one by one."""


def cache_listing(*, as_json: bool) -> int:
    """Print number and size of the artifacts by kind."""
    store = Store.default()
    rows: dict[str, dict[str, int]] = defaultdict(lambda: {"artifacts": 0, "bytes": 0})
    for ref in store.refs():
        rows[ref.kind]["artifacts"] += 1
        rows[ref.kind]["bytes"] += store.size(ref)
    if as_json:
        Console().print_json(json.dumps({"folder": str(store.root), "kinds": rows}))
        return 0
    table = Table("kind", "artifacts", "MiB", title=str(store.root))
    for kind, row in sorted(rows.items()):
        table.add_row(kind, str(row["artifacts"]), mebibytes(row["bytes"]))
    table.add_row("total", str(total(rows, "artifacts")), mebibytes(total(rows, "bytes")), style="bold")
    Console().print(table)
    return 0


def total(rows: dict[str, dict[str, int]], column: str) -> int:
    """Sum over all kinds."""
    return sum(row[column] for row in rows.values())


def cache_sizes(*, as_json: bool) -> int:
    """Print what each stage has in the cache."""
    store = Store.default()
    rows = usages(store)
    if as_json:
        tree = {"folder": str(cache_root()), "stages": as_rows(rows), "bytes": sum(row.size for row in rows)}
        Console().print_json(json.dumps(tree))
        return 0
    Console().print(usage_table(rows, str(cache_root())))
    return 0


def cache_collection(older_than_days: float, others: Sequence[Path], *, delete: bool, as_json: bool) -> int:
    """Print what no run needs; delete it if that is asked."""
    store = Store.default()
    if delete:
        with used_alone(cache_root()):
            kept, what = found_unneeded(store, older_than_days, others)
            collect(store, what)
    else:
        kept, what = found_unneeded(store, older_than_days, others)
    young = 0
    if older_than_days > 0.0:
        young = unneeded(store, kept.needs, 0.0).count - (0 if delete else what.count)
    if as_json:
        Console().print_json(json.dumps(collection_tree(kept, what, young, deleted=delete)))
        return 0
    tell_collection(kept, what, young, older_than_days, deleted=delete)
    return 0


def found_unneeded(store: Store, older_than_days: float, others: Sequence[Path]) -> tuple["KeptRuns", Unneeded]:
    """The runs that are kept, and what they do not need."""
    from flows.kept_runs import kept_runs  # brings all stages along, which the other commands do not wait for

    kept = kept_runs(others)
    return kept, unneeded(store, kept.needs, older_than_days * DAY_S)


def collection_tree(kept: "KeptRuns", what: Unneeded, young: int, *, deleted: bool) -> dict[str, object]:
    """What `--json` prints."""
    return {
        "runs": [str(folder) for folder in kept.folders],
        "unknown": list(kept.unknown),
        "records": len(what.records),
        "artifacts": len(what.artifacts),
        "litter": len(what.litter),
        "bytes": what.size,
        "stages": as_rows(what.usage),
        "young": young,
        "deleted": deleted,
    }


def tell_collection(kept: "KeptRuns", what: Unneeded, young: int, older_than_days: float, *, deleted: bool) -> None:
    """The same for a person."""
    console = Console(highlight=False)
    for line in shortened([f"cannot be looked up: {one}" for one in kept.unknown]):
        note(line)
    if what.usage:
        console.print(usage_table(what.usage, "deleted" if deleted else "no run needs"))
    runs = f"{len(kept.folders)} runs and placements are kept"
    age = f"; {young} things that none of them needs are younger than {older_than_days:g} days" if young else ""
    console.print(f"{runs}{age}")
    if what.count:
        told = "were deleted" if deleted else "would be deleted; --yes does it"
        console.print(f"{what.count} things, {mebibytes(what.size)} MiB, {told}")
    else:
        console.print("nothing to delete")


def cache_verification(*, repair: bool, as_json: bool) -> int:
    """Read everything; exit code 4 if damage was found and left."""
    store = Store.default()
    with used_alone(cache_root()) if repair else nullcontext():  # what another program has mended meanwhile is sound
        found = damages(store)
        moved = moved_away(found) if repair and found else None
    damaged = [one for one in found if one.what is not DamagedThing.LITTER]
    counts = {"artifacts": sum(1 for _ in store.refs()), "records": sum(1 for _ in record_files())}
    if as_json:
        Console().print_json(json.dumps(verification_tree(found, counts, moved)))
    else:
        tell_verification(found, counts, moved)
    return DAMAGED if damaged and moved is None else 0


def verification_tree(found: Sequence[Damage], counts: dict[str, int], moved: Path | None) -> dict[str, object]:
    """What `--json` prints."""
    artifacts = [one.path for one in found if one.what is DamagedThing.ARTIFACT]
    rows = [{"path": str(one.path), "why": one.why} for one in found if one.what is DamagedThing.RECORD]
    return {
        **counts,
        "damaged": [{"kind": path.parent.parent.name, "sha256": path.name} for path in artifacts],
        "damaged_records": rows,
        "litter": [str(one.path) for one in found if one.what is DamagedThing.LITTER],
        "repaired": str(moved) if moved else None,
    }


def tell_verification(found: Sequence[Damage], counts: dict[str, int], moved: Path | None) -> None:
    """The same for a person."""
    console = Console(highlight=False, markup=False, soft_wrap=True)
    for one in found:
        console.print(
            f"{'litter' if one.what is DamagedThing.LITTER else 'damaged'}: {shown(one.path)}: {shown(one.why)}"
        )
    told = ", ".join(f"{number} {name}" for name, number in counts.items())
    left_behind = sum(one.what is DamagedThing.LITTER for one in found)
    console.print(f"{told}, {len(found) - left_behind} damaged, {left_behind} left half-made")
    if moved is not None:
        console.print(f"what was damaged lies in {moved} now and is computed again when needed")


def shown(text: Path | str) -> str:
    """Text that any terminal can print in one line."""
    return " ".join(str(text).encode(errors="backslashreplace").decode().split())


def usage_table(rows: Iterable[CacheUsage], title: str) -> Table:
    """Rows of stages with a sum."""
    every = list(rows)
    table = Table("stage", "records", "artifacts", "MiB", "computed in [s]", title=title)
    for row in every:
        cells = (str(row.records), str(row.artifacts), mebibytes(row.size), f"{row.seconds:.1f}")
        table.add_row(row.stage, *cells)
    sums = sum(row.artifacts for row in every), sum(row.size for row in every), sum(row.seconds for row in every)
    table.add_row("total", "", str(sums[0]), mebibytes(sums[1]), f"{sums[2]:.1f}", style="bold")
    return table


def as_rows(rows: Iterable[CacheUsage]) -> list[dict[str, object]]:
    """Rows for `--json`."""
    return [{("bytes" if key == "size" else key): value for key, value in asdict(row).items()} for row in rows]


def shortened(lines: Sequence[str]) -> list[str]:
    """The first lines, and how many more there are."""
    more = len(lines) - SHOWN
    return [*lines[:SHOWN], *([f"and {more} more"] if more > 0 else [])]


def mebibytes(size: int) -> str:
    """A size in MiB."""
    return f"{size / 2**20:.1f}"
