"""The offline choice of a material: what words say, the thing's own list, part name, category; else a stated fallback.

In: a part with its name, what the whole is, and the prompt. Out: the id of a library row and why. One row per part,
never a blend. Which row is usual for what stands in the lexicon (things.csv, parts.csv, usual_materials.csv).
"""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from functools import cache

from dcap.language.material_table import FAMILIES, families
from dcap.language.offline.lexicon import is_a, label_words, lineage, part_words, rows, thing_of, things, vocabulary
from dcap.language.offline.made_of import (
    EVERY,
    listed,
    materials_in,
    row_of_part,
    said_of_part,
    said_of_thing,
    without_id,
)
from dcap.language.protocol.replies import MaterialChoice
from dcap.language.protocol.requests import MaterialQuestion, MaterialsRequest
from dcap.scene.errors import InputError
from dcap.scene.types.materials import Material

USUAL = "lexicon/usual_materials.csv"
OBJECT = "object"
ALIKE = 3
"""Rows of a likely family that are offered for one of another [-]."""
VAGUE_PARTS = frozenset({"body", "base", "head", "handle", "top", "side"})
"""Names of parts that say nothing about the material as long as it is not known what the whole is."""


@dataclass(frozen=True, slots=True)
class UsualMaterial:
    """Material that parts of a thing are mostly made of."""

    thing: str
    """Empty: the fallback."""
    parts: tuple[str, ...]
    """Part names, or words of the fallback; `*`: all."""
    material: str


def chosen_materials(request: MaterialsRequest) -> Iterator[MaterialChoice]:
    """The material of each part and why."""
    known = {material.id for material in request.library}
    for question in request.questions:
        material, reason = material_of(question, known, said_of(question, request))
        yield MaterialChoice(body=question.body, part_index=question.part.index, material=material, reason=reason)


def shortlist(request: MaterialsRequest, most: int) -> tuple[Material, ...]:
    """Rows of the request's library that its parts may be made of, in the order of the library: for each part the row
    that its name and the words name, then rows of all families in turn, three of those families for one of another, up
    to `most`."""
    known = {row.id: row for row in request.library}
    chosen = dict.fromkeys(one.material for one in chosen_materials(request))
    near = dict.fromkeys(families()[one] for one in chosen)
    by_family = {kind: [row for row in known if families()[row] == kind] for kind in (*near, *FAMILIES)}
    for turn in range(len(known)):
        for kind, alike in by_family.items():
            count = ALIKE if kind in near else 1
            for row in alike[turn * count : (turn + 1) * count]:
                if len(chosen) < most:
                    chosen[row] = None
    return tuple(row for name, row in known.items() if name in chosen)


def said_of(question: MaterialQuestion, request: MaterialsRequest) -> list[str]:
    """Words of the prompt about the whole or the part; nothing is said of what is neither object nor base."""
    is_object = question.body == OBJECT
    if not is_object and question.body != request.base_id:
        return []
    thing = thing_of(question.label)
    whole = said_of_thing(request.prompt, thing.id, last=not is_object) if thing else []
    return whole if is_object else [*said_of_part(request.prompt, question.part.name), *whole]


def material_of(question: MaterialQuestion, known: Collection[str], said: Collection[str] = ()) -> tuple[str, str]:
    """The row that words name for this part, else the usual one."""
    usual, reason = usual_material(question, known)
    thing = thing_of(question.label)
    whole = thing.id if thing else ""
    label = without_id(label_words(question.label), whole)
    for source, words in (("prompt", list(said)), ("part", label_words(question.part.name)), ("label", label)):
        for named in materials_in(words, head=False):
            row = row_of_part(named, whole, question.part.name, usual)
            if row in known:
                return row, f"the {source} says {named.phrase!r}: the {question.part.name} is meant"
    return usual, reason


def usual_material(question: MaterialQuestion, known: Collection[str]) -> tuple[str, str]:
    """First rule that gives a row of the library, by what the whole and the part are."""
    name, label = question.part.name, question.label
    thing = thing_of(label)
    whole = thing.id if thing else ""
    kinds = [things()[one] for one in lineage(whole) if one in things()]
    for one in kinds:
        if one.materials.get(name) in known:
            return one.materials[name], f"the {name} of a {one.id}"
        for row in usual_rows(one.id):
            if (name in row.parts or EVERY in row.parts) and row.material in known:
                return row.material, f"usual for the {name} of a {one.id}"
    if name in part_words() and part_words()[name].material in known:
        owned = any(is_a(whole, owner) for owner in part_words()[name].owners)
        if owned or is_a(whole, "furniture") or (not whole and name not in VAGUE_PARTS):
            return part_words()[name].material, f"usual for a part named {name}"
    for one in kinds:
        if one.materials.get("body") in known:
            return one.materials["body"], f"usual for a {one.id}"
    words = label_words(label)
    for part in [] if whole else parts_named(words):
        if part_words()[part].material in known:
            return part_words()[part].material, f"usual for a {part}"
    for named in (*materials_in([name], head=True), *materials_in(words, head=True)):
        if named.material in known:
            return named.material, f"the word {named.phrase!r} names it"
    row = next(r for r in usual_rows("") if EVERY in r.parts or {*r.parts} & {*words, name})
    kind = "" if EVERY in row.parts else " for soft things"
    return row.material, f"fallback{kind}: nothing is known about {name!r} of {label!r}"


def parts_named(words: Sequence[str]) -> list[str]:
    """Parts that a label names, by its last words: a mattress without its bed."""
    meanings = [vocabulary().get(tuple(words[begin:]), frozenset()) for begin in range(len(words))]
    return [meaning.value for found in meanings for meaning in sorted(found) if meaning.kind == "part"]


@cache
def usual_rows(thing: str) -> tuple[UsualMaterial, ...]:
    """Rows of usual_materials.csv about one thing, in the order in which they count; the fallback for none."""
    found = [UsualMaterial(row["thing"], listed(row["parts"]), row["material"]) for row in rows(USUAL)]
    for one in found:
        if one.material not in families():
            raise InputError(f"{USUAL}: {one.material!r} is not in materials.csv")
    return tuple(one for one in found if one.thing == thing)
