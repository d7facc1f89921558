"""The part, the areas and the carrying faces that a reply or a given point selects.

In: scene, base, intent, the reply or the user's point, and the object in its planned pose. Out: a `Choice`: areas to
try, and spare areas in case the first ones have no place; and sets of faces that may carry, to try one after the other:
the part's own, and those of things lying flat on it. On a bed both the blanket and the uncovered mattress carry, unless
the prompt names one of them; on a floor the rugs do if the bare floor has no place. Near a point only its surface does.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dcap.arrays import Array, Mask
from dcap.geometry.placement.named_regions import OFF, SIDES, Region, ViewerFrame, both, distance_beside, regions
from dcap.geometry.placement.polygons import convex_hull
from dcap.geometry.raycast import Raycaster
from dcap.language.protocol.replies import AnchorReply, region_constraints
from dcap.scene.types.boxes import OrientedBox
from dcap.scene.types.choices import Intent, RegionConstraint
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.outcome import Cause, Caution
from dcap.scene.types.segmentation import Instance, Segmentation
from tasks.anchor.constraints import RIM, Bounds, constrained
from tasks.anchor.no_room import side_cautions
from tasks.requests.surroundings import horizontal_gap, is_floor, part_frame, reference_boxes, reference_frame

COVERS = frozenset({"blanket", "mattress"})
"""Parts that lie on each other: the one on top carries the object."""
SEEN = 0.3
"""Share of its box below which a named part is hidden from above, so that the thing on it carries instead [-]."""
FLAT = 0.03
"""Largest height of things that cover a floor [m]: rugs, mats."""

HAND = 0.6
"""Largest distance of a place next to a thing on the floor [m], a hand's reach."""
NEIGHBOUR = 1.5
"""Largest distance between a base and a thing next to it [m]: then "the chair next to the desk" identifies the
chair."""
ABOVE = 0.02
"""Height above the point from which its surface is searched [m]."""
BAND = (0.12, 0.1)
"""Distance below and above the point within which a surface carries [m]: dents and cushions, not the board above."""
NEAR = 0.05
"""Largest offset from the point if that is not free, or half the object's breadth if that is larger [m]."""
UP = np.array([0.0, 0.0, 1.0])


def carrier_masks(scene: Segmentation, base: Instance, index: int, intent: Intent, caster: Raycaster) -> list[Mask]:
    """Masks of the faces that may carry on a part, best first, each of shape (faces,)."""
    own = faces_of(scene, base, index)
    if base.structure:
        flat = coverings(scene, base, index)
        return [own, own | flat] if flat.any() else [own]
    named = names_part(base, index, intent)
    if base.parts[index].name not in COVERS or (named and exposed(scene, base, index, caster) > SEEN):
        return [own]
    parts = [number for number, part in enumerate(base.parts) if part.name in COVERS]
    covers = (scene.face_instance == scene.index_of(base.id)) & np.isin(scene.face_part, parts)
    return [np.asarray(covers)]


def faces_of(scene: Segmentation, base: Instance, index: int) -> Mask:
    """The faces of a part, shape (faces,)."""
    return np.asarray((scene.face_instance == scene.index_of(base.id)) & (scene.face_part == index))


def coverings(scene: Segmentation, base: Instance, index: int) -> Mask:
    """The faces of things that lie flat on a floor, shape (faces,)."""
    top = base.parts[index].box.top
    flat = [not one.structure and abs(one.box.bottom - top) < FLAT and one.box.top < top + FLAT
            for one in scene.instances]  # fmt: skip
    return np.array([*flat, False])[scene.face_instance]


def exposed(scene: Segmentation, base: Instance, index: int, caster: Raycaster) -> float:
    """Share of a part's box from which a ray down meets the part first [-]."""
    box = base.parts[index].box
    steps = (np.arange(12) + 0.5) / 6.0 - 1.0
    u, v = np.meshgrid(steps, steps)
    local = np.c_[u.ravel(), v.ravel(), np.ones(u.size)] * box.half_extents + (0.0, 0.0, 0.3)
    hits = caster.cast(box.to_world(local), np.tile([0.0, 0.0, -1.0], (u.size, 1)))
    mine = faces_of(scene, base, index)
    return float(np.mean((hits.face >= 0) & mine[hits.face]))


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
    """Interpretation of the region, for the report."""
    spare_note: str = ""
    """Interpretation of the region in the spare areas."""
    distance: float | None = None
    """Distance of the requested place from the part [m]; None if it is on it."""
    cautions: tuple[Caution, ...] = ()
    """Warnings on sides whose point of view is ambiguous."""
    in_turn: bool = False
    """Whether an area is only tried if the areas before it have no place: the corner that is farthest from
    something."""

    def tries(self) -> list[tuple[list[Region], str]]:
        """Areas to try together, best first, with the interpretation of the region that each stands for."""
        both = ((self.areas, self.note), (self.spare, self.spare_note))
        return [
            (part, note) for areas, note in both for part in ([[one] for one in areas] if self.in_turn else [areas])
        ]


def names_part(base: Instance, index: int, intent: Intent) -> bool:
    """Return whether the prompt names this part."""
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
    view, axes = other or frame, np.stack([frame.right, frame.front], axis=1)
    reach = np.asarray(0.5 * np.ptp(mesh.vertices[:, :2] @ axes, axis=0))
    outline = convex_hull(mesh.vertices[np.unique(mesh.faces)][:, :2])
    outside = any(horizontal_gap(base.box, box) > 0.0 for group in groups for box in group) and not is_floor(base)
    sided = any(name in SIDES for name in names)  # "in front of a chair that stands next to the table
    limits = (*intent.region.constraints, *region_constraints(reply.constraints))
    guessed = side_cautions(scene, base, intent, names, reply.references, limits, frame, other)
    farther = max([HAND if outside and sided else 0.0, *distances(limits, reply.references)])
    free = base.parts[index].box.top + float(np.ptp(mesh.bounds[:, 2]))
    if "under" in names and all(box.bottom > free for group in groups for box in group):
        farther = float(reach.max())  # what hangs over it is high enough: below a picture is before its wall
    areas = asked_areas(frame, names, groups, reach, view, outline, farther)
    if len(reply.references) > 1 and "between" not in names:
        areas[:0] = both(areas)  # "next to the lamp and the book": where the two meet, if they do
    if not areas and all(horizontal_gap(base.box, box) < NEIGHBOUR for group in groups for box in group):
        taken = f"{intent.region.words!r} is interpreted as selecting the {base.label}"
        names, note = (), Caution(Cause.WHICH, taken)
        areas = regions(frame, (), [], reach)
    if not areas:
        away = min(distance_beside(frame, names, group, reach, view) for group in groups)
        return Choice(index, frame, [], [], " ".join(names), distance=away)
    spare, spare_note = spare_areas(base, frame, names, groups, reach, view, outline)
    if reply.point is not None:
        areas = [replace(area, target=frame.world(np.array(reply.point))) for area in areas]
    if not names and not note and sum(part.name == base.parts[index].name for part in base.parts) > 1:
        names = intent.region.names  # "on the left": the reply picked one of the cushions side by side
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
    """Areas if there is no room next to a thing: on the floor slightly farther away, on furniture under overhanging
    things."""
    if not OFF.intersection(names) or not any(groups):
        return [], ""
    if is_floor(base):
        far = asked_areas(frame, names, groups, reach, view, outline, HAND)
        return far, Caution(Cause.NOT_MET, f"there is no room right next to it: up to {HAND:g} m away")
    under = [area for group in groups for area in regions(frame, names, group, reach, view)]
    return under, Caution(Cause.NOT_MET, "there is no room next to it: partly over or under it")


def distances(limits: Sequence[RegionConstraint], references: Sequence[str]) -> list[float]:
    """Requested distances from the things next to which the object goes [m]: "in front of the armchair, 50 cm from
    it"."""
    return [
        one.metres for one in limits
        if one.metres is not None and one.reference in references and one.kind in ("exactly", "at_least")
        and not RIM.intersection(one.regions)
    ]  # fmt: skip


def groups_of(scene: Segmentation, base: Instance, reply: AnchorReply, index: int) -> list[list[OrientedBox]]:
    """Boxes of the regions' references, grouped if they form one area together, the nearest to the part first.

    "Near the pillow" with two pillows means near either of them; "between" takes all together.
    """
    boxes = reference_boxes(scene, base, reply.references, base.parts[index].box.center)
    return [[box] for box in boxes] if boxes and "between" not in reply.regions else [boxes]


def reply_at(scene: Segmentation, base: Instance, at: Array, caster: Raycaster) -> AnchorReply:
    """The part at the point, without asking a client."""
    hit = caster.cast((at + ABOVE * UP)[None], -UP[None])
    face = int(hit.face[0])
    own = face >= 0 and int(scene.face_instance[face]) == scene.index_of(base.id)
    index = max(int(scene.face_part[face]), 0) if own else 0
    return AnchorReply(part_index=index, reason="the given point")


def area_at(at: Array, mesh: Mesh) -> Region:
    """A square about the point, with its middle as the aim; `mesh` is the object in its planned pose."""
    half = max(NEAR, 0.25 * float(np.ptp(mesh.bounds[:, :2], axis=0).sum()))
    ring = np.array([[-half, -half], [half, -half], [half, half], [-half, half]])
    return Region(at[:2] + ring, at[:2].copy(), "at the point")


def carrying_at(scene: Segmentation, base: Instance, at: Array) -> NDArray[np.bool_]:
    """The faces of the base about as high as the point, shape (faces,)."""
    height = scene.mesh.triangles[:, :, 2]
    level = (height.max(axis=1) > at[2] - BAND[0]) & (height.min(axis=1) < at[2] + BAND[1])
    return np.asarray(level & (scene.face_instance == scene.index_of(base.id)))
