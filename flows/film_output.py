"""Writes the film of a drop: `drop.mp4`."""

import os
from pathlib import Path

import imageio_ffmpeg
import numpy as np

from dcap.geometry.raycast import Raycaster
from dcap.scene.json_tree import draft_folder
from flows.map_output import automatic_camera
from flows.run_files import FinishedPlacement
from tasks.render.motion import drop_pictures
from tasks.render.settled_meshes import settled_item, settled_scene, structure_faces
from tasks.render.stage import nearby

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


def write_film(placement: FinishedPlacement, folder: Path) -> Path | None:
    """Write the film of a placement's drop into a folder; None if its frames were not kept."""
    values = placement.values
    scene, item, anchor, settled = values.scene, values.item, values.anchor, values.settled
    if scene is None or item is None or anchor is None or settled is None or settled.frames is None:
        return None
    config = placement.config.render
    config = config.model_copy(update={"size": SIZE, "closeup_factor": FARTHER * config.closeup_factor})
    around = settled_scene(scene, settled, anchor.base_id).scene
    things = Raycaster(around.mesh.submesh(np.flatnonzero(~structure_faces(around))))
    thing = settled_item(item, anchor, settled.bodies[0])
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
