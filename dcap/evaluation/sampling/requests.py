"""Possible requests for a scene, each with its truth, and the random draws among them.

In: carrying surfaces and objects. Out: every plausible `PlacementAsk`, and those that should be refused. An object
plausibly fits if its footprint leaves room; only a solver decides whether it comes to rest.

A draw is a digest of words as a number, so that it depends neither on other draws nor on their order.
"""

import hashlib
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TypeVar

from dcap.evaluation.sampling.supports import FLAT_TOPS, WALKED_ON, CarryingSurface, is_sure, naming, thing_name
from dcap.knowledge.kinds import NO_KIND, coarse, faced_by_opening
from dcap.knowledge.lexicon import in_line, is_a, label_words, lineage, things
from dcap.language.protocol.requests import InstanceView, Vector

FITS, FITS_PART = 0.8, 0.45
"""Largest share of a surface's side for an object on the whole surface, and on a half or at an edge [-]."""
FILLS = 0.5
"""Largest share of the free area that it may occupy [-]."""
TALL = 1.3
"""Least height over width of a standing thing that has a side to be laid on [-]."""
SLENDER, SLENDER_SOFT = 8.0, 3.0
"""Least height over width at which it would topple on a rigid surface, and on a soft one [-]."""
ROUND = 1.15
"""Least elongation of a thing with a top or a side [-]."""
TOO_LARGE = 1.5
"""Factor between an object's shorter side and a surface's longer one above which it does not fit [-]."""
FACED_FROM = 1.0 / 3.0
"""Least distance of a faced thing from the middle of a surface, over its longer side: from anywhere in the middle third
of the surface, it is in about the same direction [-]."""
FACED_WIDTH = 1.0
"""Largest width of a faced thing, over its distance [-]."""
ON_THE_FLOOR = ("furniture", "ball", "toy", "shoe", "bag", "basket", "box", "dumbbell", "cushion", "bucket", "plant")
"""Kinds of things that stand on the floor."""
ABSENT = ("bed", "sofa", "armchair", "bench", "stool", "desk", "dining table", "coffee table", "nightstand", "shelf",
          "bathtub", "piano", "dresser", "washing machine", "rug", "treadmill")  # fmt: skip
"""Supports for requests of things that the scene lacks."""
ValueT = TypeVar("ValueT")
DIGITS = 13
"""Hexadecimal digits that a float holds exactly [-]."""


@dataclass(frozen=True, slots=True)
class PlacedAsset:
    """An object as it would be placed."""

    name: str
    """Name of its file in the data set."""
    noun: str
    """Its name in sentences."""
    thing: str
    """Its kind, a thing of the lexicon."""
    size: Vector
    """Extents along x, y, z in the file's pose, at its placed size [m]."""
    front: tuple[float, float] | None = None
    """Horizontal unit vector out of its front, in the file's frame; None if neither shape nor category determines
    it."""

    def is_kind(self, *kinds: str) -> bool:
        """Whether it is one of some kinds."""
        return any(is_a(self.thing, kind) for kind in kinds)

    @property
    def rolls(self) -> bool:
        """Whether it rolls: it is about as thick as long."""
        return max(self.size) < ROUND * min(self.size)

    @property
    def stands(self) -> bool:
        """Whether it has a foot and is taller than wide."""
        return things()[self.thing].rest == "upright" and self.size[2] > TALL * max(self.size[:2])


@dataclass(frozen=True, slots=True)
class PlacementAsk:
    """A possible placement request."""

    asset: PlacedAsset
    surface: CarryingSurface | None
    """None: the requested support does not exist."""
    place: str
    """whole, center, left, ..., absent or too large; decides the sentences that fit."""
    regions: tuple[str, ...] = ()
    landmark: str = ""
    """Thing that it should be next to."""
    absent: str = ""
    """Requested support that the scene lacks."""
    pose: str = ""
    """upright, upside_down, on_side, or empty."""
    faced: InstanceView | None = None
    """Thing that its front should face."""

    @property
    def base(self) -> str:
        """Label of the support, empty if it does not exist."""
        return self.surface.base.label if self.surface is not None else ""

    @property
    def key(self) -> str:
        """Unique key of the request."""
        base = self.surface.base.id if self.surface is not None else self.absent
        words = (self.asset.name, base, self.place, *self.regions, self.landmark, self.pose)
        return " ".join(words if self.faced is None else (*words, "facing", self.faced.id))


def feasible_asks(
    surfaces: Sequence[CarryingSurface], assets: Sequence[PlacedAsset], instances: Sequence[InstanceView]
) -> Iterator[PlacementAsk]:
    """All requests that should come to rest."""
    for surface in surfaces:
        for asset in assets:
            if not goes_with(asset, surface):
                continue
            for ask in places_on(surface, asset):
                yield ask
                if ask.place in ("whole", "center") and not ask.landmark:
                    for pose in poses_of(asset, surface):
                        yield PlacementAsk(asset, surface, ask.place, ask.regions, pose=pose)
                if ask.place == "center" and asset.front is not None:
                    for faced in faced_from(surface, asset, instances):
                        yield PlacementAsk(asset, surface, ask.place, ask.regions, faced=faced)


def faced_from(
    surface: CarryingSurface, asset: PlacedAsset, instances: Sequence[InstanceView]
) -> Iterator[InstanceView]:
    """Things with a name that lie in one direction from the middle of a surface; none if there are several such
    surfaces."""
    if surface.several:
        return
    for one in instances:
        distance = math.hypot(*towards(surface.base, one))
        if abs(one.center[2] - surface.base.high[2]) > distance:  # nothing faces things overhead
            continue
        width = math.hypot(one.high[0] - one.low[0], one.high[1] - one.low[1])
        if distance < FACED_FROM * surface.sides[0] or width > FACED_WIDTH * distance:
            continue
        thing, (several, names) = thing_name(one), naming(one, instances)
        if one.id == surface.base.id or not is_sure(one) or several or not names or asset.is_kind(thing):
            continue
        if thing and not any(in_line(kind, thing) for kind in ("floor", "wall", "ceiling")):
            yield one


def towards(base: InstanceView, other: InstanceView) -> tuple[float, float]:
    """The horizontal way from the middle of one thing to that of another, x and y [m]."""
    return other.center[0] - base.center[0], other.center[1] - base.center[1]


def asked_front(asset: PlacedAsset, base: InstanceView, faced: InstanceView) -> tuple[float, float]:
    """The horizontal unit vector along which the +y axis of an object's file points in the scene when the object's
    front looks from a base to another thing; ValueError for an object without a front."""
    if asset.front is None:
        raise ValueError(f"object {asset.name!r} has no front that its shape tells")
    # as complex numbers: the turn takes the front to the way, so it is way / front, and it takes i, which is +y, along
    turned = 1j * complex(*towards(base, faced)) / complex(*asset.front)
    turned /= abs(turned)
    return turned.real, turned.imag


def goes_with(asset: PlacedAsset, surface: CarryingSurface) -> bool:
    """Whether such a thing belongs there, and has room."""
    if in_line(asset.thing, surface.thing) or any(is_a(thing_name(one), asset.thing) for one in surface.landmarks):
        return False
    if surface.is_kind(*WALKED_ON) and not asset.is_kind(*ON_THE_FLOOR):
        return False
    if asset.is_kind("furniture") and not surface.is_kind("floor"):
        return False
    slender = asset.size[2] / min(asset.size[:2])
    if things()[asset.thing].rest == "upright" and slender > (SLENDER_SOFT if surface.soft else SLENDER):
        return False
    return fits(asset, surface, FITS) and footprint(asset)[0] * footprint(asset)[1] <= FILLS * surface.free * area(
        surface
    )


def area(surface: CarryingSurface) -> float:
    """[m^2]."""
    return surface.sides[0] * surface.sides[1]


def footprint(asset: PlacedAsset) -> tuple[float, float]:
    """Longer and shorter side of its footprint over all possible poses [m]."""
    x, y, z = asset.size
    upright = things()[asset.thing].rest == "upright"
    sides = (x, y) if upright else tuple(sorted((x, y, z))[1:])
    return max(sides), min(sides)


def height(asset: PlacedAsset) -> float:
    """Its largest height above a surface [m]."""
    return asset.size[2] if things()[asset.thing].rest != "any" else max(asset.size)


def fits(asset: PlacedAsset, surface: CarryingSurface, share: float) -> bool:
    """Whether it takes at most a share of each side, and fits under the things above."""
    long, short = footprint(asset)
    return long <= share * surface.sides[0] and short <= share * surface.sides[1] and height(asset) < surface.headroom


def places_on(surface: CarryingSurface, asset: PlacedAsset) -> Iterator[PlacementAsk]:
    """The whole surface, its middle, halves, edges, corners, and places next to things on it."""
    if not surface.is_kind("floor") or not surface.landmarks:
        yield PlacementAsk(asset, surface, "whole")
    small = 2 * footprint(asset)[0] <= 2 * FITS_PART * surface.sides[1]
    if surface.center_free and not surface.is_kind("floor", "shelf"):
        yield PlacementAsk(asset, surface, "center", ("center",))
    crowded = surface.free < 0.7
    if small and not crowded and surface.base.front is not None and surface.is_kind("bed", "sofa", "bench", *FLAT_TOPS):
        for side in ("left", "right"):
            yield PlacementAsk(asset, surface, "half", (side,))
    if small and not crowded and surface.is_kind("bed") and surface.base.front is not None:
        yield PlacementAsk(asset, surface, "foot", ("foot",))
    if small and not crowded and surface.is_kind(*FLAT_TOPS) and not asset.rolls:
        yield PlacementAsk(asset, surface, "edge", ("edge",))
        yield PlacementAsk(asset, surface, "corner", ("corner",))
        if surface.base.front is not None:
            for side in ("left", "right", "front"):
                yield PlacementAsk(asset, surface, "side edge", (side, "edge"))
    if small and not surface.is_kind("shelf", "rug"):
        for one in surface.landmarks:
            name = " ".join(label_words(one.label))
            yield PlacementAsk(asset, surface, "near", ("near",), landmark=name)
            yield PlacementAsk(asset, surface, "beside", ("next_to",), landmark=name)


def poses_of(asset: PlacedAsset, surface: CarryingSurface) -> Iterator[str]:
    """Poses that a sentence may request and that are stable."""
    if asset.rolls and not asset.is_kind(*faced_by_opening()):
        return
    if asset.stands and not surface.soft:
        yield "upright"
    if asset.stands and max(asset.size) <= FITS * surface.sides[1]:
        yield "on_side"
    low = asset.size[2] < TALL * max(asset.size[:2])
    if low and faced_by_opening() & set(lineage(asset.thing)) and not surface.soft:
        yield "upside_down"


# requests that should be refused -----------------------------------------------------------------------------------


def refused_asks(
    surfaces: Sequence[CarryingSurface], assets: Sequence[PlacedAsset], instances: Sequence[InstanceView]
) -> Iterator[PlacementAsk]:
    """Requests for missing supports, and for objects without room."""
    missing = absent_things(instances)
    for asset in assets:
        for name in missing:
            if not in_line(asset.thing, name) and not asset.is_kind("furniture"):
                yield PlacementAsk(asset, None, "absent", absent=name)
        for surface in surfaces:
            too_large = min(asset.size) >= TOO_LARGE * surface.sides[0]  # at any angle about the vertical
            if too_large and not in_line(asset.thing, surface.thing):
                yield PlacementAsk(asset, surface, "too large")


def absent_things(instances: Sequence[InstanceView]) -> list[str]:
    """Things of ABSENT that match nothing in the scene; none if a label in the scene is uncertain."""
    if not all(is_sure(one) for one in instances if not one.structure):
        return []
    return [name for name in ABSENT if not any(may_be_called(one, name) for one in instances)]


def may_be_called(instance: InstanceView, name: str) -> bool:
    """Whether someone might call an instance by a name: it is of that kind, of a kindred one, or shares a word."""
    thing, words = thing_name(instance), label_words(instance.label)
    kinds = (thing, *coarse().get(tuple(words), ()))
    if any(kind and in_line(kind, name) for kind in kinds) or set(words) & set(name.split()):
        return True
    if any(part.name == name for part in instance.parts):
        return True
    parents = [things()[kind].parent for kind in kinds if kind in things()]
    return any(parent == things()[name].parent and parent not in NO_KIND for parent in parents)


def chance(*words: object) -> float:
    """A pseudo-random number in [0, 1), the same for the same words."""
    digest = hashlib.sha256("\n".join(map(str, words)).encode()).hexdigest()
    return float(int(digest[:DIGITS], 16) / 16**DIGITS)


def picked(options: Sequence[ValueT], *words: object) -> ValueT:
    """One of several, by chance."""
    return options[int(chance(*words) * len(options))]
