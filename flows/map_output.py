"""Writes the conditioning maps of a finished placement into a folder: into a draft there, then file by file.

In: the results of the stages, a camera and perhaps a photograph. Out: the folder; other files in it stay.
"""

import io
import os
from contextlib import suppress
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import ExifTags, Image, ImageOps

from dcap.geometry.camera import Camera, looking_at
from dcap.geometry.camera_file import read_camera
from dcap.geometry.rendering.coverage import composite
from dcap.geometry.rendering.map_files import COLMAP, COMPOSITE, FILES, write_maps
from dcap.scene.errors import InputError
from dcap.scene.json_tree import draft_folder
from dcap.scene.readers.files import FORMATS, read_bytes, read_image
from flows.options import check_out
from flows.placement_json import Values
from flows.run_files import FinishedPlacement, finished_placement
from tasks.render.config import RenderConfig
from tasks.render.maps import conditioning_maps, placed

FOLDER = "maps"


def write_maps_of(
    placement: FinishedPlacement, folder: Path, camera: Path | None = None, photo: Path | None = None
) -> Path:
    """Write the maps of a finished placement; InputError where it has no rest state to be seen."""
    values, config = placement.values, placement.config.render
    scene, item, anchor, settled = values.scene, values.item, values.anchor, values.settled
    if scene is None or item is None or anchor is None or settled is None or values.renders is None:
        reason = values.infeasible.reason.value if values.infeasible else "it has no pictures"
        raise InputError(f"{placement.finished.sample.id} has no maps: {reason}")
    view = automatic_camera(values, config) if camera is None else read_camera(camera, values.renders.camera_target)
    image = None if photo is None else read_photo(photo)
    surfaces = values.scene_surface, values.object_surface
    what = placed(scene, item, anchor, values.materials, settled, *surfaces)
    found = conditioning_maps(what, view, config, cutaway=camera is None)
    over = None if image is None else composite(found, image)
    check_out(folder)
    with draft_folder(folder) as fresh:
        write_maps(fresh, found, view)
        if over is not None:
            Image.fromarray(over).save(fresh / COMPOSITE)
        (folder / COLMAP).mkdir(exist_ok=True)
        for name in FILES:
            if (fresh / name).is_file():
                os.replace(fresh / name, folder / name)
            else:  # of an earlier view
                (folder / name).unlink(missing_ok=True)
    return folder


def clear_maps(folder: Path) -> None:
    """Remove the files of earlier maps, and their folders if nothing else is in them."""
    for name in FILES:
        (folder / name).unlink(missing_ok=True)
    for one in (folder / COLMAP, folder):
        with suppress(OSError):  # not there, or something else is in it
            one.rmdir()


def automatic_camera(values: Values, config: RenderConfig) -> Camera:
    """The camera of `settled.png`."""
    renders = values.renders
    assert renders is not None
    return looking_at(renders.camera_position, renders.camera_target, config.size, config.size, fov_deg=config.fov_deg)


def read_photo(path: Path) -> NDArray[np.uint8]:
    """A photograph as sRGB bytes, turned as its EXIF data say, shape (h, w, 3)."""
    try:
        data = read_bytes(path)
    except OSError as error:
        raise InputError(f"--over {path}: {error.strerror or error}") from None
    plain = read_image(data, str(path))  # raises InputError for a file that is no picture
    with Image.open(io.BytesIO(data), formats=FORMATS) as photo:
        if photo.mode.startswith(("I", "F")):
            raise InputError(f"--over {path}: {photo.mode} has more than 8 bits a channel; give an 8-bit sRGB picture")
        turned = photo.getexif().get(ExifTags.Base.Orientation, 1) != 1
        return np.array(ImageOps.exif_transpose(photo).convert("RGB")) if turned else plain


def maps_of_sample(run: str, sample: str | None, camera: Path | None, photo: Path | None, out: Path | None) -> Path:
    """Write the maps of one sample of a run; returns their folder, by default `maps` in the sample's own."""
    if photo is not None and camera is None:
        raise InputError(f"--over {photo}: a photo needs its camera: --camera FILE (camera.json, docs/formats.md)")
    found = finished_placement(run, sample)
    return write_maps_of(found, out or found.folder / FOLDER, camera, photo)


def note_of(folder: Path) -> str:
    """Note for maps that are correct but useless; empty if there is nothing to note."""
    seen = np.asarray(Image.open(folder / "object_mask.png")).any()
    return "" if seen else "nothing of the object is visible from this camera: object_mask.png is empty"
