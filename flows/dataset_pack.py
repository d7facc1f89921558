"""A run as a dataset for others: settled meshes, maps, prompts and placements, with a manifest and a datasheet.

In: a run, or the folder of one placement. Out: a .tar.gz whose bytes depend on the packed files alone: names are
sorted, times, owners and modes fixed. It is written to a draft and moved into place, so it appears whole or not at all.
It holds no paths of this machine: sources have their names alone.
"""

import gzip
import json
import os
import shutil
import tarfile
import tempfile
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from dcap.scene.errors import InputError
from dcap.scene.settings import version
from dcap.scene.types.sample import Sample
from dcap.scene.written_files import JsonObject, JsonValue, digest_of_file
from flows.find_run import RUN, find_run
from flows.output import PICTURES, SCHEMA, readable_json
from flows.placement_json import AT_REST
from flows.run_files import PLACEMENT, RunRequest, find_request, load_run_request
from flows.samples import EMBEDDED, SPLAT_ROOMS, licences_in

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
FORMAT, VERSION = "dcap dataset", 1
"""Name and version of the format, in a manifest."""
MANIFEST, README, DEFAULT = "manifest.json", "README.md", "dataset.tar.gz"
ARCHIVE = ".tar.gz"
RESULT = "placement.json"
PACKED = (
    RESULT, "object.ply", "object.glb", "scene.glb", "scene.json", "scene_settled.ply", "deformed_*.ply", "maps/**/*",
    *(f"{name}.png" for name in PICTURES),
)  # fmt: skip
"""Patterns of the files that are packed from a placement's folder."""
OWN = "Apache-2.0 (made by dcap from its own recipes)"
"""Licence of the embedded rooms and objects."""
UNKNOWN = "unknown"
MODE = 0o644


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


@dataclass(frozen=True, slots=True)
class Pack:
    """A written pack."""

    path: Path
    manifest: JsonObject
    warnings: tuple[str, ...]
    """Points to settle before the pack is passed on, one sentence each."""


def pack_run(run: str, out: Path | None) -> Pack:
    """Pack a run; InputError where nothing of it can be packed."""
    asked = load_request(run)
    target = out or asked.folder / DEFAULT
    if not target.name.endswith(ARCHIVE) or target.is_dir():
        raise InputError(f"--out {target}: give the name of a file that ends in {ARCHIVE}")
    found, left = packable(asked)
    if not found:
        why = "; ".join(f"{name}: {why}" for name, why in list(left.items())[:3]) or "it has no samples"
        raise InputError(f"{asked.folder}: there is nothing to pack: {why}")
    known = licences_of(asked)
    target.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=target.parent, prefix=".packing-") as name:
        draft = Path(name) / (target.name.removesuffix(ARCHIVE) or "dataset")
        draft.mkdir()
        manifest = write_draft(draft, asked, found, left, known)
        write_archive(draft, Path(name) / "archive")
        os.replace(Path(name) / "archive", target)
    return Pack(target, manifest, warnings_of(known, found, left))


def load_request(run: str) -> RunRequest:
    """Request of a run, or of one placement."""
    folder = Path(run)
    if (folder / PLACEMENT).is_file() and not (folder / RUN).is_file():
        return find_request(run, None)[0]
    return load_run_request(find_run(run))


# contents of a pack ---------------------------------------------------------------------------------------------------


def packable(asked: RunRequest) -> tuple[list[Sample], dict[str, str]]:
    """Samples with a result, by id, and why others are left out."""
    found, left = [], {}
    for name in sorted(asked.samples):
        folder = asked.folder_of(name)
        failure = folder / "error.txt"
        if failure.is_file():
            said = failure.read_text(encoding="utf-8", errors="replace").partition("\n")[0]
            left[name] = f"failed: {without_paths(said, asked.samples[name])}"
        elif result_of(folder) is None:
            left[name] = f"no readable {RESULT}"
        else:
            found.append(asked.samples[name])
    return found, left


def without_paths(message: str, sample: Sample) -> str:
    """A message with the names of the sample's files instead of their paths."""
    for path in (sample.scene, sample.object, sample.labels):
        message = message.replace(path, Path(path).name) if path else message
    return message


def result_of(folder: Path) -> Mapping[str, JsonValue] | None:
    """placement.json of a folder; None where there is none that can be read."""
    try:
        tree = json.loads((folder / RESULT).read_bytes())
    except (OSError, ValueError):
        return None
    return tree if isinstance(tree, dict) and "verdict" in tree else None


def files_in(folder: Path) -> list[str]:
    """Names of the files of a placement that are packed, sorted; links are not followed, to a folder either."""
    found = {path.relative_to(folder) for pattern in PACKED for path in folder.glob(pattern) if path.is_file()}
    home = os.path.realpath(folder)
    return sorted(name.as_posix() for name in found if os.path.realpath(folder / name) == os.path.join(home, name))


def licences_of(asked: RunRequest) -> dict[str, str]:
    """The licence of each sample's scene and object as far as it is known, by id."""
    try:
        given = json.loads((asked.folder / RUN).read_bytes()).get("dataset", "")
    except (OSError, ValueError):
        given = ""
    dataset = Path(str(given))
    if given and dataset in (EMBEDDED.resolve(), SPLAT_ROOMS.resolve()):
        return dict.fromkeys(asked.samples, OWN)
    told = licences_in(dataset) if given and dataset.is_file() else {}
    return {name: told.get(name, "").strip() or UNKNOWN for name in asked.samples}


def warnings_of(known: Mapping[str, str], found: Sequence[Sample], left: Mapping[str, str]) -> tuple[str, ...]:
    """Warnings for the person who passes the pack on."""
    unknown = [one.id for one in found if known[one.id] == UNKNOWN]
    told = []
    if unknown:
        more = f" and {len(unknown) - 3} more" if len(unknown) > 3 else ""
        told.append(
            f"the licence of the sources of {', '.join(unknown[:3])}{more} is unknown; find out before you pass it on, "
            "and state it as `licence` of the sample in the dataset's file"
        )
    return (*told, *(f"left out: {name}: {why}" for name, why in left.items()))


# writing --------------------------------------------------------------------------------------------------------------


def write_draft(
    draft: Path, asked: RunRequest, found: Sequence[Sample], left: Mapping[str, str], known: Mapping[str, str]
) -> JsonObject:
    """All files of the pack; returns its manifest."""
    rows: list[JsonValue] = []
    for sample in found:
        source = asked.folder_of(sample.id)
        own = Path("placements") / source.name if not asked.one else Path("placements") / "placement"
        names = files_in(source)
        for name in names:
            (draft / own / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(source / name, draft / own / name)
        rows.append(sample_row(sample, own, draft / own, names, known[sample.id]))
    schema = next(
        (asked.folder_of(one.id) / SCHEMA for one in found if (asked.folder_of(one.id) / SCHEMA).is_file()), None
    )
    if schema is not None:
        shutil.copyfile(schema, draft / SCHEMA)
    prompts = [json.dumps({"id": one.id, "prompt": one.prompt}, ensure_ascii=False) + "\n" for one in found]
    (draft / "prompts.jsonl").write_bytes("".join(prompts).encode())
    verdicts = [str(row["verdict"]) for row in rows if isinstance(row, Mapping)]
    manifest: JsonObject = {
        "format": FORMAT,
        "version": VERSION,
        "dcap": version(),
        "name": draft.name,
        "counts": {
            "samples": len(found),
            "at_rest": verdicts.count(AT_REST),
            "infeasible": len(verdicts) - verdicts.count(AT_REST),
            "left_out": len(left),
        },
        "licences": dict(sorted(Counter(known[one.id] for one in found).items())),
        "samples": rows,
        "left_out": [{"id": name, "why": why} for name, why in left.items()],
    }
    (draft / README).write_text(readme(manifest), encoding="utf-8")
    manifest["files"] = [
        {"path": name, "bytes": (draft / name).stat().st_size, "sha256": digest_of_file(draft / name)}
        for name in names_below(draft)
    ]
    (draft / MANIFEST).write_bytes(readable_json(manifest))
    return manifest


def sample_row(sample: Sample, own: Path, folder: Path, names: Sequence[str], licence: str) -> JsonObject:
    """Manifest entry of a sample."""
    tree = result_of(folder) or {}
    return {
        "id": sample.id,
        "prompt": sample.prompt,
        "scene": Path(sample.scene).name,
        "object": Path(sample.object).name,
        "licence": licence,
        "verdict": tree.get("verdict"),
        "reason": tree.get("reason"),
        "base": tree.get("base"),
        "mass": tree.get("mass"),
        "placement_schema": tree.get("schema"),
        "folder": own.as_posix(),
        "maps": any(name.startswith("maps/") for name in names),
    }


def names_below(folder: Path) -> list[str]:
    """All files below a folder, sorted by name."""
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())


def write_archive(folder: Path, target: Path) -> None:
    """Write a .tar.gz of a folder; same files, same bytes."""
    with (
        target.open("wb") as raw,
        gzip.GzipFile(filename="", mode="wb", fileobj=raw, mtime=0) as packed,
        tarfile.open(fileobj=packed, mode="w", format=tarfile.PAX_FORMAT) as tar,
    ):
        for name in names_below(folder):
            entry = tarfile.TarInfo(f"{folder.name}/{name}")
            entry.size, entry.mode = (folder / name).stat().st_size, MODE
            with (folder / name).open("rb") as file:
                tar.addfile(entry, file)
