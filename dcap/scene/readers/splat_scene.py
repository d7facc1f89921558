"""A scene as Gaussians with its annotations: labelled boxes, rooms, a map of the floor; in metres and z up."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dcap.scene.errors import InputError
from dcap.scene.readers.frame import Role, find_frame
from dcap.scene.readers.scenes.interiorgs import is_interiorgs, read_labels, read_structure
from dcap.scene.readers.scenes.occupancy import read_occupancy
from dcap.scene.readers.scenes.sugar import COMPRESSED_NAME, find_splats
from dcap.scene.readers.source import check_options, read_file, stated_frame
from dcap.scene.types.floor_plan import Occupancy
from dcap.scene.types.gaussians import Gaussians
from dcap.scene.types.sample import SourceOptions
from dcap.scene.types.scan import LabelBox, Room


@dataclass(frozen=True, eq=False, slots=True)
class SplatScene:
    """Content of a folder or file of splats."""

    path: Path
    """The file of splats."""
    splats: Gaussians
    boxes: tuple[LabelBox, ...]
    rooms: tuple[Room, ...]
    occupancy: Occupancy | None
    annotated: bool
    """Whether the folder has InteriorGS' annotations: the format states units and axes."""
    world_from_file: NDArray[np.float64]
    """Maps the file's own coordinates to ours, shape (4, 4)."""
    notes: tuple[str, ...]
    """Assumptions and ignored parts on reading, one sentence each."""


def read_splat_scene(path: Path, options: SourceOptions) -> SplatScene:
    """Read a folder with Gaussian splats, or a file of them."""
    if not path.exists():
        raise InputError(f"{path}: no such file or folder")
    annotated = path.is_dir() and is_interiorgs(path)
    if annotated:
        check_options(path, options, Role.SCENE)
    found = find_splats(path) if path.is_dir() else path
    if found is None:
        raise InputError(
            f"{path}: no Gaussian splats in this folder (looked for {COMPRESSED_NAME} and other "
            ".ply, .splat, .spz and .sog files)"
        )
    raw, splats = read_file(found)
    if not isinstance(splats, Gaussians):
        kind = "a mesh" if splats is None else "a point cloud"
        raise InputError(f"{found}: {kind}, not Gaussian splats; give a file of splats or a folder with one")
    frame = (stated_frame if annotated else find_frame)(raw, options, Role.SCENE)
    boxes, notes = read_labels(path) if annotated else ((), ())
    rooms = read_structure(path)[0] if annotated else ()
    occupancy, map_notes = read_occupancy(path, rooms) if path.is_dir() else (None, ())
    return SplatScene(
        found, splats.transformed(frame.world_from_file), boxes, rooms, occupancy, annotated, frame.world_from_file,
        raw.notes + frame.notes + notes + map_notes,
    )  # fmt: skip
