"""The offline choice of a material: the thing's own list, part name, category, words; else a stated fallback.

In: a part with its name and what the whole is. Out: the id of a library row and why. One row per part, never a blend.
"""

from language.lexicon import is_a, lineage, part_words, thing_of, things
from language.materials import material_words
from language.replies import MaterialChoice
from language.requests import MaterialQuestion

FALLBACK_SOFT, FALLBACK_RIGID = "foam_seat", "wood_oak"
SOFT_WORDS = frozenset({"cushion", "pillow", "mattress", "plush", "towel", "blanket", "clothes", "sofa", "bed"})


def chosen_material(question: MaterialQuestion, known: set[str]) -> MaterialChoice:
    """The material of one part and why."""
    material, reason = material_of(question, known)
    return MaterialChoice(body=question.body, part_index=question.part.index, material=material, reason=reason)


def material_of(question: MaterialQuestion, known: set[str]) -> tuple[str, str]:
    """First rule that gives a row of the library."""
    name, label = question.part.name, question.label
    thing = thing_of(label)
    whole = thing.id if thing else ""
    kinds = [things()[one] for one in lineage(whole) if one in things()]
    for one in kinds:
        if one.materials.get(name) in known:
            return one.materials[name], f"the {name} of a {one.id}"
    structure = {"floor": "laminate", "wall": "plaster", "ceiling": "plaster", "window": "glass", "door": "wood_pine"}
    if structure.get(whole) in known:
        return structure[whole], f"a {whole} indoors"
    if is_a(whole, "bathtub") and "acrylic" in known:
        return "acrylic", "a bathtub"
    if name in part_words() and part_words()[name].material in known:
        owned = any(is_a(whole, owner) for owner in part_words()[name].owners)
        telling = not whole and name not in ("body", "base", "head", "handle", "top", "side")
        if owned or telling or is_a(whole, "furniture"):
            return part_words()[name].material, f"usual for a part named {name}"
    for one in kinds:
        if one.materials.get("body") in known:
            return one.materials["body"], f"usual for a {one.id}"
    for word in (name, label.lower(), *label.lower().split()):
        if material_words().get(word) in known:
            return material_words()[word], f"the word {word!r} names it"
    if SOFT_WORDS & {*label.lower().split(), name}:
        return FALLBACK_SOFT, f"fallback for soft things: nothing is known of {name!r} of {label!r}"
    return FALLBACK_RIGID, f"fallback: nothing is known of {name!r} of {label!r}"
