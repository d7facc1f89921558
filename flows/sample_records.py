"""Which records a placement is made of: `records.json` beside its placement.json.

The keys are those of the records, which hold everything else; `inputs` are artifacts that no stage made (source files,
labels).
"""

from typing import Any

from dcap.scene.json_tree import JsonObject
from dcap.scene.store.ref import Ref
from flows.sample_run import FinishedSample
from tasks.runner.records import Record
from tasks.runner.why import reference

RECORDS = "records.json"
VERSION = 1


def records_json(finished: FinishedSample) -> JsonObject:
    """What records.json holds."""
    records = [record for _, record, _ in finished.records]
    inputs = set[Ref[Any]]().union(*map(inputs_of, records)) - {record.ref for record in records}
    return {
        "version": VERSION,
        "records": [
            {"stage": stage, "key": record.key, **record.ref.to_json()} for stage, record, _ in finished.records
        ],
        "inputs": [dict(ref.to_json()) for ref in sorted(inputs)],
    }


def inputs_of(record: Record) -> set[Ref[Any]]:
    """The artifacts that a record's result was made of."""
    inputs = record.deciders.get("inputs")
    values = inputs.values() if isinstance(inputs, dict) else ()
    return {ref for value in values if (ref := reference(value)) is not None}
