"""Properties of things that follow from their names: usual size and mass, figures, vessels, fronts, softness.

Size and mass come from the lexicon, by the more specific of the prompt's noun and the file's label; masses scale with
the size of the mesh. A thing with an unknown name keeps its mesh's size if that is plausible in a home. Otherwise a
unit with a plausible size is assumed, and a note says so.

Figures (`lexicon/figures.csv`) have a body that can sit or stand; other things are just set down. Vessels
(`lexicon/vessels.csv`) hold something: their opening is a mouth, not damage; `face` marks those whose opening is their
face. Both lists include all kinds of each entry. `lexicon/fronts.csv` gives the side of the front if the category
determines it: a car drives along its long side, a television faces across it; shape alone shows neither.

Deformable supports are counted per scene by label, as in the paper's figure 3 (beds, sofas, cushions, blankets and so
on). A label counts if the lexicon knows it as one of KINDS or as furniture, and the usual material of its carrying part
is soft, with a Young's modulus of at most 1 GPa. Nothing is measured: a scan may hold a wooden bed.
"""

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cache
from types import MappingProxyType

from dcap.knowledge.lexicon import Size, Thing, first_part, is_a, label_words, lineage, rows, thing_of, things
from dcap.knowledge.material_table import load_materials
from dcap.knowledge.usual_materials import material_of, parts_named
from dcap.scene.types.outcome import Cause, Caution
from dcap.scene.types.scan import TAKEN_AS_METRES

GENERIC = frozenset({"toy", "food", "fruit", "clothes", "furniture", "cutlery", "structure", "object"})
UNKNOWN_DENSITY = 150.0
"""Mass of an unknown thing over the volume of its bounding box [kg/m^3]: most household things have 50 to 500."""
UNKNOWN_LENGTH = (0.005, 3.0)
"""Range of the longest extent of an unknown thing, from a coin to a pole [m]: a mesh within it keeps its size."""
THINNEST = 1e-4
"""Thickness assumed for a mesh without thickness, that of a sheet of paper [m]."""
TYPICAL_LENGTH = 0.25
"""Of several possible units, the one with the longest extent nearest to this is chosen [m]."""
RIGID_ABOVE = 1.0e9
"""Young's modulus above which a part is rigid [Pa]; the paper's 1 GPa."""

MATTRESS = "mattress"
"""A part that scenes annotate as a separate thing."""

KINDS = {
    "bed": ("bed",),
    "sofa": ("sofa",),
    "soft seat": ("armchair", "chair", "stool", "bench"),
    MATTRESS: (),
    "pillow or cushion": ("pillow", "cushion"),
    "blanket or towel": ("blanket", "sheet", "towel"),
    "soft toy": ("plush toy",),
    "rug": ("rug",),
}
"""Kinds of deformable supports with their things, in the order in which they are shown."""

NO_KIND = frozenset({"", "furniture", "structure"})
"""Parents that group things that nobody would confuse with each other."""
RIGHTING = 0.5
"""Lead of another side's shape score above which a file that could stand counts as lying or overturned [-]."""
LEVEL = 0.5
"""Largest sine of the elevation of the upright axis of a thing that lies on its side [-]."""

OTHER = "other"
"""Kind of soft furniture that belongs to none of KINDS."""


@dataclass(frozen=True, slots=True)
class Prior:
    """Sizes and mass of the object known from its name."""

    name: str
    sizes: tuple[Size, ...]
    """Extents of each of its usual shapes, largest first [m]; the most usual shape first."""
    spread: float
    mass: float
    """Mass [kg]."""
    hollow: bool
    notes: tuple[str, ...]


def object_thing(said: str, label: str) -> Thing | None:
    """Kind of the object: the prompt's, or the file's if that is more specific or the prompt has none.

    Args:
        said: id of the thing that the prompt names; empty if it names none.
        label: label of the file.
    """
    named, filed = things().get(said), thing_of(label)
    if named is None:
        return filed
    if filed is not None and (named.id in GENERIC or is_a(filed.id, named.id)):
        return filed
    return named


def prior_of(said: str, label: str, size: Size, name: str = "") -> Prior:
    """The prior for an object.

    Args:
        said: id of the thing that the prompt names; empty if it names none.
        label: label of the file.
        size: extents of its mesh, largest first [m].
        name: name for an unknown thing; the label by default.
    """
    thing = object_thing(said, label)
    if thing is not None:
        return Prior(thing.id, thing.sizes, thing.spread, thing.mass, thing.hollow, mismatch(said, label, thing))
    name = name or label or "object"
    scale, assumed = unknown_scale(max(size[0], THINNEST))
    length, width, height = (max(scale * extent, THINNEST) for extent in size)
    mass = max(1e-3, UNKNOWN_DENSITY * length * width * height)
    note = f"{name!r} is not in the lexicon: {assumed}; {UNKNOWN_DENSITY:g} kg/m^3 over its box is assumed"
    return Prior(name, ((length, width, height),), 1.0, mass, True, (Caution(Cause.ASSUMED, note),))


def unknown_scale(longest: float) -> tuple[float, str]:
    """Factor for a mesh of an unknown thing with this longest extent [m], and the assumption."""
    low, high = UNKNOWN_LENGTH
    if low <= longest <= high:
        return 1.0, "the mesh keeps its size"
    fitting = {name: unit for name, unit in TAKEN_AS_METRES.items() if low <= longest * unit <= high}
    if not fitting:
        return TYPICAL_LENGTH / longest, f"nothing in a home is {longest:.3g} m long; assuming {TYPICAL_LENGTH:g} m"
    name = min(fitting, key=lambda name: abs(math.log(longest * fitting[name] / TYPICAL_LENGTH)))
    return fitting[name], f"nothing in a home is {longest:.3g} m long; assuming {name}"


def mismatch(said: str, label: str, chosen: Thing) -> tuple[str, ...]:
    """A note if prompt and file name different things."""
    filed = thing_of(label)
    if not said or filed is None or is_a(filed.id, chosen.id):
        return ()
    told = f"the prompt says {said!r}, the file is named {label!r}; using the prompt"
    return (Caution(Cause.ASSUMED, told),)


@cache
def figures() -> frozenset[str]:
    """Ids of things that are figures."""
    return frozenset(row["id"] for row in rows("lexicon/figures.csv"))


def is_figure(name: str) -> bool | None:
    """Return whether a name means a figure; None if the lexicon does not know it."""
    thing = thing_of(name)
    return None if thing is None else bool(figures() & set(lineage(thing.id)))


@cache
def vessels() -> frozenset[str]:
    """Ids of vessels."""
    return frozenset(row["id"] for row in rows("lexicon/vessels.csv"))


@cache
def faced_by_opening() -> frozenset[str]:
    """Ids of vessels that lie on their face when their opening is down."""
    return frozenset(row["id"] for row in rows("lexicon/vessels.csv") if row["face"] == "opening")


def is_vessel(name: str) -> bool | None:
    """Return whether a name means a vessel; None if the lexicon does not know it."""
    thing = thing_of(name)
    return None if thing is None else bool(vessels() & set(lineage(thing.id)))


class FrontSide(StrEnum):
    """Side of the front, seen from above."""

    LONG = "long"
    """At an end of the longer horizontal side."""
    SHORT = "short"
    """In the middle of the longer horizontal side."""
    UNKNOWN = ""


@cache
def front_sides() -> Mapping[str, FrontSide]:
    """Side of the front by thing id."""
    return MappingProxyType({row["id"]: FrontSide(row["front"]) for row in rows("lexicon/fronts.csv")})


def front_side(name: str) -> FrontSide:
    """Side of the front of the named thing, or of its nearest kind with an entry."""
    thing = thing_of(name)
    kinds = lineage(thing.id) if thing else ()
    return next((front_sides()[kind] for kind in kinds if kind in front_sides()), FrontSide.UNKNOWN)


def to_right(thing: Thing | None, *, righting: float, stands: bool, file_up: float) -> bool:
    """Return whether the file's pose is rejected: it could not stand, or its shape clearly indicates another side.

    Furniture stands on legs, and its open underside looks like a mouth; if it could stand, the file's pose is accepted.
    Figures may have four legs and a flat back; one that could stand is only righted from its side.
    """
    if righting == 0.0 or (thing is not None and thing.rest != "upright"):
        return False
    clearly = righting > RIGHTING
    if thing is None or is_figure(thing.id):  # it may have legs like furniture, unless it lies on its side
        return not stands or (clearly and abs(file_up) < LEVEL)
    return not stands or (clearly and not is_a(thing.id, "furniture"))


@cache
def coarse() -> Mapping[tuple[str, ...], tuple[str, ...]]:
    """Possible things of each broad category, by the words of its label."""
    return {tuple(label_words(row["label"])): tuple(row["things"].split("|")) for row in rows("lexicon/coarse.csv")}


def deformable_supports(labels: Iterable[str]) -> Counter[str]:
    """Number of labels that are deformable supports, by kind."""
    return Counter(kind for label in labels if (kind := deformable_kind(label)))


@cache
def deformable_kind(label: str) -> str:
    """The kind of deformable support named by a label; empty if it is none."""
    thing = thing_of(label)
    if thing is None:
        return MATTRESS if MATTRESS in parts_named(label_words(label)) and _is_soft(label, MATTRESS) else ""
    kind = next((kind for kind, things in KINDS.items() if any(is_a(thing.id, one) for one in things)), "")
    if not kind and not is_a(thing.id, "furniture"):
        return ""
    return (kind or OTHER) if _is_soft(label, first_part(thing.id) or "body") else ""


def deformable_materials(things: Iterable[tuple[str, Sequence[str]]]) -> Counter[str]:
    """Number of parts of each deformable material of the library, for things given by label and part names. Each part
    counts with its usual material."""
    moduli = _moduli()
    tags = (_material(label, part) for label, parts in things for part in parts)
    return Counter(material for material in tags if moduli[material] <= RIGID_ABOVE)


def _is_soft(label: str, part: str) -> bool:
    """Return whether the library's material for a part of a thing is not rigid."""
    return _moduli()[_material(label, part)] <= RIGID_ABOVE


@cache
def _material(label: str, part: str) -> str:
    """The id of the library's material for a part of a thing."""
    return material_of(label, part, set(_moduli()))[0]


@cache
def _moduli() -> dict[str, float]:
    return {name: material.youngs_modulus for name, material in load_materials().items()}
