"""Writes one sample of a run for a simulator or a splat viewer: a table of formats.

In: a finished placement. Out: its folder, with the files of the format and `export.json`, which lists them.
"""

import os
from collections.abc import Callable, Mapping
from pathlib import Path

from dcap.scene.errors import InputError
from dcap.scene.text import not_one_of
from dcap.scene.types.export_scene import ExportScene
from dcap.scene.writers.mjcf import mjcf_files
from dcap.scene.writers.urdf import urdf_files
from dcap.scene.writers.usda import usda_files
from dcap.scene.written_files import draft_folder
from flows.extra_output import FOLDER, SPLATS, Files, write_files
from flows.options import check_out
from flows.output import SETTLED_SPLATS, settled_scene_splats, write_made
from flows.run_files import FinishedPlacement, finished_placement
from tasks.export.settled_export import export_scene


def exported_scene(placement: FinishedPlacement) -> ExportScene:
    """The scene to export from a placement; InputError if it has no rest state."""
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


def export_sample(run: str, sample: str | None, kind: str, out: Path | None) -> Path:
    """Write one sample in a format; returns the folder, by default `export/FORMAT` in the sample's own."""
    if kind not in (*FORMATS, SPLATS):
        raise InputError(f"--format {kind!r} {not_one_of(kind, (*FORMATS, SPLATS))}")
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


def write_settled_splats(placement: FinishedPlacement, folder: Path) -> Path:
    """Write scene_settled.ply into a folder; InputError where the scene has no Gaussians or nothing rests in it."""
    check_out(folder)
    made = settled_scene_splats(placement.finished, placement.values)
    with draft_folder(folder) as draft:
        write_made(made, draft)
        os.replace(draft / SETTLED_SPLATS, folder / SETTLED_SPLATS)
    return folder / SETTLED_SPLATS
