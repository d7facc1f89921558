"""LayoutGPT and Holodeck as stages: both place a box in the floor plan of the scene, after one question.

In: scene, object, the object's scale and name (nothing else of the intent), prompt; for LayoutGPT plans of other rooms.
Out: an `Anchor` whose pose is final. LayoutGPT: `no_support_hit` if the answer is not one new line of the layout.
Holodeck: `too_large_for_target` if the object is not smaller than 90 % of the receptacle, `no_support_hit` if all
attempts fail, the place collides, the floor has no place, or the answer has no line for the object. See
`dcap/evaluation/baselines`.
"""

from dataclasses import replace

import numpy as np
from pydantic import BaseModel, NonNegativeInt, PositiveInt

from dcap.evaluation.baselines.floor_plan import CanonicalAsset, canonical_asset, floor_plan_of, proposed_anchor
from dcap.evaluation.baselines.holodeck.floor_search import CENTIMETRES, floor_place, floor_pose
from dcap.evaluation.baselines.holodeck.receptacle import collides, fits_on, is_small, is_thin, receptacle_place
from dcap.evaluation.baselines.holodeck.scores import parsed_relations
from dcap.evaluation.baselines.layoutgpt import layout_request, new_line, proposed_pose
from dcap.evaluation.metrics.touching import columns
from dcap.geometry.raycast import Raycaster
from dcap.language.connect import Client
from dcap.language.protocol.client import LanguageConfig
from dcap.language.protocol.questions import HOLODECK, LAYOUTGPT, RelationsRequest, names_of
from dcap.language.protocol.requests import IntentRequest, vector
from dcap.scene.types.choices import Anchor, Intent
from dcap.scene.types.floor_plan import FloorPlan, FloorPlans
from dcap.scene.types.outcome import Cause, Caution, Infeasible, Reason
from dcap.scene.types.segmentation import SegmentedObject, SegmentedScene
from tasks.cache import stage
from tasks.requests.views import instance_views, object_view, room_center

SHOWN = 120
"""Maximum number of characters of a bad answer that a message quotes."""


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
    """Ask for one line and use it unchanged; `left_out` names example rooms that cannot be read."""
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
    unread = (Caution(Cause.ASSUMED, f"{name} is not used as an example: it cannot be read") for name in left_out)
    return replace(found, notes=tuple(unread))


layoutgpt_task = stage(layoutgpt)


class HolodeckConfig(BaseModel, frozen=True, extra="forbid"):
    """Language client, and limits of the search; the source's numbers except for the last two."""

    language: LanguageConfig = LanguageConfig()
    attempts: PositiveInt = 10
    """Places that are tried on a receptacle."""
    roots: PositiveInt = 30
    """Places that are tried for the first thing of an empty room."""
    steps: PositiveInt = 1000
    """Objects for which the floor is searched, in place of the source's 30 s."""
    seed: NonNegativeInt = 0
    """Seed of random draws."""


def holodeck(
    scene: SegmentedScene, item: SegmentedObject, intent: Intent, prompt: str, config: HolodeckConfig, client: Client
) -> Anchor | Infeasible:
    """Ask once, then search the floor or try the receptacle."""
    plan, views = floor_plan_of(scene), instance_views(scene)
    asset = canonical_asset(item.mesh, intent.scale, intent.object_name)
    things = names_of(views)
    object_name = f"{intent.object_name.lower()}-0"
    while object_name in {one.name for one in things}:
        object_name += "-new"
    length, width, height = (int(CENTIMETRES * float(value)) for value in asset.size)
    request = RelationsRequest(
        prompt=prompt,
        item=object_view(item),
        instances=views,
        room_center=vector(room_center(scene)),
        room_type=plan.kind,
        room_size_cm=(int(CENTIMETRES * plan.extents[0]), int(CENTIMETRES * plan.extents[1])),
        object_name=object_name,
        object_size_cm=(length, width, height),
        things=things,
    )
    reply = client.ask(HOLODECK, request)
    if reply.on_top_of:
        receptacle = next(one.id for one in things if one.name == reply.on_top_of)
        return on_receptacle(scene, item, receptacle, plan, asset, config)
    return on_floor(scene, item, plan, asset, request, reply.constraints, config)


holodeck_task = stage(holodeck)


def on_receptacle(
    scene: SegmentedScene,
    item: SegmentedObject,
    receptacle: str,
    plan: FloorPlan,
    asset: CanonicalAsset,
    config: HolodeckConfig,
) -> Anchor | Infeasible:
    """A random free place on a thing; objects that the source settles by physics are lowered onto the surface
    beneath."""
    index = scene.index_of(receptacle)
    one = scene.instances[index]
    extents = 2.0 * one.box.half_extents[:2]
    if not fits_on(asset, extents):
        return Infeasible(
            Reason.TOO_LARGE_FOR_TARGET,
            f"the object is {asset.size[0]:.2f} x {asset.size[1]:.2f} m, not less than 90 % of the {one.label}'s "
            f"{extents[0]:.2f} x {extents[1]:.2f} m",
            None,
        )
    attempts = config.attempts
    place = receptacle_place(scene, index, asset, np.random.default_rng(config.seed), attempts)
    if place is None:
        return Infeasible(Reason.NO_SUPPORT_HIT, f"{attempts} attempts found no free place on the {one.label}", None)
    pose = asset.pose(place.center, place.yaw, place.tilt)
    thing = item.mesh.transformed(pose)
    if is_small(asset.size) or is_thin(asset.size):
        pose[2, 3] -= float(columns(thing, Raycaster(scene.mesh), sunk=False).gap.min())
    elif met := collides(plan, receptacle, *thing.bounds):
        return Infeasible(Reason.NO_SUPPORT_HIT, f"dropped: on the {one.label} its box meets that of the {met}", None)
    turned = f"{np.degrees(place.yaw):.0f} degrees"
    reason = f"Holodeck: on top of the {one.label}, attempt {place.attempt} of {attempts}, turned by {turned}"
    return proposed_anchor(scene, item.mesh, pose, "anywhere", reason)


def on_floor(
    scene: SegmentedScene,
    item: SegmentedObject,
    plan: FloorPlan,
    asset: CanonicalAsset,
    request: RelationsRequest,
    constraints: str,
    config: HolodeckConfig,
) -> Anchor | Infeasible:
    """The best-scoring place on the floor."""
    names, name = {one.id: one.name for one in request.things}, request.object_name
    relations = parsed_relations(constraints, name, [names[box.thing] for box in plan.things])
    if relations is None:
        said = " ".join(constraints.split())[:SHOWN]
        return Infeasible(Reason.NO_SUPPORT_HIT, f"the answer has no line for {name}: {said!r}", None)
    rng = np.random.default_rng(config.seed)
    place = floor_place(plan, names, asset, name, relations, rng, roots=config.roots, steps=config.steps)
    said = " | ".join(", ".join(filter(None, (one.name, one.target))) for one in relations) or "edge by default"
    if place is None:
        return Infeasible(Reason.NO_SUPPORT_HIT, f"the floor has no place for the object ({said})", None)
    reason = f"Holodeck: on the floor, {said}; score {place.score:.2f}, turned by {place.turn} degrees"
    return proposed_anchor(scene, item.mesh, floor_pose(place, plan, asset), "as related", reason)


def floor_plan(scene: SegmentedScene) -> FloorPlan:
    """Outline and boxes of a scene."""
    return floor_plan_of(scene)


def gathered(plan: FloorPlan, before: FloorPlans | None = None) -> FloorPlans:
    """The plans collected before, with one more added."""
    return FloorPlans((*(before.plans if before else ()), plan))


floor_plan_task = stage(floor_plan)
gathered_task = stage(gathered)
