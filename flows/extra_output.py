"""Output on request, in folders that are written whole or not at all: maps, the film of a drop, and exports.

`export.json` lists the files of an export. A new one removes those of an earlier one; other files in the folder stay,
as they do next to maps.
"""

import io
import json
import os
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path, PurePosixPath

import imageio_ffmpeg
import numpy as np
from numpy.typing import NDArray
from PIL import ExifTags, Image, ImageOps

from dcap.geometry.camera import Camera, looking_at
from dcap.geometry.camera_file import read_camera
from dcap.geometry.raycast import Raycaster
from dcap.geometry.rendering.coverage import composite
from dcap.geometry.rendering.map_files import COLMAP, COMPOSITE, FILES, write_maps
from dcap.scene.errors import InputError
from dcap.scene.readers.files import FORMATS, read_bytes, read_image
from dcap.scene.text import not_one_of
from dcap.scene.types.export_scene import ExportScene
from dcap.scene.writers.mjcf import mjcf_files
from dcap.scene.writers.urdf import urdf_files
from dcap.scene.writers.usda import usda_files
from dcap.scene.written_files import draft_folder
from flows.options import check_out
from flows.output import SETTLED_SPLATS, readable_json, settled_scene_splats, write_made
from flows.placement_json import Values
from flows.run_files import FinishedPlacement, finished_placement
from tasks.export.settled_export import export_scene
from tasks.render.config import RenderConfig
from tasks.render.maps import conditioning_maps, placed
from tasks.render.motion import drop_pictures
from tasks.render.settled_meshes import settled_item, settled_scene, structure_faces
from tasks.render.stage import nearby

Files = Mapping[str, bytes]
"""Content by path within the folder."""

FOLDER, LIST = "export", "export.json"
WRITERS: Mapping[str, Callable[[ExportScene], Files]] = {"mjcf": mjcf_files, "urdf": urdf_files, "usd": usda_files}
"""Formats of simulators: from a scene to the files."""
SPLATS = "splats"
"""The settled Gaussians, one file without a list."""
MAPS_FOLDER = "maps"
FILM = "drop.mp4"
SIZE = 720
"""Side of the film [pixel]."""
PER_SECOND = 24
HELD = 24
"""How often the last picture is repeated, so that the rest state stays in view."""
FARTHER = 1.25
"""Distance of the camera over that of the close-up [-]: the object starts above its place."""
CODEC = "libx264"
EXACT = ["-fflags", "+bitexact", "-flags:v", "+bitexact", "-map_metadata", "-1", "-threads", "1"]
"""Equal pictures give equal bytes."""


def write_files(folder: Path, files: Files, kind: str) -> None:
    """Write files into a folder: into a draft there, then one by one, the list last; InputError where it cannot be."""
    listed = {**files, LIST: readable_json({"format": kind, "files": sorted(files)})}
    try:
        folder.mkdir(parents=True, exist_ok=True)
        check_free(folder, listed)
        with draft_folder(folder) as draft:
            for name, content in listed.items():
                path = draft / name
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(content)
            clear_export(folder)
            for name in listed:
                (folder / name).parent.mkdir(parents=True, exist_ok=True)
                os.replace(draft / name, folder / name)
    except OSError as error:
        where = error.filename or folder
        raise InputError(f"{folder}: {where}: {error.strerror or error}; give another folder (--out)") from None


def check_free(folder: Path, files: Files) -> None:
    """Raise InputError if a folder is in the way of a file, or a file in the way of a folder."""
    for name in files:
        if (folder / name).is_dir():
            raise InputError(f"{folder / name} is a folder where a file goes; move it or give another folder (--out)")
        for parent in list((folder / name).parents)[: len(PurePosixPath(name).parts) - 1]:
            if parent.exists() and not parent.is_dir():
                raise InputError(f"{parent} is a file where a folder goes; move it or give another folder (--out)")


def clear_export(folder: Path) -> None:
    """Remove the files of an earlier export, and their folders if nothing else is in them."""
    try:
        names = list(json.loads((folder / LIST).read_bytes())["files"])
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


def clear_exports(out: Path) -> None:
    """Remove the exports of an earlier placement in the same folder."""
    folders = [path for path in (out / FOLDER).glob("*") if path.is_dir()]
    for folder in folders:
        clear_export(folder)
        if folder.name == SPLATS:
            (folder / SETTLED_SPLATS).unlink(missing_ok=True)
    for folder in (*folders, out / FOLDER):
        with suppress(OSError):  # not there, or something else is in it
            folder.rmdir()


def write_maps_of(
    placement: FinishedPlacement, folder: Path, camera: Path | None = None, photo: Path | None = None
) -> Path:
    """Write the maps of a finished placement; InputError where it has no rest state to be seen."""
    values, config = placement.values, placement.config.render
    lacks = f"{placement.finished.sample.id} has no maps"
    final = values.need_final(lacks)
    if values.renders is None:
        raise InputError(f"{lacks}: {values.infeasible.reason.value if values.infeasible else 'it has no pictures'}")
    view = automatic_camera(values, config) if camera is None else read_camera(camera, values.renders.camera_target)
    image = None if photo is None else read_photo(photo)
    surfaces = values.scene_surface, values.object_surface
    what = placed(final.scene, final.item, final.anchor, values.materials, final.settled, *surfaces)
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
    return write_maps_of(found, out or found.folder / MAPS_FOLDER, camera, photo)


def note_of(folder: Path) -> str:
    """Note for maps that are correct but useless; empty if there is nothing to note."""
    seen = np.asarray(Image.open(folder / "object_mask.png")).any()
    return "" if seen else "nothing of the object is visible from this camera: object_mask.png is empty"


def write_film(placement: FinishedPlacement, folder: Path) -> Path | None:
    """Write the film of a placement's drop into a folder; None if its frames were not kept."""
    values, final = placement.values, placement.values.final
    if final is None or final.settled.frames is None:
        return None
    scene, item, anchor, settled = final.scene, final.item, final.anchor, final.settled
    config = placement.config.render
    config = config.model_copy(update={"size": SIZE, "closeup_factor": FARTHER * config.closeup_factor})
    around = settled_scene(scene, settled, anchor.base_id).scene
    things = Raycaster(around.mesh.submesh(np.flatnonzero(~structure_faces(around))))
    thing = settled_item(item, anchor, final.body)
    camera = nearby(things, thing, automatic_camera(values, config), config)
    surfaces = values.scene_surface, values.object_surface
    with draft_folder(folder) as draft:
        path = draft / FILM
        writer = imageio_ffmpeg.write_frames(
            str(path), (SIZE, SIZE), fps=PER_SECOND, codec=CODEC, quality=8, macro_block_size=8, output_params=EXACT
        )
        writer.send(None)
        picture = None
        for picture in drop_pictures(scene, item, anchor, settled, surfaces, camera, config):
            writer.send(np.ascontiguousarray(picture))
        for _ in range(HELD if picture is not None else 0):
            writer.send(np.ascontiguousarray(picture))
        writer.close()
        os.replace(path, folder / FILM)
    return folder / FILM


def exported_scene(placement: FinishedPlacement) -> ExportScene:
    """The scene to export from a placement; InputError if it has no rest state."""
    values = placement.values
    lacks = f"{placement.finished.sample.id} has no rest state to export"
    final = values.need_final(lacks)
    if values.particles is None or values.infeasible:
        raise InputError(f"{lacks}: {values.infeasible.reason.value if values.infeasible else 'it was not dropped'}")
    return export_scene(final.scene, final.item, final.anchor, values.materials, values.particles, final.settled)


def export_sample(run: str, sample: str | None, kind: str, out: Path | None) -> Path:
    """Write one sample in a format; returns the folder, by default `export/FORMAT` in the sample's own."""
    if kind not in (*WRITERS, SPLATS):
        raise InputError(f"--format {kind!r} {not_one_of(kind, (*WRITERS, SPLATS))}")
    if out is not None:
        check_out(out)
    placement = finished_placement(run, sample)
    folder = out or placement.folder / FOLDER / kind
    check_out(folder)
    if kind == SPLATS:
        write_settled_splats(placement, folder)
    else:
        write_files(folder, WRITERS[kind](exported_scene(placement)), kind)
    return folder


def write_settled_splats(placement: FinishedPlacement, folder: Path) -> Path:
    """Write scene_settled.ply into a folder; InputError where the scene has no Gaussians or nothing rests in it."""
    check_out(folder)
    made = settled_scene_splats(placement.finished, placement.values)
    with draft_folder(folder) as draft:
        write_made(made, draft)
        os.replace(draft / SETTLED_SPLATS, folder / SETTLED_SPLATS)
    return folder / SETTLED_SPLATS
