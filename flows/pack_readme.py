"""The datasheet of a packed dataset: content, origin and permitted use. In: its manifest."""

from collections.abc import Mapping

from dcap.scene.json_tree import JsonValue

TEMPLATE = """# {name}

{count} placements of objects in rooms, each settled by physics: {at_rest} at rest, {infeasible} infeasible (the reason
is part of the result).
Made by dcap {dcap}. Format "{format}", version {version}; schema of `placement.json`: {schema}.

## What is in it

- `manifest.json`: every sample with its prompt, verdict, licence and folder; every file with its size and SHA-256.
- `prompts.jsonl`: id and prompt of every sample, a line of JSON each.
- `placements/NAME/placement.json`: the result (pose, contacts, materials, certificate), after `placement.schema.json`.
- `placements/NAME/object.ply`, `scene.glb`: the object and the scene as they came to rest, in metres; z up but in the
  glTF, which has y up.
- `placements/NAME/maps/`: conditioning maps (depth, normals, masks, contact ...) of {maps} of the samples.
- `placements/NAME/*.png`: pictures of it.

Lengths are in metres, masses in kilograms, quaternions (w, x, y, z). dcap's docs/formats.md has all keys.

## How it was made

A sentence chose support, place and orientation; the object was dropped until all forces and moments balanced.
Materials are typical values of a table, chosen by what a part is called, not measured. `certificate` says how still a
result is, `warnings` what was guessed or not met, `notes` what else was assumed. Whether anybody has looked at the
results one by one is not known here.

## Licences of the sources

Scenes and objects keep the licences of their sources. Number of samples by licence:

{licences}
{unknown}
## Left out

{left}
"""


def readme(manifest: Mapping[str, JsonValue]) -> str:
    """The text of README.md."""
    counts, samples = manifest["counts"], manifest["samples"]
    licences, left = manifest["licences"], manifest["left_out"]
    assert isinstance(counts, Mapping)
    assert isinstance(licences, Mapping)
    assert isinstance(samples, list)
    assert isinstance(left, list)
    rows = [one for one in samples if isinstance(one, Mapping)]
    gone = [f"- {one['id']}: {one['why']}" for one in left if isinstance(one, Mapping)]
    schemas = sorted({str(one["placement_schema"]) for one in rows})
    warning = '\n"unknown" means that nobody said it: find out before you pass these samples on.\n'
    return TEMPLATE.format(
        name=manifest["name"], dcap=manifest["dcap"], format=manifest["format"], version=manifest["version"],
        schema=", ".join(schemas), count=counts["samples"], at_rest=counts["at_rest"], infeasible=counts["infeasible"],
        maps=sum(one["maps"] is True for one in rows),
        licences="\n".join(f"- {name}: {count}" for name, count in licences.items()),
        unknown=warning if "unknown" in licences else "", left="\n".join(gone) or "Nothing: every sample has a result.",
    )  # fmt: skip
