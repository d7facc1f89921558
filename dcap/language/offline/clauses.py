"""From clauses to one reading: which say where to go, what is moved, and what is no placement of one thing."""

from dataclasses import replace

from dcap.language.offline.nouns import Noun
from dcap.language.offline.reading import Clause, Reading
from dcap.scene.errors import LanguageError

EXAMPLE = "say what to put where, for example: put the ball on the bed"
MIRRORED = {"left": "right", "right": "left"}
STANDS_BY_ITSELF = frozenset({"upside_down", "on_side", "on_left_side", "on_right_side", "on_back", "on_front"})
"""Poses that a thing keeps although it rests against something."""


def check(prompt: str, clauses: list[Clause]) -> None:
    """Refuse what is not the placement of one thing."""
    placing = [clause for clause in clauses if clause.says_where and not clause.negated]
    if not placing and any(clause.negated for clause in clauses):
        raise LanguageError(f"prompt {prompt!r} says only where not to put it; {EXAMPLE}")
    if not any(clause.kind or clause.places for clause in placing):
        what = "asks for something other than a placement" if len(placing) < len(clauses) else "says no place"
        raise LanguageError(f"prompt {prompt!r} {what}; {EXAMPLE}")
    if any(clause.hangs and any(place.relation == "source" for place in clause.places) for clause in clauses):
        raise LanguageError(
            f"prompt {prompt!r} hangs something up: only what rests on a support can be placed; {EXAMPLE}"
        )
    moved = themes(clauses)
    plural = any(clause.theme is not None and clause.theme.plural for clause in clauses if clause.kind != "other")
    if plural or any(not alike(moved[0], theme) for theme in moved[1:]):
        listed = f" ({' and '.join(dict.fromkeys(theme.text for theme in moved))})" if moved else ""
        raise LanguageError(f"prompt {prompt!r} moves more than one thing{listed}; place one object at a time")


def themes(clauses: list[Clause]) -> list[Noun]:
    """Nouns of the things that are moved, clause by clause."""
    nouns = [clause.theme for clause in clauses if clause.kind != "other"]
    known = any(noun is not None and not noun.is_unknown and noun.pronoun != "it" for noun in nouns)
    return [noun for noun in nouns if noun is not None and noun.pronoun != "it" and not (known and noun.is_unknown)]


def alike(one: Noun, other: Noun) -> bool:
    """Whether two phrases can mean one thing: "the red mug", then "the mug"."""
    colours, sides = {one.colour, other.colour} - {""}, {one.sides, other.sides} - {()}
    return one.name == other.name and len(colours) < 2 and len(sides) < 2


def reading_of(clauses: list[Clause], lost: tuple[str, ...]) -> Reading:
    """The clauses as one reading: the last pose counts, a said pose before one that a verb implies."""
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
    """A noun with left and right exchanged: who sits in a chair looks the other way than who stands before it."""
    swapped = tuple(" ".join(MIRRORED.get(word, word) for word in side.split()) for side in noun.sides)
    return replace(noun, sides=swapped, owner=mirrored(noun.owner) if noun.owner is not None else None)
