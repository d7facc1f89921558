"""Support and relations of a thing, by rules: the reply that Holodeck asks of a model, from the same reader of
sentences.

The receptacle is the support that the reader finds; the floor is none. Of the place the vocabulary says what it can:
at a wall or in the middle, near and far, the sides of another thing, and what is faced.
"""

from dcap.language.offline.grounded import is_any
from dcap.language.offline.likelihood import label_thing
from dcap.language.protocol.baseline_questions import RelationsReply, RelationsRequest
from dcap.language.protocol.replies import IntentReply
from dcap.language.protocol.requests import InstanceView

SIDE_WORDS = {"left": "left of", "right": "right of", "front": "in front of", "back": "behind"}
AT_WALL = frozenset({"edge", "corner"})


def relations_answer(request: RelationsRequest, meant: IntentReply) -> RelationsReply:
    """Receptacle and line for what was understood; the floor where the scene has no such support."""
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
    """Whether the place is at a wall: a wall, a window or a door is near, or an edge of the floor is asked for."""
    near = [views[one] for one in meant.references if one in views]
    return any(one.structure and label_thing(one) == "wall" for one in near) or bool(AT_WALL & set(meant.regions))


def relations_to(name: str, meant: IntentReply, *, again: bool) -> list[str]:
    """Distance and position relative to one thing; of several only how near."""
    sides = [SIDE_WORDS[one] for one in meant.regions if one in SIDE_WORDS]
    found = [f"near, {name}"]
    if sides and not again:
        found.append(f"{sides[0]}, {name}")
    return found
