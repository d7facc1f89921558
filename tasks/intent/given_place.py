"""The object's place on the base: from the sentence, or the point that the user gave."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.language.protocol.replies import IntentReply, region_constraints
from dcap.scene.types.caution import Cause, Caution
from dcap.scene.types.intent import RegionRequest
from dcap.scene.types.pointed import Pointed


@dataclass(frozen=True, eq=False, slots=True)
class WantedPlace:
    """The region, or a point."""

    region: RegionRequest
    at: NDArray[np.float64] | None
    """[m], shape (3,)."""
    notes: tuple[str, ...]


def place_of(reply: IntentReply, pointed: Pointed | None) -> WantedPlace:
    """The sentence's region; a given point overrides it, with a note if the sentence has one."""
    limits = region_constraints(reply.constraints)
    said = RegionRequest(reply.part, reply.regions, reply.references, reply.region_words, reply.which, limits)
    if pointed is None or not len(pointed.point):
        return WantedPlace(said, None, () if pointed is None else pointed.notes)
    words = reply.region_words or reply.part
    told = reply.regions or reply.part or reply.constraints or reply.lean_on
    lost = (Caution(Cause.NOT_MET, f"--at decides where: {words!r} is not followed"),) if told else ()
    return WantedPlace(RegionRequest("", (), (), ""), pointed.point, (*pointed.notes, *lost))
