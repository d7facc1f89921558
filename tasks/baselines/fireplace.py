"""FirePlace* as a stage: constraint outlines, anchors, surfaces, solve, pruning and choice; a final pose out.

In: scene, object, and the shared part of the intent (name and scale of the object). Out: `Anchor` whose
`world_from_object` is the final pose, or `Infeasible` if the scene lacks a requested thing or no pose is free. The
steps are those of the package `dcap.evaluation.baselines.fireplace`, whose docstring separates the source's ideas from
ours; nothing is simulated, and nothing is corrected after the solve.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from pydantic import BaseModel, NonNegativeInt, PositiveInt

from dcap.evaluation.baselines.fireplace.anchors import ItemSurfaces, item_surfaces
from dcap.evaluation.baselines.fireplace.placement import (
    RestingItem,
    SolvedPlacement,
    SolveOutcome,
    SurfaceFrame,
    placements,
    resting,
    room_plan,
)
from dcap.evaluation.baselines.fireplace.problem import SupportArea
from dcap.evaluation.baselines.fireplace.solve import BATCH, MOST_OVERHANG, batches
from dcap.geometry.raycast import Raycaster
from dcap.language.connect import Client
from dcap.language.protocol.client import LanguageConfig
from dcap.language.protocol.fireplace import (
    OUTLINES,
    PRUNING,
    ChoiceOption,
    ConstraintOutline,
    OutlinesReply,
    OutlinesRequest,
    PruningRequest,
)
from dcap.language.protocol.requests import ObjectView, Picture, vector
from dcap.scene.types.choices import Anchor, Intent
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.outcome import Infeasible, NoRoom, NotInScene, Reason
from dcap.scene.types.segmentation import Segmentation, SegmentedObject, SegmentedScene
from tasks.baselines.fireplace_anchors import (
    AnchorResolver,
    Carrier,
    Chooser,
    Described,
    placement_picture,
    resting_picture,
)
from tasks.cache import stage
from tasks.requests.marks import marked, numbers_of, plan_picture, room_pictures
from tasks.requests.surroundings import part_frame
from tasks.requests.views import instance_views, object_view, room_center

UNSURE = 0.9
"""Confidence of a label below which the scene is also shown in pictures [-]."""
LOOKED_UNDER = 0.02
"""Distance below and above its contact surface in which the object's support is searched [m]."""
LETTERS = "ABCDEFGHIJKLMNOPQRSTUVWXYZ"


class FirePlaceConfig(BaseModel, frozen=True, extra="forbid"):
    """Language client, and number of candidate placements."""

    language: LanguageConfig = LanguageConfig()
    seed: NonNegativeInt = 0
    """Seed of the samples and of the order of options."""
    placements: PositiveInt = 16
    """Most diverse placements for pruning and choice [-]."""
    batch: PositiveInt = BATCH
    """Options that are compared at once, at least two [-]."""
    picture_size: PositiveInt = 320
    """Width and height of the options' pictures [pixels]."""


def fireplace(
    scene: SegmentedScene, item: SegmentedObject, intent: Intent, prompt: str, config: FirePlaceConfig, client: Client
) -> Anchor | Infeasible:
    """Outline, resolve, solve, prune, choose."""
    scaled = item.mesh.transformed(np.diag([intent.scale] * 3 + [1.0]))
    surfaces = item_surfaces(scaled, intent.object_name)
    request = outlines_request(scene, item, intent, prompt, surfaces)
    reply = client.ask(OUTLINES, request)
    if reply.missing:
        return not_there(reply, request)
    chooser = Chooser(client, prompt, np.random.default_rng(config.seed), max(config.batch, 2))
    resolver = AnchorResolver(scene, chooser, config.picture_size)
    carrying = next(one for one in reply.constraints if one.function == "contact")
    carrier = resolver.carrier(carrying)
    plane = SurfaceFrame.of(carrier.anchor.surface)
    others = [
        resolver.constraint(one, carrier, plane)
        for one in reply.constraints
        if one is not carrying and not is_implied(one, carrying)
    ]
    rested = resting_item(item.mesh, intent.scale, surfaces, carrying, chooser, config)
    found = placements(
        scene.mesh, carrier.anchor, rested, others, room_of(scene), seed=config.seed, most=config.placements
    )
    if not found.placements:
        return no_placement(carrier, rested, found, scene)
    best, about = chosen_placement(scene, item.mesh, intent, carrier, found, chooser, config)
    return anchored(scene, carrier, part_below(scene, carrier, rested, best), best, reply, about)


fireplace_task = stage(fireplace)


# outlines -----------------------------------------------------------------------------------------------------------


def outlines_request(
    scene: Segmentation, item: Segmentation, intent: Intent, prompt: str, surfaces: ItemSurfaces
) -> OutlinesRequest:
    """Information for a client to write the outlines: the candidates are those of the question for the support."""
    seen = object_view(item)
    x, y, z = (intent.scale * length for length in seen.size)
    fronts = (np.append(part_frame(scene, one, one.box).front, 0.0) for one in scene.instances)
    views, pictures = instance_views(scene), tuple[Picture, ...]()
    if any(one.confidence < UNSURE and not one.structure for one in scene.instances):
        numbers = numbers_of(scene)
        views = tuple(replace(view, number=numbers.get(index, 0)) for index, view in enumerate(views))
        pictures = (
            Picture("the room as a plan, from above; each thing has its number", lambda: plan_picture(marked(scene))),
            Picture("the room over a corner; each thing has its number", lambda: room_pictures(marked(scene), 1)[0]),
        )
    return OutlinesRequest(
        prompt=prompt,
        object_name=intent.object_name,
        item=ObjectView(seen.label, (x, y, z), seen.parts),
        instances=views,
        fronts=tuple(vector(front) for front in fronts),
        room_center=vector(room_center(scene)),
        object_surfaces=surfaces.poses,
        symmetry=surfaces.symmetry,
        has_front=surfaces.has_front,
        stands=surfaces.stands,
        righting=surfaces.righting,
        on_legs=surfaces.on_legs,
        pictures=pictures,
    )


def not_there(reply: OutlinesReply, request: OutlinesRequest) -> Infeasible:
    """The scene has no such thing."""
    present = tuple(sorted({one.label for one in request.instances}))
    meant = f" (did you mean the {reply.did_you_mean}?)" if reply.did_you_mean else ""
    missing = reply.missing.removeprefix("the ").removeprefix("a ")
    return Infeasible(
        Reason.TARGET_NOT_FOUND,
        f"the scene has no {missing}{meant}; it has: {', '.join(present)}",
        NotInScene(asked=reply.missing, present=present, object=request.object_name),
    )


def is_implied(one: ConstraintOutline, carrying: ConstraintOutline) -> bool:
    """Return whether an outline merely repeats, for the contact's own surface, a condition of every solve."""
    same = (one.anchors, one.anchor_parts, one.anchor_side) == (
        carrying.anchors, carrying.anchor_parts, carrying.anchor_side,
    )  # fmt: skip
    return same and one.function in ("no_overhang", "parallel") and one.object_surfaces[0] in ("bottom", "top")


# surfaces and room --------------------------------------------------------------------------------------------------


def resting_item(
    mesh: Mesh,
    scale: float,
    surfaces: ItemSurfaces,
    carrying: ConstraintOutline,
    chooser: Chooser,
    config: FirePlaceConfig,
) -> RestingItem:
    """The object on the surface chosen for the contact."""
    by_id = {one.id: one for one in surfaces.poses}
    meant = [by_id[name] for name in carrying.object_surfaces]
    items = [resting(mesh, scale, np.array(one.rotation), surfaces.sides, surfaces.up) for one in meant]
    options = [
        Described(
            one.id,
            (("likelihood", 1.0 / (1.0 + rank)), ("stable", one.probability), ("area_m2", posed.contact.area)),
            partial(resting_picture, posed.mesh, config.picture_size),
        )
        for rank, (one, posed) in enumerate(zip(meant, items, strict=True))
    ]
    return items[chooser.choose("object_surface", carrying.words or "the surface on which it rests", options)]


def room_of(scene: Segmentation) -> SupportArea | None:
    """The plan of the room; None without a labelled floor."""
    floors = [k for k, one in enumerate(scene.instances) if one.structure and "floor" in one.label]
    if not floors:
        return None
    things = [one.box for one in scene.instances if not one.structure]
    return room_plan(Mesh.concatenate([scene.instance_mesh(k) for k in floors]), things)


def part_below(scene: Segmentation, carrier: Carrier, item: RestingItem, best: SolvedPlacement) -> int:
    """The part of the base that the object touches or lies over; if no part is near, the part of the anchor's
    surface."""
    resting_to_world = best.world_from_object @ np.linalg.inv(item.matrix)
    points = item.contact.points @ resting_to_world[:3, :3].T + resting_to_world[:3, 3]
    normal = carrier.anchor.surface.normal
    hits = Raycaster(scene.mesh).cast(points + LOOKED_UNDER * normal, np.tile(-normal, (len(points), 1)))
    face = hits.face[(hits.face >= 0) & (hits.distance < 2.0 * LOOKED_UNDER)]
    own = scene.face_part[face[scene.face_instance[face] == scene.index_of(carrier.base.id)]]
    return int(np.bincount(own[own >= 0]).argmax()) if (own >= 0).any() else carrier.anchor.part


def no_placement(carrier: Carrier, item: RestingItem, found: SolveOutcome, scene: Segmentation) -> Infeasible:
    """The refusal of an empty set of feasible placements, with its reason."""
    base, part = carrier.base, carrier.base.parts[carrier.anchor.part]
    size = np.ptp(item.mesh.bounds, axis=0)
    large = found.proposed == 0 and found.least_overhang >= MOST_OVERHANG
    share = 1.0 - found.least_overhang
    reason = Reason.TOO_LARGE_FOR_TARGET if large else Reason.NO_SUPPORT_HIT
    why = (
        f"at best {100 * share:.0f} % of it would be over the {part.name}"
        if large
        else f"no pose on the {part.name} is free of collisions"
    )
    half = carrier.rim.half
    evidence = NoRoom(
        base=base.id,
        part=part.name,
        region="",
        footprint_m=(float(size[0]), float(size[1])),
        height_m=float(size[2]),
        part_size_m=(2.0 * float(half[0]), 2.0 * float(half[1])),
        best_supported_share=share,
        needed_share=1.0 - MOST_OVERHANG,
        blocked_share=0.0 if large else 1.0,
        in_the_way=(),
    )
    footprint = f"{size[0]:.2f} x {size[1]:.2f} m"
    return Infeasible(reason, f"no feasible placement of {footprint} on the {base.label}: {why}", evidence)


# pruning and choice -------------------------------------------------------------------------------------------------


def chosen_placement(
    scene: Segmentation,
    mesh: Mesh,
    intent: Intent,
    carrier: Carrier,
    found: SolveOutcome,
    chooser: Chooser,
    config: FirePlaceConfig,
) -> tuple[SolvedPlacement, str]:
    """The preferred placement among those that survive pruning, and the number of placements."""
    options = [
        Described(
            f"placement {k}",
            (
                ("loss", one.loss),
                ("overhang", one.overhang),
                ("margin_m", one.margin),
                ("from_middle_m", one.from_middle),
                ("gap_m", one.gap),
            ),
            partial(
                placement_picture, scene, mesh.transformed(one.world_from_object), carrier.frame, config.picture_size
            ),
        )
        for k, one in enumerate(found.placements)
    ]
    left = plausible(options, intent.object_name, chooser)
    sought = f"the most natural placement of the {intent.object_name}"
    number = left[chooser.choose("placement", sought, [options[k] for k in left])]
    about = f"{found.proposed} feasible poses, {len(options)} measured as free, {len(left)} plausible"
    return found.placements[number], about


def plausible(options: Sequence[Described], object_name: str, chooser: Chooser) -> list[int]:
    """The placements that remain after pruning in batches; all of them if none would remain."""
    if len(options) < 2:
        return list(range(len(options)))
    order = [int(k) for k in chooser.rng.permutation(len(options))]
    groups = batches(order, chooser.batch)
    requests = [
        PruningRequest(
            chooser.prompt,
            object_name,
            tuple(ChoiceOption(LETTERS[i], options[k].label, options[k].facts) for i, k in enumerate(group)),
            tuple(Picture(f"option {LETTERS[i]}", options[k].picture) for i, k in enumerate(group)),
        )
        for group in groups
    ]
    replies = chooser.client.ask_all(PRUNING, requests)
    out = {
        group[LETTERS.index(letter)]
        for group, reply in zip(groups, replies, strict=True)
        for letter in reply.implausible
    }
    return [k for k in range(len(options)) if k not in out] or list(range(len(options)))


def anchored(
    scene: Segmentation, carrier: Carrier, index: int, best: SolvedPlacement, reply: OutlinesReply, about: str
) -> Anchor:  # fmt: skip
    """The result in the form that all methods share."""
    base, surface = carrier.base, carrier.anchor.surface
    part = base.parts[index]
    own = [one for one in reply.constraints if one.anchor_side in ("left", "right", "front", "back")
           and one.function == "close_to" and base.id in one.anchors]  # fmt: skip
    spot = best.world_from_object[:3, 3]
    terms = ", ".join(f"{name} {value:.3f}" for name, value in best.terms)
    return Anchor(
        base_id=base.id,
        part=part.name,
        part_index=index,
        region=" ".join(dict.fromkeys(one.anchor_side for one in own)) or "center",
        local=part_frame(scene, base, part.box).local(spot[:2]),
        surface_point=spot - float((spot - surface.center) @ surface.normal) * surface.normal,
        world_from_object=best.world_from_object,
        clearance=max(best.gap, 0.0),
        region_polygon=surface.outline[:, :2],
        reason=f"{reply.reason}; {carrier.anchor.kind} surface; {about}; loss {best.loss:.4f}: {terms}",
    )
