"""The intent's question: the sentence, the scene's things, and numbered pictures of them if labels are uncertain."""

from collections.abc import Mapping
from dataclasses import replace
from functools import cache, partial

import numpy as np
from numpy.typing import NDArray

from dcap.language.protocol.requests import IntentRequest, Picture, vector
from dcap.scene.types.segmentation import Segmentation
from tasks.requests.marks import marked, numbers_of, plan_picture, room_pictures
from tasks.requests.views import instance_views, object_view, room_center

UNSURE = 0.9
"""Confidence of a label below which the scene is also shown in pictures [-]."""
VIEWS = 2
"""Number of views over corners of the room, besides the plan [-]."""


def intent_request(scene: Segmentation, item: Segmentation, prompt: str, given_base: str) -> IntentRequest:
    """Information for the client's choice; pictures are made on demand."""
    views, pictures = instance_views(scene), tuple[Picture, ...]()
    if any(one.confidence < UNSURE and not one.structure for one in scene.instances):
        numbers = numbers_of(scene)
        views = tuple(replace(view, number=numbers.get(index, 0)) for index, view in enumerate(views))
        pictures = set_of_marks(scene, numbers)
    center = vector(room_center(scene))
    return IntentRequest(prompt, object_view(item), views, center, pictures, given_base)


def set_of_marks(scene: Segmentation, numbers: Mapping[int, int]) -> tuple[Picture, ...]:
    """The plan and the views, made together on first use."""

    @cache
    def made() -> list[NDArray[np.uint8]]:
        pictures = marked(scene, numbers)
        return [plan_picture(pictures), *room_pictures(pictures, VIEWS)]

    def shown(index: int) -> NDArray[np.uint8]:
        return made()[index]

    names = ("the room as a plan, from above", *(f"the room over a corner, view {k}" for k in range(1, VIEWS + 1)))
    return tuple(
        Picture(f"{name}; each thing has its number", partial(shown, index)) for index, name in enumerate(names)
    )
