"""Gaussians of a splat scene with the placement in them: scene_settled.ply.

In: a finished sample and the results of its stages. Out: one file of plain 3DGS, in the scene file's own frame and
unit, so that it can replace the input file.
"""

import logging
from functools import partial
from pathlib import Path

from dcap.geometry.rendering.painted import painted, surface_colors
from dcap.scene.errors import DcapError, InputError
from dcap.scene.readers.scenes.sugar import find_splats
from dcap.scene.readers.splats.formats import is_splats, read_gaussians
from dcap.scene.writers.gaussians import write_splat_parts
from flows.placement_json import Values
from flows.sample_run import FinishedSample
from tasks.artifact import Source, Store
from tasks.render.settled_splats import SettledSplats, settled_splats

LOG = logging.getLogger(__name__)

SETTLED_SPLATS = "scene_settled.ply"
DEGREE = 3
"""Degree of the file's harmonics, as 3DGS and SuGaR read it; lower degrees are padded with zeros."""


def splats_of(given: str) -> Path | None:
    """The file of Gaussians of an input scene, None without one. InputError if there are several."""
    path = Path(given)
    return find_splats(path) if path.is_dir() else path if is_splats(path) else None


def splat_artifact(finished: FinishedSample, values: Values, folder: Path) -> dict[str, str]:
    """Write the file if the scene has Gaussians and something rests in it; a failure is only reported."""
    try:
        if values.settled is None or splats_of(finished.sample.scene) is None:
            return {}
        made = settled_scene_splats(finished, values)
    except DcapError as error:  # the placement is sound without it
        LOG.warning("no %s: %s", SETTLED_SPLATS, error)
        return {}
    write_made(made, folder)
    return {"splats": SETTLED_SPLATS}


def settled_scene_splats(finished: FinishedSample, values: Values) -> SettledSplats:
    """Content of the file. InputError if the scene has no Gaussians, or the placement no rest state."""
    sample = finished.sample
    scan, scene, item, anchor, settled = values.scan, values.scene, values.item, values.anchor, values.settled
    if splats_of(sample.scene) is None:
        raise InputError(f"{sample.scene}: no Gaussian splats; --format splats takes a placement in a scene of splats")
    if scan is None or scene is None or item is None or anchor is None or settled is None:
        reason = values.infeasible.reason.value if values.infeasible else "nothing settled"
        raise InputError(f"{sample.id} has no settled splats: {reason}")
    store = Store.default()
    source = store.load(store.add_source(sample.scene))  # the file at the time of the placement
    assert isinstance(source, Source)
    kept = splats_of(str(source.path))
    assert kept is not None
    colors = partial(surface_colors, painted(item.mesh, values.object_surface))
    return settled_splats(read_gaussians(kept), scan.world_from_file, scene, item, anchor, settled, colors=colors)


def write_made(made: SettledSplats, folder: Path) -> None:
    """Write the file into a folder."""
    write_splat_parts(folder / SETTLED_SPLATS, made.parts(), len(made), DEGREE, made.comments)
