"""The intent's question to a client, and the question to the user if the choice is ambiguous, the same for all clients.

In: a reply with the likelihood of each thing. Out: nothing if the sentence means one thing; else a LanguageError whose
single line distinguishes the candidates so that a person can answer, or, if the user is not to be asked, a note on the
chosen candidate. A thing known by its shape alone must also be likely by itself.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache, partial

import numpy as np
from numpy.typing import NDArray

from dcap.language.offline.tell_apart import told_apart
from dcap.language.protocol.replies import Candidate, IntentReply
from dcap.language.protocol.requests import InstanceView, IntentRequest, Picture, vector
from dcap.scene.errors import LanguageError
from dcap.scene.types.outcome import Cause, Caution
from dcap.scene.types.segmentation import Segmentation
from tasks.requests.marks import marked, numbers_of, plan_picture, room_pictures
from tasks.requests.views import instance_views, object_view, room_center

UNSURE = 0.9
"""Confidence of a label below which the scene is also shown in pictures [-]."""
VIEWS = 2
"""Number of views over corners of the room, besides the plan [-]."""
AS_LIKELY = 0.5
"""Least likelihood of a further candidate, over that of the likeliest [-]."""
SURE_BY_SHAPE = 0.6
"""Least likelihood at which a thing known by its shape alone is accepted without a question: below it fewer than nine
in ten are right (decision 052) [-]."""
MOST = 8
"""Maximum number of listed candidates [-]."""


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


def settle_choice(reply: IntentReply, request: IntentRequest, *, ask: bool) -> tuple[str, ...]:
    """Notes on choices made for the user; raises LanguageError if the user is to be asked."""
    notes = []
    for candidates in (reply.candidates, reply.reference_candidates):
        ordered = sorted(candidates, key=lambda one: -one.likelihood)
        likely = [one for one in ordered if one.likelihood >= AS_LIKELY * ordered[0].likelihood]
        if len(likely) < 2:
            continue
        by_id = {one.id: one for one in request.instances}
        found = [by_id[one.id] for one in likely]
        if ask:
            raise LanguageError(question(found, request))
        others = ", ".join(one.id for one in found[1:])
        taken = f"{found[0].label}: several may be meant; using {found[0].id} (also {others})"
        notes.append(Caution(Cause.WHICH, taken))
    return tuple(notes)


def doubted(reply: IntentReply, request: IntentRequest) -> Candidate | None:
    """The support, or else the reference, that is known by its shape alone and too unlikely to be meant; None if there
    is none. A support that the user pointed at is certain."""
    by_shape = {one.id for one in request.instances if one.guesses}
    for candidates in (() if request.given_base else reply.candidates, reply.reference_candidates):
        best = max(candidates, key=lambda one: one.likelihood, default=None)
        if best is not None and best.id in by_shape and best.likelihood < SURE_BY_SHAPE:
            return best
    return None


def question(found: Sequence[InstanceView], request: IntentRequest) -> str:
    """The question in one line."""
    listed = told_apart(found[:MOST], request.instances, request.room_center)
    rest = f", or one of {len(found) - MOST} more" if len(found) > MOST else ""
    named = f"{', '.join(listed[:-1])} or {listed[-1]}{rest}"
    return (
        f"which one does prompt {request.prompt!r} mean: {named}? Say it in the prompt (an id will do), or take the "
        "likeliest with --ambiguous best"
    )
