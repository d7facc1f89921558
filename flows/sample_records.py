"""Which records a placement is made of: `records.json` beside its placement.json, so that the cache keeps them.

The keys are those of the records, which hold everything else; `inputs` are artifacts that no stage made (source files,
labels).
"""

import json
from pathlib import Path

from dcap.scene.json_tree import JsonObject
from dcap.scene.store.ref import Ref
from flows.sample_run import FinishedSample
from tasks.runner.collection import Needs, inputs_of

RECORDS = "records.json"
VERSION = 1


def records_json(finished: FinishedSample) -> JsonObject:
    """What records.json holds."""
    records = [record for _, record, _ in finished.records]
    inputs = set[Ref[object]]().union(*map(inputs_of, records)) - {record.ref for record in records}
    return {
        "version": VERSION,
        "records": [
            {"stage": stage, "key": record.key, **record.ref.to_json()} for stage, record, _ in finished.records
        ],
        "inputs": [dict(ref.to_json()) for ref in sorted(inputs)],
    }


def read_needs(folder: Path) -> Needs | None:
    """What the placement in a folder needs; None where the file is missing or damaged."""
    try:
        return needs_in(json.loads((folder / RECORDS).read_bytes()))
    except (OSError, ValueError, KeyError, TypeError):
        return None


def needs_in(tree: JsonObject) -> Needs:
    """The needs that records.json tells; KeyError or TypeError if it is something else."""
    records, inputs = tree["records"], tree["inputs"]
    if not isinstance(records, list) or not isinstance(inputs, list):
        raise TypeError("no lists of records and inputs")
    rows = [row for row in (*records, *inputs) if isinstance(row, dict)]
    keys = frozenset(str(row["key"]) for row in records if isinstance(row, dict))
    return Needs(keys, frozenset(Ref.from_json(row) for row in rows))
