"""Names of parts: geometry proposes, a client names, with a numbered picture of each thing in parts if it needs one.

In: a divided scene or object. Out: the same with the client's names; faces, boxes and the number of parts do not
change, so two parts with the same name remain two parts.
"""

import colorsys
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont
from scipy.ndimage import distance_transform_edt

from dcap.geometry.camera import looking_at
from dcap.geometry.rendering.picture import picture
from dcap.geometry.segmentation.labels import SYNONYMS
from dcap.knowledge.lexicon import part_words
from dcap.language.connect import Client
from dcap.language.protocol.questions import PARTS
from dcap.language.protocol.requests import PartsRequest, Picture, ProposedPart, Vector
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.segmentation import Part, Segmentation
from tasks.requests.badges import HUE_STEP
from tasks.requests.pictures import SIZE, THING_DISTANCE, TINT, best_place, from_inside
from tasks.requests.views import Sums, part_views, sums_of

SATURATION, BRIGHT, DARK = 0.9, 1.0, 0.6
"""Saturation and brightness of the colours; every other colour is dark [-]."""
DIGITS = 22
"""Height of the numbers [pixels]."""


def paint(index: int) -> Vector:
    """The colour of a part in the picture, sRGB 0..1."""
    return colorsys.hsv_to_rgb((index * HUE_STEP) % 1.0, SATURATION, DARK if index % 2 else BRIGHT)


def parts_picture(scene: Segmentation, index: int) -> NDArray[np.uint8]:
    """One instance from the side where most of it is visible, preferably its front, shape (SIZE, SIZE, 3)."""
    instance = scene.instances[index]
    parts = []
    for number in range(len(instance.parts)):  # the remainder of its own colours keeps shading and pattern visible
        part = scene.mesh.submesh(np.flatnonzero((scene.face_instance == index) & (scene.face_part == number)))
        colors = (1.0 - TINT) * part.colors + TINT * 255.0 * np.array(paint(number))
        parts.append(Mesh(part.vertices, part.faces, np.rint(colors).astype(np.uint8)))
    way, from_below = from_inside(scene.mesh.bounds, instance.box)
    way = way if instance.front is None else instance.front
    box = instance.box
    distance = THING_DISTANCE * box.diagonal
    position = best_place(Mesh.concatenate([]), Mesh.concatenate(parts), box, distance, way, from_below)
    shot = picture(parts, looking_at(position, box.center, SIZE, SIZE), samples=1, shadows=False)
    return _numbered(shot.rgb, shot.mesh_index)


def _numbered(rgb: NDArray[np.uint8], part: NDArray[np.int32]) -> NDArray[np.uint8]:
    """The picture with the number of each visible part, at the pixel that lies deepest inside it."""
    image = Image.fromarray(rgb)
    draw, font = ImageDraw.Draw(image), ImageFont.load_default(size=DIGITS)
    for number in np.unique(part[part >= 0]):
        row, column = np.unravel_index(np.argmax(distance_transform_edt(part == number)), part.shape)
        draw.text(
            (float(column), float(row)), str(number), "white", font, "mm", stroke_width=2, stroke_fill="black"
        )  # fmt: skip
    return np.asarray(image, dtype=np.uint8).copy()


def with_part_names(scene: Segmentation, client: Client) -> Segmentation:
    """Ask for the names of parts: one question per instance with two or more parts, all asked together.

    No question is asked about structure and annotated names.
    """
    asked = [
        i
        for i, one in enumerate(scene.instances)
        if not one.structure and len(one.parts) > 1 and any(part.confidence < 1.0 for part in one.parts)
    ]
    if not asked:
        return scene
    sums, instances = sums_of(scene), list(scene.instances)
    replies = client.ask_all(PARTS, [parts_request(scene, i, sums) for i in asked])
    for i, reply in zip(asked, replies, strict=True):
        chosen = {one.index: one for one in reply.names}
        parts = (Part(chosen[k].name, p.box, chosen[k].confidence) for k, p in enumerate(instances[i].parts))
        instances[i] = replace(instances[i], parts=tuple(parts))
    return replace(scene, instances=tuple(instances))


def parts_request(scene: Segmentation, index: int, sums: Sums) -> PartsRequest:
    """The question about one instance."""
    instance = scene.instances[index]
    parts = tuple(
        ProposedPart(view, part.confidence, paint(view.index))
        for view, part in zip(part_views(scene, index, sums), instance.parts, strict=True)
    )
    names = {*SYNONYMS, *part_words(), *(part.name for part in instance.parts)}
    pictures = (
        Picture("the thing alone, each part in its own colour with its index", partial(parts_picture, scene, index)),
    )
    return PartsRequest(instance.id, instance.label, parts, tuple(sorted(names)), pictures)
