"""The usual material of a part of a thing: by words for materials, the thing's own list, part name, category.

In: the label of a thing and the name of its part. Out: the id of a library row and the reason. One row per part, never
a blend. The usual rows are listed in the lexicon (things.csv, parts.csv, usual_materials.csv).

Words in the label count: "leather sofa", "glass table". A glass table has a top of glass and legs of something else, a
leather sofa has cushions of leather over foam: `lexicon/families.csv` and `materials.csv` assign words to families of
materials, `lexicon/made_of.csv` assigns families to parts.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType

from dcap.knowledge.lexicon import (
    FAMILY_WORDS,
    Words,
    is_a,
    label_words,
    lineage,
    part_words,
    rows,
    split_words,
    thing_of,
    things,
    vocabulary,
)
from dcap.knowledge.material_table import families, material_words
from dcap.scene.errors import InputError

MADE_OF = "lexicon/made_of.csv"
EVERY = "*"
"""Stands for all parts."""
USUAL = "lexicon/usual_materials.csv"
VAGUE_PARTS = frozenset({"body", "base", "head", "handle", "top", "side"})
"""Names of parts that say nothing about the material unless the whole thing is known."""


@dataclass(frozen=True, slots=True)
class MaterialPhrase:
    """A material named by the user or a label."""

    phrase: str
    material: str
    """Id of the row that it means on its own."""
    family: str
    generic: bool
    """Whether it names a family (wooden), not a row (oak)."""


@dataclass(frozen=True, slots=True)
class MaterialRule:
    """The parts that a family of materials applies to."""

    family: str
    owners: tuple[str, ...]
    """Things to which the parts belong; empty: all."""
    parts: tuple[str, ...]
    """Part names; empty: none, `*`: all."""
    material: str
    """The row for such a part; empty: the named one."""


@cache
def material_rules() -> tuple[MaterialRule, ...]:
    """Rows of made_of.csv; the first one that matches family, owner and part counts."""
    return tuple(
        MaterialRule(row["family"], listed(row["owners"]), listed(row["parts"]), row["material"])
        for row in rows(MADE_OF)
    )


def listed(text: str) -> tuple[str, ...]:
    """Entries of a cell."""
    return tuple(one for one in text.split("|") if one)


@cache
def named_phrases() -> Mapping[Words, MaterialPhrase]:
    """Every word or phrase that names a material."""
    found: dict[Words, MaterialPhrase] = {}
    for phrase, material in material_words().items():
        found[tuple(split_words(phrase))] = MaterialPhrase(phrase, material, families()[material], generic=False)
    for row in rows(FAMILY_WORDS):
        for phrase in listed(row["words"]):
            words = tuple(split_words(phrase))
            if words in found:
                raise InputError(f"{FAMILY_WORDS}: {phrase!r} names {found[words].material} already")
            found[words] = MaterialPhrase(phrase, row["material"], row["family"], generic=True)
    return MappingProxyType(found)


def materials_in(words: Sequence[str], *, head: bool) -> Iterator[MaterialPhrase]:
    """Materials named by the words, the longest phrase at each place, without colours; the last word names the thing
    itself and only counts as a material if `head`."""
    known = named_phrases()
    begin = 0
    while begin < len(words):
        ends = range(len(words), begin, -1)
        phrase = next((p for end in ends if (p := tuple(words[begin:end])) in known), ())
        alone = begin == len(words) - 1
        if phrase and (head if alone else not is_colour(phrase)):
            yield known[phrase]
        begin += max(1, len(phrase))


def is_colour(words: Words) -> bool:
    """Return whether a phrase is also a colour: a silver laptop is not of silver."""
    return any(meaning.kind == "colour" for meaning in vocabulary().get(words, ()))


def row_of_part(named: MaterialPhrase, whole: str, part: str, usual: str) -> str:
    """The row for a part of a thing that is named after a material; empty if the part is not meant.

    The name of a family ("wooden") keeps the part's usual row if that belongs to the family.
    """
    for row in material_rules():
        if row.family != named.family or not (not row.owners or any(is_a(whole, owner) for owner in row.owners)):
            continue
        if not row.parts:
            return ""
        if part in row.parts or EVERY in row.parts:
            chosen = row.material or named.material
            return usual if named.generic and families().get(usual) == families()[chosen] else chosen
    return ""


def without_id(words: Sequence[str], whole: str) -> list[str]:
    """The words without those with which the thing's own name begins: a rubber duck need not be of rubber."""
    own = split_words(whole)
    for begin in range(len(words) - len(own) + 1):
        if len(own) > 1 and list(words[begin : begin + len(own)]) == own:
            return [*words[:begin], *words[begin + len(own) - 1 :]]
    return list(words)


@dataclass(frozen=True, slots=True)
class UsualMaterial:
    """Usual material of parts of a thing."""

    thing: str
    """Id of the thing; empty: the fallback."""
    parts: tuple[str, ...]
    """Part names, or words of the fallback; `*`: all."""
    material: str


def material_of(label: str, part: str, known: Collection[str], said: Collection[str] = ()) -> tuple[str, str]:
    """The row for a part of a labelled thing, and the reason: the row that words name, else the usual row.

    Args:
        label: label of the whole.
        part: name of the part.
        known: ids of the library's rows.
        said: words of the prompt about the part or the whole.
    """
    usual, reason = usual_material(label, part, known)
    thing = thing_of(label)
    whole = thing.id if thing else ""
    own = without_id(label_words(label), whole)
    for source, words in (("prompt", list(said)), ("part", label_words(part)), ("label", own)):
        for named in materials_in(words, head=False):
            row = row_of_part(named, whole, part, usual)
            if row in known:
                return row, f"the {source} says {named.phrase!r}: the {part} is meant"
    return usual, reason


def usual_material(label: str, name: str, known: Collection[str]) -> tuple[str, str]:
    """The first rule that gives a row of the library for the whole and the part of that name."""
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
    """Parts named by the last words of a label: a mattress without its bed."""
    meanings = [vocabulary().get(tuple(words[begin:]), frozenset()) for begin in range(len(words))]
    return [meaning.value for found in meanings for meaning in sorted(found) if meaning.kind == "part"]


@cache
def usual_rows(thing: str) -> tuple[UsualMaterial, ...]:
    """Rows of usual_materials.csv for one thing, in order of precedence; the fallback for an empty thing."""
    found = [UsualMaterial(row["thing"], listed(row["parts"]), row["material"]) for row in rows(USUAL)]
    for one in found:
        if one.material not in families():
            raise InputError(f"{USUAL}: {one.material!r} is not in materials.csv")
    return tuple(one for one in found if one.thing == thing)
