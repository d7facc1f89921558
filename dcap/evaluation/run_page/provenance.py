"""Provenance of a run: versions, seeds, configuration, and the digest of every file that it made.

In: run.json and the folders of the placements. Out: `artifacts.sha256`, which `sha256sum -c` checks, and texts.
"""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from dcap.evaluation.table_files import write_if_other
from dcap.scene.json_tree import JsonObject, canonical_json, digest_of_file

RUN, HASHES = "run.json", "artifacts.sha256"


@dataclass(frozen=True, slots=True)
class Provenance:
    """A run's provenance for its page."""

    facts: tuple[tuple[str, str], ...]
    versions: tuple[tuple[str, str], ...]
    config: str
    """The configuration as JSON."""
    files: int
    """Files in `artifacts.sha256` [-]."""
    digest: str
    """Digest of that list."""


def provenance_of(run: Path, folders: Sequence[Path]) -> Provenance:
    """Read a run's origin and write the digests of the files in the folders of its placements."""
    asked = read_run(run)
    lines = [
        f"{digest_of_file(path)}  {path.relative_to(run).as_posix()}\n"
        for folder in folders
        for path in sorted(folder.rglob("*"))
        if path.is_file() and not path.name.startswith(".")
    ]
    text = "".join(lines).encode()
    write_if_other(run / HASHES, text)
    config = asked.get("config")
    versions = asked.get("versions")
    facts = [("dataset", str(asked.get("dataset") or "")), ("started", str(asked.get("started") or "")),
             ("methods", ", ".join(map(str, listed(asked.get("methods"))))), ("language", language_of(asked)),
             ("seeds of samples", seeds_of(asked))]  # fmt: skip
    if isinstance(config, Mapping):
        facts.append(("seeds of the configuration", ", ".join(f"{name} {seed}" for name, seed in config_seeds(config))))
        facts.append(("digest of the configuration", hashlib.sha256(canonical_json(config)).hexdigest()))
    return Provenance(
        tuple((name, value) for name, value in facts if value),
        tuple((str(name), str(one)) for name, one in versions.items()) if isinstance(versions, Mapping) else (),
        json.dumps(config, indent=1, ensure_ascii=False) if config else "",
        len(lines),
        hashlib.sha256(text).hexdigest(),
    )


def read_run(run: Path) -> JsonObject:
    """Read run.json, empty if there is none."""
    try:
        tree = json.loads((run / RUN).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return tree if isinstance(tree, dict) else {}


def listed(value: object) -> Sequence[object]:
    """A list, empty for any other value."""
    return value if isinstance(value, list) else []


def seeds_of(asked: Mapping[str, object]) -> str:
    """The seeds of the samples: their range if they are many."""
    seeds = sorted({one["seed"] for one in listed(asked.get("samples"))
                    if isinstance(one, Mapping) and isinstance(one.get("seed"), int)})  # fmt: skip
    if len(seeds) > 2 and seeds == list(range(seeds[0], seeds[-1] + 1)):
        return f"{seeds[0]} to {seeds[-1]}"
    return ", ".join(map(str, seeds[:40])) + (" …" if len(seeds) > 40 else "")


def config_seeds(tree: Mapping[str, object], path: str = "") -> list[tuple[str, object]]:
    """Every `seed` of a configuration with its key."""
    found: list[tuple[str, object]] = []
    for key, value in tree.items():
        name = f"{path}.{key}" if path else str(key)
        if key == "seed":
            found.append((name, value))
        elif isinstance(value, Mapping):
            found += config_seeds(value, name)
    return found


def language_of(asked: Mapping[str, object]) -> str:
    """The language options of the run, `offline` without any."""
    told = asked.get("language")
    if not isinstance(told, Mapping):
        return ""
    return ", ".join(f"{name} {value}" for name, value in told.items() if value) or "offline"
