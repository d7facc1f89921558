"""Content of a sentence, without a scene: its clauses, places, poses, turns, facings and the moved thing.

Plain values; `sentence` makes them from a prompt.

Turns about the vertical: "rotated by 90 degrees clockwise", "at a 45 degree angle", "diagonally".

In: a cursor among the tokens. Out: the number of tokens that state a turn, and the turn. Grammar, as in `sentence`:

    turn = { WORD } (TURNED | ANGLE [ "angle" ]) [ SENSE ] | TURN before a pose or facing, to which it adds nothing
    WORD = TURN | SENSE | "at" | "by" | DET

An angle alone is not a turn ("tilted by 30 degrees"): it needs a turn, a sense or "at".

Combines clauses into one reading: those that say where to go and name the moved thing, and those that are not a
placement.
"""

import math
from dataclasses import dataclass, field, replace

from dcap.knowledge.lexicon import label_words
from dcap.language.offline.nouns import Noun
from dcap.language.offline.words import Token, TokenCursor
from dcap.scene.errors import LanguageError

TURNS_TO = {"left": 1.0, "right": -1.0}
"""Sign of a turn to the left or right, counterclockwise seen from above."""
EXAMPLE = "say what to put where, for example: put the ball on the bed"
MIRRORED = {"left": "right", "right": "left"}
STANDS_BY_ITSELF = frozenset({"upside_down", "on_side", "on_left_side", "on_right_side", "on_back", "on_front"})
"""Poses that a thing keeps even if it rests against something."""


@dataclass(frozen=True, slots=True)
class Turn:
    """A turn about the vertical."""

    degrees: float
    """Angle, counterclockwise seen from above."""
    text: str


def turn_length(cursor: TokenCursor, *, said: bool) -> int:
    """Number of tokens from here to an angle that state a turn, 0 if none do; `said`: the verb is "turn"."""
    here = cursor.here
    ahead = 0
    while here("turn", "sense", "det", ahead=ahead) or leads_to_angle(cursor, ahead):
        said = said or here("turn", "sense", ahead=ahead) or leads_to_angle(cursor, ahead) == "at"
        ahead += 1
    if here("turned", ahead=ahead) or (here("angle", ahead=ahead) and (said or here("sense", ahead=ahead + 1))):
        return ahead + 1
    return ahead if here("turn") and here("pose", "face", ahead=ahead) else 0


def leads_to_angle(cursor: TokenCursor, ahead: int) -> str:
    """ "at" or "by" `ahead` tokens further, which may precede an angle; empty if there is neither."""
    text = cursor.tokens[cursor.index + ahead].text if cursor.here("relation", ahead=ahead) else ""
    return text if text in ("at", "by") else ""


def turn_of(cursor: TokenCursor, length: int) -> Turn | None:
    """The turn in that many tokens, with the sense that may follow them; None if they contain no angle."""
    begin = cursor.index
    tokens = [cursor.take() for _ in range(length)]
    degrees = tokens[-1].value("angle") or tokens[-1].value("turned")
    if cursor.here("angle word"):
        cursor.take()
    if cursor.here("sense"):
        tokens.append(cursor.take())
    sense = next((float(token.value("sense")) for token in tokens if token.has("sense")), None)
    sense = sideways(cursor) if sense is None else sense
    return Turn(math.fmod(sense * float(degrees), 360.0), cursor.text(begin)) if degrees else None


def sideways(cursor: TokenCursor) -> float:
    """The sense of "to the left" or "to the right", consuming these words; else counterclockwise."""
    ahead = 2 if cursor.here("det", ahead=1) else 1
    side = cursor.tokens[cursor.index + ahead].value("side") if cursor.here("side", ahead=ahead) else ""
    if side not in TURNS_TO or not is_to(cursor):
        return 1.0
    cursor.index += ahead + 1
    return TURNS_TO[side]


def is_to(cursor: TokenCursor) -> bool:
    """Return whether the next word is "to"."""
    return cursor.here("relation") and cursor.tokens[cursor.index].text == "to"


@dataclass(frozen=True, slots=True)
class Measure:
    """A distance of a place from something."""

    metres: float
    mode: str = "exactly"
    """Mode: exactly, most or least."""


@dataclass(frozen=True, slots=True)
class Place:
    """A relation to one or two nouns."""

    relation: str
    """on, in, at, near, next_to, nearest, farthest, against, between, under, left_of, right_of, front_of, behind, away,
    opposite, carrying, lacking, distance, which."""
    nouns: tuple[Noun, ...]
    restrict: bool
    """Whether it selects a thing ("the bed that is near the window") instead of naming a place to go."""
    text: str
    attached: bool = False
    """Whether it follows a noun without a pause, so that it may select a thing: "the bed on the left"."""
    clause: int = 0
    """Index of its clause."""
    excluded: bool = False
    """Whether it is a place to avoid ("not on the pillow"), or with `restrict` a property that the meant thing
    lacks."""
    measure: Measure | None = None
    """Distance from its noun."""
    topmost: bool = False
    """Whether it says "on top of"."""
    literal: str = ""
    """The literal words of the relation: "at" and "on" the foot of a bed differ."""


@dataclass(frozen=True, slots=True)
class Facing:
    """Direction of the front."""

    mode: str
    """toward or away."""
    noun: Noun
    text: str


@dataclass(frozen=True, slots=True)
class Reading:
    """Interpretation of a sentence, as far as possible without a scene."""

    theme: Noun | None
    """Moved thing; None if the sentence only says "it" or nothing."""
    places: tuple[Place, ...]
    pose: str
    """upright, seated, standing, upside_down, on_side, on_left_side, on_right_side, lying, on_back, on_front,
    leaning or any."""
    pose_words: str
    turn: float
    """Turn about the vertical, counterclockwise seen from above [degrees]."""
    turn_words: str
    facing: Facing | None
    aside: tuple[str, ...]
    """Phrases that are understood but do not say where to put the thing: the place from which it is taken, its name
    again."""
    not_understood: tuple[str, ...]
    notes: tuple[str, ...] = ()
    """Misspelt words and their corrections."""


@dataclass(slots=True)
class Clause:
    """A clause during reading."""

    begin: int
    kind: str = ""
    """place, pick, be, other (not a placement), or empty before the verb."""
    theme: Noun | None = None
    places: list[Place] = field(default_factory=list)
    verb_pose: str = ""
    poses: list[Token] = field(default_factory=list)
    facing: Facing | None = None
    turning: bool = False
    """Whether its verb is "turn", so that an angle after it is the size of the turn."""
    turns: list[Turn] = field(default_factory=list)
    negated: bool = False
    """Whether it says what not to do, so that its places are excluded."""
    own_view: bool = False
    """Whether left and right are those of a person who sits or lies in the support."""
    hangs: bool = False
    """Whether its verb may mean hanging: "hang it from the ceiling"."""
    leans: bool = False
    """Whether its verb may mean leaning: "rest it against the wall"."""

    def texts(self) -> list[str]:
        """Phrases about places, poses, turns and facings."""
        turns = [turn.text for turn in self.turns]
        facing = [self.facing.text] if self.facing is not None else []
        return [*(place.text for place in self.places), *(token.text for token in self.poses), *turns, *facing]

    @property
    def says_where(self) -> bool:
        """Whether its places are where to go."""
        return self.kind not in ("pick", "other")


def check(prompt: str, clauses: list[Clause], moved: str = "") -> None:
    """Refuse what is not the placement of one thing; the file called `moved` is one, be it a plural ("candles")."""
    placing = [clause for clause in clauses if clause.says_where and not clause.negated]
    if not placing and any(clause.negated for clause in clauses):
        raise LanguageError(f"prompt {prompt!r} says only where not to put it; {EXAMPLE}")
    if not any(clause.kind or clause.places for clause in placing):
        what = "asks for something other than a placement" if len(placing) < len(clauses) else "says no place"
        raise LanguageError(f"prompt {prompt!r} {what}; {EXAMPLE}")
    if any(clause.hangs and any(place.relation == "source" for place in clause.places) for clause in clauses):
        raise LanguageError(
            f"prompt {prompt!r} hangs something up: only things that rest on a support can be placed; {EXAMPLE}"
        )
    named, file = themes(clauses), label_words(moved)
    plural = any(
        clause.theme is not None and clause.theme.plural and label_words(clause.theme.name) != file
        for clause in clauses if clause.kind != "other"
    )  # fmt: skip
    if plural or any(not alike(named[0], theme) for theme in named[1:]):
        listed = f" ({' and '.join(dict.fromkeys(theme.text for theme in named))})" if named else ""
        raise LanguageError(f"prompt {prompt!r} moves more than one thing{listed}; place one object at a time")


def themes(clauses: list[Clause]) -> list[Noun]:
    """Nouns of the moved things, clause by clause."""
    nouns = [clause.theme for clause in clauses if clause.kind != "other"]
    known = any(noun is not None and not noun.is_unknown and noun.pronoun != "it" for noun in nouns)
    return [noun for noun in nouns if noun is not None and noun.pronoun != "it" and not (known and noun.is_unknown)]


def alike(one: Noun, other: Noun) -> bool:
    """Return whether two phrases can mean the same thing: "the red mug", then "the mug"."""
    colours, sides = {one.colour, other.colour} - {""}, {one.sides, other.sides} - {()}
    return one.name == other.name and len(colours) < 2 and len(sides) < 2


def reading_of(clauses: list[Clause], lost: tuple[str, ...]) -> Reading:
    """The clauses as one reading: the last pose counts, and a stated pose takes precedence over one implied by a
    verb."""
    moved = themes(clauses)
    nouns = (clause.theme for clause in clauses if clause.kind != "other" and clause.theme not in moved)
    idle = [noun.text for noun in nouns if noun is not None and noun.pronoun == "" and noun.text not in " ".join(lost)]
    placing = [clause for clause in clauses if clause.says_where]
    poses = [token for clause in placing for token in clause.poses if not clause.negated]
    implied = next((clause.verb_pose for clause in reversed(placing) if clause.verb_pose), "")
    places = [
        replace(
            place, nouns=tuple(mirrored(noun) for noun in place.nouns) if clause.own_view else place.nouns,
            clause=index, excluded=place.excluded or (clause.negated and not place.restrict),
        )
        for index, clause in enumerate(placing) for place in clause.places
    ]  # fmt: skip
    said = poses[-1].value("pose") if poses else implied or "any"
    leaning = said == "leaning" or any(c.leans and any(p.relation == "against" for p in c.places) for c in placing)
    facings = [clause.facing for clause in placing if clause.facing is not None]
    turns = [turn for clause in placing for turn in clause.turns]
    elsewhere = [text for clause in clauses if not clause.says_where for text in clause.texts()]
    sources = [place.text for place in places if place.relation == "source"]
    return Reading(
        theme=moved[0] if moved else None,
        places=tuple(place for place in places if place.relation != "source"),
        pose="leaning" if leaning and said not in STANDS_BY_ITSELF else said,
        pose_words=" ".join(token.text for token in poses) or implied,
        turn=turns[-1].degrees if turns else 0.0,
        turn_words=turns[-1].text if turns else "",
        facing=facings[-1] if facings else None,
        aside=(*elsewhere, *sources, *(theme.text for theme in moved[1:])),
        not_understood=(*lost, *idle, *(facing.text for facing in facings[:-1]), *(turn.text for turn in turns[:-1])),
    )


def mirrored(noun: Noun) -> Noun:
    """A noun with left and right exchanged: a person sitting in a chair faces the opposite way to one standing before
    it."""
    swapped = tuple(" ".join(MIRRORED.get(word, word) for word in side.split()) for side in noun.sides)
    return replace(noun, sides=swapped, owner=mirrored(noun.owner) if noun.owner is not None else None)
