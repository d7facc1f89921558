"""ScanNet scenes: a mesh, its over-segmentation, the annotated instances and the alignment with the axes.

A folder holds `ID_vh_clean_2.ply` with `ID_vh_clean_2.0.010000.segs.json` and `ID.aggregation.json`, or the finer
`ID_vh_clean.ply` with `ID_vh_clean.segs.json` and `ID_vh_clean.aggregation.json`, and `ID.txt`. Scenes of the test set
have no annotation. Coordinates are metres with z up; `axisAlignment` of ID.txt turns the walls along x and y.
Source: Dai et al., "ScanNet: Richly-annotated 3D Reconstructions of Indoor Scenes", 2017, and its file descriptions.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from scene.errors import FormatError
from scene.readers.json_text import read_json
from scene.readers.ply import read_ply
from scene.readers.raw import RawMesh, read_bytes

MESHES = (
    ("_vh_clean_2.ply", "_vh_clean_2.0.010000.segs.json", (".aggregation.json", "_vh_clean.aggregation.json")),
    ("_vh_clean.ply", "_vh_clean.segs.json", ("_vh_clean.aggregation.json", ".aggregation.json")),
)
"""Endings of a mesh, its segments and its instances, the mesh that is annotated first."""

ALIGNMENT_KEY = "axisAlignment"

RIGID = 1e-3
"""Most that an alignment's rotation may differ from a rotation [-]; files have six digits."""


@dataclass(frozen=True)
class SceneFiles:
    """The files of one scene; None where there is none."""

    mesh: Path
    segments: Path | None
    groups: Path | None
    about: Path | None

    @property
    def present(self) -> tuple[Path, ...]:
        """Those that there are."""
        return tuple(path for path in (self.mesh, self.segments, self.groups, self.about) if path is not None)


def scannet_files(folder: Path) -> SceneFiles | None:
    """The files of a scene folder; None where it is none."""
    for mesh_end, segments_end, group_ends in MESHES:
        for mesh in sorted(folder.glob(f"*{mesh_end}")):
            scene = mesh.name.removesuffix(mesh_end)
            groups = [folder / f"{scene}{end}" for end in group_ends if (folder / f"{scene}{end}").is_file()]
            segments, about = folder / f"{scene}{segments_end}", folder / f"{scene}.txt"
            return SceneFiles(
                mesh=mesh,
                segments=segments if segments.is_file() else None,
                groups=groups[0] if groups else None,
                about=about if about.is_file() else None,
            )
    return None


def is_scannet(folder: Path) -> bool:
    """Whether a folder is a ScanNet scene."""
    return scannet_files(folder) is not None


def read_scannet(folder: Path) -> tuple[RawMesh, NDArray[np.float64]]:
    """The mesh with one node per annotated instance, in the file's own axes, and the alignment (4, 4)."""
    files = scannet_files(folder)
    if files is None:
        raise FormatError(f"{folder}: no mesh of a ScanNet scene (*_vh_clean_2.ply or *_vh_clean.ply)")
    raw = replace(read_ply(files.mesh), up="z", unit_metres=1.0)
    alignment, note = _alignment(files.about)
    notes = (note,) if note else ()
    if files.segments is None or files.groups is None:
        missing = "segs.json" if files.segments is None else "aggregation.json"
        return replace(raw, notes=(*raw.notes, *notes, f"no {missing}: instances are found by shape alone")), alignment
    instances, group_notes = _instances(files.groups, files.segments)
    vertex = _vertex_instances(files.segments, instances, len(raw.vertices))
    return replace(
        raw, face_node=_majority(vertex[raw.faces]), node_names=tuple(one.name for one in instances),
        node_labels=tuple(one.label for one in instances), notes=(*raw.notes, *notes, *group_notes),
    ), alignment  # fmt: skip


@dataclass(frozen=True, eq=False)
class AnnotatedInstance:
    """One group of segments."""

    name: str
    """Unique: the label and the number of the object."""
    label: str
    segments: NDArray[np.int64]


def _instances(path: Path, segments_path: Path) -> tuple[list[AnnotatedInstance], tuple[str, ...]]:
    """The groups of an aggregation file and notes; those without a label or segments are skipped."""
    document = read_json(path)
    groups = document.get("segGroups") if isinstance(document, dict) else None
    if not isinstance(document, dict) or not isinstance(groups, list):
        raise FormatError(f"{path}: no list 'segGroups'")
    named = str(document.get("segmentsFile") or segments_path.name)
    if not named.endswith(segments_path.name):
        raise FormatError(
            f"{path}: segmentsFile is {named!r}, but the mesh has {segments_path.name!r}; add the one that fits it"
        )
    found: list[AnnotatedInstance] = []
    for index, group in enumerate(groups):
        if not isinstance(group, dict):
            raise FormatError(f"{path}: segGroups[{index}] is a {type(group).__name__}, expected an object")
        label = " ".join(str(group.get("label") or "").lower().replace("/", " ").split())
        segments = _whole_numbers(path, f"segments of segGroups[{index}]", group.get("segments"))
        number = group.get("objectId", group.get("id"))
        name = f"{label.replace(' ', '_')}_{number if isinstance(number, int) else index}"
        if label and len(segments):
            found.append(AnnotatedInstance(name, label, segments))
    if len({one.name for one in found}) < len(found):  # numbers that repeat tell nothing apart
        found = [replace(one, name=f"{one.label.replace(' ', '_')}_{i}") for i, one in enumerate(found)]
    skipped = len(groups) - len(found)
    return found, ((f"{skipped} segGroups of {path.name} without a label or segments are skipped",) if skipped else ())


def _whole_numbers(path: Path, where: str, values: object) -> NDArray[np.int64]:
    """A list of segment numbers, shape (n,)."""
    if not isinstance(values, list):
        raise FormatError(f"{path}: {where} is a {type(values).__name__}, expected a list")
    for index, value in enumerate(values):
        if type(value) is not int or not 0 <= value < 2**62:
            raise FormatError(f"{path}: {where} has {value!r} at {index}, expected a whole number of 0 or more")
    return np.array(values, dtype=np.int64)


def _vertex_instances(path: Path, instances: list[AnnotatedInstance], count: int) -> NDArray[np.int64]:
    """Instance of each vertex, -1 for none, shape (count,); of two instances with a segment the later has it."""
    document = read_json(path)
    if not isinstance(document, dict):
        raise FormatError(f"{path}: not an object")
    segment = _whole_numbers(path, "segIndices", document.get("segIndices"))
    if len(segment) != count:
        raise FormatError(f"{path}: segIndices has {len(segment)} entries, the mesh has {count} vertices")
    known, place = np.unique(segment, return_inverse=True)
    owner = np.full(len(known), -1, dtype=np.int64)
    for index, one in enumerate(instances):
        at = np.searchsorted(known, one.segments)
        absent = (at == len(known)) | (known[np.minimum(at, len(known) - 1)] != one.segments)
        if absent.any():
            raise FormatError(f"{path}: no vertex is in segment {one.segments[absent][0]}, which {one.name} names")
        owner[at] = index
    return np.asarray(owner[place.reshape(-1)])


def _majority(corner: NDArray[np.int64]) -> NDArray[np.int32]:
    """The instance of two corners of a face at least, of its first corner where all three differ, shape (m,)."""
    first, second, third = corner.T
    return np.asarray(np.where(second == third, second, first), dtype=np.int32)


def _alignment(path: Path | None) -> tuple[NDArray[np.float64], str]:
    """The rigid map to the axes of the room (4, 4), row by row in the file, and a note where there is none."""
    text = "" if path is None else read_bytes(path).decode("utf-8", "replace")
    for number, line in enumerate(text.splitlines(), start=1):
        key, _, value = line.partition("=")
        if key.strip() == ALIGNMENT_KEY:
            return _rigid(f"{path}: line {number}: {ALIGNMENT_KEY}", value.split()), ""
    return np.eye(4), f"no {ALIGNMENT_KEY}: the mesh stays as it was scanned"


def _rigid(where: str, words: list[str]) -> NDArray[np.float64]:
    try:
        matrix = np.array(words, dtype=np.float64).reshape(4, 4)
    except ValueError:
        raise FormatError(f"{where} has {len(words)} values, expected 16 numbers") from None
    turn = matrix[:3, :3]
    bounded = bool((np.abs(turn) <= 2.0).all() and np.isfinite(matrix).all())
    if (
        not bounded
        or np.abs(turn @ turn.T - np.eye(3)).max() > RIGID
        or np.linalg.det(turn) < 0
        or np.abs(matrix[3] - [0, 0, 0, 1]).max() > RIGID
    ):
        raise FormatError(f"{where} is not a rotation and a shift")
    return matrix
