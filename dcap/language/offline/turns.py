"""Turns about the vertical: "rotated by 90 degrees clockwise", "at a 45 degree angle", "diagonally".

In: a cursor among the tokens. Out: how many of them speak of a turn, and the turn. Grammar, as in `sentence`:

    turn = { WORD } (TURNED | ANGLE [ "angle" ]) [ SENSE ] | TURN before a pose or facing, to which it adds nothing
    WORD = TURN | SENSE | "at" | "by" | DET

An angle alone is none ("tilted by 30 degrees"): a turn, a sense or "at" must be said with it.
"""

import math
from dataclasses import dataclass

from dcap.language.offline.words import TokenCursor

TURNS_TO = {"left": 1.0, "right": -1.0}
"""Seen from above, what turns to its left turns counterclockwise."""


@dataclass(frozen=True, slots=True)
class Turn:
    """A turn about the vertical."""

    degrees: float
    """Counterclockwise seen from above."""
    text: str


def turn_length(cursor: TokenCursor, *, said: bool) -> int:
    """How many tokens from here up to an angle speak of a turn, 0 if none does; `said`: the verb is "turn"."""
    here = cursor.here
    ahead = 0
    while here("turn", "sense", "det", ahead=ahead) or leads_to_angle(cursor, ahead):
        said = said or here("turn", "sense", ahead=ahead) or leads_to_angle(cursor, ahead) == "at"
        ahead += 1
    if here("turned", ahead=ahead) or (here("angle", ahead=ahead) and (said or here("sense", ahead=ahead + 1))):
        return ahead + 1
    return ahead if here("turn") and here("pose", "face", ahead=ahead) else 0


def leads_to_angle(cursor: TokenCursor, ahead: int) -> str:
    """ "at" or "by" `ahead` tokens further, the words that may stand before an angle; empty if neither does."""
    text = cursor.tokens[cursor.index + ahead].text if cursor.here("relation", ahead=ahead) else ""
    return text if text in ("at", "by") else ""


def turn_of(cursor: TokenCursor, length: int) -> Turn | None:
    """The turn in that many tokens with the sense that may follow them; None if they say no angle."""
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
    """The sense of "to the left" or "to the right", which is taken then; else counterclockwise."""
    ahead = 2 if cursor.here("det", ahead=1) else 1
    side = cursor.tokens[cursor.index + ahead].value("side") if cursor.here("side", ahead=ahead) else ""
    if side not in TURNS_TO or not is_to(cursor):
        return 1.0
    cursor.index += ahead + 1
    return TURNS_TO[side]


def is_to(cursor: TokenCursor) -> bool:
    """Whether the next word is "to"."""
    return cursor.here("relation") and cursor.tokens[cursor.index].text == "to"
