"""What the cache holds and whether it is sound."""

import json
from collections import defaultdict

from rich.console import Console
from rich.table import Table

from dcap.scene.store.artifacts import Store
from dcap.scene.store.ref import Ref

DAMAGED = 4


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
        table.add_row(kind, str(row["artifacts"]), f"{row['bytes'] / 2**20:.1f}")
    table.add_row("total", str(total(rows, "artifacts")), f"{total(rows, 'bytes') / 2**20:.1f}", style="bold")
    Console().print(table)
    return 0


def total(rows: dict[str, dict[str, int]], column: str) -> int:
    """Sum over all kinds."""
    return sum(row[column] for row in rows.values())


def cache_verification(*, as_json: bool) -> int:
    """Read every artifact; exit code 4 if any is damaged."""
    store = Store.default()
    refs = list(store.refs())
    damaged: list[Ref[object]] = [ref for ref in refs if not store.has(ref)]
    if as_json:
        Console().print_json(json.dumps({"artifacts": len(refs), "damaged": [ref.to_json() for ref in damaged]}))
    else:
        for ref in damaged:
            Console().print(f"damaged: {ref.kind} {ref.sha256}", highlight=False)
        Console().print(f"{len(refs)} artifacts, {len(damaged)} damaged", highlight=False)
    return DAMAGED if damaged else 0
