"""Checks a dataset folder: finds its scenes and single meshes, and checks each by the rules of its reader.

Finds the scenes and the single meshes in a dataset folder.

A scene is a folder with annotations (InteriorGS), a folder of ScanNet, or a folder with SuGaR's folder tree, a single
mesh or a single file of splats. Several meshes in one folder are a collection of single meshes. Every other folder is
searched, whatever its name.
"""

import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from dcap.scene.checks.annotations import check_annotations, check_occupancy, read_tree
from dcap.scene.checks.findings import Findings, json_lines
from dcap.scene.errors import InputError, error, note, warning
from dcap.scene.readers.files import GROUND_TRUTH
from dcap.scene.readers.mesh.raw import RawMesh
from dcap.scene.readers.points.formats import is_points, read_points
from dcap.scene.readers.scenes.interiorgs import is_interiorgs
from dcap.scene.readers.scenes.scannet import (
    SceneFiles,
    alignment_of,
    instances_of,
    is_scannet,
    scannet_files,
    segments_of,
    vertex_instances,
)
from dcap.scene.readers.scenes.sugar import MESH_SUFFIXES, check_suffix, describe, find_mesh
from dcap.scene.readers.source import READERS, readable
from dcap.scene.readers.splats.formats import is_splats, read_gaussians

MANY = 0.1
"""Share of faces without area above which a mesh is damaged, beyond rounding [-]."""

NUMBERED = re.compile(r"\d{4}_\w+")
"""Pattern of InteriorGS's scene folders: 0001_839920."""
MARKS = ("occupancy.json", "occupancy.png", "3dgs_compressed.ply")
"""Other files that only occur in scene folders."""
SUGAR_TREE = ("refined_mesh", "coarse_mesh", "output")
"""Folders in which SuGaR leaves its meshes."""
NOT_DATA = ("cache", "runs", *GROUND_TRUTH)
"""Folders of our own next to the data: results, and files that no stage may read."""


@dataclass(frozen=True, slots=True)
class FileContents:
    """Content of a file; zeros if it could not be read."""

    path: Path
    faces: int = 0
    splats: int = 0
    vertices: int = 0
    names: tuple[str, ...] = ()
    """Labels of its annotated instances, else names of its nodes or groups."""


def check_shape(path: Path, findings: Findings) -> FileContents:
    """Read one mesh file with its materials and textures, or one file of splats or points."""
    try:
        with readable(path):
            if is_splats(path):
                return FileContents(path, splats=len(read_gaussians(path)))
            if is_points(path):
                return FileContents(path, vertices=len(read_points(path)[0]))
            raw = READERS[path.suffix.lower()](path)
    except InputError as broken:
        problem = getattr(broken, "problem", None) or error(str(broken).removeprefix(f"{path}: "))
        text = path.read_text("utf-8-sig") if problem.place and path.suffix.lower() == ".gltf" else ""
        findings.report(path, json_lines(text) if text else None)(problem)
        return FileContents(path)
    report = findings.report(path)
    for one in raw.notes:
        report(warning(one))
    bad = raw.degenerate
    if bad.any():
        what = (
            f"{int(bad.sum())} of {len(bad)} faces have no area (first: face {int(np.argmax(bad))}); they are dropped"
        )
        report(warning(what) if bad.mean() > MANY else note(what))
    return FileContents(path, faces=len(raw.faces), vertices=len(raw.vertices), names=_names(raw))


def _names(raw: RawMesh) -> tuple[str, ...]:
    """One name per annotated instance (its parts are separate nodes), and one per node without annotation."""
    if not raw.node_labels:
        return raw.node_names
    named = zip(raw.node_names, raw.node_labels, strict=True)
    found = {name if label is None else name.split("/")[0]: name if label is None else label for name, label in named}
    return tuple(one for one in found.values() if one)


@dataclass(slots=True)
class Layout:
    """Paths of the scenes and the single meshes."""

    scenes: list[Path] = field(default_factory=list)
    meshes: list[Path] = field(default_factory=list)
    empty: list[Path] = field(default_factory=list)
    """Folders without scenes and meshes."""


def layout_of(path: Path, findings: Findings) -> Layout:
    """Scenes and meshes below a folder, or the path itself if it is a scene or mesh."""
    if not path.is_dir():
        return Layout(meshes=[path])
    found = _searched(path, findings)
    for folder in found.empty:
        findings.report(folder)(note("nothing in this folder is a scene or a mesh"))
    if not found.scenes and not found.meshes:
        findings.report(path)(error(f"no scene in this folder: neither labels.json nor {', '.join(MESH_SUFFIXES)}"))
    return found


def is_marked(folder: Path) -> bool:
    """Return whether the files or the name of a folder mark it as one scene."""
    if is_interiorgs(folder) or is_scannet(folder) or NUMBERED.fullmatch(folder.name):
        return True
    if any((folder / name).is_file() for name in MARKS):
        return True
    trees = [folder / tree for tree in SUGAR_TREE]
    return any(file.suffix in (".obj", ".ply") for tree in trees if tree.is_dir() for file in tree.rglob("*.*"))


def mesh_files(folder: Path) -> list[Path]:
    """Meshes and splats directly in a folder."""
    return sorted(one for one in folder.iterdir() if one.suffix.lower() in MESH_SUFFIXES and one.is_file())


def _searched(folder: Path, findings: Findings) -> Layout:
    try:
        if is_marked(folder):
            return Layout(scenes=[folder])
        meshes = mesh_files(folder)
        children = sorted(one for one in folder.iterdir() if one.is_dir() and not one.is_symlink())
    except OSError as broken:
        findings.report(folder)(error(f"cannot be read: {broken.strerror}"))
        return Layout()
    children = [one for one in children if not one.name.startswith(".") and one.name.lower() not in NOT_DATA]
    below = [_searched(child, findings) for child in children]
    found = Layout()
    for layout in below:
        found.scenes += layout.scenes
        found.meshes += layout.meshes
        found.empty += layout.empty
    if len(meshes) == 1 and not found.scenes and not found.meshes:
        return Layout(scenes=[folder])  # folders below contain its textures
    found.meshes[:0] = meshes
    if not meshes and not children:
        found.empty.append(folder)
    return found


@dataclass(frozen=True, slots=True)
class SceneFacts:
    """Content of a scene according to its files."""

    path: Path
    labels: tuple[str, ...]
    """Labels of its instances: of annotated boxes, else names of nodes, else the name of the file."""
    faces: int
    """Number of faces of its mesh; 0 for a scene of splats."""
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
    """Names of the things in a file, or the file's own name if it names none; empty if it could not be read."""
    return shape.names or ((own,) if shape.faces or shape.splats else ())


def _shapes(folder: Path, findings: Findings) -> tuple[Path | None, list[FileContents]]:
    """The mesh or splats used for the scene, and the content of every mesh or splat file in the folder."""
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
    if segment is not None and len(segment):  # otherwise every group would be reported
        vertex_instances(segment, instances, tell_groups)
    return shape, tuple(one.label for one in instances)
