"""Which things of a scene give way under what is put on them, by their labels alone.

The paper counts deformable supports per scene (its figure 3): beds, sofas, cushions, blankets and so on. Here a label
counts if the lexicon knows it as one of KINDS, or as furniture that carries, and the library's material of the part
that carries is soft: its Young's modulus does not exceed 1 GPa. Nothing is measured: a scan may hold a wooden bed.
"""

from collections import Counter
from collections.abc import Iterable, Sequence
from functools import cache

from dcap.language.material_table import load_materials
from dcap.language.offline.lexicon import first_part, is_a, label_words, thing_of
from dcap.language.offline.material_choice import material_of, parts_named
from dcap.language.protocol.requests import MaterialQuestion, PartView

RIGID_ABOVE = 1.0e9
"""Young's modulus above which a part is rigid [Pa]; the paper's 1 GPa."""

MATTRESS = "mattress"
"""A part that scenes annotate by itself."""

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
"""Kinds of deformable supports and the things that belong to each, in the order in which they are shown."""

OTHER = "other"
"""Furniture that carries softly and is none of KINDS."""


def deformable_supports(labels: Iterable[str]) -> Counter[str]:
    """How many of the labels are deformable supports, by kind."""
    return Counter(kind for label in labels if (kind := deformable_kind(label)))


@cache
def deformable_kind(label: str) -> str:
    """The kind of deformable support that a label names; empty if it names none."""
    thing = thing_of(label)
    if thing is None:
        return MATTRESS if MATTRESS in parts_named(label_words(label)) and _is_soft(label, MATTRESS) else ""
    kind = next((kind for kind, things in KINDS.items() if any(is_a(thing.id, one) for one in things)), "")
    if not kind and not is_a(thing.id, "furniture"):
        return ""
    return (kind or OTHER) if _is_soft(label, first_part(thing.id) or "body") else ""


def deformable_materials(things: Iterable[tuple[str, Sequence[str]]]) -> Counter[str]:
    """How many parts are made of each deformable material of the library, for things given by label and names of parts;
    the material is the one that is usual for such a part of such a thing."""
    moduli = _moduli()
    tags = (_material(label, part) for label, parts in things for part in parts)
    return Counter(material for material in tags if moduli[material] <= RIGID_ABOVE)


def _is_soft(label: str, part: str) -> bool:
    """Whether the library's material for a part of a thing is not rigid."""
    return _moduli()[_material(label, part)] <= RIGID_ABOVE


@cache
def _material(label: str, part: str) -> str:
    """The id of the library's material for a part of a thing."""
    view = PartView(0, part, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    return material_of(MaterialQuestion("", label, view), set(_moduli()))[0]


@cache
def _moduli() -> dict[str, float]:
    return {name: material.youngs_modulus for name, material in load_materials().items()}
