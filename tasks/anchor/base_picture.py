"""The picture of a base from above, with the things on it and next to it; made on demand."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from dcap.geometry.camera import looking_at
from dcap.geometry.placement.named_regions import ViewerFrame
from dcap.geometry.rendering.picture import picture
from dcap.scene.types.segmentation import Instance, Segmentation
from tasks.requests.pictures import SIZE

AROUND = 1.25
"""Half width of the picture at the base's top over the base's half extent [-]: shows a rim of the surroundings."""
HEADROOM = 1.0
"""Height over the base's top above which things are left out, as they would hide it [m]."""
FOV_DEG = 30.0
"""Narrow field of view, so that high things hardly lean outward [degrees]."""
LETTERS = 20
"""Height of the words at the rim [pixels]."""


def base_from_above(
    scene: Segmentation, base: Instance, frame: ViewerFrame, others: Sequence[Instance]
) -> NDArray[np.uint8]:  # fmt: skip
    """The viewer's side at the bottom, his right at the right, shape (SIZE, SIZE, 3)."""
    shown = [base, *(one for one in others if one.box.bottom < base.box.top + HEADROOM)]
    meshes = [scene.instance_mesh(scene.index_of(one.id)) for one in shown]
    height = AROUND * float(frame.half.max()) / np.tan(np.radians(FOV_DEG / 2.0))
    # above everything that is shown
    height = max(height, *(float(mesh.bounds[1, 2]) - base.box.top + 0.2 for mesh in meshes))
    up = (-float(frame.front[0]), -float(frame.front[1]), 0.0)
    position, target = (np.array([*frame.center, base.box.top + above]) for above in (height, 0.0))
    camera = looking_at(position, target, SIZE, SIZE, fov_deg=FOV_DEG, up=up)
    return with_sides(picture(meshes, camera, samples=1, shadows=False).rgb)


def with_sides(rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The names of the four sides at the rim."""
    image = Image.fromarray(rgb)
    draw, font = ImageDraw.Draw(image), ImageFont.load_default(size=LETTERS)
    width, height = image.size
    for word, place, align in (
        ("back", (width / 2, 4), "ma"), ("front", (width / 2, height - 4), "md"),
        ("left", (4, height / 2), "lm"), ("right", (width - 4, height / 2), "rm"),
    ):  # fmt: skip
        draw.text(place, word, "white", font, align, stroke_width=2, stroke_fill="black")
    return np.asarray(image, dtype=np.uint8).copy()
