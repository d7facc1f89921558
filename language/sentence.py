"""The grammar of placement sentences: what is moved, and the phrases that say where and how; no scene is needed.

In: a prompt. Out: a `Reading`. Grammar (brackets: optional, braces: any number; words in capitals are kinds of the
lexicon):

    sentence  = { FILLER } clause { ("and" | ",") clause }
    clause    = [ VERB ] [ noun ] { place | POSE | FACE noun | noun }
    place     = RELATION noun [ "and" noun ]
    noun      = { DET | SIDE | COLOUR | QUALITY | NUMBER } [ { THING | PART | unknown } head ] [ "of" noun ]
    head      = THING | PART | REGION | ONE | PRONOUN | unknown

The first noun of a placing (or picking) clause is what is moved. In "pick A near B and place it on C" only the last
placing clause says where. What fits nowhere is kept and reported. A sentence that is no placement of one thing raises
LanguageError.
"""

from dataclasses import dataclass, field

from language.nouns import MODIFIERS, NOUNS, Noun, noun_of, replaced
from language.words import Token, tokens_of
from scene.errors import LanguageError

POSE_VERBS = {"lying": "lying", "standing": "standing", "upside_down": "upside_down"}
SUPPORT = frozenset({"on", "in"})


@dataclass(frozen=True, slots=True)
class Place:
    """A relation to one or two nouns."""

    relation: str
    """on, in, at, near, next_to, against, between, under, left_of, right_of, front_of, behind, away, which."""
    nouns: tuple[Noun, ...]
    restrict: bool
    """It says which one is meant ("the bed that is near the window"), not where to go."""
    text: str


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
    """upright, standing, upside_down, on_side, lying, on_back, on_front or any."""
    pose_words: str
    facing: Facing | None
    not_understood: tuple[str, ...]


@dataclass(slots=True)
class Clause:
    """A clause while it is read."""

    verb: str
    theme: Noun | None = None
    places: list[Place] = field(default_factory=list)


def read(prompt: str) -> Reading:
    """Read a prompt; LanguageError if it is not the placement of one thing."""
    tokens = tokens_of(prompt)
    if not any(token.text != "," for token in tokens):
        raise LanguageError("the prompt is empty; say what to put where, for example: put the ball on the bed")
    return Reader(prompt, tokens).reading()


class Reader:
    """Goes through the tokens once, from left to right."""

    def __init__(self, prompt: str, tokens: list[Token]) -> None:
        self.prompt = prompt
        self.tokens = tokens
        self.index = 0
        self.clauses: list[Clause] = [Clause("")]
        self.pose, self.pose_words = "any", ""
        self.verb_pose = ""
        self.facing: Facing | None = None
        self.left_over: list[str] = []
        self.last_noun: Noun | None = None
        self.restrict = False

    def reading(self) -> Reading:
        """The whole sentence."""
        while self.index < len(self.tokens):
            self.step()
        placing = [clause for clause in self.clauses if clause.verb not in ("pick", "other")]
        moved = [clause for clause in self.clauses if clause.verb != "other"]
        themes = [clause.theme for clause in moved if clause.theme and clause.theme.pronoun != "it"]
        self.check_clauses(placing, themes)
        places = [place for clause in placing for place in clause.places]
        pose = self.pose if self.pose_words else (self.verb_pose or "any")
        return Reading(
            theme=themes[0] if themes else None,
            places=tuple(places),
            pose=pose,
            pose_words=self.pose_words or ("" if not self.verb_pose else self.verb_pose),
            facing=self.facing,
            not_understood=tuple(dict.fromkeys(self.left_over)),
        )

    def check_clauses(self, placing: list[Clause], themes: list[Noun]) -> None:
        """Refuse what is no placement of one thing."""
        others = [clause for clause in self.clauses if clause.verb == "other"]
        if not any(clause.verb or clause.places for clause in placing):
            what = "asks for something else than a placement" if others else "says no place"
            raise LanguageError(
                f"prompt {self.prompt!r} {what}; say what to put where, for example: put the ball on the bed"
            )
        if len({theme.text for theme in themes}) > 1 or any(theme.plural for theme in themes[:1]):
            names = " and ".join(dict.fromkeys(theme.text for theme in themes))
            raise LanguageError(
                f"prompt {self.prompt!r} moves more than one thing ({names}); place one object at a time"
            )
        later = [clause.theme for clause in placing if clause.places][1:]
        if any(theme is not None and theme.plural for theme in later):
            raise LanguageError(f"prompt {self.prompt!r} moves several things; place one object at a time")

    # one step ------------------------------------------------------------------------------------------------------

    def step(self) -> None:
        """Read one token, or a phrase that starts with it."""
        token = self.tokens[self.index]
        clause = self.clauses[-1]
        if token.has("negation"):
            raise LanguageError(
                f"prompt {self.prompt!r}: {token.text!r} is not understood; say where to put it instead"
            )
        if token.has("verb") and not (token.has(*NOUNS) and clause.verb and not self.after_conjunction()):
            self.verb(token)
        elif clause.verb == "other":
            self.skip_foreign(token)
        elif token.has("pose"):
            self.pose, self.pose_words = token.value("pose"), f"{self.pose_words} {token.text}".strip()
            self.index += 1
        elif token.has("face"):
            self.face(token)
        elif token.has("relation"):
            self.place(token)
        elif token.has("restrict"):
            self.restrict = True
            self.index += 1
        elif self.starts_noun(token):
            self.bare_noun()
        else:
            if not token.has("pause", "conj", "filler", "of"):
                self.left_over.append(token.text)
            self.index += 1

    def after_conjunction(self) -> bool:
        """Whether the token before is `and` or a comma."""
        return self.index > 0 and self.tokens[self.index - 1].has("conj", "pause")

    def verb(self, token: Token) -> None:
        """A verb opens a clause, unless it only goes on with one that has no verb yet."""
        value = token.value("verb")
        self.index += 1
        if value == "be":
            self.clauses[-1].verb = self.clauses[-1].verb or "place"
            return
        if value in POSE_VERBS:
            self.verb_pose, value = POSE_VERBS[value], "place"
        if value == "other":
            self.left_over.append(token.text)
        if self.clauses[-1].verb or self.clauses[-1].places:
            self.clauses.append(Clause(value))
        else:
            self.clauses[-1].verb = value

    def skip_foreign(self, token: Token) -> None:
        """Inside "close the drawer": remember the noun for a later "it", report the words."""
        if self.starts_noun(token):
            self.last_noun = self.noun()
            self.left_over.append(self.last_noun.text)
        else:
            self.index += 1

    def place(self, token: Token) -> None:
        """RELATION noun [ "and" noun ]."""
        begin = self.index
        relation = token.value("relation")
        self.index += 1
        nouns = [self.referred(self.noun())] if self.at_noun() else []
        if relation == "between" and nouns and self.here("conj") and self.at_noun(1):
            self.index += 1
            nouns.append(self.noun())
        text = " ".join(t.text for t in self.tokens[begin : self.index])
        if not nouns and relation in SUPPORT and self.last_noun is not None:
            nouns = [self.last_noun]  # "open the drawer and put it inside"
        if not nouns:
            self.left_over.append(text)
            return
        self.last_noun = nouns[0]
        self.clauses[-1].places.append(Place(relation, tuple(nouns), self.restrict, text))
        self.restrict = False

    def referred(self, noun: Noun) -> Noun:
        """The noun that "it" stands for after "on", where a clause before spoke of something."""
        if noun.pronoun == "it" and self.last_noun is not None:
            return self.last_noun
        return noun

    def face(self, token: Token) -> None:
        """FACE noun."""
        begin = self.index
        self.index += 1
        if not self.at_noun():
            self.left_over.append(token.text)
            return
        noun = self.noun()
        text = " ".join(t.text for t in self.tokens[begin : self.index])
        self.facing = Facing(token.value("face"), noun, text)

    def bare_noun(self) -> None:
        """A noun without a relation: what is moved, a region, or "the one" that explains the noun before."""
        clause = self.clauses[-1]
        noun = self.noun()
        if noun.pronoun == "one" and clause.places:
            self.restrict = True
            if noun.sides or noun.colour:
                clause.places.append(Place("which", (noun,), True, noun.text))
        elif noun.is_region:
            clause.places.append(Place("at", (noun,), False, noun.text))
        elif clause.theme is None and not clause.places:
            clause.theme = noun
            if self.here("conj") and self.at_noun(1):
                self.second_theme(noun)
        elif noun.pronoun != "it" and not (noun.parts and self.here("face")):  # "with its screen facing ..."
            self.left_over.append(noun.text)

    def second_theme(self, first: Noun) -> None:
        """ "the mug and the book": two things to move, unless a region follows."""
        back = self.index
        self.index += 1
        second = self.noun()
        if second.is_region or second.pronoun:
            self.index = back
            return
        raise LanguageError(
            f"prompt {self.prompt!r} moves more than one thing ({first.text} and {second.text}); "
            "place one object at a time"
        )

    # noun phrases --------------------------------------------------------------------------------------------------

    def here(self, *kinds: str) -> bool:
        """Whether the next token may be one of these kinds."""
        return self.index < len(self.tokens) and self.tokens[self.index].has(*kinds)

    def at_noun(self, ahead: int = 0) -> bool:
        """Whether a noun phrase starts here, or so many tokens ahead; fillers before it are skipped."""
        index = self.index + ahead
        while index < len(self.tokens) and self.tokens[index].has("filler") and not self.tokens[index].has("det"):
            index += 1
        return index < len(self.tokens) and self.starts_noun(self.tokens[index])

    def starts_noun(self, token: Token) -> bool:
        """Whether a noun phrase can start with this token."""
        return token.has(*MODIFIERS, *NOUNS, "pronoun", "one", "viewer", "unknown") and not token.has("conj")

    def noun(self) -> Noun:
        """{ modifiers } { nouns } [ "of" noun ]."""
        begin = self.index
        words: list[Token] = []
        while self.index < len(self.tokens):
            token = self.tokens[self.index]
            skippable = token.has("filler") and not token.has(*MODIFIERS, *NOUNS, "pronoun", "one", "unknown", "viewer")
            if skippable and self.continues() and not any(w.has(*NOUNS) for w in words):
                self.index += 1
                continue
            if token.has("conj") and words and words[-1].has("colour") and self.next_is("colour"):
                self.index += 1  # "the yellow and white mug"
                continue
            if not self.starts_noun(token) or (token.has("relation") and not token.has("side")):
                break
            if token.has("verb") and words and not token.has("side", *NOUNS):
                break
            if token.has("det", "pronoun", "number") and any(w.has(*NOUNS) and not w.has("det") for w in words):
                break
            words.append(token)
            self.index += 1
        head = noun_of(words, " ".join(t.text for t in self.tokens[begin : self.index]))
        self.left_over.extend(head.unknown if not head.is_unknown else ())
        return self.with_count(self.with_owner(head))

    def next_is(self, kind: str) -> bool:
        """Whether the token after this one may be of that kind."""
        return self.index + 1 < len(self.tokens) and self.tokens[self.index + 1].has(kind)

    def continues(self) -> bool:
        """Whether the phrase goes on after this filler."""
        return self.index + 1 < len(self.tokens) and self.starts_noun(self.tokens[self.index + 1])

    def with_owner(self, head: Noun) -> Noun:
        """ "of the bed"."""
        if not (self.here("of") and self.at_noun(1)):
            return head
        self.index += 1
        owner = self.referred(self.noun())
        return replaced(head, owner=owner, text=f"{head.text} of {owner.text}")

    def with_count(self, head: Noun) -> Noun:
        """ "the second shelf from the top"."""
        if not self.here("count"):
            return head
        where = self.tokens[self.index].value("count")
        self.index += 1
        sides = tuple(f"{side} from {where}" if side.isdigit() else side for side in head.sides)
        return replaced(head, sides=sides or (where,))
