"""Writes the input of SuGaR's command line: pictures, cameras, Gaussians and a COLMAP model [G24].

FOLDER/images/ and FOLDER/sparse/0/ are its scene (-s), FOLDER/checkpoint/ its checkpoint of plain Gaussian splatting
(-c): cameras.json and point_cloud/iteration_7000/point_cloud.ply with 45 harmonics. Everything is in our world frame,
and so is the resulting mesh.

[G24] Guedon, Lepetit: SuGaR: surface-aligned Gaussian splatting for efficient 3D mesh reconstruction. CVPR 2024.

COLMAP models are written as text (https://colmap.github.io/format.html), without observations and tracks.
"""

import json
import shlex
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from dcap.scene.types.gaussians import Gaussians
from dcap.scene.types.pictures import ColmapModel
from dcap.scene.writers.gaussians import write_splats

NO_ERROR = -1.0
"""Reprojection error of points without matches [pixel]."""

COLUMNS = {
    "cameras": "CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]",
    "images": "IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, then a line of X Y POINT3D_ID",
    "points3D": "POINT3D_ID X Y Z R G B ERROR TRACK[]",
}
CHECKPOINT = "checkpoint"
ITERATION = 7000
"""Iterations of plain Gaussian splatting, from which SuGaR starts."""
DEGREE = 3
"""Degree of the harmonics: SuGaR refuses fewer than 45 numbers."""
MESHES = ("coarse_mesh", "refined_mesh")
"""Folders of `output/` in which SuGaR writes meshes."""


def write_colmap(folder: Path, model: ColmapModel) -> None:
    """Write cameras.txt, images.txt and points3D.txt, with enough digits to restore the same numbers."""
    folder.mkdir(parents=True, exist_ok=True)

    def line(*values: object) -> str:
        return " ".join(repr(float(v)) if isinstance(v, float) else str(v) for v in values) + "\n"

    rows = {
        "cameras": [line(c.id, "PINHOLE", c.width, c.height, *c.focal, *c.center) for c in model.cameras],
        "images": [
            line(i.id, *i.quaternion.tolist(), *i.translation.tolist(), i.camera_id, i.name) + "\n"
            for i in model.images
        ],
        "points3D": [
            line(k + 1, *place, *color, NO_ERROR)
            for k, (place, color) in enumerate(zip(model.points.tolist(), model.colors.tolist(), strict=True))
        ],
    }
    for name, lines in rows.items():
        (folder / f"{name}.txt").write_text("".join([f"# {COLUMNS[name]}\n", *lines]), encoding="utf-8")


def write_sugar_model(folder: Path, model: ColmapModel, splats: Gaussians) -> None:
    """Write everything except the pictures."""
    write_colmap(folder / "sparse" / "0", model)
    cloud = folder / CHECKPOINT / "point_cloud" / f"iteration_{ITERATION}" / "point_cloud.ply"
    cloud.parent.mkdir(parents=True)
    write_splats(cloud, splats, degree=DEGREE)
    text = json.dumps(cameras_json(model), indent=1)
    (folder / CHECKPOINT / "cameras.json").write_text(text + "\n", encoding="utf-8")


def cameras_json(model: ColmapModel) -> list[dict[str, object]]:
    """The list of cameras in the form of plain Gaussian splatting: poses are camera to world, names have no suffix."""
    entries: list[dict[str, object]] = []
    for image in model.images:
        camera = model.camera_of(image)
        entries.append(
            {
                "id": image.id,
                "img_name": Path(image.name).stem,
                "width": camera.width,
                "height": camera.height,
                "position": image.position.tolist(),
                "rotation": image.camera_from_world.T.tolist(),
                "fy": camera.focal[1],
                "fx": camera.focal[0],
            }
        )
    return entries


def write_picture(folder: Path, name: str, image: NDArray[np.uint8]) -> None:
    """Write one view, sRGB bytes of shape (rows, columns, 3)."""
    path = folder / "images" / name
    path.parent.mkdir(exist_ok=True)
    Image.fromarray(image).save(path)


def train_command(folder: Path) -> str:
    """The command that makes meshes from a folder, to be run in SuGaR's own folder."""
    # SuGaR concatenates the checkpoint's path and file names as text: the trailing slash matters
    source, checkpoint = shlex.quote(str(folder)), shlex.quote(f"{folder / CHECKPOINT}/")
    return f"python train.py -s {source} -c {checkpoint} -r sdf --refinement_time short --eval False"


def run_script(folder: Path, scene: Path) -> str:
    """A shell script that runs SuGaR on `folder` and copies the meshes to their place in `scene`."""
    name = shlex.quote(folder.name)  # SuGaR names its outputs after the scene's folder
    copies = "\n".join(
        f"if [ -d output/{kind}/{name} ]; then\n"
        f'  mkdir -p "$scene"/output/{kind}\n  cp -R output/{kind}/{name} "$scene"/output/{kind}/\nfi'
        for kind in MESHES
    )
    return f"""#!/bin/sh
# Runs SuGaR on the pictures next to this file and copies its meshes into the scene: sh run_sugar.sh PATH_OF_SUGAR
set -eu
cd "${{1:?give the folder of SuGaR, which holds train.py}}"
scene={shlex.quote(str(scene))}
{train_command(folder)}
{copies}
echo "meshes: $scene/output"
"""
