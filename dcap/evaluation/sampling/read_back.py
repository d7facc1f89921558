"""Compares the embedded reader's reading of sentences with their truth: support, part, region, pose and facing.

It measures both. No sample is left out because the reader misses it: a benchmark cut to its reader would flatter it.
"""

from dcap.evaluation.outcome_table import ExpectedOutcome, same_region
from dcap.language.offline.client import OfflineClient
from dcap.language.protocol.questions import INTENT
from dcap.language.protocol.requests import IntentRequest
from dcap.scene.errors import LanguageError

POSES_OF_TOP = {
    "up": ("upright", "seated", "standing"),
    "down": ("upside_down",),
    "sideways": ("on_side", "on_left_side", "on_right_side", "lying"),
}


def misread(request: IntentRequest, truth: ExpectedOutcome, faced: str = "") -> str:
    """The reader's deviations in words; empty if it agrees. `faced` is the id of the thing that the object should face
    according to the sentence."""
    try:
        reply = OfflineClient().ask(INTENT, request)
    except LanguageError as refused:
        return f"refused: {' '.join(str(refused).split())}"
    if truth.reason == "target_not_found":
        return f"found {reply.base_id}" if reply.base_id else ""
    base = next((one for one in request.instances if one.id == reply.base_id), None)
    if base is None:
        return f"not found: {reply.missing}"
    if base.label != truth.base or truth.base_id not in ("", base.id):
        return f"base {base.label} {base.id}"
    if reply.part and truth.part and reply.part != truth.part:
        return f"part {reply.part}"
    if truth.region and not same_region(" ".join(reply.regions), truth.region):
        return f"region {' '.join(reply.regions) or 'none'}"
    if not truth.region and (reply.regions or reply.constraints):
        return f"region {' '.join(reply.regions)} where none is requested"
    if truth.top and reply.pose not in POSES_OF_TOP[truth.top]:
        return f"pose {reply.pose}"
    if reply.facing != faced:
        return f"facing {reply.facing or 'nothing'}"
    return f"not understood: {', '.join(reply.not_understood)}" if reply.not_understood else ""
