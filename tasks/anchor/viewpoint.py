"""Warnings on sides of a support, or of a thing next to it, whose point of view is ambiguous.

In: scene, base, the request and the frames of its reading. Out: a caution for each thing without a front whose
left, right, front or back the result depends on. Doors and walls are seen from the room, which settles it.
"""

from collections.abc import Sequence

from dcap.geometry.placement.named_regions import ViewerFrame
from dcap.scene.types.caution import Cause, Caution
from dcap.scene.types.intent import Intent, RegionConstraint
from dcap.scene.types.segmentation import Instance, Segmentation
from dcap.scene.types.viewpoint import VIEWED, axis_word
from tasks.requests.surroundings import PART, is_floor, part_frame

FACED = frozenset({"viewer", "left", "right", "front", "back"})
"""Facings that depend on the point of view on the support."""


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
    cautions = (seen_from(*one) for one in found if one[1].front is None and not is_seen_from_the_room(one[1]))
    return (*dict.fromkeys(cautions), *facing_cautions(scene, base, intent))


def facing_cautions(scene: Segmentation, base: Instance, intent: Intent) -> tuple[Caution, ...]:
    """Warnings on facing a side of the support, or its viewer."""
    if base.front is not None or intent.orientation.facing.removeprefix("away:") not in FACED:
        return ()
    words = intent.orientation.words or f"facing {intent.orientation.facing}"
    return (seen_from(words, base, part_frame(scene, base, base.box)),)


def is_seen_from_the_room(thing: Instance) -> bool:
    """Whether it is only seen from one side: a door or a wall, but not a floor."""
    return thing.structure and not is_level(thing)


def is_level(thing: Instance) -> bool:
    """Whether it is lower than it is long and wide: a floor or a ceiling."""
    return bool(thing.box.half_extents[2] < thing.box.half_extents[:2].min())


def seen_from(words: str, thing: Instance, frame: ViewerFrame) -> Caution:
    """Point of view of the words, and how to state another one."""
    where = f"{words!r} is taken as seen from the {axis_word(frame.front)} side of the {thing.label} (world axes, z up)"
    return Caution(
        Cause.WHICH, f'{where}, which has no front; "on the side nearest the ..." or --at X,Y say it otherwise'
    )
