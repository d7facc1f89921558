"""Noun phrases: a head with its modifiers and its owner.

In: a cursor at the first token of a noun phrase. Out: a `Noun` that keeps every reading of its head; the scene decides
later between a thing, a part and a region ("back" of a sofa, "pillow", "shelf"). Grammar, as in `sentence`:

    noun     = simple [ GENITIVE noun ] { OF noun | COUNT | ID | NOW }  the bed's left corner, the second shelf
    simple   = { FILLER } { modifier | name | UNKNOWN }            a name as often as it comes: "bed corner"
    modifier = DET | SIDE | COLOUR | QUALITY | NUMBER | BOTH
    name     = THING | PART | REGION | PRONOUN | ONE | VIEWER | ID
"""

from dataclasses import dataclass, replace

from dcap.knowledge.lexicon import is_a, is_for, part_words
from dcap.language.offline.words import Token, TokenCursor

MODIFIERS = ("det", "side", "colour", "quality", "number", "both")
NOUNS = ("thing", "part", "region")
SAYING = (*MODIFIERS[1:], *NOUNS, "pronoun", "one", "viewer", "id", "unknown")
"""Kinds of tokens that can make a noun phrase alone; an article cannot."""
OUTER = frozenset({"edge", "end", "long_edge", "side", "head", "foot"})
"""Regions at the rim of a surface."""
STARTS = ("det", *SAYING)
"""Kinds of tokens with which a noun phrase may start."""


@dataclass(frozen=True, slots=True)
class Noun:
    """A noun phrase with all possible meanings of its head."""

    text: str
    name: str = ""
    """Its own words without article, sides, colour and owner: words that may occur in a label."""
    thing: str = ""
    """Thing id; empty if the head is not a thing."""
    parts: tuple[str, ...] = ()
    """Part ids that the head may mean."""
    region: str = ""
    """Region that the head may mean: center, middle, edge, corner, side, head, foot, any."""
    pronoun: str = ""
    """it, one or viewer."""
    sides: tuple[str, ...] = ()
    """left, top, 2, largest ... before the head, or the head itself ("the left")."""
    colour: str = ""
    owner: "Noun | None" = None
    """The whole of "part of whole"."""
    plural: bool = False
    toward: "Noun | None" = None
    """Thing that it faces: "the edge facing the sofa"."""
    encloses: bool = False
    """Whether one puts things into it, not onto it: a drawer, a basket."""
    id: str = ""
    """Id of the instance: "the chair with id chair_2"."""
    whichever: bool = False
    """Whether any one will do: "any chair", "one of the chairs"."""
    modifiers: tuple[str, ...] = ()
    """Words before the head other than article, side, colour or number: "single", "wooden"."""

    @property
    def is_region(self) -> bool:
        """Whether it can only mean a region ("the left", "the far corner")."""
        named = self.thing or self.parts or self.pronoun or self.id
        return not named and bool(self.region or self.sides)

    @property
    def is_unknown(self) -> bool:
        """Whether the head is an unknown word."""
        return not (self.thing or self.parts or self.region or self.pronoun or self.sides or self.id)


def at_noun(cursor: TokenCursor, ahead: int = 0) -> bool:
    """Return whether a noun phrase starts here, or `ahead` tokens further; fillers and articles alone do not count."""
    while cursor.here("filler", "det", ahead=ahead) and not cursor.here(*SAYING, ahead=ahead):
        ahead += 1
    return starts(cursor, ahead)


def starts(cursor: TokenCursor, ahead: int = 0) -> bool:
    """Return whether a noun phrase can start with this very token."""
    relation = cursor.here("relation", ahead=ahead) and not cursor.here("side", ahead=ahead)
    return cursor.here(*STARTS, ahead=ahead) and not relation and not cursor.here("conj", ahead=ahead)


def noun_phrase(cursor: TokenCursor) -> Noun:
    """simple [ GENITIVE noun ] { OF noun | COUNT }."""
    begin = cursor.index
    noun = simple(cursor)
    if cursor.here("genitive") and at_noun(cursor, 1):
        cursor.take()
        noun = owned(noun_phrase(cursor), noun)
    while True:
        if cursor.here("of") and at_noun(cursor, 1):
            cursor.take()
            noun = owned(noun, noun_phrase(cursor))
        elif cursor.here("count") and counted(noun) and not starts(cursor, 1):
            noun = counting(noun, cursor.take().value("count"))
        elif cursor.here("id word") and cursor.here("id", ahead=1):
            cursor.take()
            noun = replace(noun, id=cursor.take().value("id"))
        elif cursor.here("now") and not cursor.here("now", ahead=-1):  # "the shelf with nothing on it"
            noun = replace(noun, sides=(*noun.sides, cursor.take().value("now")))
        else:
            return replace(noun, text=cursor.text(begin))


def simple(cursor: TokenCursor) -> Noun:
    """{ FILLER } { modifier | name | UNKNOWN }."""
    begin = cursor.index
    words: list[Token] = []
    while not cursor.at_end:
        if skipped(cursor, words):
            cursor.take()
        elif begin > 0 and cursor.tokens[begin - 1].has("verb") and says_again(cursor):
            break  # "put the book back on the shelf"
        elif goes_on(cursor, words):
            words.append(cursor.take())
        else:
            break
    return noun_of(words, cursor.text(begin))


def says_again(cursor: TokenCursor) -> bool:
    """Return whether "back" comes next and only means that something was there before, because a place follows."""
    again = cursor.tokens[cursor.index].text == "back" and cursor.here("thing", "pronoun", "verb", ahead=-1)
    return again and cursor.value("relation", ahead=1) in ("on", "in", "under")


def skipped(cursor: TokenCursor, words: list[Token]) -> bool:
    """Return whether a filler before the name ("the very edge"), or the word between two colours ("yellow and white"),
    was skipped."""
    if cursor.here("conj"):
        return bool(words) and words[-1].has("colour") and cursor.here("colour", ahead=1)
    filler = cursor.here("filler") and not cursor.here(*STARTS)
    return filler and at_noun(cursor, 1) and not any(word.has(*NOUNS) for word in words)


def goes_on(cursor: TokenCursor, words: list[Token]) -> bool:
    """Return whether the token still belongs to the phrase: after its name, articles and verbs do not."""
    if not starts(cursor) or (cursor.here("verb") and words and not cursor.here("side", *NOUNS)):
        return False
    named = any(word.has(*NOUNS) and not word.has("det") for word in words)
    return not (named and cursor.here("det", "pronoun", "number") and not cursor.here("id"))


def noun_of(words: list[Token], text: str) -> Noun:
    """The noun phrase formed by these tokens: the last noun is the head, an earlier thing its owner."""
    several = any(t.has("number", "both") or t.value("pronoun") == "them" for t in words)
    index = next((i for i in range(len(words) - 1, -1, -1) if words[i].has(*NOUNS)), None)
    if index is None:
        sides = tuple(t.value("side") for t in words if t.has("side"))
        said = sides or any(t.has("unknown") for t in words)
        kinds = ("one", "viewer") if said else ("one", "viewer", "pronoun")
        pronoun = next((kind for kind in kinds if any(t.has(kind) for t in words)), "")
        pronoun = "it" if pronoun == "pronoun" else pronoun
        name, colour = name_of(words), colour_of(words)
        return Noun(text, name, pronoun=pronoun, sides=sides, colour=colour, plural=several, id=id_of(words))
    head, before = words[index], words[:index]
    if any(is_for(head.value("thing"), token.text) for token in words[index + 1 : index + 2]):
        return Noun(text, name_of(words), colour=colour_of(before), plural=several)
    sides = tuple(t.value("side") for t in before if t.has("side") and not t.has("thing"))
    return Noun(
        text=text,
        name=name_of(words[: index + 1]),
        thing=head.value("thing"),
        parts=head.values("part"),
        region=head.value("region"),
        sides=sides or ((head.value("side"),) if head.has("side") and not head.has("region") else ()),
        colour=colour_of(before),
        owner=owner_before(head, before),
        plural=several or head.plural(),
        encloses=head.has("encloses"),
        id=id_of(words),
        whichever=any(t.value("det") == "any" for t in before),
        modifiers=tuple(t.text for t in before if t.has("quality", "unknown") and not t.has("side", "colour", "id")),
    )


def id_of(words: list[Token]) -> str:
    """The id among the words; empty if there is none."""
    return next((t.value("id") for t in words if t.has("id")), "")


def name_of(words: list[Token]) -> str:
    """Name among the words, without article, sides, colour and number; the last word counts as the head."""
    kept = [t for t in words[:-1] if not t.has("det", "side", "colour", "number", "both")]
    return " ".join(t.text for t in (*kept, *words[-1:]))


def owner_before(head: Token, before: list[Token]) -> Noun | None:
    """The thing named before a part or region: "bed corner", "sofa arm"."""
    things = [t for t in before if t.has("thing") and not t.has("side", "quality")]
    if not things or not head.has("part", "region"):
        return None
    return Noun(things[-1].text, things[-1].text, thing=things[-1].value("thing"), parts=things[-1].values("part"))


def colour_of(words: list[Token]) -> str:
    """The first colour, unless it is also a noun ("orange")."""
    return next((t.value("colour") for t in words if t.has("colour")), "")


def owned(noun: Noun, owner: Noun) -> Noun:
    """The noun with its owner; "the corner of the cushion of the sofa" belongs to the cushion, "the smaller of the two
    tables" is a table."""
    if noun.is_region and not noun.region and owner.plural:
        pronoun = "" if owner.thing or owner.parts else "one"
        return replace(owner, sides=noun.sides, plural=False, pronoun=pronoun)
    if noun.region in ("center", "middle") and noun.owner is None and owner.region in OUTER:
        return owner  # "the middle of the long edge" is the edge, whose middle is the aim
    innermost = owned(noun.owner, owner) if noun.owner is not None else owner
    return replace(noun, owner=innermost)


def counted(noun: Noun) -> bool:
    """Return whether a noun is "the second one" of several."""
    return any(side.isdigit() for side in noun.sides)


def counting(noun: Noun, where: str) -> Noun:
    """ "the second shelf from the top"."""
    return replace(noun, sides=tuple(f"{side} from {where}" if side.isdigit() else side for side in noun.sides))


def thing_and_region(noun: Noun) -> bool:
    """Return whether there are two nouns side by side of which the second is only a region: "mug dead centre"."""
    return noun.is_region and noun.owner is not None and noun.name.startswith(noun.owner.name)


def several(one: Noun, other: Noun) -> Noun:
    """Two things to be moved."""
    return replace(one, text=f"{one.text} and {other.text}", name=f"{one.name} and {other.name}", plural=True)


def belongs(theme: Noun | None, whole: Noun) -> bool:
    """Return whether the moved thing usually belongs to such a thing: a blanket at the foot of the bed lies on the
    bed."""
    owners = {one for part in theme.parts for one in part_words()[part].owners} if theme is not None else set()
    return any(is_a(whole.thing, one) for one in owners)


def is_place_alone(noun: Noun) -> bool:
    """Return whether a noun without a relation can only be a region; "left side" is not a board at the side."""
    return noun.is_region or bool(noun.region == "side" and noun.sides and not noun.thing and noun.owner is None)


def is_bare_side(noun: Noun) -> bool:
    """Return whether a noun is "the side" of nothing in particular."""
    return noun.region == "side" and not (noun.sides or noun.thing or noun.owner)


def is_front(noun: Noun, theme: Noun | None) -> bool:
    """Return whether a noun is a side of the moved thing that can face something: "its screen towards the window"."""
    parts = [part_words()[part] for part in noun.parts if part_words()[part].front]
    whole = theme.thing if theme is not None else ""
    own = not whole or any(is_a(whole, owner) for part in parts for owner in part.owners)
    return bool(parts) and own
