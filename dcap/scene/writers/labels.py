"""labels.json: the things of a scene for a person to correct, in the scene file's own frame (docs/formats.md)."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.scene.readers.labels.things import VERSION, up_frame
from dcap.scene.types.boxes import OrientedBox
from dcap.scene.types.scan import Scan
from dcap.scene.types.segmentation import Segmentation, faces_digest

DIGITS = 4
"""Decimals of lengths and confidences."""


@dataclass(frozen=True, slots=True)
class FoundThing:
    """A found thing."""

    number: int
    """Number on the pictures; 0 if it is not shown."""
    index: int
    """Index among the instances."""
    id: str
    label: str
    confidence: float
    structure: bool
    size_m: tuple[float, float, float]
    """Length, breadth and height of its box [m]."""
    surface_m: float | None
    """Height of its main surface above the floor [m]; None without an upward face."""


def labels_tree(scan: Scan, scene: Segmentation, things: Sequence[FoundThing], name: str) -> dict[str, object]:
    """Content of labels.json."""
    return {
        "dcap_labels": VERSION,
        "scene": name,
        "up": scan.up,
        "unit_metres": scan.unit_metres,
        "mesh": {"faces": len(scan.mesh.faces), "digest": faces_digest(scan.mesh)},
        "things": [thing_tree(scan, scene, thing) for thing in things],
    }


def thing_tree(scan: Scan, scene: Segmentation, thing: FoundThing) -> dict[str, object]:
    """One entry."""
    instance = scene.instances[thing.index]
    mine = scene.face_instance == thing.index
    parts = [
        {"name": part.name, "faces": runs(np.flatnonzero(mine & (scene.face_part == k)))}
        for k, part in enumerate(instance.parts)
    ]
    return {
        "number": thing.number,
        "id": thing.id,
        "label": thing.label,
        "guess": thing.label,
        "confidence": round(thing.confidence, DIGITS),
        "guesses": [[label, round(share, DIGITS)] for label, share in instance.guesses],
        "structure": thing.structure,
        "size_m": [round(one, DIGITS) for one in thing.size_m],
        "surface_m": None if thing.surface_m is None else round(thing.surface_m, DIGITS),
        "box": box_tree(scan, instance.box),
        "parts": [part for part in parts if part["faces"]],
        "faces": runs(np.flatnonzero(mine)),
    }


def box_tree(scan: Scan, box: OrientedBox) -> dict[str, object]:
    """A box in the file's own axes and unit: centre; length, breadth and height; turn about the upward axis."""
    file_from_world = np.linalg.inv(scan.world_from_file)
    unit = float(np.cbrt(np.linalg.det(file_from_world[:3, :3])))
    center = file_from_world[:3, :3] @ box.center + file_from_world[:3, 3]
    along = file_from_world[:3, :3] @ box.axes[:, 0]
    x, y, _ = up_frame(scan.up)
    turn = float(np.degrees(np.arctan2(along @ y, along @ x)))
    return {
        "center": [round(float(one), DIGITS) for one in center],
        "size": [round(float(2.0 * unit * half), DIGITS) for half in box.half_extents],
        "turn_deg": round(turn, 2),
    }


def runs(faces: NDArray[np.integer]) -> list[list[int]]:
    """Sorted face numbers as runs, first and one past the last."""
    if not len(faces):
        return []
    cuts = np.flatnonzero(np.diff(faces) > 1)
    first = faces[np.r_[0, cuts + 1]]
    last = faces[np.r_[cuts, len(faces) - 1]]
    return [[int(a), int(b) + 1] for a, b in zip(first, last, strict=True)]


def labels_text(tree: Mapping[str, object]) -> str:
    """The document for people: one line per key of a thing, however many faces it has."""
    things = tree["things"]
    assert isinstance(things, list)
    head = [f"  {json.dumps(key)}: {compact(value)}," for key, value in tree.items() if key != "things"]
    bodies = []
    for thing in things:
        lines = ",\n".join(f"      {json.dumps(key)}: {compact(value)}" for key, value in thing.items())
        bodies.append(f"    {{\n{lines}\n    }}")
    return "\n".join(["{", *head, '  "things": [', ",\n".join(bodies), "  ]", "}", ""])


def compact(value: object) -> str:
    """JSON in one line."""
    return json.dumps(value, ensure_ascii=False, allow_nan=False)
