"""Checks one scene: a folder, or a single file with a mesh or splats."""

from dataclasses import dataclass
from pathlib import Path

from dcap.scene.checks.annotations import check_annotations, read_tree
from dcap.scene.checks.files import FileContents, check_shape
from dcap.scene.checks.findings import Findings
from dcap.scene.checks.layout import MARKS, mesh_files
from dcap.scene.checks.occupancy import check_occupancy
from dcap.scene.errors import InputError
from dcap.scene.problems import error, warning
from dcap.scene.readers.scenes.interiorgs import is_interiorgs
from dcap.scene.readers.scenes.scannet import (
    SceneFiles,
    alignment_of,
    instances_of,
    scannet_files,
    segments_of,
    vertex_instances,
)
from dcap.scene.readers.scenes.sugar import check_suffix, describe, find_mesh


@dataclass(frozen=True, slots=True)
class SceneFacts:
    """Content of a scene according to its files."""

    path: Path
    labels: tuple[str, ...]
    """Labels of its instances: of annotated boxes, else names of nodes, else of the file."""
    faces: int
    """Faces of the mesh that is used; 0 if it is a scene of splats."""
    splats: int


def check_scene(path: Path, findings: Findings) -> SceneFacts:
    """Check a scene folder or file."""
    if not path.is_dir():
        return check_file(path, findings)
    try:
        scannet = None if is_interiorgs(path) else scannet_files(path)
        if scannet is not None:
            shape, labels = check_scannet(scannet, findings)
            return SceneFacts(path, labels, shape.faces, shape.splats)
        annotated = is_interiorgs(path) or any((path / name).is_file() for name in MARKS)
        labels = ()
        if annotated:
            labels = tuple(box.label for box in check_annotations(path, findings))
            check_occupancy(path, findings)
        used, shapes = _shapes(path, findings)
    except OSError as broken:
        findings.report(path)(error(f"cannot be read: {broken.strerror}"))
        return SceneFacts(path, (), 0, 0)
    faces = next((shape.faces for shape in shapes if shape.path == used), 0)
    splats = max((shape.splats for shape in shapes), default=0)
    if not annotated and used is not None:
        own = describe(used, path.name if used.parent == path else "")
        labels = next((_labels(shape, own) for shape in shapes if shape.path == used), ())
    return SceneFacts(path, labels, faces, splats)


def check_file(path: Path, findings: Findings) -> SceneFacts:
    """Check a single mesh or file of splats."""
    try:
        if not path.is_file():
            raise InputError(f"{path}: neither a file nor a folder")
        check_suffix(path)
    except InputError as refused:
        findings.report(path)(error(str(refused).removeprefix(f"{path}: ")))
        return SceneFacts(path, (), 0, 0)
    shape = check_shape(path, findings)
    return SceneFacts(path, _labels(shape, describe(path)), shape.faces, shape.splats)


def _labels(shape: FileContents, own: str) -> tuple[str, ...]:
    """Names of the things in a file, its own name if it names none; none if it could not be read."""
    return shape.names or ((own,) if shape.faces or shape.splats else ())


def _shapes(folder: Path, findings: Findings) -> tuple[Path | None, list[FileContents]]:
    """The mesh or splats that are used, and the content of every such file of the folder."""
    files = mesh_files(folder)
    used: Path | None = None
    try:
        used, _ = find_mesh(folder)
    except InputError as missing:
        what = str(missing).removeprefix(f"{folder}: ")
        hint = "" if files else "; put 3dgs_compressed.ply or a mesh there"
        findings.report(folder)(error(what + hint))
    if used is not None and used not in files:
        files.append(used)
    return used, [check_shape(path, findings) for path in files]


def check_scannet(files: SceneFiles, findings: Findings) -> tuple[FileContents, tuple[str, ...]]:
    """Check the files of a folder that are read; returns the mesh and the labels of the annotated instances."""
    shape = check_shape(files.mesh, findings)
    alignment_of(files, findings.report(files.about or files.mesh))
    if files.segments is None or files.groups is None:
        missing = "segs.json" if files.segments is None else "aggregation.json"
        findings.report(files.mesh)(warning(f"its {missing} is missing: instances are found by shape alone"))
        return shape, ()
    document, tell_segments = read_tree(files.segments, findings)
    segment = None if document is None else segments_of(document, shape.vertices or None, tell_segments)
    document, tell_groups = read_tree(files.groups, findings)
    instances = [] if document is None else instances_of(document, files.segments.name, tell_groups)[0]
    if segment is not None and len(segment):  # else every group would be reported
        vertex_instances(segment, instances, tell_groups)
    return shape, tuple(one.label for one in instances)
