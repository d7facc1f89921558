"""The questions of the baselines about a mug and the small bedroom."""

from box_rooms import ROOM, mug, thing

from dcap.evaluation.baselines.floor_plan import canonical_asset, floor_plan_of
from dcap.evaluation.baselines.layoutgpt import layout_request
from dcap.language.protocol.questions import LayoutRequest, RelationsRequest, names_of
from dcap.language.protocol.requests import IntentRequest, vector
from tasks.requests.views import instance_views, object_view, room_center

PROMPT = "put the mug at the center of the bed"


def asked_layout(prompt: str = PROMPT) -> LayoutRequest:
    """LayoutGPT's question without examples."""
    asset = canonical_asset(mug(), 1.0, "mug")
    asked = IntentRequest(prompt, object_view(thing("mug", mug())), instance_views(ROOM), vector(room_center(ROOM)))
    return layout_request(asked, floor_plan_of(ROOM), None, asset, "mug", most=8, limit=7000)


def asked_relations(prompt: str = PROMPT) -> RelationsRequest:
    """Holodeck's question."""
    views = instance_views(ROOM)
    return RelationsRequest(
        prompt, object_view(thing("mug", mug())), views, vector(room_center(ROOM)), "bedroom", (600, 600), "mug-0",
        (11, 8, 10), names_of(views),
    )  # fmt: skip
