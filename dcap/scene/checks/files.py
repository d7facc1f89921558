"""Checks mesh files, Gaussian splats and points, by the rules of their readers."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np

from dcap.scene.checks.findings import Findings
from dcap.scene.checks.places import Lines, json_lines
from dcap.scene.errors import InputError
from dcap.scene.problems import Place, Problem, Report, Severity, error, note, warning
from dcap.scene.readers.mesh.raw import RawMesh
from dcap.scene.readers.points.formats import is_points, read_points
from dcap.scene.readers.source import BROKEN, READERS
from dcap.scene.readers.splats.formats import check_gaussians, is_splats

MANY = 0.1
"""Share of faces without area above which a mesh is damaged, beyond rounding [-]."""

Found = TypeVar("Found")


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
    """Check one mesh file, with the materials and textures it names, or one file of splats or points."""
    report = findings.report(path, _lines(path))
    if is_splats(path):
        return FileContents(path, splats=_guarded(path, report, lambda: check_gaussians(path, report), 0))
    if is_points(path):
        return FileContents(path, vertices=_guarded(path, report, lambda: len(read_points(path)[0]), 0))
    return _guarded(path, report, lambda: _check_mesh(path, report), FileContents(path))


def _check_mesh(path: Path, report: Report) -> FileContents:
    told: list[Severity] = []

    def also(problem: Problem) -> None:
        told.append(problem.severity)
        report(problem)

    try:
        raw = READERS[path.suffix.lower()](path, also).without_loose_vertices()
    except (InputError, *BROKEN):
        if Severity.ERROR in told:  # the rest of a broken file may be no valid mesh, which is no further problem
            return FileContents(path)
        raise
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
    """One name per annotated instance, whose parts are nodes of their own, and one per node without annotation."""
    if not raw.node_labels:
        return raw.node_names
    named = zip(raw.node_names, raw.node_labels, strict=True)
    found = {name if label is None else name.split("/")[0]: name if label is None else label for name, label in named}
    return tuple(one for one in found.values() if one)


def _guarded(path: Path, report: Report, check: Callable[[], Found], otherwise: Found) -> Found:
    """Run a check; a truncated file is a further error."""
    try:
        return check()
    except InputError as broken:
        report(error(str(broken).removeprefix(f"{path}: ")))
    except OSError as broken:
        report(error(f"cannot be read: {broken.strerror}"))
    except BROKEN as broken:
        report(error(f"the file contradicts its format ({type(broken).__name__}: {broken})"))
    return otherwise


def _lines(path: Path) -> Lines | None:
    """Lines of places in a glTF text; problems of other formats name their lines themselves."""
    if path.suffix.lower() != ".gltf":
        return None
    known: list[Lines] = []

    def line(place: Place) -> int:
        if not place:
            return 0
        try:
            known[:] = known or [json_lines(path.read_text("utf-8"))]
        except (OSError, ValueError):  # JSON in another encoding
            return 0
        return known[0](place)

    return line
