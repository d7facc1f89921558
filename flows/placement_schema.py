"""The JSON Schema of placement.json, from the types that `dcap.place` returns.

In: `Placement`. Out: a schema of draft 2020-12. Keys are only added within a version; what is removed, renamed or means
something else makes a new one.
"""

from collections.abc import Mapping
from functools import cache
from typing import Any

from dcap.scene.json_tree import JsonObject, object_to_json
from dcap.scene.types.outcome import Reason
from flows.placement_json import AT_REST, SCHEMA_VERSION
from flows.results import Placement, adapter

OWN = ("checks", "evidence", "folder", "tree")
"""Fields of `Placement` that are not keys of the file."""


@cache
def placement_schema() -> JsonObject:
    """The schema."""
    found = adapter(Placement).json_schema()
    keys = {name: value for name, value in found["properties"].items() if name not in OWN}
    keys["verdict"] = {"enum": [AT_REST, "infeasible"]}
    keys["reason"] = {"enum": [None, *(one.value for one in Reason)]}
    keys["visible_fraction"] = {"anyOf": [{"type": "number", "minimum": 0, "maximum": 1}, {"type": "null"}]}
    keys["schema"] = {"const": SCHEMA_VERSION, "description": "Version of this schema."}
    keys["certificate"] = {
        "description": "Of a drop: its signals and what was asked (placement, column); else what a stage found.",
        "anyOf": [{"type": "object", "properties": certificate(found)}, {"type": "null"}],
    }
    return object_to_json(
        {
            "$schema": "https://json-schema.org/draft/2020-12/schema",
            "title": f"placement.json of dcap, version {SCHEMA_VERSION}",
            "type": "object",
            "properties": keys,
            "required": sorted(keys),
            "$defs": found["$defs"],
        }
    )


def certificate(found: Mapping[str, Any]) -> dict[str, Any]:
    """Schema of the certificate's keys."""
    known = dict(found["$defs"]["Certificate"]["properties"])
    return {**known, "placement": {"$ref": "#/$defs/PlacementChecks"}}
