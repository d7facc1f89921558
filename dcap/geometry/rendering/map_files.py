"""Writes conditioning maps to files: pictures, arrays, the camera as JSON and as a COLMAP model.

`camera.json` has the format of `dcap.geometry.camera_file`. All files are described in docs/formats.md.
"""

import json
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from dcap.geometry.camera import Camera
from dcap.geometry.camera_file import write_camera
from dcap.geometry.rendering.coverage import share_bytes
from dcap.scene.types.pictures import ColmapModel, ConditioningMaps, Pinhole, posed
from dcap.scene.writers.sugar import write_colmap

MILLIMETRES = 1000.0
FARTHEST = 65535
"""Largest depth that fits into 16 bits [mm]; larger depths are cut to it."""
POINTS = 2000
"""Maximum number of surface points in the COLMAP model."""
PICTURE = "rgb.png"
ARRAYS = ("depth", "normal_world", "normal_camera", "dent")
PICTURES = (
    "rgb", "depth", "normal_world", "normal_camera", "object_mask", "occlusion_matte", "contact", "shadow",
    "ambient_occlusion", "instance", "part", "material",
)  # fmt: skip
COLMAP = "colmap"
COMPOSITE = "composite.png"
FILES = (
    *(f"{name}.png" for name in PICTURES), *(f"{name}.npy" for name in ARRAYS), "ids.json", "camera.json", COMPOSITE,
    *(f"{COLMAP}/{name}.txt" for name in ("cameras", "images", "points3D")),
)  # fmt: skip
"""All files that may be written, below the folder of the maps."""


def write_maps(folder: Path, maps: ConditioningMaps, camera: Camera) -> None:
    """Write all files of one view."""
    folder.mkdir(parents=True, exist_ok=True)
    seen = np.isfinite(maps.depth)
    pictures: dict[str, NDArray[np.uint8] | NDArray[np.uint16]] = {
        "rgb": maps.rgb,
        "depth": millimetres(maps.depth),
        "normal_world": normal_picture(maps.normal_world, seen),
        "normal_camera": normal_picture(maps.normal_camera, seen),
        "object_mask": maps.object_mask,
        "occlusion_matte": np.stack([maps.hidden_mask, maps.object_mask, np.zeros_like(maps.object_mask)], axis=2),
        "contact": maps.contact,
        "shadow": share_bytes(maps.shadow),
        "ambient_occlusion": share_bytes(maps.ambient_occlusion),
        "instance": maps.instance,
        "part": maps.part,
        "material": maps.material,
    }
    for name in PICTURES:
        Image.fromarray(pictures[name]).save(folder / f"{name}.png")
    for name in ARRAYS:
        np.save(folder / f"{name}.npy", getattr(maps, name), allow_pickle=False)
    (folder / "ids.json").write_text(json.dumps(maps.names, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    write_camera(folder / "camera.json", camera)
    write_colmap(folder / COLMAP, colmap_model(maps, camera))


def colmap_model(maps: ConditioningMaps, camera: Camera) -> ColmapModel:
    """A COLMAP model of one camera, one picture, and points of the visible surface."""
    pinhole = Pinhole(1, camera.width, camera.height, (*camera.focals.tolist(),), (*camera.principal.tolist(),))
    image = posed(1, PICTURE, pinhole.id, camera.world_from_camera, camera.position)
    seen = np.flatnonzero(np.isfinite(maps.depth.ravel()))
    some = seen[:: max(1, -(-len(seen) // POINTS))]
    ways = camera.directions(camera.pixel_centers[some])
    along = maps.depth.ravel()[some] / (ways @ camera.world_from_camera[:, 2])
    return ColmapModel((pinhole,), (image,), camera.position + along[:, None] * ways, maps.rgb.reshape(-1, 3)[some])


def millimetres(depth: NDArray[np.float32]) -> NDArray[np.uint16]:
    """Depth in whole millimetres, 0 where nothing is."""
    whole = np.round(np.where(np.isfinite(depth), depth, 0.0) * MILLIMETRES)
    return np.asarray(np.clip(whole, 0, FARTHEST), dtype=np.uint16)


def normal_picture(normal: NDArray[np.float32], seen: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Components -1..1 as 0..255; black where nothing is."""
    return np.where(seen[..., None], np.round(127.5 * (normal + 1.0)), 0.0).astype(np.uint8)
