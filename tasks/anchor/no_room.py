"""Reasons why an object has no place, and warnings on sides whose point of view is ambiguous.

In: scene, base, the request and the frames in which it is read. Out: a refusal with its evidence; or a caution for each
thing without a front whose left, right, front or back the result depends on. Doors and walls are seen from the room,
which settles it.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.placement.named_regions import Region, ViewerFrame
from dcap.geometry.placement.search import SHARES, PlacementSearch
from dcap.scene.types.choices import VIEWED, Intent, RegionConstraint, axis_word
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.outcome import BesideThePart, Cause, Caution, Infeasible, InTheWay, NoRoom, Reason
from dcap.scene.types.segmentation import Instance, Segmentation
from tasks.requests.surroundings import PART, is_floor, part_frame

NAMED, LEAST = 3, 0.05
"""Maximum number of named obstacles, and minimum share of the spots that each of them blocks [-]."""
FACED = frozenset({"viewer", "left", "right", "front", "back"})
"""Facings that depend on the point of view on the support."""


def no_room(
    scene: Segmentation, base: Instance, index: int, frame: ViewerFrame, search: PlacementSearch,
    areas: Sequence[Region], intent: Intent, mesh: Mesh,
) -> Infeasible:  # fmt: skip
    """The refusal with its evidence; `mesh`: the object in its planned pose."""
    part, size, space = base.parts[index], np.ptp(mesh.bounds, axis=0), 2.0 * frame.half
    reasons = [search.failure(area) for area in areas]
    best = max(reason.best_share for reason in reasons)
    blockers = in_the_way(scene, base, np.concatenate([reason.blockers for reason in reasons]))
    evidence = NoRoom(
        base=base.id,
        part=part.name,
        region=" ".join(intent.region.names) or "whole surface",
        footprint_m=(round(float(size[0]), 4), round(float(size[1]), 4)),
        height_m=round(float(size[2]), 4),
        part_size_m=(round(float(space[0]), 4), round(float(space[1]), 4)),
        best_supported_share=round(best, 4),
        needed_share=SHARES[-1],
        blocked_share=round(max(reason.blocked for reason in reasons), 4),
        in_the_way=tuple(InTheWay(one, name, round(share, 4)) for one, name, share in blockers),
    )
    words = intent.region.words if intent.region.names else ""
    where = f"the {part.name} of {base.label}" + (f" ({words})" if words else "")
    if not any(reason.hit for reason in reasons):
        return Infeasible(Reason.NO_SUPPORT_HIT, f"{where} has no surface under the requested place", evidence)
    text = (
        f"{intent.object_name} of {size[0]:.2f} x {size[1]:.2f} m does not fit on {where}, {space[0]:.2f} x "
        f"{space[1]:.2f} m: at best {100 * best:.0f} % of its underside would be supported without anything in the "
        f"way, {100 * SHARES[-1]:.0f} % are needed"
    )
    if blockers:
        text += f"; in the way: {', '.join(dict.fromkeys(name for _, name, _ in blockers))}"
    return Infeasible(Reason.TOO_LARGE_FOR_TARGET, text, evidence)


def not_on_it(base: Instance, index: int, intent: Intent, away: float) -> Infeasible:
    """The refusal of a place next to something that is too far from the part: no part of the place is on it."""
    part, words = base.parts[index].name, intent.region.words
    place = f"the requested place ({words})" if words else "the requested place"
    text = f"{place} lies {away:.2f} m from the {part} of {base.label}, not on it"
    return no_surface(text, base, part, " ".join(intent.region.names), tuple(intent.region.references), away)


def nothing_left(base: Instance, index: int, intent: Intent) -> Infeasible:
    """The refusal of constraints that no place on the part meets."""
    part, region = base.parts[index].name, intent.region
    asked = ", ".join(dict.fromkeys(one.words for one in region.constraints if one.words)) or region.words
    references = tuple(one.reference for one in region.constraints if one.reference) or tuple(region.references)
    text = f"no place on the {part} of {base.label} meets the request ({asked}); ask for less or another distance"
    return no_surface(text, base, part, " ".join(region.names), references)


def no_surface(
    text: str, base: Instance, part: str, region: str = "", references: tuple[str, ...] = (), away: float = 0.0
) -> Infeasible:
    """A refusal because no surface of the base carries the object at the requested place."""
    evidence = BesideThePart(base.id, part, region, references, round(away, 4))
    return Infeasible(Reason.NO_SUPPORT_HIT, text, evidence)


def in_the_way(scene: Segmentation, base: Instance, faces: NDArray[np.int64]) -> list[tuple[str, str, float]]:
    """Id, name and share of blocked spots of the most frequent obstacles; parts of the base have their own names."""
    if len(faces) == 0:
        return []
    key = np.stack([scene.face_instance[faces], scene.face_part[faces]], axis=1).astype(np.int64)
    key[key[:, 0] != scene.index_of(base.id), 1] = -1
    kinds, count = np.unique(key[key[:, 0] >= 0], axis=0, return_counts=True)
    order = np.argsort(-count, kind="stable")[:NAMED]
    result = []
    for (instance, part), number in zip(kinds[order].tolist(), count[order].tolist(), strict=True):
        one, share = scene.instances[instance], number / len(faces)
        if share >= LEAST:
            result.append((one.id, one.label if part < 0 else one.parts[part].name, share))
    return result


def side_cautions(
    scene: Segmentation, base: Instance, intent: Intent, names: Sequence[str], references: Sequence[str],
    limits: Sequence[RegionConstraint], frame: ViewerFrame, view: ViewerFrame | None,
) -> tuple[Caution, ...]:  # fmt: skip
    """Warnings on the region words and the constraints; `view` is the frame of the single reference, if it has one
    (`reference_frame`)."""
    found = []
    if VIEWED.intersection(names):
        words = intent.region.words or " ".join(names)
        if view is None:
            found.append((words, base, frame))
        elif is_floor(base):
            found.append((words, scene.instances[scene.index_of(references[0])], view))
    which = intent.region.which, *(name.partition("/")[2] for name in references if name.startswith(PART))
    if VIEWED.intersection(which):
        found.append((intent.region.words or intent.region.part, base, part_frame(scene, base, base.box)))
    found += [(one.words or one.kind, base, frame) for one in limits if VIEWED.intersection(one.regions)]

    def is_one_sided(thing: Instance) -> bool:  # a door or a wall is seen from the room; a floor or a ceiling is level
        return thing.structure and not thing.box.half_extents[2] < thing.box.half_extents[:2].min()

    cautions = (seen_from(*one) for one in found if one[1].front is None and not is_one_sided(one[1]))
    return (*dict.fromkeys(cautions), *facing_cautions(scene, base, intent))


def facing_cautions(scene: Segmentation, base: Instance, intent: Intent) -> tuple[Caution, ...]:
    """Warnings on facing a side of the support, or its viewer."""
    if base.front is not None or intent.orientation.facing.removeprefix("away:") not in FACED:
        return ()
    words = intent.orientation.words or f"facing {intent.orientation.facing}"
    return (seen_from(words, base, part_frame(scene, base, base.box)),)


def seen_from(words: str, thing: Instance, frame: ViewerFrame) -> Caution:
    """The point of view from which the words are understood, and how to state another one."""
    where = f"{words!r} is read as seen from the {axis_word(frame.front)} side of the {thing.label} (world axes, z up)"
    return Caution(
        Cause.WHICH, f'{where}, which has no front; "on the side nearest the ..." or --at X,Y state it differently'
    )
