"""Writes the facts of a placed scene for the next placement, and copies files of earlier results.

Same scene, same bytes. `dcap.scene.readers.scenes.placed_scene` has the schema and reads them.

Copies the files of earlier results instead of making them again.

A key identifies the files. A note in the cache contains the folder where they were written last, and the digest of
each. Files that were moved, deleted or edited there are made again, so a lost or damaged note only costs time.
"""

import hashlib
import json
import shutil
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dcap.scene.readers.scenes.placed_scene import (
    FACTS,
    SHIFT,
    VERSION,
    DeformationEntry,
    InstanceEntry,
    SceneFile,
)
from dcap.scene.settings import cache_root
from dcap.scene.types.earlier import Deformation, EarlierPlacements
from dcap.scene.types.materials import PartMaterial
from dcap.scene.types.segmentation import Instance
from dcap.scene.writers.meshes import ply_bytes
from dcap.scene.written_files import canonical_json, digest_of_file, write_whole

FOLDER = "earlier"
DAMAGED = (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError)
"""Errors of reading a damaged note."""


def placed_scene_files_of(
    earlier: EarlierPlacements, last: str | None, last_parts: NDArray[np.integer] | None
) -> dict[str, bytes]:
    """The files by name. `last` is the thing that is the node `object` in scene.glb, `last_parts` the part of each face
    of object.ply, shape (m,)."""
    names = [f"deformed_{number}.ply" for number in range(1, len(earlier.deformations) + 1)]
    facts = SceneFile(
        version=VERSION,
        up="z",
        unit="m",
        object=last,
        instances=[instance_entry(one, earlier, last_parts if one.id == last else None) for one in earlier.instances],
        touching=list(earlier.touching),
        deformations=[
            DeformationEntry(
                instance=one.instance, loads=list(one.loads), file=name,
                largest_m=round(float(np.linalg.norm(one.shift, axis=1).max(initial=0.0)), 6),
            )
            for one, name in zip(earlier.deformations, names, strict=True)
        ],
    )  # fmt: skip
    text = json.dumps(facts.model_dump(mode="json", exclude_none=False), indent=2, allow_nan=False, ensure_ascii=False)
    surfaces = {
        name: deformed_ply(one) for name, one in zip(names, earlier.deformations, strict=True)
    }  # fmt: skip
    return {FACTS: (text + "\n").encode(), **surfaces}


def deformed_ply(one: Deformation) -> bytes:
    """A surface under its loads, with its shift."""
    vertex = {"x y z": one.surface.vertices, " ".join(SHIFT): one.shift}
    face = {"list vertex_indices": one.surface.faces.astype(np.int32, copy=False)}
    return ply_bytes({"vertex": vertex, "face": face}, ["metres, right-handed, z up"])


def instance_entry(one: Instance, earlier: EarlierPlacements, parts: NDArray[np.integer] | None) -> InstanceEntry:
    """An instance in the file's form."""
    materials = {row.part_index: row for row in earlier.materials if row.body == one.id}
    facts = {name: getattr(one, name) for name in ("id", "label", "structure", "confidence", "guesses", "front", "box")}
    rows = [
        {
            "name": part.name, "confidence": part.confidence, "box": part.box,
            "material": material_facts(materials[index]) if index in materials else None,
            "faces": None if parts is None else runs_of(parts == index),
        }
        for index, part in enumerate(one.parts)
    ]  # fmt: skip
    return InstanceEntry.model_validate(facts | {"parts": rows, "placed": earlier.thing(one.id)})


def material_facts(row: PartMaterial) -> dict[str, object]:
    """A part's material in the file's form."""
    return asdict(row.material) | {"model": row.model.value, "reason": row.reason}


def runs_of(mine: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Runs of true values: first and one past the last."""
    step = np.diff(np.concatenate([[0], mine.astype(np.int8), [0]]))
    return list(zip(np.flatnonzero(step == 1).tolist(), np.flatnonzero(step == -1).tolist(), strict=True))


def copy_earlier(key: str, folder: Path) -> dict[str, str]:
    """Copy the files of a key into a folder.

    Returns their names there by kind; empty unless all are complete.
    """
    try:
        note = read_note(note_path(key))
        for name, digest in note["sha256"].items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(Path(note["folder"], name), folder / name)
            if digest_of_file(folder / name) != digest:
                return {}
    except DAMAGED:
        return {}
    return dict(note["files"])


def note_files(key: str, folder: Path, files: Mapping[str, str]) -> None:
    """Record where the files of a key were written: their names in the folder by kind."""
    digests = {name: digest_of_file(folder / name) for name in files.values()}
    note = {"folder": str(folder.resolve()), "files": dict(files), "sha256": digests}
    path = note_path(key)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, json.dumps({**note, "check": check_of(note)}).encode())


def note_path(key: str) -> Path:
    """Return the path of a key's note."""
    return cache_root() / FOLDER / f"{hashlib.sha256(key.encode()).hexdigest()}.json"


def read_note(path: Path) -> Any:
    """Return the content of a note; raises ValueError if it is damaged."""
    note = json.loads(path.read_bytes())
    if note.pop("check") != check_of(note):
        raise ValueError(f"{path} does not match its own digest")
    return note


def check_of(note: Mapping[str, object]) -> str:
    """Return the digest of a note's content."""
    return hashlib.sha256(canonical_json(note)).hexdigest()


def lost_notes() -> list[Path]:
    """Return the notes that cannot be read, or whose folder is gone."""
    return [path for path in sorted((cache_root() / FOLDER).glob("*.json")) if not is_there(path)]


def is_there(note: Path) -> bool:
    """Return whether the folder in a note still exists."""
    try:
        return Path(read_note(note)["folder"]).is_dir()
    except DAMAGED:
        return False
