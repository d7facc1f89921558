"""Noun phrases: a head with what stands before it and whose it is.

In: the tokens of one phrase. Out: a `Noun` that keeps every reading of its head; the scene decides later between a
thing, a
part and a region ("back" of a sofa, "pillow", "shelf").
"""

from dataclasses import dataclass

from language.words import Token

MODIFIERS = ("det", "side", "colour", "quality", "number", "both")
NOUNS = ("thing", "part", "region")


@dataclass(frozen=True, slots=True)
class Noun:
    """A noun phrase with all that its head may mean."""

    text: str
    thing: str = ""
    """Thing id, empty if the head is none."""
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
    unknown: tuple[str, ...] = ()
    """Words in it that are not known."""

    @property
    def is_region(self) -> bool:
        """Whether it can only mean a region ("the left", "the far corner")."""
        return not self.thing and not self.parts and not self.pronoun and bool(self.region or self.sides)

    @property
    def is_unknown(self) -> bool:
        """Whether the head is a word that nobody taught us."""
        return not (self.thing or self.parts or self.region or self.pronoun or self.sides)


def replaced(noun: Noun, *, text: str = "", owner: Noun | None = None, sides: tuple[str, ...] | None = None) -> Noun:
    """The noun with something added."""
    innermost = noun.owner if noun.owner is not None else owner
    return Noun(
        text=text or noun.text,
        thing=noun.thing,
        parts=noun.parts,
        region=noun.region,
        pronoun=noun.pronoun,
        sides=noun.sides if sides is None else sides,
        colour=noun.colour,
        owner=innermost,
        plural=noun.plural,
        unknown=noun.unknown,
    )


def noun_of(words: list[Token], text: str) -> Noun:
    """The noun phrase that these tokens make: the last noun is the head, an earlier thing its owner."""
    unknown = tuple(t.text for t in words if t.has("unknown"))
    head_index = head_of(words)
    if head_index is None:
        sides = tuple(t.value("side") for t in words if t.has("side"))
        pronoun = next((kind for kind in ("one", "viewer") if any(t.has(kind) for t in words)), "")
        if not pronoun and not unknown and not sides and any(t.has("pronoun") for t in words):
            pronoun = "it"
        several = is_plural(words) or any(t.value("pronoun") == "them" for t in words)
        return Noun(text=text, pronoun=pronoun, sides=sides, colour=colour_of(words), plural=several, unknown=unknown)
    head, before = words[head_index], words[:head_index]
    sides = tuple(t.value("side") for t in before if t.has("side") and not t.has("thing"))
    owner = owner_of(head, before, text)
    return Noun(
        text=text,
        thing=head.value("thing"),
        parts=head.values("part"),
        region=head.value("region"),
        sides=sides + ((head.value("side"),) if head.has("side") and not head.has("region") and not sides else ()),
        colour=colour_of(before),
        owner=owner,
        plural=head.plural() or any(t.has("both") for t in before),
        unknown=unknown,
    )


def head_of(words: list[Token]) -> int | None:
    """Index of the last noun; a word that may be side or noun ("back", "top") counts as noun only at the end."""
    for index in range(len(words) - 1, -1, -1):
        if words[index].has(*NOUNS):
            return index
    return None


def owner_of(head: Token, before: list[Token], text: str) -> Noun | None:
    """The thing named before a part or region: "bed corner", "sofa arm"."""
    things = [t for t in before if t.has("thing") and not t.has("side", "quality")]
    if not things or not head.has("part", "region"):
        return None
    return Noun(text=things[-1].text, thing=things[-1].value("thing"), parts=things[-1].values("part"))


def colour_of(words: list[Token]) -> str:
    """The first colour, as long as it is not a noun as well ("orange")."""
    return next((t.value("colour") for t in words if t.has("colour")), "")


def is_plural(words: list[Token]) -> bool:
    """Whether the words speak of several."""
    return any(t.has("number", "both") or t.plural() for t in words)
