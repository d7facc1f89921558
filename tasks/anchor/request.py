"""The anchor's question: information and a picture for a client to choose a part and a place on it.

In: scene, base, intent, sentence and the object in its planned pose. Out: an `AnchorRequest` with boxes in the frame of
a viewer of the base's front, and a picture of the base and its surroundings from above, made on demand.
"""

from collections.abc import Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from dcap.geometry.camera import looking_at
from dcap.geometry.placement.named_regions import ViewerFrame
from dcap.geometry.rendering.picture import picture
from dcap.language.protocol.requests import AnchorRequest, BoxView, PartView, Picture, vector
from dcap.scene.types.boxes import OrientedBox
from dcap.scene.types.choices import Intent
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.segmentation import Instance, Segmentation
from tasks.requests.pictures import SIZE
from tasks.requests.surroundings import PART, boxes_of, horizontal_gap, part_frame, parts_meant
from tasks.requests.views import part_views

AROUND = 1.25
"""Half width of the picture at the base's top over the base's half extent [-]: shows a rim of the surroundings."""
HEADROOM = 1.0
"""Height over the base's top above which things are left out, as they would hide it [m]."""
FOV_DEG = 30.0
"""Narrow field of view, so that high things hardly lean outward [degrees]."""
LETTERS = 20
"""Height of the words at the rim [pixels]."""
NEARBY = 0.6
"""Distance from a base within which things are shown with it [m]."""
MOST = 40
"""Maximum number of these things, nearest first: a floor carries everything."""


def base_from_above(
    scene: Segmentation, base: Instance, frame: ViewerFrame, others: Sequence[Instance]
) -> NDArray[np.uint8]:  # fmt: skip
    """The picture with the viewer's side at the bottom and the viewer's right at the right, and the names of the four
    sides at the rim, shape (SIZE, SIZE, 3)."""
    shown = [base, *(one for one in others if one.box.bottom < base.box.top + HEADROOM)]
    meshes = [scene.instance_mesh(scene.index_of(one.id)) for one in shown]
    height = AROUND * float(frame.half.max()) / np.tan(np.radians(FOV_DEG / 2.0))
    # above everything that is shown
    height = max(height, *(float(mesh.bounds[1, 2]) - base.box.top + 0.2 for mesh in meshes))
    up = (-float(frame.front[0]), -float(frame.front[1]), 0.0)
    position, target = (np.array([*frame.center, base.box.top + above]) for above in (height, 0.0))
    camera = looking_at(position, target, SIZE, SIZE, fov_deg=FOV_DEG, up=up)
    image = Image.fromarray(picture(meshes, camera, samples=1, shadows=False).rgb)
    draw, font = ImageDraw.Draw(image), ImageFont.load_default(size=LETTERS)
    width, height = image.size
    for word, place, align in (
        ("back", (width / 2, 4), "ma"), ("front", (width / 2, height - 4), "md"),
        ("left", (4, height / 2), "lm"), ("right", (width - 4, height / 2), "rm"),
    ):  # fmt: skip
        draw.text(place, word, "white", font, align, stroke_width=2, stroke_fill="black")
    return np.asarray(image, dtype=np.uint8).copy()


def anchor_request(scene: Segmentation, base: Instance, intent: Intent, prompt: str, mesh: Mesh) -> AnchorRequest:
    """Information for the client's choice."""
    frame = part_frame(scene, base, base.box)
    size = np.ptp(mesh.bounds, axis=0)
    others = neighbours(scene, base)
    return AnchorRequest(
        prompt=prompt,
        region_words=intent.region.words,
        object_name=intent.object_name,
        footprint=(float(size[0]), float(size[1])),
        base_label=base.label,
        parts=allowed_parts(scene, base, intent),
        asked_part=intent.region.part,
        asked_which=intent.region.which,
        asked_regions=intent.region.names,
        asked_references=intent.region.references,
        asked_constraints=intent.region.constraints,
        right=(float(frame.right[0]), float(frame.right[1]), 0.0),
        front=(float(frame.front[0]), float(frame.front[1]), 0.0),
        part_boxes=tuple(box_view(str(k), part.name, part.box, frame, base) for k, part in enumerate(base.parts)),
        references=asked_boxes(scene, base, intent, frame),
        neighbours=tuple(box_view(one.id, one.label, one.box, frame, base) for one in others),
        pictures=(
            Picture(
                "the base from above; who looks at its front stands at the bottom edge",
                partial(base_from_above, scene, base, frame, others),
            ),
        ),
    )


def allowed_parts(scene: Segmentation, base: Instance, intent: Intent) -> tuple[PartView, ...]:
    """The base's parts without the excluded ones; all parts if none would be left."""
    views = part_views(scene, scene.index_of(base.id))
    barred = {
        index
        for one in intent.region.constraints
        if one.kind == "not_on" and one.reference.startswith(PART)
        for index in parts_meant(scene, base, one.reference)
    }
    return tuple(view for view in views if view.index not in barred) or views


def asked_boxes(scene: Segmentation, base: Instance, intent: Intent, frame: ViewerFrame) -> tuple[BoxView, ...]:
    """The boxes of the region's references; a part of two pieces has two."""
    found = []
    for name in intent.region.references:
        part = name.startswith(PART)
        label = name.removeprefix(PART) if part else scene.instances[scene.index_of(name)].label
        found += [box_view(name, label, box, frame, base) for box in boxes_of(scene, base, name)]
    return tuple(found)


def neighbours(scene: Segmentation, base: Instance) -> list[Instance]:
    """Things standing or hanging on, over and next to the base, the nearest first."""
    away = [
        (horizontal_gap(base.box, one.box), float(np.linalg.norm(one.box.center - base.box.center)), one.id, one)
        for one in scene.instances
        if one.id != base.id and not one.structure
    ]
    return [one for gap, _, _, one in sorted(away, key=lambda row: row[:3]) if gap < NEARBY][:MOST]


def box_view(name: str, label: str, box: OrientedBox, frame: ViewerFrame, base: Instance) -> BoxView:
    """A box as seen by a viewer of the base's front."""
    axes = np.array([[*frame.right, 0.0], [*frame.front, 0.0], [0.0, 0.0, 1.0]])
    local = (box.corners - base.box.center) @ axes.T
    low, high = local.min(axis=0), local.max(axis=0)
    return BoxView(name, label, vector(0.5 * (low + high)), vector(high - low))
