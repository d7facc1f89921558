"""Materials of the parts of a thing, by a word of its name: "leather sofa", "glass table", "mug made of steel".

In: words of a label or a prompt. Out: the row of the library that a part is made of then, or nothing: a glass table
has a top of glass and legs of something else, a leather sofa has cushions of leather over foam. Which words belong to
which family of materials stands in `lexicon/families.csv` and `materials.csv`, which parts a family applies to in
`lexicon/made_of.csv`.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType

from dcap.language.material_table import families, material_words
from dcap.language.offline.lexicon import Words, in_line, is_a, rows, split_words, vocabulary
from dcap.language.offline.words import Token, tokens_of
from dcap.scene.errors import InputError

FAMILIES = "lexicon/families.csv"
MADE_OF = "lexicon/made_of.csv"
EVERY = "*"
"""All parts."""
ADJECTIVAL = frozenset({"quality", "colour", "unknown", "thing", "part", "side", "number"})
"""Kinds of words that may stand between an article and its noun."""
OF = frozenset({"of", "from", "out of"})


@dataclass(frozen=True, slots=True)
class MaterialPhrase:
    """A material that somebody named."""

    phrase: str
    material: str
    """Id of the row that it means by itself."""
    family: str
    generic: bool
    """Whether it names a family (wooden) and not a row (oak)."""


@dataclass(frozen=True, slots=True)
class MaterialRule:
    """The parts that a family of materials applies to."""

    family: str
    owners: tuple[str, ...]
    """Things whose parts they are; empty: all."""
    parts: tuple[str, ...]
    """Part names; empty: none, `*`: all."""
    material: str
    """The row that such a part has then; empty: the named one."""


@cache
def material_rules() -> tuple[MaterialRule, ...]:
    """Rows of made_of.csv; of those that fit a family, an owner and a part the first decides."""
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
    for row in rows(FAMILIES):
        for phrase in listed(row["words"]):
            words = tuple(split_words(phrase))
            if words in found:
                raise InputError(f"{FAMILIES}: {phrase!r} names {found[words].material} already")
            found[words] = MaterialPhrase(phrase, row["material"], row["family"], generic=True)
    return MappingProxyType(found)


def materials_in(words: Sequence[str], *, head: bool) -> Iterator[MaterialPhrase]:
    """Materials that the words name, the longest phrase at each place, colours left out; the last word is what the
    thing is and names a material only by itself if `head`."""
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
    """Whether it is a colour as well: a silver laptop is no silver."""
    return any(meaning.kind == "colour" for meaning in vocabulary().get(words, ()))


def row_of_part(named: MaterialPhrase, whole: str, part: str, usual: str) -> str:
    """The row that a part of a thing has when the thing is called after a material; empty if it is not meant.

    A family's name ("wooden") keeps the part's usual row where that is of the family.
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
    """The words without those that the thing's own name begins with: a rubber duck need not be of rubber."""
    own = split_words(whole)
    for begin in range(len(words) - len(own) + 1):
        if len(own) > 1 and list(words[begin : begin + len(own)]) == own:
            return [*words[:begin], *words[begin + len(own) - 1 :]]
    return list(words)


def said_of_thing(prompt: str, whole: str, *, last: bool) -> list[str]:
    """Words before and after the prompt's word for a thing; around the last one if it stands there twice and `last`."""
    tokens = tokens_of(prompt)
    there = [i for i, t in enumerate(tokens) if any(in_line(v, whole) for v in t.values("thing"))]
    # an adjective may be a thing as well, "glass table": the noun is the one that no other noun follows
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
    """Parts that a phrase means, or begins with: "top of"."""
    first = vocabulary().get((token.text.split()[0],), frozenset()) if token.text.split() else frozenset()
    return {*token.values("part"), *(meaning.value for meaning in first if meaning.kind == "part")}


def around(tokens: Sequence[Token], index: int, name: str) -> list[str]:
    """Adjectives of a noun, then itself; "made of X" counts as an adjective."""
    first = index
    while first > 0 and any(meaning.kind in ADJECTIVAL for meaning in tokens[first - 1].meanings):
        first -= 1
    before = [word for token in tokens[first : index + 1] for word in token.text.split()]
    return [*after(tokens, index), *without_id(before, name)]


def after(tokens: Sequence[Token], index: int) -> list[str]:
    """Words of "made of X" behind a noun."""
    words = [word for token in tokens[index + 1 :] for word in token.text.split()]
    if words[:1] == ["made"]:
        words = words[1:]
    return words[1:4] if words[:1] and words[0] in OF else []
