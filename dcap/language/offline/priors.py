"""Size and mass priors of the object by its name.

In: the noun of the prompt and the label of the file. Out: the more specific of the two, with the lexicon's numbers;
masses follow the size of the mesh. An unknown name keeps the mesh's own size as long as anything in a home may be that
large, else the unit that makes it so is taken, and a note says what was assumed.
"""

import math
from dataclasses import dataclass

from dcap.language.offline.lexicon import Size, Thing, is_a, thing_of, things
from dcap.language.offline.nouns import Noun
from dcap.language.protocol.replies import LONGEST_NAME
from dcap.scene.types.caution import Cause, Caution
from dcap.scene.types.units import TAKEN_AS_METRES

GENERIC = frozenset({"toy", "food", "fruit", "clothes", "furniture", "cutlery", "structure", "object"})
UNKNOWN_DENSITY = 150.0
"""Mass of an unknown thing over the volume of its bounding box [kg/m^3]: most household things are 50 to 500."""
UNKNOWN_LENGTH = (0.005, 3.0)
"""The longest extent of an unknown thing, a coin to a pole: a mesh within stays as it is [m]."""
THINNEST = 1e-4
"""A sheet of paper: what a mesh without thickness is taken for [m]."""
TYPICAL_LENGTH = 0.25
"""Where several units are possible, the one that brings the longest extent nearest to this is taken [m]."""


@dataclass(frozen=True, slots=True)
class Prior:
    """Sizes and mass of the object that are known from its name."""

    name: str
    sizes: tuple[Size, ...]
    """Extents of each shape it is met in, largest first [m]; the most usual one first."""
    spread: float
    mass: float
    """[kg]."""
    hollow: bool
    notes: tuple[str, ...]


def object_thing(theme: Noun | None, label: str) -> Thing | None:
    """Thing that the object is: the prompt's word, or the file's where it is more specific or the prompt says none."""
    said = things().get(theme.thing) if theme is not None else None
    filed = thing_of(label)
    if said is None:
        return filed
    if filed is not None and (said.id in GENERIC or is_a(filed.id, said.id)):
        return filed
    return said


def prior_of(theme: Noun | None, label: str, size: Size) -> Prior:
    """The prior for an object whose mesh has these extents, largest first [m]."""
    thing = object_thing(theme, label)
    if thing is not None:
        return Prior(thing.id, thing.sizes, thing.spread, thing.mass, thing.hollow, mismatch(theme, label, thing))
    said = theme.text.removeprefix("the ").removeprefix("a ") if theme is not None and not theme.pronoun else label
    name = said[:LONGEST_NAME] or "object"
    scale, assumed = unknown_scale(max(size[0], THINNEST))
    length, width, height = (max(scale * extent, THINNEST) for extent in size)
    mass = max(1e-3, UNKNOWN_DENSITY * length * width * height)
    note = f"{name!r} is not in the lexicon: {assumed}; {UNKNOWN_DENSITY:g} kg/m^3 over its box is assumed"
    return Prior(name, ((length, width, height),), 1.0, mass, True, (Caution(Cause.ASSUMED, note),))


def unknown_scale(longest: float) -> tuple[float, str]:
    """Factor for a mesh of an unknown thing with this longest extent [m], and what that assumes."""
    low, high = UNKNOWN_LENGTH
    if low <= longest <= high:
        return 1.0, "the mesh keeps its size"
    fitting = {name: unit for name, unit in TAKEN_AS_METRES.items() if low <= longest * unit <= high}
    if not fitting:
        return TYPICAL_LENGTH / longest, f"nothing at home is {longest:.3g} m long, so {TYPICAL_LENGTH:g} m are assumed"
    name = min(fitting, key=lambda name: abs(math.log(longest * fitting[name] / TYPICAL_LENGTH)))
    return fitting[name], f"nothing at home is {longest:.3g} m long, so {name} are assumed"


def mismatch(theme: Noun | None, label: str, chosen: Thing) -> tuple[str, ...]:
    """A note where prompt and file speak of different things."""
    filed = thing_of(label)
    if theme is None or not theme.thing or filed is None or is_a(filed.id, chosen.id):
        return ()
    told = f"the prompt says {theme.thing!r}, the file is named {label!r}; the prompt counts"
    return (Caution(Cause.ASSUMED, told),)
