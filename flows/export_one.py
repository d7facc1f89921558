"""Writes one sample of a run for a simulator or a splat viewer: a table of formats, and a folder written whole or not.

In: a finished placement. Out: its folder, with the files of the format and `export.json`, which lists them: what an
earlier export left there is replaced, anything else in the folder stays.
"""

import json
import os
import tempfile
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path, PurePosixPath

from dcap.scene.errors import InputError
from dcap.scene.types.export_scene import ExportScene
from dcap.scene.writers.mjcf import mjcf_files
from dcap.scene.writers.urdf import urdf_files
from dcap.scene.writers.usda import usda_files
from flows.options import check_out
from flows.output import readable_json
from flows.run_files import FinishedPlacement, finished_placement
from flows.splat_output import write_settled_splats
from tasks.export.settled_export import export_scene

Files = Mapping[str, bytes]
"""Content by path within the folder."""

FOLDER, LIST = "export", "export.json"


def exported_scene(placement: FinishedPlacement) -> ExportScene:
    """What is exported of a placement; InputError where it has no rest state."""
    values = placement.values
    scene, item, anchor, settled, particles = (
        values.scene, values.item, values.anchor, values.settled, values.particles
    )  # fmt: skip
    if scene is None or item is None or anchor is None or settled is None or particles is None or values.infeasible:
        reason = values.infeasible.reason.value if values.infeasible else "it was not dropped"
        raise InputError(f"{placement.finished.sample.id} has no rest state to export: {reason}")
    return export_scene(scene, item, anchor, values.materials, particles, settled)


def simulated(write: Callable[[ExportScene], Files]) -> Callable[[FinishedPlacement], Files]:
    """A format that is written from an `ExportScene`."""
    return lambda placement: write(exported_scene(placement))


FORMATS: Mapping[str, Callable[[FinishedPlacement], Files]] = {
    "mjcf": simulated(mjcf_files),
    "urdf": simulated(urdf_files),
    "usd": simulated(usda_files),
}
"""Formats of simulators: from a finished placement to the files."""
SPLATS = "splats"
"""The settled Gaussians, which are written as they are made."""


def export_sample(run: str, sample: str | None, kind: str, out: Path | None) -> Path:
    """Write one sample in a format; returns the folder, by default `export/FORMAT` in the sample's own."""
    if kind not in (*FORMATS, SPLATS):
        raise InputError(f"--format {kind!r} is not one of {', '.join((*FORMATS, SPLATS))}")
    if out is not None:
        check_out(out)
    placement = finished_placement(run, sample)
    folder = out or placement.folder / FOLDER / kind
    check_out(folder)
    if kind == SPLATS:
        write_settled_splats(placement, folder)
    else:
        write_files(folder, FORMATS[kind](placement), kind)
    return folder


def write_files(folder: Path, files: Files, kind: str) -> None:
    """Write files into a folder: into a draft there, then one by one, the list last; InputError where it cannot be."""
    listed = {**files, LIST: readable_json({"format": kind, "files": sorted(files)})}
    try:
        folder.mkdir(parents=True, exist_ok=True)
        check_free(folder, listed)
        with tempfile.TemporaryDirectory(dir=folder, prefix=".writing-") as draft:
            for name, content in listed.items():
                path = Path(draft) / name
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(content)
            clear_export(folder)
            for name in listed:
                (folder / name).parent.mkdir(parents=True, exist_ok=True)
                os.replace(Path(draft) / name, folder / name)
    except OSError as error:
        where = error.filename or folder
        raise InputError(f"{folder}: {where}: {error.strerror or error}; give another folder (--out)") from None


def check_free(folder: Path, files: Files) -> None:
    """InputError where a folder stands in the place of a file, or a file in that of a folder."""
    for name in files:
        if (folder / name).is_dir():
            raise InputError(f"{folder / name} is a folder where a file goes; move it or give another folder (--out)")
        for parent in list((folder / name).parents)[: len(PurePosixPath(name).parts) - 1]:
            if parent.exists() and not parent.is_dir():
                raise InputError(f"{parent} is a file where a folder goes; move it or give another folder (--out)")


def clear_export(folder: Path) -> None:
    """Remove the files of an earlier export, and their folders if nothing else is in them."""
    try:
        names = list(json.loads((folder / LIST).read_text())["files"])
    except (OSError, ValueError, KeyError, TypeError):
        return  # none, or none of ours
    paths = [PurePosixPath(one) for one in names if isinstance(one, str)]
    within = [path for path in paths if path.parts and not path.is_absolute() and ".." not in path.parts]
    for path in within:
        with suppress(OSError):
            (folder / path).unlink(missing_ok=True)
    (folder / LIST).unlink(missing_ok=True)
    for parent in sorted({path.parent for path in within if len(path.parts) > 1}, reverse=True):
        with suppress(OSError):
            (folder / parent).rmdir()
