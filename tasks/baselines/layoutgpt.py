"""LayoutGPT as a stage: one question, one new line of the room's layout, and its pose.

In: scene, object, the intent's scale and name of the object (nothing else of it), prompt, plans of other rooms. Out:
an `Anchor` whose pose is final, or `no_support_hit` if the answer is not one new line. See
`dcap/evaluation/baselines/layoutgpt`.
"""

from dataclasses import replace

from pydantic import BaseModel, NonNegativeInt, PositiveInt

from dcap.evaluation.baselines.asset import canonical_asset
from dcap.evaluation.baselines.floor_plan import floor_plan_of
from dcap.evaluation.baselines.layoutgpt.placement import layout_request, new_line, proposed_pose
from dcap.evaluation.baselines.proposal import proposed_anchor
from dcap.language.connect import Client
from dcap.language.protocol.client import LanguageConfig
from dcap.language.protocol.questions import LAYOUTGPT
from dcap.language.protocol.requests import IntentRequest, vector
from dcap.scene.types.anchor import Anchor
from dcap.scene.types.caution import Cause, Caution
from dcap.scene.types.floor_plan import FloorPlans
from dcap.scene.types.intent import Intent
from dcap.scene.types.outcome import Infeasible
from dcap.scene.types.segmentation import SegmentedObject, SegmentedScene
from tasks.cache import stage
from tasks.requests.views import instance_views, object_view, room_center


class LayoutGptConfig(BaseModel, frozen=True, extra="forbid"):
    """Language client, and size of the question; the source's numbers."""

    language: LanguageConfig = LanguageConfig()
    exemplars: NonNegativeInt = 8
    """Most rooms shown as examples."""
    token_limit: PositiveInt = 7000
    """Approximate limit of tokens in sentence, categories, layout and examples together; the system text, which the
    source counts too, and the list of instances, which it does not have, are not counted."""


def layoutgpt(
    scene: SegmentedScene,
    item: SegmentedObject,
    intent: Intent,
    prompt: str,
    config: LayoutGptConfig,
    client: Client,
    exemplars: FloorPlans | None = None,
    left_out: tuple[str, ...] = (),
) -> Anchor | Infeasible:
    """Ask for one line and use it unchanged; `left_out` names rooms that would be examples but cannot be read."""
    plan = floor_plan_of(scene)
    asset = canonical_asset(item.mesh, intent.scale, intent.object_name)
    asked = IntentRequest(prompt, object_view(item), instance_views(scene), vector(room_center(scene)))
    request = layout_request(
        asked, plan, exemplars, asset, intent.object_name, most=config.exemplars, limit=config.token_limit
    )
    box = new_line(client.ask(LAYOUTGPT, request).layout, request.lines)
    if isinstance(box, Infeasible):
        return box
    reason = f"LayoutGPT with {len(request.exemplars)} exemplars wrote: {box.text}"
    found = proposed_anchor(scene, item.mesh, proposed_pose(box, plan, asset), "as the layout says", reason)
    unread = (Caution(Cause.ASSUMED, f"{name} is no example: it cannot be read") for name in left_out)
    return replace(found, notes=tuple(unread))


layoutgpt_task = stage(layoutgpt)
