"""Size and mass priors of the object by its name.

In: the noun of the prompt and the label of the file. Out: the more specific of the two, with the lexicon's numbers;
masses follow the size of the mesh. An unknown name keeps the mesh's own size and says so.
"""

from dataclasses import dataclass

from language.lexicon import Thing, is_a, thing_of, things
from language.nouns import Noun

GENERIC = frozenset({"toy", "food", "fruit", "clothes", "furniture", "cutlery", "structure", "object"})
UNKNOWN_DENSITY = 150.0
"""Mass of an unknown thing over the volume of its bounding box [kg/m^3]: most household things are 50 to 500."""


@dataclass(frozen=True, slots=True)
class Prior:
    """What is known of the object from its name."""

    name: str
    size: tuple[float, float, float]
    """Extents, largest first [m]."""
    spread: float
    mass: float
    """[kg]."""
    hollow: bool
    notes: tuple[str, ...]


def object_thing(theme: Noun | None, label: str) -> Thing | None:
    """What the object is: the prompt's word, or the file's where that is more specific or the prompt says none."""
    said = things().get(theme.thing) if theme is not None else None
    filed = thing_of(label)
    if said is None:
        return filed
    if filed is not None and (said.id in GENERIC or is_a(filed.id, said.id)):
        return filed
    return said


def prior_of(theme: Noun | None, label: str, size: tuple[float, float, float]) -> Prior:
    """The prior for an object whose mesh has these extents [m]."""
    thing = object_thing(theme, label)
    if thing is not None:
        return Prior(thing.id, thing.size, thing.spread, thing.mass, thing.hollow, mismatch(theme, label, thing))
    name = theme.text.removeprefix("the ").removeprefix("a ") if theme is not None and not theme.pronoun else label
    mass = max(1e-3, UNKNOWN_DENSITY * size[0] * size[1] * size[2])
    note = f"{name!r} is not in the lexicon: the mesh keeps its size; {UNKNOWN_DENSITY:g} kg/m^3 of its box are assumed"
    return Prior(name, size, 1.0, mass, True, (note,))


def mismatch(theme: Noun | None, label: str, chosen: Thing) -> tuple[str, ...]:
    """A note where prompt and file speak of different things."""
    filed = thing_of(label)
    if theme is None or not theme.thing or filed is None or is_a(filed.id, chosen.id):
        return ()
    return (f"the prompt says {theme.thing!r}, the file is named {label!r}; the prompt counts",)
