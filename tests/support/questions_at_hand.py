"""One request of each kind, with what any client needs to answer it."""

import numpy as np
from baseline_requests import asked_layout, asked_relations

from dcap.knowledge.material_table import load_materials
from dcap.language.protocol.questions import ANCHOR, HOLODECK, LABEL, LAYOUTGPT, MATERIALS, PARTS, ROTATION
from dcap.language.protocol.requests import (
    AnchorRequest,
    BoxView,
    FacingView,
    LabelRequest,
    MaterialQuestion,
    MaterialsRequest,
    PartsRequest,
    PartView,
    Picture,
    PoseView,
    ProposedPart,
    RotationRequest,
)


def pose(name: str, up: tuple[float, float, float], probability: float = 0.2) -> PoseView:
    eye = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    turned = ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0))
    return PoseView(name, eye if up[2] > 0 else turned, probability, up, (0.0, -1.0, 0.0), (0.1, 0.1, 0.1))


def flat(name: str, shade: int) -> Picture:
    """A picture of one shade."""
    return Picture(name, lambda: np.full((8, 8, 3), shade, dtype=np.uint8))


def rotation_request() -> RotationRequest:
    poses = (pose("upright", (0.0, 0.0, 1.0)), pose("flip_y", (0.0, 0.0, -1.0)))
    facings = (FacingView("aligned", (0.0, -1.0, 0.0)), FacingView("keep", (0.0, 0.0, 0.0)))
    shot = [flat(f"the object, flipped by 180 degrees about {axis}", 10 * k) for k, axis in enumerate("xyz")]
    return RotationRequest("mug upside down", "mug", "upside_down", "", poses, facings, 1, False, tuple(shot))


def anchor_request() -> AnchorRequest:
    parts = (
        PartView(0, "leg", (0.0, 0.0, 0.35), (1.0, 0.6, 0.7), 0.1),
        PartView(1, "top", (0.0, 0.0, 0.73), (1.0, 0.6, 0.03), 0.6),
    )
    right, front = (1.0, 0.0, 0.0), (0.0, -1.0, 0.0)
    boxes = (BoxView("lamp_1", "table lamp", (0.3, 0.1, 0.5), (0.2, 0.2, 0.4)),)
    return AnchorRequest(
        "put the mug on the left of the table", "on the left", "mug", (0.1, 0.1), "table", parts, "", "", ("left",), (),
        right, front, neighbours=boxes, pictures=(flat("the base from above", 70),),
    )  # fmt: skip


def materials_request() -> MaterialsRequest:
    part = PartView(0, "body", (0.0, 0.0, 0.0), (0.1, 0.1, 0.1), 0.01)
    return MaterialsRequest("", (MaterialQuestion("object", "mug", part),), tuple(load_materials().values()))


def label_request() -> LabelRequest:
    shot = [flat(name, 10 * k) for k, name in enumerate(("the room", "the thing from near"))]
    return LabelRequest(
        "thing_3", (2.0, 1.6, 0.9), 0.0, 0.9, 0.5, 2.0, 0.4, 1, 0.55, 1.0, 0.8, 0.05, "floor", "floor", 0.02, 2,
        (0.8, 0.8, 0.8), 12.0, 0.4, ("bed", "sofa", "desk"), tuple(shot),
    )  # fmt: skip


def parts_request() -> PartsRequest:
    views = [PartView(k, name, (0.0, 0.0, 0.4), (1.0, 0.6, 0.1)) for k, name in enumerate(("top", "leg", "leg"))]
    parts = tuple(ProposedPart(view, 0.7, (1.0, 0.0, 0.0)) for view in views)
    return PartsRequest("4", "desk", parts, ("board", "leg", "top"), (flat("the thing alone", 0),))


AT_HAND = (
    (ROTATION, rotation_request),
    (ANCHOR, anchor_request),
    (MATERIALS, materials_request),
    (LABEL, label_request),
    (PARTS, parts_request),
    (LAYOUTGPT, asked_layout),
    (HOLODECK, asked_relations),
)
"""Questions that need no scene of the test's own, with their requests."""
