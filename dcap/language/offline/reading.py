"""Content of a sentence, before any scene is looked at: places, poses, facings and the thing that is moved.

Plain values; `sentence` makes them from a prompt.
"""

from dataclasses import dataclass, field

from dcap.language.offline.nouns import Noun
from dcap.language.offline.turns import Turn
from dcap.language.offline.words import Token


@dataclass(frozen=True, slots=True)
class Measure:
    """A length that a place is to be from something."""

    metres: float
    mode: str = "exactly"
    """exactly, most or least."""


@dataclass(frozen=True, slots=True)
class Place:
    """A relation to one or two nouns."""

    relation: str
    """on, in, at, near, next_to, nearest, farthest, against, between, under, left_of, right_of, front_of, behind, away,
    opposite, carrying, lacking, distance, which."""
    nouns: tuple[Noun, ...]
    restrict: bool
    """It says which one is meant ("the bed that is near the window"), not where to go."""
    text: str
    attached: bool = False
    """It follows a noun without a pause, so that it may say which one: "the bed on the left"."""
    clause: int = 0
    """Which of the clauses says it."""
    excluded: bool = False
    """It is where not to go ("not on the pillow"), or with `restrict` what the one that is meant is not."""
    measure: Measure | None = None
    """How far from its noun."""
    topmost: bool = False
    """It says "on top of"."""
    literal: str = ""
    """The relation's own words: "at" and "on" the foot of a bed differ."""


@dataclass(frozen=True, slots=True)
class Facing:
    """Where the front shall look."""

    mode: str
    """toward or away."""
    noun: Noun
    text: str


@dataclass(frozen=True, slots=True)
class Reading:
    """A sentence understood as far as it goes without a scene."""

    theme: Noun | None
    """Thing that is moved; None if only "it" or nothing was said."""
    places: tuple[Place, ...]
    pose: str
    """upright, seated, standing, upside_down, on_side, on_left_side, on_right_side, lying, on_back, on_front,
    leaning or any."""
    pose_words: str
    turn: float
    """About the vertical, counterclockwise seen from above [degrees]."""
    turn_words: str
    facing: Facing | None
    aside: tuple[str, ...]
    """Phrases that are understood and do not say where to put it: where it is picked up, its name once more."""
    not_understood: tuple[str, ...]
    notes: tuple[str, ...] = ()
    """Mistyped words and what they are read as."""


@dataclass(slots=True)
class Clause:
    """A clause while it is read."""

    begin: int
    kind: str = ""
    """place, pick, be, other (no placement), or empty as long as no verb was read."""
    theme: Noun | None = None
    places: list[Place] = field(default_factory=list)
    verb_pose: str = ""
    poses: list[Token] = field(default_factory=list)
    facing: Facing | None = None
    turning: bool = False
    """Its verb is "turn": an angle after it is how far."""
    turns: list[Turn] = field(default_factory=list)
    negated: bool = False
    """It says what not to do: its places are excluded."""
    own_view: bool = False
    """Left and right are those of who sits or lies in the support."""
    hangs: bool = False
    """Its verb may mean hanging: "hang it from the ceiling"."""
    leans: bool = False
    """Its verb may mean leaning: "rest it against the wall"."""

    def texts(self) -> list[str]:
        """Phrases about places, poses, turns and facings."""
        turns = [turn.text for turn in self.turns]
        facing = [self.facing.text] if self.facing is not None else []
        return [*(place.text for place in self.places), *(token.text for token in self.poses), *turns, *facing]

    @property
    def says_where(self) -> bool:
        """Whether its places are where to go."""
        return self.kind not in ("pick", "other")
