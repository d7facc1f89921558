"""Names of parts: geometry proposes, a client names.

In: a divided scene or object. Out: the same with the client's names; faces, boxes and the number of parts stay, so two
parts that get one name remain two.

The picture of an instance in parts: alone, each part in its own paint and numbered; made only if a client looks.
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
from dcap.language.connect import Client
from dcap.language.offline.lexicon import part_words
from dcap.language.protocol.questions import PARTS
from dcap.language.protocol.requests import PartsRequest, Picture, ProposedPart, Vector
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.segmentation import Instance, Part, Segmentation
from tasks.requests.pictures import SIZE, THING_DISTANCE, TINT, best_place, from_inside
from tasks.requests.views import Sums, part_views, sums_of

HUE_STEP = 0.381966
"""Turn of the colour wheel from part to part [-]: by the golden section, hues next to each other come late."""
SATURATION, BRIGHT, DARK = 0.9, 1.0, 0.6
"""Of the paints; every other one is dark [-]."""
DIGITS = 22
"""Height of a number [pixels]."""


def paint(index: int) -> Vector:
    """The colour of a part in the picture, sRGB 0..1."""
    return colorsys.hsv_to_rgb((index * HUE_STEP) % 1.0, SATURATION, DARK if index % 2 else BRIGHT)


def parts_picture(scene: Segmentation, index: int) -> NDArray[np.uint8]:
    """One instance from where most of it is seen, at best from its front, shape (SIZE, SIZE, 3)."""
    instance = scene.instances[index]
    parts = [_painted(scene, index, number) for number in range(len(instance.parts))]
    way, from_below = from_inside(scene.mesh.bounds, instance.box)
    way = way if instance.front is None else instance.front
    box = instance.box
    distance = THING_DISTANCE * box.diagonal
    position = best_place(Mesh.concatenate([]), Mesh.concatenate(parts), box, distance, way, from_below)
    shot = picture(parts, looking_at(position, box.center, SIZE, SIZE), samples=1, shadows=False)
    return _numbered(shot.rgb, shot.mesh_index)


def _painted(scene: Segmentation, index: int, number: int) -> Mesh:
    """One part in its paint; the rest of its colours lets shading and pattern through."""
    part = scene.mesh.submesh(np.flatnonzero((scene.face_instance == index) & (scene.face_part == number)))
    colors = (1.0 - TINT) * part.colors + TINT * 255.0 * np.array(paint(number))
    return Mesh(part.vertices, part.faces, np.rint(colors).astype(np.uint8))


def _numbered(rgb: NDArray[np.uint8], part: NDArray[np.int32]) -> NDArray[np.uint8]:
    """The number of each part that is seen, on the pixel that lies deepest inside it."""
    image = Image.fromarray(rgb)
    draw, font = ImageDraw.Draw(image), ImageFont.load_default(size=DIGITS)
    for number in np.unique(part[part >= 0]):
        row, column = np.unravel_index(np.argmax(distance_transform_edt(part == number)), part.shape)
        draw.text(
            (float(column), float(row)), str(number), "white", font, "mm", stroke_width=2, stroke_fill="black"
        )  # fmt: skip
    return np.asarray(image, dtype=np.uint8).copy()


def with_part_names(scene: Segmentation, client: Client) -> Segmentation:
    """Ask what the parts are called: one question for every instance of two parts or more, however many there are.

    Not asked are structure and what an annotation names.
    """
    asked = [i for i, one in enumerate(scene.instances) if is_asked(one)]
    if not asked:
        return scene
    sums, instances = sums_of(scene), list(scene.instances)
    replies = client.ask_all(PARTS, [parts_request(scene, i, sums) for i in asked])
    for i, reply in zip(asked, replies, strict=True):
        chosen = {one.index: one for one in reply.names}
        parts = (Part(chosen[k].name, p.box, chosen[k].confidence) for k, p in enumerate(instances[i].parts))
        instances[i] = replace(instances[i], parts=tuple(parts))
    return replace(scene, instances=tuple(instances))


def is_asked(instance: Instance) -> bool:
    """Whether there is something to tell apart that the source does not name for certain."""
    return not instance.structure and len(instance.parts) > 1 and any(p.confidence < 1.0 for p in instance.parts)


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
