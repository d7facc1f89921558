"""Writes the conditioning maps of a finished placement into a folder: beside it first, then moved in.

In: what the stages returned, a camera and perhaps a photograph. Out: the folder, whole or not at all.
"""

import os
import shutil
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from dcap.geometry.camera import Camera, looking_at
from dcap.geometry.camera_file import read_camera
from dcap.geometry.rendering.composite import composite
from dcap.geometry.rendering.map_files import write_maps
from dcap.scene.errors import InputError
from dcap.scene.readers.files.image import read_image
from dcap.scene.store.artifacts import Store
from flows.output import load_values
from flows.placement_json import Values
from flows.sample_run import FinishedSample
from tasks.render.maps import conditioning_maps, placed
from tasks.render.stage import RenderConfig

FOLDER = "maps"
COMPOSITE = "composite.png"


def write_maps_of(
    finished: FinishedSample, folder: Path, config: RenderConfig, camera: Path | None = None, photo: Path | None = None
) -> Path:
    """Write the maps of a finished placement; InputError where it has no rest state to be seen."""
    values = load_values(finished, Store.default())
    scene, item, anchor, settled = values.scene, values.item, values.anchor, values.settled
    if scene is None or item is None or anchor is None or settled is None or values.renders is None:
        reason = values.infeasible.reason.value if values.infeasible else "it has no pictures"
        raise InputError(f"{finished.sample.id} has no maps: {reason}")
    view = automatic_camera(values, config) if camera is None else read_camera(camera, values.renders.camera_target)
    image = None if photo is None else read_photo(photo)
    what = placed(scene, item, anchor, values.materials, settled)
    found = conditioning_maps(what, view, config, cutaway=camera is None)
    over = None if image is None else composite(found, image)
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder.parent, prefix=".writing-") as draft:
        fresh = Path(draft) / FOLDER
        write_maps(fresh, found, view)
        if over is not None:
            Image.fromarray(over).save(fresh / COMPOSITE)
        if folder.exists():
            os.replace(folder, Path(draft) / "before")
        os.replace(fresh, folder)
        shutil.rmtree(Path(draft) / "before", ignore_errors=True)
    return folder


def automatic_camera(values: Values, config: RenderConfig) -> Camera:
    """The camera of `settled.png`."""
    renders = values.renders
    assert renders is not None
    return looking_at(renders.camera_position, renders.camera_target, config.size, config.size, fov_deg=config.fov_deg)


def read_photo(path: Path) -> NDArray[np.uint8]:
    """A photograph as sRGB bytes, shape (h, w, 3)."""
    try:
        return read_image(path.read_bytes(), str(path))
    except OSError as error:
        raise InputError(f"--over {path}: {error.strerror or error}") from None
