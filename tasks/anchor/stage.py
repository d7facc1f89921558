"""Stage 5, anchor: the part and the place on it, from which gravity does the rest.

In: scene, object, intent and rotation. Out: `Anchor` with the pre-drop pose, or `no_support_hit`, or
`too_large_for_target`. The region's aim is tried first, then the spots around it: a ray along gravity must hit the
part, the object's underside must be over it, and nothing else may be in the way. Faces need not look up. The object's
centre of mass goes over the anchor, and its lowest points start `clearance` above what lies beneath them, measured
between the meshes, which cut through each other nowhere.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, PositiveFloat

from dcap.geometry.placement.clearance import Clearance
from dcap.geometry.placement.named_regions import Region, ViewerFrame, both, distance_beside, regions
from dcap.geometry.placement.poses import center_of_mass
from dcap.geometry.placement.search import SHARES, PlacementSearch
from dcap.geometry.placement.set_down import Start, set_down
from dcap.geometry.raycast import Raycaster
from dcap.language.connect import Client
from dcap.language.protocol.client import LanguageConfig
from dcap.language.protocol.questions import ANCHOR
from dcap.language.protocol.replies import AnchorReply
from dcap.scene.types.anchor import Anchor
from dcap.scene.types.box import OrientedBox
from dcap.scene.types.intent import Intent
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.outcome import Infeasible
from dcap.scene.types.rotation import Rotation
from dcap.scene.types.segmentation import Instance, Segmentation, SegmentedObject, SegmentedScene
from tasks.anchor.carriers import COVERS, carriers, owner
from tasks.anchor.given_point import area_at, beside_the_point, carrying_at, reply_at
from tasks.anchor.no_room import no_room, not_on_it
from tasks.anchor.request import anchor_request
from tasks.requests.surroundings import apart, part_frame, reference_boxes, reference_frame
from tasks.requests.views import instance_of
from tasks.runner.stage import stage

Array = NDArray[np.float64]
NEIGHBOUR = 1.5
"""A base within this distance of a thing stands beside it [m]: then "the chair next to the desk" says which chair."""


class AnchorConfig(BaseModel, frozen=True, extra="forbid"):
    """Who is asked, and where the drop starts."""

    language: LanguageConfig = LanguageConfig()
    clearance: PositiveFloat = 0.01
    """Smallest vertical gap at the start [m]; the paper's 1 cm."""


@dataclass(frozen=True, eq=False, slots=True)
class Choice:
    """A part with its frame and the areas to try."""

    index: int
    frame: ViewerFrame
    areas: list[Region]
    region: str
    """Region words that the areas mean; empty for the whole part."""
    note: str = ""
    """How the region was understood."""
    beside: float | None = None
    """How far from the part the asked place lies [m]; None where it is on it."""


def anchor(
    scene: SegmentedScene,
    item: SegmentedObject,
    intent: Intent,
    rotation: Rotation,
    prompt: str,
    config: AnchorConfig,
    client: Client,
) -> Anchor | Infeasible:
    """Choose part and region, find a free spot, set the object over it."""
    base = instance_of(scene, intent.base_id)
    pose = np.eye(4)
    pose[:3, :3] = intent.scale * rotation.matrix
    mesh = item.mesh.transformed(pose)
    pose[:3, 3] = -center_of_mass(mesh)
    mesh = item.mesh.transformed(pose)
    caster = Raycaster(scene.mesh)
    if intent.at is None:
        reply = client.ask(ANCHOR, anchor_request(scene, base, intent, prompt, mesh))
        choice = choice_of(scene, base, intent, reply, mesh)
        if choice.beside is not None:
            return not_on_it(base, choice.index, intent, choice.beside)
        masks = carriers(scene, base, choice.index, named=asked(base, choice.index, intent), caster=caster)
    else:
        reply = reply_at(scene, base, intent.at, caster)
        frame = part_frame(scene, base, base.parts[reply.part_index].box)
        choice = Choice(reply.part_index, frame, [area_at(intent.at, mesh)], "at the point")
        masks = [carrying_at(scene, base, intent.at)]
    exact = Clearance(mesh, scene.mesh, caster)
    search = None
    for mask in masks:
        search = PlacementSearch(scene.mesh, caster, mask, mesh)
        start = set_down(search, exact, choice.areas, config.clearance)
        if start is not None:
            found = anchored(scene, base, choice, start, pose, search, reply)
            spot = np.array([start.spot.x, start.spot.y])
            return replace(found, reason=found.reason + beside_the_point(intent.at, spot))
    assert search is not None  # there is always a mask to try
    return no_room(scene, base, choice.index, choice.frame, search, choice.areas, intent, mesh)


anchor_task = stage(anchor)


# choosing -----------------------------------------------------------------------------------------------------------


def asked(base: Instance, index: int, intent: Intent) -> bool:
    """Whether the prompt names this part."""
    return base.parts[index].name == intent.region.part


def choice_of(scene: Segmentation, base: Instance, intent: Intent, reply: AnchorReply, mesh: Mesh) -> Choice:
    """The areas that the reply means on the part; words for a place on a bed mean its mattress, whatever covers it.

    A point is one of the part that was chosen, and stays on it.
    """
    index = reply.part_index
    if base.parts[index].name in COVERS and reply.point is None and not asked(base, index, intent):
        index = next((number for number, part in enumerate(base.parts) if part.name == "mattress"), index)
    frame = part_frame(scene, base, base.parts[index].box)
    names: tuple[str, ...] = reply.regions
    note = ""
    groups = groups_of(scene, base, reply, index)
    view, reach = reference_frame(scene, base, reply.references) or frame, reach_of(mesh, frame)
    areas = [area for group in groups for area in regions(frame, names, group, reach, view)]
    if len(reply.references) > 1 and "between" not in names:
        areas[:0] = both(areas)  # "next to the lamp and the book": where the two meet, if they do
    if not areas and all(apart(base.box, box) < NEIGHBOUR for group in groups for box in group):
        names, note = (), f"; {intent.region.words!r} is taken to say which {base.label} is meant"
        areas = regions(frame, (), [], reach)
    if not areas:
        away = min(distance_beside(frame, names, group, reach, view) for group in groups)
        return Choice(index, frame, [], " ".join(names), beside=away)
    if reply.point is not None:
        areas = [replace(area, target=frame.world(np.array(reply.point))) for area in areas]
    if not names and not note and sum(part.name == base.parts[index].name for part in base.parts) > 1:
        names = intent.region.names  # "on the left": it picked one of the cushions side by side
    return Choice(index, frame, areas, " ".join(names), note)


def groups_of(scene: Segmentation, base: Instance, reply: AnchorReply, index: int) -> list[list[OrientedBox]]:
    """Boxes of what the regions refer to, those that make an area together in a group, the nearest to the part first.

    "Near the pillow" with two pillows is near one of them; "between" takes all together.
    """
    boxes = reference_boxes(scene, base, reply.references, base.parts[index].box.center)
    return [[box] for box in boxes] if boxes and "between" not in reply.regions else [boxes]


def reach_of(mesh: Mesh, frame: ViewerFrame) -> Array:
    """Half extents along a frame's right and front [m], shape (2,)."""
    return np.asarray(0.5 * np.ptp(mesh.vertices[:, :2] @ np.stack([frame.right, frame.front], axis=1), axis=0))


# setting ------------------------------------------------------------------------------------------------------------


def anchored(
    scene: Segmentation,
    base: Instance,
    choice: Choice,
    start: Start,
    pose: Array,
    search: PlacementSearch,
    reply: AnchorReply,
) -> Anchor:
    """The pre-drop pose over the spot."""
    spot = np.array([start.spot.x, start.spot.y])
    hit = search.caster.cast(np.array([[*spot, search.top]]), np.array([[0.0, 0.0, -1.0]]))
    carrier, index = owner(scene, int(hit.face[0]))
    part = carrier.parts[index]
    world_from_object = pose.copy()
    world_from_object[:3, 3] += (*spot, start.height)
    return Anchor(
        base_id=carrier.id,
        part=part.name,
        part_index=index,
        region=start.region.name or choice.region or "center",
        local=part_frame(scene, carrier, part.box).local(spot),
        surface_point=hit.position[0],
        world_from_object=world_from_object,
        clearance=start.gap,
        region_polygon=start.region.polygon,
        reason=f"{reply.reason}{choice.note}{covered(base, choice, carrier, index)}{support_note(start, part.name)}",
    )


def covered(base: Instance, choice: Choice, carrier: Instance, index: int) -> str:
    """That something else than the part meant carries the object."""
    meant = base.parts[choice.index].name
    if carrier.id != base.id:
        return f"; there the {carrier.label} lies on the {meant}"
    return "" if index == choice.index else f"; there the {carrier.parts[index].name} lies on the {meant}"


def support_note(start: Start, part: str) -> str:
    """That not all of the underside is over the support."""
    share = start.spot.share
    return "" if share >= SHARES[0] else f"; {100 * share:.0f} % of its underside is over the {part}"
