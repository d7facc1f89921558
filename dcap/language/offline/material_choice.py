"""The offline choice of a material: by words for materials, the thing's own list, part name, category.

In: a part with its name, the whole thing, and the prompt. Out: the id of a library row and the reason. One row per
part, never a blend. The usual rows are listed in the lexicon (things.csv, parts.csv, usual_materials.csv).

Materials of the parts of a thing, by a word in its name: "leather sofa", "glass table", "mug made of steel".

In: words of a label or a prompt. Out: the row of the library for a part, or nothing: a glass table has a top of glass
and legs of something else, a leather sofa has cushions of leather over foam. `lexicon/families.csv` and `materials.csv`
assign words to families of materials, `lexicon/made_of.csv` assigns families to parts.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType

from dcap.language.material_table import FAMILIES, families, material_words
from dcap.language.offline.lexicon import (
    Words,
    in_line,
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
from dcap.language.offline.words import Token, tokens_of
from dcap.language.protocol.replies import MaterialChoice
from dcap.language.protocol.requests import MaterialQuestion, MaterialsRequest
from dcap.scene.errors import InputError
from dcap.scene.types.materials import Material

FAMILY_FILE = "lexicon/families.csv"
MADE_OF = "lexicon/made_of.csv"
EVERY = "*"
"""Stands for all parts."""
ADJECTIVAL = frozenset({"quality", "colour", "unknown", "thing", "part", "side", "number"})
"""Kinds of words that may stand between an article and its noun."""
OF = frozenset({"of", "from", "out of"})
USUAL = "lexicon/usual_materials.csv"
OBJECT = "object"
ALIKE = 3
"""Number of rows of a likely family that are offered for each row of another family [-]."""
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
    for row in rows(FAMILY_FILE):
        for phrase in listed(row["words"]):
            words = tuple(split_words(phrase))
            if words in found:
                raise InputError(f"{FAMILY_FILE}: {phrase!r} names {found[words].material} already")
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


def said_of_thing(prompt: str, whole: str, *, last: bool) -> list[str]:
    """Words before and after the prompt's word for a thing; around the last occurrence if there are two and `last`."""
    tokens = tokens_of(prompt)
    there = [i for i, t in enumerate(tokens) if any(in_line(v, whole) for v in t.values("thing"))]
    # an adjective may be a thing as well, "glass table": the noun is the one not followed by another noun
    nouns = [i for i in there if not (i + 1 < len(tokens) and tokens[i + 1].has("thing", "part"))]
    return around(tokens, nouns[-1 if last else 0], whole) if nouns else []


def said_of_part(prompt: str, part: str) -> list[str]:
    """Words before the prompt's word for a part."""
    tokens = tokens_of(prompt)
    return next((around(tokens, i, part) for i, t in enumerate(tokens) if part in parts_begun_by(t)), [])


def material_words_about(prompt: str, *wholes: str) -> set[str]:
    """Words of the prompt that name materials of these things."""
    found: set[str] = set()
    for index, whole in enumerate(wholes):
        said = said_of_thing(prompt, whole, last=index > 0) if whole else []
        found.update(word for named in materials_in(said, head=False) for word in named.phrase.split())
    return found


def parts_begun_by(token: Token) -> set[str]:
    """Parts that a phrase means, or with which it begins: "top of"."""
    first = vocabulary().get((token.text.split()[0],), frozenset()) if token.text.split() else frozenset()
    return {*token.values("part"), *(meaning.value for meaning in first if meaning.kind == "part")}


def around(tokens: Sequence[Token], index: int, name: str) -> list[str]:
    """Adjectives of a noun, followed by the noun; "made of X" counts as an adjective."""
    first = index
    while first > 0 and any(meaning.kind in ADJECTIVAL for meaning in tokens[first - 1].meanings):
        first -= 1
    before = [word for token in tokens[first : index + 1] for word in token.text.split()]
    return [*after(tokens, index), *without_id(before, name)]


def after(tokens: Sequence[Token], index: int) -> list[str]:
    """Words of "made of X" after a noun."""
    words = [word for token in tokens[index + 1 :] for word in token.text.split()]
    if words[:1] == ["made"]:
        words = words[1:]
    return words[1:4] if words[:1] and words[0] in OF else []


@dataclass(frozen=True, slots=True)
class UsualMaterial:
    """Usual material of parts of a thing."""

    thing: str
    """Id of the thing; empty: the fallback."""
    parts: tuple[str, ...]
    """Part names, or words of the fallback; `*`: all."""
    material: str


def chosen_materials(request: MaterialsRequest) -> Iterator[MaterialChoice]:
    """The material of each part and the reason."""
    known = {material.id for material in request.library}
    for question in request.questions:
        material, reason = material_of(question, known, said_of(question, request))
        yield MaterialChoice(body=question.body, part_index=question.part.index, material=material, reason=reason)


def shortlist(request: MaterialsRequest, most: int) -> tuple[Material, ...]:
    """Rows of the request's library for its parts, in the order of the library: for each part the row named by its name
    and the words, then rows of all families in turn, three of those families for each row of another, up to `most`."""
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
    """Words of the prompt about the whole or the part; empty for things that are neither object nor base."""
    is_object = question.body == OBJECT
    if not is_object and question.body != request.base_id:
        return []
    thing = thing_of(question.label)
    whole = said_of_thing(request.prompt, thing.id, last=not is_object) if thing else []
    return whole if is_object else [*said_of_part(request.prompt, question.part.name), *whole]


def material_of(question: MaterialQuestion, known: Collection[str], said: Collection[str] = ()) -> tuple[str, str]:
    """The row that words name for this part, else the usual row."""
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
    """The first rule that gives a row of the library for the whole and the part."""
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
