"""Records of a placement: `records.json` next to placement.json, by which the cache keeps them.

It lists the keys of the records, which hold everything else; `inputs` are artifacts that no stage made (source files,
labels).
"""

import json
from pathlib import Path
from typing import Any

from dcap.scene.json_tree import JsonObject
from flows.sample_run import FinishedSample
from tasks.artifact import Ref
from tasks.records import refs_in

RECORDS = "records.json"
VERSION = 1


def records_json(finished: FinishedSample) -> JsonObject:
    """Return the content of records.json."""
    made = {one.ref for one in finished.results}
    given = {ref for one in finished.results for ref in refs_in(one.record.recipe)} - made
    rows = [{"stage": one.stage, "key": one.record.key, **one.ref.to_json()} for one in finished.results]
    return {"version": VERSION, "records": rows, "inputs": [dict(ref.to_json()) for ref in sorted(given)]}


def read_needs(folder: Path) -> set[Ref[Any]] | None:
    """Return the artifacts that the placement in a folder needs; None where the file is missing or damaged."""
    try:
        tree = json.loads((folder / RECORDS).read_bytes())
        return {Ref.from_json(row) for row in (*tree["records"], *tree["inputs"])}
    except (OSError, ValueError, KeyError, TypeError):
        return None
