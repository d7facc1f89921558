"""The vocabulary: things with sizes and masses, parts, and phrases, from CSV files next to it.

In: `lexicon/*.csv`. Out: frozen rows, and a vocabulary that maps word sequences to their possible meanings. The files
hold every word with a meaning in the grammar; the grammar's code only knows kinds of words. Words that need their own
rule (a container's opening, a colour's sRGB value) are in a table next to that rule.
"""

import csv
import math
import re
import unicodedata
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import MappingProxyType

from dcap.scene.errors import InputError
from dcap.scene.text import says_something

FOLDER = Path(__file__).resolve().parent
THINGS = "lexicon/things.csv"
PARTS = "lexicon/parts.csv"
PHRASES = "lexicon/phrases.csv"
DEFAULTS = "lexicon/defaults.csv"
FAMILY_WORDS = "lexicon/families.csv"
OPPOSITES = "lexicon/opposites.csv"
Words = tuple[str, ...]
Size = tuple[float, float, float]
ESTIMATE = "estimate"
ROOM = "room"
ARROW = re.compile(r"\s*(?:[-=]+>|\N{RIGHTWARDS ARROW})\s*")
WORD_OR_MARK = re.compile(r"(?<!\S)-\d+(?:\.\d+)?|\d+\.\d+|[^\W_]+|[,.;:!?]")
"""Words and numbers, and the marks that separate clauses."""
SOURCE = re.compile(r"size: (?P<size>\S+); mass: (?P<mass>\S+)|(?P<both>\S+)")
"""A single source for both, or one for each."""


@dataclass(frozen=True, slots=True)
class Thing:
    """A category of household things."""

    id: str
    parent: str
    """More general category, or empty."""
    sizes: tuple[Size, ...]
    """Typical extents, largest first [m]; several if it occurs in several shapes: folded and spread out, closed and
    open, rolled up and laid out."""
    spread: float
    """Factor within which real sizes lie: between size / spread and size * spread [-]."""
    mass: float
    """Typical mass at that size [kg]."""
    hollow: bool
    """Whether its mass differs from density times the volume of its closed mesh."""
    rest: str
    """Default rest pose: upright, flat or any."""
    materials: Mapping[str, str]
    """Material id by part name."""
    size_source: str
    """Address of a page that states the main dimension (length, height or diameter), or `estimate`."""
    mass_source: str
    """Address of a page that states the mass, or `estimate`."""

    @property
    def size(self) -> Size:
        """Extents of the most usual shape, largest first [m]."""
        return self.sizes[0]


@dataclass(frozen=True, slots=True)
class PartWord:
    """A kind of part."""

    id: str
    owners: tuple[str, ...]
    """Things that have such a part."""
    material: str
    """Usual material id."""
    front: bool
    """Whether the part faces a target when the whole thing does: a screen, an eye."""


@dataclass(frozen=True, slots=True, order=True)
class Meaning:
    """One possible meaning of a phrase."""

    kind: str
    """thing, part, verb, relation, region, side, pose, face, ..."""
    value: str
    plural: bool = False


def rows(name: str) -> Iterator[dict[str, str]]:
    """Rows of one lexicon file."""
    with (FOLDER / name).open(newline="", encoding="utf-8") as text:
        for row in csv.DictReader(text):
            if None in row or None in row.values():
                raise InputError(f"{FOLDER / name}: row {next(iter(row.values()))!r} has a wrong number of fields")
            yield row


@cache
def things() -> Mapping[str, Thing]:
    """All things by id."""
    found: dict[str, Thing] = {}
    for row in rows(THINGS):
        if row["id"] in found:
            raise InputError(f"{FOLDER / THINGS}: {row['id']!r} is listed twice")
        try:
            found[row["id"]] = thing_row(row)
        except ValueError as error:
            raise InputError(f"{FOLDER / THINGS}: row {row['id']!r}: {error}") from error
    return MappingProxyType(found)


def thing_row(row: Mapping[str, str]) -> Thing:
    """One row of things.csv; raises ValueError for an invalid field."""
    spread, mass = float(row["spread"]), float(row["mass_kg"])
    if not (1.0 <= spread <= 5.0 and 0.0 < mass < math.inf):
        raise ValueError(f"spread {spread:g} is not within 1 to 5 or mass {mass:g} kg is not positive")
    size_source, mass_source = sources_of(row["source"])
    pairs = (entry.split("=") for entry in row["materials"].split("|") if entry)
    return Thing(
        id=row["id"],
        parent=row["parent"],
        sizes=tuple(size_of(size) for size in row["size_m"].split("|")),
        spread=spread,
        mass=mass,
        hollow=row["hollow"] == "1",
        rest=row["rest"],
        materials=MappingProxyType(dict(pairs)),
        size_source=size_source,
        mass_source=mass_source,
    )


def size_of(text: str) -> Size:
    """Extents such as 0.3x0.2x0.1, largest first [m]."""
    extents = sorted((float(extent) for extent in text.split("x")), reverse=True)
    if len(extents) != 3 or not 0.0 < extents[2] <= extents[0] < math.inf:
        raise ValueError(f"size {text!r} is not three positive metres, 0.3x0.2x0.1")
    return extents[0], extents[1], extents[2]


def sources_of(text: str) -> tuple[str, str]:
    """Sources of size and mass: `estimate` or an address for both, or `size: ...; mass: ...`."""
    match = SOURCE.fullmatch(text)
    found = (match["size"] or match["both"], match["mass"] or match["both"]) if match else ("", "")
    if not all(one == ESTIMATE or re.match(r"https?://[^/]+/", one) for one in found):
        raise ValueError(f"source {text!r} is neither 'estimate', nor an address, nor 'size: ...; mass: ...' of these")
    return found


@cache
def part_words() -> Mapping[str, PartWord]:
    """All kinds of parts by id."""
    return MappingProxyType(
        {
            row["id"]: PartWord(row["id"], tuple(row["owners"].split("|")), row["material"], row["front"] == "1")
            for row in rows(PARTS)
        }
    )


@cache
def default_parts() -> Mapping[str, tuple[str, ...]]:
    """Parts of a base that carry things, best first."""
    return MappingProxyType({row["base"]: tuple(row["parts"].split("|")) for row in rows(DEFAULTS)})


def first_part(thing_id: str) -> str:
    """The first carrying part of a thing, or of its nearest kind with an entry; empty if unknown."""
    return next((default_parts()[one][0] for one in lineage(thing_id) if one in default_parts()), "")


@cache
def inside_parts() -> Mapping[str, str]:
    """The part that `in` means."""
    return MappingProxyType({row["base"]: row["inside"] for row in rows(DEFAULTS) if row["inside"]})


def lineage(thing_id: str) -> Iterator[str]:
    """The thing, its parent, its parent's parent ..."""
    while thing_id:
        yield thing_id
        thing_id = things()[thing_id].parent if thing_id in things() else ""


def is_a(thing_id: str, ancestor: str) -> bool:
    """Return whether a category is `ancestor` or a kind of it."""
    return ancestor in lineage(thing_id)


def in_line(thing_id: str, other: str) -> bool:
    """Return whether one of two categories is the other or a kind of it."""
    return is_a(thing_id, other) or is_a(other, thing_id)


def plural(word: str) -> str:
    """Regular English plural of the last word."""
    if re.search(r"(s|x|z|ch|sh)$", word):
        return word + "es"
    if re.search(r"[^aeiou]y$", word):
        return word[:-1] + "ies"
    return word + "s"


def split_words(text: str) -> list[str]:
    """Lower-case words; marks that separate clauses are returned as `,`."""
    plain = unicodedata.normalize("NFKC", text).casefold().replace("\N{DEGREE SIGN}", " degrees ")
    plain = ARROW.sub(" onto ", plain)  # "towel -> stool"
    return [w if w[-1].isalnum() else "," for w in WORD_OR_MARK.findall(plain)]


@cache
def vocabulary() -> Mapping[Words, frozenset[Meaning]]:
    """Possible meanings of every known phrase."""
    found: dict[Words, set[Meaning]] = {}

    def add(text: str, kind: str, value: str, *, is_plural: bool = False) -> None:
        if text:
            found.setdefault(tuple(split_words(text)), set()).add(Meaning(kind, value, is_plural))

    for kind, file in (("thing", THINGS), ("part", PARTS)):
        for row in rows(file):
            names = [row["id"], *(name for name in row["synonyms"].split("|") if name)]
            for name in names:
                add(name, kind, row["id"])
            irregular = row["plural"]
            add(irregular, kind, row["id"], is_plural=True)
            for name in names[1 if irregular else 0 :]:
                words = tuple(split_words(plural(name)))
                if all(meaning.plural for meaning in found.get(words, ())):  # "glasses" keeps its own meaning
                    add(plural(name), kind, row["id"], is_plural=True)
    for row in rows(PHRASES):
        for text in row["phrases"].split("|"):
            add(text, row["kind"], row["value"])
    return MappingProxyType({words: frozenset(meanings) for words, meanings in found.items()})


@cache
def longest_phrase() -> int:
    """Words in the longest known phrase."""
    return max(len(words) for words in vocabulary())


def label_words(label: str) -> list[str]:
    """Words of a file stem, node name or label: 'TableLamp_02' -> ['table', 'lamp']."""
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", label)
    words = split_words(re.sub(r"[\d_]+", " ", spaced))
    return words[: words.index("with")] if "with" in words[1:] else words


def is_for(thing_id: str, following: str) -> bool:
    """Return whether an unknown word after a food names a tool for it: a cheese grinder is not cheese."""
    known = (following,) in vocabulary()
    return not known and re.fullmatch(r"[a-z]{3,}(er|or)s?", following) is not None and is_a(thing_id, "food")


def thing_of(label: str) -> Thing | None:
    """The thing named by a label's longest known phrase, the last one on a tie; None for a tool named after food."""
    words = label_words(label)
    best: tuple[int, int, str] | None = None
    for begin in range(len(words)):
        for end in range(begin + 1, len(words) + 1):
            for meaning in sorted(vocabulary().get(tuple(words[begin:end]), ())):
                if meaning.kind == "thing" and (best is None or (end - begin, end) >= best[:2]):
                    best = (end - begin, end, meaning.value)
    if best is None or any(is_for(best[2], word) for word in words[best[1] : best[1] + 1]):
        return None
    return things()[best[2]]


def names_thing(name: str) -> bool:
    """Return whether the name of a node or a file has a word for a thing; words for a whole room do not count, nor do
    those inserted by modelling tools (a cube)."""
    thing = thing_of(name) if says_something(name) else None
    return thing is not None and thing.id != ROOM
