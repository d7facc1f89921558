"""Conditioning maps of one sample of a run, for a person."""

from pathlib import Path

import numpy as np
from PIL import Image

from dcap.scene.errors import InputError
from flows.map_output import FOLDER, write_maps_of
from flows.run_files import finished_placement


def maps_of_sample(run: str, sample: str | None, camera: Path | None, photo: Path | None, out: Path | None) -> Path:
    """Write the maps of one sample of a run; returns their folder, by default `maps` in the sample's own."""
    if photo is not None and camera is None:
        raise InputError(f"--over {photo}: a photo needs its camera: --camera FILE (camera.json, docs/formats.md)")
    found = finished_placement(run, sample)
    return write_maps_of(found, out or found.folder / FOLDER, camera, photo)


def note_of(folder: Path) -> str:
    """What a person ought to know of maps that are right, and of no use; empty where there is nothing to say."""
    seen = np.asarray(Image.open(folder / "object_mask.png")).any()
    return "" if seen else "nothing of the object is seen from this camera: object_mask.png is empty"
