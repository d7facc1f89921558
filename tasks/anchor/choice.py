"""The part and the areas on it that a reply selects, under the intent's constraints.

In: scene, base, intent, the reply and the object as it will lie. Out: a `Choice`: areas to try, and spare ones for
the case that those have no place.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.placement.named_regions import OFF, SIDES, Region, ViewerFrame, both, distance_beside, regions
from dcap.geometry.placement.polygons import convex_hull
from dcap.geometry.raycast import Raycaster
from dcap.language.protocol.replies import AnchorReply, region_constraints
from dcap.scene.types.box import OrientedBox
from dcap.scene.types.caution import Cause, Caution
from dcap.scene.types.intent import Intent, RegionConstraint
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.segmentation import Instance, Segmentation
from tasks.anchor.carriers import COVERS, Mask, carriers
from tasks.anchor.constraints import EDGE, Bounds, constrained
from tasks.anchor.viewpoint import side_cautions
from tasks.requests.surroundings import horizontal_gap, is_floor, part_frame, reference_boxes, reference_frame

Array = NDArray[np.float64]
HAND = 0.6
"""Largest distance of a place next to a thing on the floor [m], a hand's reach."""
NEIGHBOUR = 1.5
"""Largest distance between a base and a thing next to it [m]: then "the chair next to the desk" identifies the
chair."""


@dataclass(frozen=True, eq=False, slots=True)
class Choice:
    """A part with its frame and the areas to try."""

    index: int
    frame: ViewerFrame
    areas: list[Region]
    spare: list[Region]
    """Areas to try if those have no place."""
    region: str
    """Region words of the areas; empty for the whole part."""
    note: str = ""
    """How the region was understood."""
    spare_note: str = ""
    """How it was understood in the spare areas."""
    distance: float | None = None
    """Distance of the requested place from the part [m]; None if it is on it."""
    cautions: tuple[Caution, ...] = ()
    """Warnings on sides whose point of view is ambiguous."""
    in_turn: bool = False
    """Whether an area is only tried if those before it have no place: the corner that is farthest from something."""

    def tries(self) -> list[tuple[list[Region], str]]:
        """Areas to try together, best first, with how the region is understood in them."""
        both = ((self.areas, self.note), (self.spare, self.spare_note))
        return [
            (part, note) for areas, note in both for part in ([[one] for one in areas] if self.in_turn else [areas])
        ]


def carrier_masks(
    scene: Segmentation, base: Instance, choice: Choice, intent: Intent, caster: Raycaster
) -> list[Mask]:  # fmt: skip
    """Faces that may carry, best first."""
    return carriers(scene, base, choice.index, named=names_part(base, choice.index, intent), caster=caster)


def names_part(base: Instance, index: int, intent: Intent) -> bool:
    """Whether the prompt names this part."""
    return base.parts[index].name == intent.region.part


def choice_of(scene: Segmentation, base: Instance, intent: Intent, reply: AnchorReply, mesh: Mesh) -> Choice:
    """The areas that the reply selects on the part; words for a place on a bed refer to its mattress, whatever covers
    it.

    A point belongs to the chosen part, and stays on it.
    """
    index = reply.part_index
    if base.parts[index].name in COVERS and reply.point is None and not names_part(base, index, intent):
        index = next((number for number, part in enumerate(base.parts) if part.name == "mattress"), index)
    frame = part_frame(scene, base, base.parts[index].box)
    names: tuple[str, ...] = reply.regions
    note = ""
    groups = groups_of(scene, base, reply, index)
    other = reference_frame(scene, base, reply.references, names)
    view, reach = other or frame, reach_of(mesh, frame)
    outline = convex_hull(mesh.vertices[np.unique(mesh.faces)][:, :2])
    outside = any(horizontal_gap(base.box, box) > 0.0 for group in groups for box in group) and not is_floor(base)
    sided = any(name in SIDES for name in names)  # in front of a chair that stands next to the table
    limits = (*intent.region.constraints, *region_constraints(reply.constraints))
    guessed = side_cautions(scene, base, intent, names, reply.references, limits, frame, other)
    farther = max([HAND if outside and sided else 0.0, *distances(limits, reply.references)])
    areas = asked_areas(frame, names, groups, reach, view, outline, farther)
    if len(reply.references) > 1 and "between" not in names:
        areas[:0] = both(areas)  # "next to the lamp and the book": where the two meet, if they do
    if not areas and all(horizontal_gap(base.box, box) < NEIGHBOUR for group in groups for box in group):
        taken = f"{intent.region.words!r} is taken to say which {base.label} is meant"
        names, note = (), Caution(Cause.WHICH, taken)
        areas = regions(frame, (), [], reach)
    if not areas:
        away = min(distance_beside(frame, names, group, reach, view) for group in groups)
        return Choice(index, frame, [], [], " ".join(names), distance=away)
    spare, spare_note = spare_areas(base, frame, names, groups, reach, view, outline)
    if reply.point is not None:
        areas = [replace(area, target=frame.world(np.array(reply.point))) for area in areas]
    if not names and not note and sum(part.name == base.parts[index].name for part in base.parts) > 1:
        names = intent.region.names  # "on the left": it picked one of the cushions side by side
    bounds = Bounds(scene, base, index, frame, outline, reach, float(np.ptp(mesh.bounds[:, 2])))
    left, spare = (constrained(some, limits, bounds) for some in (areas, spare))
    in_turn = any(one.kind in ("farthest", "nearest") for one in limits)
    return Choice(index, frame, left, spare, " ".join(names), note, spare_note, cautions=guessed, in_turn=in_turn)


def asked_areas(
    frame: ViewerFrame, names: Sequence[str], groups: Sequence[list[OrientedBox]], reach: Array, view: ViewerFrame,
    outline: Array, farther: float = 0.0,
) -> list[Region]:  # fmt: skip
    """The areas of the region words for each group of references, off the references."""
    return [
        area
        for group in groups
        for area in regions(frame, names, group, reach, view, footprint=outline, farther=farther)
    ]


def spare_areas(
    base: Instance, frame: ViewerFrame, names: Sequence[str], groups: Sequence[list[OrientedBox]], reach: Array,
    view: ViewerFrame, outline: Array,
) -> tuple[list[Region], str]:  # fmt: skip
    """Areas if there is no room next to a thing: on the floor a little farther off, on furniture under overhanging
    things."""
    if not OFF.intersection(names) or not any(groups):
        return [], ""
    if is_floor(base):
        far = asked_areas(frame, names, groups, reach, view, outline, HAND)
        return far, Caution(Cause.NOT_MET, f"there is no room right next to it: up to {HAND:g} m away")
    under = [area for group in groups for area in regions(frame, names, group, reach, view)]
    return under, Caution(Cause.NOT_MET, "there is no room next to it: partly over or under it")


def distances(limits: Sequence[RegionConstraint], references: Sequence[str]) -> list[float]:
    """Requested distance from the things next to which it goes [m]: "in front of the armchair, 50 cm from it"."""
    return [
        one.metres for one in limits
        if one.metres is not None and one.reference in references and one.kind in ("exactly", "at_least")
        and EDGE not in one.regions
    ]  # fmt: skip


def groups_of(scene: Segmentation, base: Instance, reply: AnchorReply, index: int) -> list[list[OrientedBox]]:
    """Boxes of the regions' references, grouped if they form one area together, the nearest to the part first.

    "Near the pillow" with two pillows is near one of them; "between" takes all together.
    """
    boxes = reference_boxes(scene, base, reply.references, base.parts[index].box.center)
    return [[box] for box in boxes] if boxes and "between" not in reply.regions else [boxes]


def reach_of(mesh: Mesh, frame: ViewerFrame) -> Array:
    """Half extents along a frame's right and front [m], shape (2,)."""
    return np.asarray(0.5 * np.ptp(mesh.vertices[:, :2] @ np.stack([frame.right, frame.front], axis=1), axis=0))
