"""Replies for LayoutGPT and Holodeck by rules, from our own reader of sentences instead of a model.

The support, its part, the regions and the facing are those that the reader finds for our own method; the box stands on
the box of the part, at the requested place or the free one nearest to it.

Support and relations of a thing, by rules: a substitute for Holodeck's model, with our own reader of sentences.

The receptacle is the support that the reader finds, unless that is the floor. The place is expressed as far as the
vocabulary allows: at a wall or in the middle, near and far, the sides of another thing, and the facing.
"""

from collections.abc import Sequence

import numpy as np

from dcap.arrays import Array
from dcap.knowledge.lexicon import inside_parts, lineage
from dcap.language.offline.layout_spots import (
    PlanRectangle,
    free_spot,
    limited,
    overlap,
    rectangle_of,
    rectangles,
    referred,
    shell_rectangle,
    wanted_spot,
)
from dcap.language.offline.likelihood import label_thing
from dcap.language.offline.pose_choice import chosen_part, moved_into_which, one_of_a_whole, thing_id
from dcap.language.offline.where import is_any
from dcap.language.protocol.questions import CssBox, LayoutReply, LayoutRequest, RelationsReply, RelationsRequest
from dcap.language.protocol.replies import Constraint, IntentReply
from dcap.language.protocol.requests import AnchorRequest, InstanceView, PartView

TOUCHES = 0.02
"""Height above the support below which things are no obstacle [m]."""
WIDE = 1.2
"""Length above which a thing is faced at its nearest point instead of its middle [m]."""
COVER, WELL_COVERED = 0.1, 0.25
"""Largest height above the support [m] and least covered share [-] of a cover, on which things stand too."""
RIM = "rim"
"""Name of a ring-shaped part."""
VESSEL = 0.15
"""Assumed thickness of the bottom of a vessel over its height [-]: a box does not show it."""
SIDE_WORDS = {"left": "left of", "right": "right of", "front": "in front of", "back": "behind"}
AT_WALL = frozenset({"edge", "corner"})


def layout_answer(request: LayoutRequest, meant: IntentReply) -> LayoutReply:
    """The new line for the interpreted sentence; empty if the scene has no such support."""
    if not meant.base_id:
        return LayoutReply(layout="")
    base = next(one for one in request.instances if one.id == meant.base_id)
    size = np.array(request.asset_size)
    whole = rectangle_of(request, base.id)
    part, regions = part_and_regions(base, whole, meant, size)
    support = rectangle_of(request, base.id, part.index)
    spot, yaw = spot_and_yaw(request, base, support, meant, regions, size, on_rim=part.name == RIM)
    left, top = (spot - np.array(request.origin)[:2]) * request.pixels_per_metre
    level = level_of(request, base, part, support, spot, extents(0.5 * size[:2], yaw, support))
    depth = (level + 0.5 * size[2] - request.origin[2]) * request.pixels_per_metre
    length, width, height = request.asset
    angle = round(float(np.degrees(yaw)) + meant.turn_deg) % 360
    box = CssBox(request.category, length, width, height, round(left), round(top), round(depth), angle)
    return LayoutReply(layout=box.text)


def part_and_regions(
    base: InstanceView, whole: PlanRectangle, meant: IntentReply, size: Array
) -> tuple[PartView, tuple[str, ...]]:
    """The part of the base chosen by our own method's offline reader, and the remaining regions."""
    request = AnchorRequest(
        "", meant.region_words, meant.object_name, (float(size[0]), float(size[1])), base.label, base.parts,
        meant.part, meant.which, meant.regions, meant.references,
        (float(whole.right[0]), float(whole.right[1]), 0.0), (float(whole.front[0]), float(whole.front[1]), 0.0),
    )  # fmt: skip
    part, _ = chosen_part(request)
    regions: tuple[str, ...] = meant.regions
    if moved_into_which(request, part):
        regions = tuple(one for one in regions if one not in ("left", "right", "middle", "center"))
    if one_of_a_whole(request, part):
        regions = (meant.which, *regions)
    if part.name == RIM and not regions and not meant.references:  # a ring has nothing at its middle
        regions = ("edge",)
    return part, regions


def level_of(
    request: LayoutRequest, base: InstanceView, part: PartView, support: PlanRectangle, spot: Array, half: Array
) -> float:
    """Height on which the box stands [m]: the top of the part's box, or of a cover on it; in a vessel, the top of its
    bottom."""
    inside = {inside_parts().get(one, "") for one in lineage(thing_id(base.label))}
    if part.name in inside:
        return part.center[2] + (VESSEL - 0.5) * part.size[2]
    covers = [one.top for one in covers_of(request, support) if overlap(support, spot, half, [one]) > 0.0]
    return max([part.center[2] + 0.5 * part.size[2], *covers])


def spot_and_yaw(
    request: LayoutRequest,
    base: InstanceView,
    support: PlanRectangle,
    meant: IntentReply,
    regions: Sequence[str],
    size: Array,
    *,
    on_rim: bool,
) -> tuple[Array, float]:
    """Position of the box's middle, shape (2,), and its rotation [rad]."""
    references = [one for name in meant.references for one in referred(request, meant, name)]
    view = reference_view(request, base, meant.references)
    half = 0.5 * size[:2]
    limits = [(one, middle_of(request, meant, one.reference)) for one in meant.constraints]
    taken = in_the_way(request, meant, support, float(size[2]))
    if "under" in regions:
        taken = [one for one in taken if one.thing not in meant.references]
    spot, yaw = support.center, facing_yaw(request, base, support, support.center, meant)
    for _ in range(2):  # the faced thing depends on the place, and the room that the box takes on its rotation
        around = extents(half, yaw, support)
        if on_rim:  # the rim is narrow: the middle of the box goes over it, not its side
            around, taken = np.zeros(2), []
        spot = wanted_spot(support, regions, references, around, view, taken)
        spot = limited(support, spot, around, limits)
        spot = free_spot(support, spot, around, taken)
        yaw = facing_yaw(request, base, support, spot, meant)
    return spot, yaw


def extents(half: Array, yaw: float, frame: PlanRectangle) -> Array:
    """Half extents along a rectangle's right and front of a box turned by `yaw` [rad], shape (2,)."""
    own = np.array([[np.cos(yaw), np.sin(yaw)], [np.sin(yaw), -np.cos(yaw)]])
    axes = np.stack([frame.right, frame.front])
    return np.asarray(np.abs(axes @ own.T) @ half)


def reference_view(request: LayoutRequest, base: InstanceView, names: Sequence[str]) -> PlanRectangle | None:
    """The thing that defines left and front: on the floor a single referenced thing that has a line."""
    on_floor = base.structure or base.size[2] < 0.05
    if not on_floor or len(names) != 1:
        return None
    return next((one for one in rectangles(request) if one.thing == names[0] and one.part < 0), None)


def middle_of(request: LayoutRequest, meant: IntentReply, reference: str) -> Array | None:
    """The middle of the target of a constraint, shape (2,); None if it is the base."""
    found = referred(request, meant, reference) if reference else []
    return np.mean([one.center for one in found], axis=0) if found else None


def in_the_way(
    request: LayoutRequest, meant: IntentReply, support: PlanRectangle, height: float
) -> list[PlanRectangle]:
    """Obstacles for a box of that height on the support: other things, the base's other parts, and things excluded by
    the sentence."""
    lines = rectangles(request)
    owners = {one.thing for one in lines if one.part >= 0}
    solid = [one for one in lines if one.part >= 0 or one.thing not in owners]
    own = {(one.thing, one.part) for one in (support, *covers_of(request, support))}
    others = [one for one in solid if (one.thing, one.part) not in own]
    low, high = support.top, support.top + height
    found = [one for one in others if one.top > low + TOUCHES and one.bottom < high]
    excluded: list[Constraint] = [one for one in meant.constraints if one.kind == "not_on"]
    return found + [one for limit in excluded for one in referred(request, meant, limit.reference)]


def covers_of(request: LayoutRequest, support: PlanRectangle) -> list[PlanRectangle]:
    """Other parts of the base that lie on the support like a blanket: low, and covering a good part of it."""
    area = 4.0 * float(np.prod(support.half))
    return [
        one
        for one in rectangles(request)
        if one.thing == support.thing and one.part not in (-1, support.part)
        and one.bottom < support.top + TOUCHES and 0.0 < one.top - support.top < COVER
        and overlap(support, support.center, support.half, [one]) > WELL_COVERED * area
    ]  # fmt: skip


def facing_yaw(
    request: LayoutRequest, base: InstanceView, support: PlanRectangle, spot: Array, meant: IntentReply
) -> float:
    """The rotation with which the front faces its target, or that of the support [rad]."""
    way = faced(request, support, spot, meant, meant.facing.removeprefix("away:"))
    if way is None or np.linalg.norm(way) < 1e-6:
        way = support.front
    elif meant.facing.startswith("away:"):
        way = -way
    return float(np.arctan2(way[0], -way[1]))


def faced(request: LayoutRequest, support: PlanRectangle, spot: Array, meant: IntentReply, facing: str) -> Array | None:
    """Direction from the spot to the faced thing, shape (2,); None without a facing, or if the thing does not exist."""
    ways = {"viewer": support.front, "front": support.front, "back": -support.front}
    ways |= {"left": -support.right, "right": support.right, "room": np.array(request.room_center[:2]) - spot}
    if facing in ways:
        return ways[facing]
    ids = {one.id for one in request.instances}
    if facing in ("wall", "door", "window"):
        found = [shell_rectangle(one) for one in request.instances if facing in one.label]
    elif facing in ids or facing.startswith("part:"):
        found = referred(request, meant, facing)
    else:
        found = []
    points = [faced_point(one, spot) for one in found]
    if facing.startswith("part:") and points:
        return np.asarray(np.mean(points, axis=0) - spot)
    return min((point - spot for point in points), key=lambda way: float(np.linalg.norm(way)), default=None)


def faced_point(one: PlanRectangle, spot: Array) -> Array:
    """The middle of a small thing, the nearest point of a long one, shape (2,)."""
    if 2.0 * one.half.max() < WIDE:
        return one.center
    return one.world(np.clip(one.local(spot), -one.half, one.half))


def relations_answer(request: RelationsRequest, meant: IntentReply) -> RelationsReply:
    """Receptacle and line for the interpreted sentence; the floor if the scene has no such support."""
    names = {one.id: one.name for one in request.things}
    views = {one.id: one for one in request.instances}
    base = views.get(meant.base_id)
    on_floor = base is None or (base.structure and label_thing(base) == "floor")
    line = [request.object_name, "edge" if at_wall(meant, views) else "middle"]
    seen: set[str] = set()
    for reference in meant.references:
        if reference not in names or is_any(views[reference]):
            continue
        line += relations_to(names[reference], meant, again=bool(seen))
        seen.add(reference)
    for limit in meant.constraints:
        if limit.kind in ("farthest", "away") and limit.reference in names and limit.reference not in seen:
            line.append(f"far, {names[limit.reference]}")
        elif limit.kind == "nearest" and limit.reference in names and limit.reference not in seen:
            line.append(f"near, {names[limit.reference]}")
    if meant.facing in names:
        line.append(f"face to, {names[meant.facing]}")
    return RelationsReply(on_top_of="" if on_floor or base is None else names[base.id], constraints=" | ".join(line))


def at_wall(meant: IntentReply, views: dict[str, InstanceView]) -> bool:
    """Return whether the place is at a wall: near a wall, a window or a door, or at an edge of the floor."""
    near = [views[one] for one in meant.references if one in views]
    return any(one.structure and label_thing(one) == "wall" for one in near) or bool(AT_WALL & set(meant.regions))


def relations_to(name: str, meant: IntentReply, *, again: bool) -> list[str]:
    """Distance and position relative to one thing; relative to several things only the distance."""
    sides = [SIDE_WORDS[one] for one in meant.regions if one in SIDE_WORDS]
    found = [f"near, {name}"]
    if sides and not again:
        found.append(f"{sides[0]}, {name}")
    return found
