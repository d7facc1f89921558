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

from dcap.scene.errors import FormatError, Place, Report, error, note, refusing, short, warning
from dcap.scene.readers.files import read_bytes, read_json
from dcap.scene.readers.mesh.ply import read_ply
from dcap.scene.readers.mesh.raw import RawMesh
from dcap.scene.text import short_name
from dcap.scene.types.outcome import Cause, Caution

MESHES = (
    ("_vh_clean_2.ply", "_vh_clean_2.0.010000.segs.json", (".aggregation.json", "_vh_clean.aggregation.json")),
    ("_vh_clean.ply", "_vh_clean.segs.json", ("_vh_clean.aggregation.json", ".aggregation.json")),
)
"""File endings of a mesh, its segments and its instances, with the annotated mesh first."""

ALIGNMENT_KEY, GROUPS, SEGMENTS = "axisAlignment", "segGroups", "segIndices"

RIGID = 1e-3
"""Largest deviation of an alignment's matrix from a rotation [-]; files have six digits."""


@dataclass(frozen=True)
class SceneFiles:
    """The files of one scene; None for missing files."""

    mesh: Path
    segments: Path | None
    groups: Path | None
    about: Path | None

    @property
    def present(self) -> tuple[Path, ...]:
        """The files that exist."""
        return tuple(path for path in (self.mesh, self.segments, self.groups, self.about) if path is not None)


def scannet_files(folder: Path) -> SceneFiles | None:
    """The files of a scene folder; None if it is not one."""
    for mesh_end, segments_end, group_ends in MESHES:
        for mesh in sorted(one for one in folder.glob(f"*{mesh_end}") if one.is_file()):  # a pipe has no end
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
    """Return whether a folder is a ScanNet scene."""
    return scannet_files(folder) is not None


def read_scannet(folder: Path) -> tuple[RawMesh, NDArray[np.float64]]:
    """The mesh with one node per annotated instance, in the file's own axes, and the alignment (4, 4)."""
    files = scannet_files(folder)
    if files is None:
        raise FormatError(f"{folder}: no mesh of a ScanNet scene (*_vh_clean_2.ply or *_vh_clean.ply)")
    raw = replace(read_ply(files.mesh), up="z", unit_metres=1.0)
    stated = alignment_of(files, refusing(files.about or files.mesh))
    alignment = np.eye(4) if stated is None else stated
    notes = raw.notes
    if stated is None:
        notes += (Caution(Cause.ASSUMED, f"no {ALIGNMENT_KEY}: the mesh stays as it was scanned"),)
    if files.segments is None or files.groups is None:
        missing = "segs.json" if files.segments is None else "aggregation.json"
        plain = replace(raw, notes=(*notes, f"no {missing}: instances are found by shape alone"))
        return plain.without_loose_vertices(), alignment
    instances, skipped = instances_of(read_json(files.groups), files.segments.name, refusing(files.groups))
    if skipped:
        notes += (f"{skipped} segGroups of {files.groups.name} without a label or segments are skipped",)
    segment = segments_of(read_json(files.segments), len(raw.vertices), refusing(files.segments))
    vertex = vertex_instances(segment, instances, refusing(files.groups))
    named = replace(
        raw, face_node=majority(vertex[raw.faces]), node_names=tuple(one.name for one in instances),
        node_labels=tuple(one.label for one in instances), notes=notes,
    )  # fmt: skip
    return named.without_loose_vertices(), alignment


@dataclass(frozen=True, eq=False)
class AnnotatedInstance:
    """One group of segments."""

    name: str
    """Unique name: the label and the number of the object."""
    label: str
    segments: NDArray[np.int64]
    place: Place
    """Place of its segments in the file."""


def instances_of(document: object, segments_name: str, report: Report) -> tuple[list[AnnotatedInstance], int]:
    """Instances in an aggregation file for the segments of a file of that name, and the number of skipped groups."""
    groups = document.get(GROUPS) if isinstance(document, dict) else None
    if not isinstance(document, dict) or not isinstance(groups, list):
        report(error(f"no list {GROUPS!r}"))
        return [], 0
    named = str(document.get("segmentsFile") or segments_name)
    if not named.endswith(segments_name):
        what = f"segmentsFile is {named!r}, but the mesh has {segments_name!r}; add the one that fits it"
        report(error(what, ("segmentsFile",)))
        return [], 0
    read = [_instance(index, group, report) for index, group in enumerate(groups)]
    found = [one for one in read if one is not None]
    if len({one.name for one in found}) < len(found):  # repeated numbers identify nothing
        found = [replace(one, name=f"{one.label.replace(' ', '_')}_{i}") for i, one in enumerate(found)]
    return found, len(groups) - len(found)


def _instance(index: int, group: object, report: Report) -> AnnotatedInstance | None:
    """The instance of a group; None for a group without a label or segments."""
    where, place = f"{GROUPS}[{index}]", (GROUPS, index)
    if not isinstance(group, dict):
        report(error(f"{where} is a {type(group).__name__}, expected an object", place))
        return None
    label = short_name(" ".join(str(group.get("label") or "").lower().replace("/", " ").split()))
    if not label:
        report(warning(f"{where} has no label and is skipped; give it one", (*place, "label")))
    segments = _whole_numbers(f"segments of {where}", group.get("segments"), (*place, "segments"), report)
    if segments is None or not label:
        return None
    if not len(segments):
        report(warning(f"{where} ({label}) has no segments and is skipped", (*place, "segments")))
        return None
    number = group.get("objectId", group.get("id"))
    name = f"{label.replace(' ', '_')}_{number if isinstance(number, int) else index}"
    return AnnotatedInstance(name, label, segments, (*place, "segments"))


def _whole_numbers(where: str, values: object, place: Place, report: Report) -> NDArray[np.int64] | None:
    """A list of segment numbers, shape (n,); None if one is broken, with a report of the first."""
    if not isinstance(values, list):
        report(error(f"{where} is a {type(values).__name__}, expected a list", place))
        return None
    for index, value in enumerate(values):
        if type(value) is not int or not 0 <= value < 2**62:
            what = f"{where} has {short(value)} at {index}, expected a whole number of 0 or more"
            report(error(what, (*place, index)))
            return None
    return np.array(values, dtype=np.int64)


def segments_of(document: object, count: int | None, report: Report) -> NDArray[np.int64]:
    """The segment of each of `count` vertices, if that number is known, shape (n,); empty if they are broken."""
    none = np.zeros(0, dtype=np.int64)
    if not isinstance(document, dict):
        report(error(f"not an object, but {short(document)}"))
        return none
    segment = _whole_numbers(SEGMENTS, document.get(SEGMENTS), (SEGMENTS,), report)
    if segment is not None and count is not None and len(segment) != count:
        report(error(f"{SEGMENTS} has {len(segment)} entries, the mesh has {count} vertices", (SEGMENTS,)))
    return none if segment is None else segment


def vertex_instances(
    segment: NDArray[np.int64], instances: list[AnnotatedInstance], report: Report
) -> NDArray[np.int64]:
    """Instance of each vertex, -1 for none, from its segment (n,); if two instances have a segment, the later one
    counts."""
    known, place = np.unique(segment, return_inverse=True)
    owner = np.full(len(known), -1, dtype=np.int64)
    for index, one in enumerate(instances):
        there = np.isin(one.segments, known)
        if not there.all():
            what = f"no vertex is in segment {one.segments[~there][0]}, which {one.name} names"
            report(error(what, (*one.place, int(np.argmin(there)))))
        owner[np.searchsorted(known, one.segments[there])] = index
    return np.asarray(owner[place.reshape(-1)])


def majority(corner: NDArray[np.int64]) -> NDArray[np.int32]:
    """The instance of at least two corners of a face, or of its first corner if all three differ, shape (m,)."""
    first, second, third = corner.T
    return np.asarray(np.where(second == third, second, first), dtype=np.int32)


def alignment_of(files: SceneFiles, report: Report) -> NDArray[np.float64] | None:
    """The rigid transform to the axes of the room (4, 4), row by row in the file; None if it is missing or broken.

    A missing transform is reported as a note.
    """
    told = files.about is not None and files.about.stat().st_size > 0
    text = read_bytes(files.about).decode("utf-8", "replace") if files.about is not None and told else ""
    for number, line in enumerate(text.splitlines(), start=1):
        key, _, value = line.partition("=")
        if key.strip() == ALIGNMENT_KEY:
            return _rigid(value.split(), number, report)
    report(note(f"no {ALIGNMENT_KEY}: the mesh stays as it was scanned"))
    return None


def _rigid(words: list[str], line: int, report: Report) -> NDArray[np.float64] | None:
    try:
        matrix = np.array(words, dtype=np.float64).reshape(4, 4)
    except ValueError:
        report(error(f"{ALIGNMENT_KEY} has {len(words)} values, expected 16 numbers", line=line))
        return None
    turn = matrix[:3, :3]
    bounded = bool((np.abs(turn) <= 2.0).all() and np.isfinite(matrix).all())
    if (
        not bounded
        or np.abs(turn @ turn.T - np.eye(3)).max() > RIGID
        or np.linalg.det(turn) < 0
        or np.abs(matrix[3] - [0, 0, 0, 1]).max() > RIGID
    ):
        report(error(f"{ALIGNMENT_KEY} is not a rotation and a shift", line=line))
        return None
    return matrix
