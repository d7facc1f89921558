"""`dcap provenance`."""

import json
from typing import Annotated

import typer

from flows.cli.checks import Json


def provenance(
    artifact: Annotated[
        str, typer.Argument(help="File or folder of a sample of a run, path in the store, or an artifact's digest.")
    ],
    as_json: Json = False,
) -> int:
    """Walk back from a result to its inputs: stages, settings, code, versions, seeds, prompts and hashes."""
    from dcap.scene.json_tree import object_to_json
    from flows.provenance import provenance_lines, provenance_of

    found = provenance_of(artifact)
    if as_json:
        print(json.dumps(object_to_json(found), indent=2, ensure_ascii=False))
        return 0
    for line in provenance_lines(found):
        print(line)
    return 0
