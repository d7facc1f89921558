"""The grammar of placement sentences: what is moved, and the phrases that say where and how; no scene is needed.

In: a prompt. Out: a `Reading`. Grammar (brackets: optional, braces: any number; words in capitals are kinds of the
lexicon); each line is a method of `Reader`, nouns are read in `nouns`:

    sentence = { clause }
    clause   = { element } [ VERB { element } ]
    element  = turn | place | facing | POSE | RESTRICT | noun | FILLER
    turn                                                               see `turns`
    place    = RELATION [ noun [ "and" noun ] ]                        two nouns after "between", or beside both
    facing   = [ noun ] FACE noun                                      "its screen facing the window"

The first noun of a clause is what is moved. In "pick A near B and place it on C" only the last clause says where; in
"open A and put B in it" the first only says what "it" is. Every word is used by one of these rules or reported: what
no rule kept is the reading's `not_understood`. A sentence that is no placement of one thing raises LanguageError.
"""

from dataclasses import dataclass, field, replace

from dcap.language.offline.lexicon import is_a, part_words
from dcap.language.offline.nouns import Noun, at_noun, noun_phrase, starts
from dcap.language.offline.turns import Turn, is_to, turn_length, turn_of
from dcap.language.offline.words import Token, TokenCursor, tokens_of
from dcap.scene.errors import LanguageError

SUPPORT = frozenset({"on", "in"})
NEIGHBOURING = frozenset({"near", "next_to"})
"""Relations that one can have to two things at once."""
SIDED = {"left_of": "left", "right_of": "right", "front_of": "front", "behind": "back"}
"""The side of a support that a relation to its middle means."""
MIDDLES = frozenset({"center", "middle"})
EXAMPLE = "say what to put where, for example: put the ball on the bed"


@dataclass(frozen=True, slots=True)
class Place:
    """A relation to one or two nouns."""

    relation: str
    """on, in, at, near, next_to, against, between, under, left_of, right_of, front_of, behind, away, which."""
    nouns: tuple[Noun, ...]
    restrict: bool
    """It says which one is meant ("the bed that is near the window"), not where to go."""
    text: str
    attached: bool = False
    """It follows a noun without a pause, so that it may say which one: "the bed on the left"."""
    clause: int = 0
    """Which of the clauses says it."""


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
    """What is moved; None if only "it" or nothing was said."""
    places: tuple[Place, ...]
    pose: str
    """upright, standing, upside_down, on_side, on_left_side, on_right_side, lying, on_back, on_front or any."""
    pose_words: str
    turn: float
    """About the vertical, counterclockwise seen from above [degrees]."""
    turn_words: str
    facing: Facing | None
    aside: tuple[str, ...]
    """Phrases that are understood and do not say where to put it: where it is picked up, its name once more."""
    not_understood: tuple[str, ...]


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

    def texts(self) -> list[str]:
        """What it says of places, poses, turns and facings."""
        turns = [turn.text for turn in self.turns]
        facing = [self.facing.text] if self.facing is not None else []
        return [*(place.text for place in self.places), *(token.text for token in self.poses), *turns, *facing]

    @property
    def says_where(self) -> bool:
        """Whether its places are where to go."""
        return self.kind not in ("pick", "other")


def read(prompt: str) -> Reading:
    """Read a prompt; LanguageError if it is not the placement of one thing."""
    tokens = tokens_of(prompt)
    if not any(token.text != "," for token in tokens):
        raise LanguageError(f"the prompt is empty; {EXAMPLE}")
    for token in tokens:
        if token.has("negation", "choice"):
            raise LanguageError(f"prompt {prompt!r}: {token.text!r} is not understood; name one place to put it")
    reader = Reader(tokens)
    clauses = reader.sentence()
    check(prompt, clauses)
    return reading_of(clauses, reader.lost())


class Reader:
    """Goes through the tokens once, from left to right; each method reads what its line of the grammar says."""

    def __init__(self, tokens: list[Token]) -> None:
        self.cursor = TokenCursor(tokens)
        self.kept: set[int] = set()
        """Indices of the tokens that a rule used."""
        self.last_noun: Noun | None = None
        """What "it" is, after "open the drawer"."""
        self.restrict = False
        """The next place says which one is meant."""
        self.last_place_ends = -1
        """Index of the token after the last place."""

    def sentence(self) -> list[Clause]:
        """{ clause }."""
        clauses = []
        while not self.cursor.at_end:
            clauses.append(self.clause())
        return clauses

    def clause(self) -> Clause:
        """{ element } [ VERB { element } ]."""
        clause = Clause(self.cursor.index)
        while not self.cursor.at_end:
            if not self.at_verb(clause):
                self.element(clause)
            elif (clause.kind or clause.places) and self.cursor.tokens[self.cursor.index].value("verb") != "be":
                break
            else:
                self.verb(clause)
        return clause

    def at_verb(self, clause: Clause) -> bool:
        """Whether a verb comes; after one, a word that may be a noun is one ("stand"), unless "and" precedes it."""
        here = self.cursor.here
        return here("verb") and not (
            clause.kind and here("thing", "part", "region") and not here("conj", "pause", ahead=-1)
        )

    def verb(self, clause: Clause) -> None:
        """VERB: what kind of clause it is, and the pose that it says ("lay", "stand", "flip")."""
        kind = self.use().value("verb")
        if kind == "other":
            self.kept.difference_update(range(clause.begin, self.cursor.index))
        if kind == "be":
            clause.kind = clause.kind or "place"
        elif kind in ("place", "pick", "other"):
            clause.kind = kind
        elif kind == "turning":
            clause.kind, clause.turning = "place", True
        else:
            clause.kind, clause.verb_pose = "place", kind

    def element(self, clause: Clause) -> None:
        """turn | place | facing | POSE | RESTRICT | noun | FILLER."""
        here = self.cursor.here
        if clause.kind == "other":
            self.topic()
        elif length := turn_length(self.cursor, said=clause.turning):
            self.turn(clause, length)
        elif here("pose") and not here("relation"):
            clause.poses.append(self.use())
        elif here("face") or (clause.turning and not clause.places and here("toward")):  # "turn it towards the wall"
            self.facing(clause, self.cursor.index)
        elif here("relation"):
            self.place(clause)
        elif here("restrict"):
            self.use()
            self.restrict = True
        elif starts(self.cursor) and at_noun(self.cursor):
            self.noun(clause)
        else:
            self.cursor.take()

    def topic(self) -> None:
        """Inside "close the drawer": remember the noun for a later "it"."""
        if starts(self.cursor) and at_noun(self.cursor):
            self.last_noun = noun_phrase(self.cursor)
        else:
            self.cursor.take()

    def turn(self, clause: Clause, length: int) -> None:
        """That many tokens are a turn; what its angle is measured from ("to the edge") is no place."""
        begin = self.cursor.index
        turn = turn_of(self.cursor, length)
        self.keep(begin)
        if turn is not None:
            clause.turns.append(turn)
        if is_to(self.cursor):
            self.cursor.take()
            if at_noun(self.cursor):
                noun_phrase(self.cursor)

    def place(self, clause: Clause) -> None:
        """RELATION [ noun [ "and" noun ] ]; "put it inside" means what was spoken of before."""
        begin = self.cursor.index
        attached = not self.cursor.here("pause", ahead=-1)
        token = self.cursor.take()
        relation = token.value("relation")
        nouns = [noun_phrase(self.cursor)] if at_noun(self.cursor) else []
        if nouns and self.cursor.here("conj") and at_noun(self.cursor, 1):
            nouns += self.second(relation)
        if not nouns and relation in SUPPORT and self.last_noun is not None:
            nouns = [self.last_noun]
        if not nouns or (relation == "source" and nouns[0].region):  # "5 cm from the edge"
            return
        if nouns[0].is_unknown and self.cursor.here("length"):  # "close to 10 cm from the edge"
            return
        if relation in SIDED and nouns[0].is_region:
            if nouns[0].region not in MIDDLES:  # "left of the edge"
                return
            side = SIDED[relation]  # "left of the middle of the desk" is on its left
            relation, nouns = "at", [replace(nouns[0], region="", sides=(side,))]
        self.keep(begin)
        clause.poses += [token] if token.has("pose") else []  # "leaning against the wall"
        nouns = [self.referred(noun, relation) for noun in nouns]
        self.last_noun = nouns[0]
        clause.places.append(Place(relation, tuple(nouns), self.restrict, self.cursor.text(begin), attached))
        self.restrict = False
        self.last_place_ends = self.cursor.index

    def second(self, relation: str) -> list[Noun]:
        """The noun after "and": of "between", or of "next to A and B" where the sentence ends or pauses with it."""
        back = self.cursor.index
        self.cursor.take()
        noun = noun_phrase(self.cursor)
        ends = self.cursor.at_end or self.cursor.here("pause")
        if relation == "between" or (relation in NEIGHBOURING and ends and noun.thing and not noun.region):
            return [noun]
        self.cursor.index = back
        return []

    def facing(self, clause: Clause, begin: int) -> None:
        """[ noun ] FACE noun, from the first of them on; after an edge it says which edge."""
        mode = self.cursor.take().value("face") or "toward"
        if not at_noun(self.cursor) or clause.facing is not None:
            return
        edge = clause.places[-1] if clause.places and self.last_place_ends == begin else None
        noun = noun_phrase(self.cursor)
        self.keep(begin)
        if edge is not None and edge.nouns[0].region == "edge" and mode == "toward":
            text = f"{edge.text} {self.cursor.text(begin)}"
            clause.places[-1] = replace(edge, nouns=(replace(edge.nouns[0], toward=noun),), text=text)
        else:
            clause.facing = Facing(mode, noun, self.cursor.text(begin))

    def noun(self, clause: Clause) -> None:
        """A noun without a relation: what is moved, a region, or "the one" that explains the noun before."""
        begin = self.cursor.index
        noun = noun_phrase(self.cursor)
        if noun.pronoun == "one" and clause.places:
            if noun.sides or noun.colour:
                clause.places.append(Place("which", (noun,), True, noun.text))
            else:
                self.restrict = True
        elif noun.is_region and not (clause.theme is None and thing_and_region(noun)):
            clause.places.append(Place("at", (noun,), False, noun.text))
        elif clause.theme is None and not clause.places:
            self.theme(clause, noun)
        elif self.is_front(noun, clause.theme):
            self.facing(clause, begin)
            return
        elif clause.theme is not None and clause.places and self.cursor.here("relation") and noun.thing:
            clause.theme = several(clause.theme, noun)  # "... and a mug on the desk"
        elif noun.pronoun != "it":
            return
        if noun.pronoun != "it" or not (noun.colour or noun.owner):  # "it red" says nothing that is used
            self.keep(begin)

    def is_front(self, noun: Noun, theme: Noun | None) -> bool:
        """Whether it is the side of what is moved that looks at something: "its screen towards the window"."""
        parts = [part_words()[part] for part in noun.parts if part_words()[part].front]
        whole = theme.thing if theme is not None else ""
        own = not whole or any(is_a(whole, owner) for part in parts for owner in part.owners)
        return bool(parts) and own and self.cursor.here("face", "toward")

    def theme(self, clause: Clause, noun: Noun) -> None:
        """What is moved; "the mug dead centre" is a mug and a region, "the mug and the book" are two things."""
        if noun.owner is not None and thing_and_region(noun):
            clause.places.append(Place("at", (replace(noun, owner=noun.owner.owner),), False, noun.text))
            noun = replace(noun.owner, owner=None)
        clause.theme = noun
        back = self.cursor.index
        if self.cursor.here("conj") and at_noun(self.cursor, 1):
            self.cursor.take()
            second = noun_phrase(self.cursor)
            if second.is_region or second.pronoun:
                self.cursor.index = back
            else:
                clause.theme = several(noun, second)

    def referred(self, noun: Noun, relation: str) -> Noun:
        """What "it" stands for: the drawer of the cabinet to put things in, the cabinet to put them on."""
        if noun.pronoun != "it" or self.last_noun is None:
            return noun
        last = self.last_noun
        return last.owner if relation == "on" and last.encloses and last.owner is not None else last

    # words that no rule used ---------------------------------------------------------------------------------------

    def use(self) -> Token:
        """The next token, kept."""
        token = self.cursor.take()
        self.keep(self.cursor.index - 1)
        return token

    def keep(self, begin: int) -> None:
        """The tokens from there up to here are used, apart from unknown words."""
        indices = range(begin, self.cursor.index)
        self.kept.update(i for i in indices if not self.cursor.tokens[i].has("unknown"))

    def lost(self) -> tuple[str, ...]:
        """Runs of tokens that no rule used, without the fillers around them."""
        runs: list[list[Token]] = [[]]
        for index, token in enumerate(self.cursor.tokens):
            if index in self.kept or token.has("pause"):
                runs.append([])
            else:
                runs[-1].append(token)
        found = (trimmed(run) for run in runs)
        return tuple(dict.fromkeys(text for text in found if text))


def thing_and_region(noun: Noun) -> bool:
    """Two nouns side by side of which the second is only a region: "mug dead centre"."""
    return noun.is_region and noun.owner is not None and noun.name.startswith(noun.owner.name)


def several(one: Noun, other: Noun) -> Noun:
    """Two things to be moved."""
    return replace(one, text=f"{one.text} and {other.text}", plural=True)


def trimmed(run: list[Token]) -> str:
    """The words of a run without fillers, articles and "and" at its ends."""
    bare = [index for index, token in enumerate(run) if not token.has("filler", "conj", "of", "genitive", "det")]
    return " ".join(token.text for token in run[bare[0] : bare[-1] + 1]) if bare else ""


# from clauses to a reading ------------------------------------------------------------------------------------------


def check(prompt: str, clauses: list[Clause]) -> None:
    """Refuse what is not the placement of one thing."""
    placing = [clause for clause in clauses if clause.says_where]
    if not any(clause.kind or clause.places for clause in placing):
        what = "asks for something other than a placement" if len(placing) < len(clauses) else "says no place"
        raise LanguageError(f"prompt {prompt!r} {what}; {EXAMPLE}")
    moved = themes(clauses)
    plural = any(clause.theme is not None and clause.theme.plural for clause in clauses if clause.kind != "other")
    if plural or any(not alike(moved[0], theme) for theme in moved[1:]):
        listed = f" ({' and '.join(dict.fromkeys(theme.text for theme in moved))})" if moved else ""
        raise LanguageError(f"prompt {prompt!r} moves more than one thing{listed}; place one object at a time")


def themes(clauses: list[Clause]) -> list[Noun]:
    """What is moved, clause by clause."""
    nouns = (clause.theme for clause in clauses if clause.kind != "other")
    return [noun for noun in nouns if noun is not None and noun.pronoun != "it"]


def alike(one: Noun, other: Noun) -> bool:
    """Whether two phrases can mean one thing: "the red mug", then "the mug"."""
    colours, sides = {one.colour, other.colour} - {""}, {one.sides, other.sides} - {()}
    return one.name == other.name and len(colours) < 2 and len(sides) < 2


def reading_of(clauses: list[Clause], lost: tuple[str, ...]) -> Reading:
    """The clauses as one reading: the last pose counts, a said pose before one that a verb implies."""
    moved = themes(clauses)
    placing = [clause for clause in clauses if clause.says_where]
    poses = [token for clause in placing for token in clause.poses]
    implied = next((clause.verb_pose for clause in reversed(placing) if clause.verb_pose), "")
    places = [replace(place, clause=index) for index, clause in enumerate(placing) for place in clause.places]
    facings = [clause.facing for clause in placing if clause.facing is not None]
    turns = [turn for clause in placing for turn in clause.turns]
    elsewhere = [text for clause in clauses if not clause.says_where for text in clause.texts()]
    sources = [place.text for place in places if place.relation == "source"]
    return Reading(
        theme=moved[0] if moved else None,
        places=tuple(place for place in places if place.relation != "source"),
        pose=poses[-1].value("pose") if poses else implied or "any",
        pose_words=" ".join(token.text for token in poses) or implied,
        turn=turns[-1].degrees if turns else 0.0,
        turn_words=turns[-1].text if turns else "",
        facing=facings[-1] if facings else None,
        aside=(*elsewhere, *sources, *(theme.text for theme in moved[1:])),
        not_understood=(*lost, *(facing.text for facing in facings[:-1]), *(turn.text for turn in turns[:-1])),
    )
