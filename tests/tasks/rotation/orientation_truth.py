"""How far a chosen rotation is from the ones that a person would accept, and the room in which it is asked."""

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from box_rooms import block, segmentation

from dcap.arrays import Array
from dcap.language.connect import Client
from dcap.language.offline.client import OfflineClient
from dcap.scene.types.choices import Intent, Rotation
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.segmentation import Segmentation, SegmentedObject, SegmentedScene
from dcap.synthetic.dataset import build_object
from dcap.synthetic.furniture.decor import table_lamp
from flows.samples import load_yaml
from tasks.intent.stage import IntentConfig, intent
from tasks.rotation.stage import RotationConfig, rotation

Alternative = dict[str, str | float]
TRUTH: Any = load_yaml(Path(__file__).parent / "rotation_truth.yaml")
DIRECTIONS = {
    "up": (0, 0, 1), "down": (0, 0, -1), "window": (1, 0, 0), "left": (-1, 0, 0), "wall": (0, 1, 0), "user": (0, -1, 0),
}  # fmt: skip
OWN = {"x": (1, 0, 0), "-x": (-1, 0, 0), "y": (0, 1, 0), "-y": (0, -1, 0), "z": (0, 0, 1), "-z": (0, 0, -1)}


def error_deg(matrix: Array, alternatives: list[Alternative]) -> float:
    """Smallest angle that brings a rotation to one that is accepted [degrees]; 0 where any is."""
    return min((distance_deg(matrix, one) for one in alternatives), default=0.0)


def distance_deg(matrix: Array, alternative: Alternative) -> float:
    """Angle of the turn that is missing; where two axes are said, that of the whole rotation [degrees]."""
    pinned: list[tuple[Array, Array]] = []
    errors = [0.0]
    for axis, where in alternative.items():
        own = np.array(OWN.get(axis) or [float(n) for n in axis.split()], float)
        own /= np.linalg.norm(own)
        now = matrix @ own
        if where in DIRECTIONS:
            pinned.append((own, np.array(DIRECTIONS[str(where)], float)))
            errors.append(float(np.degrees(np.arccos(np.clip(now @ pinned[-1][1], -1, 1)))))
        elif where == "diagonal":
            off = np.degrees(np.arctan2(now[1], now[0])) % 90.0 - 45.0
            errors.append(max(abs(off), abs(float(np.degrees(np.arcsin(np.clip(now[2], -1, 1)))))))
        else:
            height = 0.0 if where == "level" else float(where)
            errors.append(abs(float(np.degrees(np.arcsin(np.clip(now[2], -1, 1)))) - height))
    if len(pinned) == 2:
        (a, b), (c, d) = pinned
        wanted = np.c_[b, d, np.cross(b, d)] @ np.c_[a, c, np.cross(a, c)].T
        return float(np.degrees(np.arccos(np.clip((np.trace(wanted.T @ matrix) - 1) / 2, -1, 1))))
    return max(errors)


@cache
def room() -> Segmentation:
    """A desk whose user sits at -y, the wall behind it, a window at +x."""
    user = (0.0, -1.0, 0.0)
    return segmentation(
        {
            "desk": ("desk", user, [("top", block((-0.8, -0.4, 0.72), (0.8, 0.4, 0.75))),
                                    ("leg", block((-0.7, -0.3, 0.0), (-0.6, 0.3, 0.72)))]),
            "floor": ("floor", None, [("floor", block((-3, -3, -0.1), (3, 0.5, 0.0)))]),
            "wall": ("wall", None, [("wall", block((-3, 0.5, 0), (3, 0.6, 2.5)))]),
            "window": ("window", None, [("window", block((2.95, -0.6, 0.8), (3.0, 0.6, 2.0)))]),
        }
    )  # fmt: skip


@cache
def parts_of(name: str) -> tuple[tuple[str, Mesh], ...]:
    """The named parts of an object in its own axes."""
    whole = table_lamp((220, 200, 180), (120, 140, 150), 3) if name == "table_lamp" else build_object(name)
    return tuple((part.name, Mesh.concatenate(list(part.solids))) for part in whole.parts)


def parts_read(read: Segmentation) -> tuple[tuple[str, Mesh], ...]:
    """The parts of an object that a stage has taken apart."""
    faces = [np.flatnonzero(read.face_part == k) for k in range(len(read.instances[0].parts))]
    whole = read.mesh
    return tuple(
        (part.name, Mesh.of(whole.vertices, whole.faces[chosen]))
        for part, chosen in zip(read.instances[0].parts, faces, strict=True)
        if len(chosen)
    )


def chosen(
    label: str,
    parts: tuple[tuple[str, Mesh], ...],
    words: str,
    file_from_own: Array,
    client: Client | None = None,
) -> Rotation:
    """What the stages answer for an object whose file has its axes turned by `file_from_own`, shape (3, 3)."""
    pose = np.eye(4)
    pose[:3, :3] = file_from_own
    item = segmentation({"object": (label, None, [(part, mesh.transformed(pose)) for part, mesh in parts])})
    prompt = f"Put the {label} on the desk, {words}." if words else f"Put the {label} on the desk."
    meant = intent(SegmentedScene(room()), SegmentedObject(item), prompt, None, IntentConfig(), OfflineClient())
    assert isinstance(meant, Intent), meant
    turned = rotation(
        SegmentedScene(room()),
        SegmentedObject(item),
        meant,
        prompt,
        RotationConfig(picture_size=16),
        client or OfflineClient(),
    )
    assert isinstance(turned, Rotation), turned
    return turned


def case_error(truth: dict[str, object], parts: tuple[tuple[str, Mesh], ...], wording: str, pose: Array) -> float:
    """Error of one case [degrees]; `pose` turns the object's own axes into those of its file, shape (3, 3)."""
    words = {**TRUTH["wordings"], **TRUTH["more_wordings"]}[wording]
    matrix = chosen(str(truth["name"]), parts, words, pose).matrix @ pose
    return error_deg(matrix, truth[wording])  # type: ignore[arg-type]
