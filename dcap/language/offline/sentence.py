"""The grammar of placement sentences: the moved thing, and the phrases that say where and how; needs no scene.

In: a prompt. Out: a `Reading`. Grammar (brackets: optional, braces: any number; words in capitals are kinds of the
lexicon); each line is a method of `Reader`, nouns are read in `nouns`:

    sentence = { clause }
    clause   = { element } [ VERB { element } ]
    element  = turn | measured | place | carried | facing | POSE | RESTRICT | EXCLUDE | VIEW | noun | FILLER
    turn                                                               see `turns`
    measured = [ BOUND ] DISTANCE ( RELATION | "of" ) noun             "20 cm from the left edge", "10 cm left of it"
    place    = RELATION [ noun [ "and" noun ] ]                        two nouns after "between", or next to both
    carried  = ( "with" | "without" | "where" ) noun [ BE ] [ "on" IT ]  says which: "that has a lamp on it"
    facing   = [ noun ] FACE noun                                      "its screen facing the window"

The first noun of a clause is the moved thing. In "pick A near B and place it on C" only the last clause says where; in
"open A and put B in it" the first only defines "it". Every word is either used by one of these rules or reported: words
that no rule kept are the reading's `not_understood`. EXCLUDE before a place or a noun turns it into a place to avoid,
and so does a clause that says what not to do. A sentence that is not the placement of one thing raises LanguageError.
"""

from dataclasses import replace

from dcap.language.offline.nouns import (
    Noun,
    at_noun,
    belongs,
    is_bare_side,
    is_front,
    is_place_alone,
    noun_phrase,
    says_again,
    several,
    starts,
    thing_and_region,
)
from dcap.language.offline.reading import (
    EXAMPLE,
    Clause,
    Facing,
    Measure,
    Place,
    Reading,
    check,
    is_to,
    reading_of,
    turn_length,
    turn_of,
)
from dcap.language.offline.words import (
    NO_SCENE,
    KeptWords,
    SceneWords,
    Token,
    given_last,
    is_aside,
    tokens_of,
    words_of,
)
from dcap.scene.errors import LanguageError
from dcap.scene.types.outcome import Cause, Caution

SUPPORT = frozenset({"on", "in"})
NEIGHBOURING = frozenset({"near", "next_to", "nearest", "away", "farthest"})
"""Relations that can refer to two things at once."""
BESIDE_IT = frozenset({"at", "near", "next_to", "front_of", "behind", "against", "left_of", "right_of"})
"""Relations of things next to a thing."""
SAYS_WHICH = frozenset({"carrying", "lacking"})
"""Relations that only select a thing."""
OF_A_LENGTH = frozenset({"source", "away", "near", "left_of", "right_of", "front_of", "behind"})
"""Relations that may follow a length: "10 cm to the left of"."""
SIDED = {"left_of": "left", "right_of": "right", "front_of": "front", "behind": "back"}
"""The side of a support meant by a relation to its middle."""
MIDDLES = frozenset({"center", "middle"})
ACROSS = frozenset({"corner", "end", "edge", "long_edge", "side"})
"""Regions of which one lies opposite a thing."""
EDGES = frozenset({"edge", "end", "long_edge"})
"""Regions of which a thing that they look at says which one is meant."""
FAR_OR_NEAR = frozenset({"nearest", "farthest", "away", "opposite"})
"""Relations that tell the ends of a thing apart."""
SEEN = {"back": "farthest", "front": "nearest", "nearest": "nearest"}
"""Meaning of a side as seen from a stated viewpoint."""


def read(prompt: str, scene: SceneWords = NO_SCENE, moved: str = "") -> Reading:
    """Read a prompt, with the words of a scene and the name of the object's file if they are known; LanguageError if it
    is not the placement of one thing."""
    tokens, spare = first_choice(given_last(tokens_of(prompt, scene)))
    if not any(token.text != "," for token in tokens):
        raise LanguageError(f"the prompt is empty; {EXAMPLE}")
    reader = Reader(tokens)
    clauses = reader.sentence()
    for index, token in enumerate(tokens):
        forbids = token.has("negation") and index not in reader.kept and not is_aside(tokens, index)
        if token.has("choice") or forbids:
            raise LanguageError(f"prompt {prompt!r}: {token.text!r} is not understood; name one place to put it")
    check(prompt, clauses, moved)
    words = words_of(prompt, scene)
    mended = (Caution(Cause.WHICH, f"{typed!r} is read as {meant!r}") for typed, meant in words.mended.items())
    found = reading_of(clauses, reader.lost())
    return replace(found, aside=(*found.aside, *spare), notes=(*words.notes, *mended, *map(not_tried, spare)))


def first_choice(tokens: list[Token]) -> tuple[list[Token], tuple[str, ...]]:
    """The tokens up to a second choice, and its words: "..., or else on the wardrobe"."""
    at = next((i for i, token in enumerate(tokens) if token.has("alternative")), len(tokens))
    if not any(token.has("relation") for token in tokens[:at]):
        return tokens, ()
    words = " ".join(token.text for token in tokens[at:])
    return tokens[:at], (words,) if words else ()


def not_tried(words: str) -> Caution:
    """That a second choice has no effect."""
    return Caution(Cause.NOT_UNDERSTOOD, f"{words!r} has no effect: only the first choice is tried")


class Reader(KeptWords):
    """Goes through the tokens once, from left to right; each method reads its line of the grammar."""

    def __init__(self, tokens: list[Token]) -> None:
        super().__init__(tokens)
        self.last_noun: Noun | None = None
        """Noun to which "it" refers, after "open the drawer"."""
        self.restrict = False
        """Whether the next place selects a thing."""
        self.but = ""
        """The word that excluded it."""
        self.exclude = False
        """Whether the next place is to be avoided, or a property that the meant thing lacks."""
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
            if self.at_ban():
                if clause.kind or clause.places:
                    break
                self.use()
                clause.negated = True
            elif not self.at_verb(clause):
                self.element(clause)
            elif (clause.kind or clause.places) and self.cursor.tokens[self.cursor.index].value("verb") != "be":
                break
            else:
                self.verb(clause)
        return clause

    def at_ban(self) -> bool:
        """Return whether a clause begins that says what not to do: "don't put it on the desk"."""
        ahead = 1
        while self.cursor.here("filler", ahead=ahead) and not self.cursor.here("verb", ahead=ahead):
            ahead += 1
        return self.cursor.here("negation") and self.cursor.here("verb", ahead=ahead)

    def at_verb(self, clause: Clause) -> bool:
        """Return whether a verb comes next; after a verb, a word that may be a noun is one ("stand"), unless "and"
        precedes it."""
        here = self.cursor.here
        if here("relation") and self.cursor.value("relation") in SAYS_WHICH:  # "the table where the lamp is"
            return False
        return here("verb") and not (
            clause.kind and here("thing", "part", "region") and not here("conj", "pause", ahead=-1)
        )

    def verb(self, clause: Clause) -> None:
        """VERB: sets the kind of the clause, and the pose that the verb states ("lay", "stand", "flip")."""
        token = self.use()
        kind = token.value("verb")
        clause.leans, clause.hangs = clause.leans or token.has("leans"), clause.hangs or token.has("hangs")
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
        """turn | measured | place | carried | facing | POSE | RESTRICT | EXCLUDE | noun | FILLER."""
        here = self.cursor.here
        if clause.kind == "other":
            self.topic()
        elif here("filler") and self.cursor.index == 0 and here("det", ahead=1):  # "can the vase go on the table?"
            self.use()
        elif here("exclude") and self.leads_to_place(1):
            self.but, self.exclude = self.use().text, True
            if at_noun(self.cursor):  # "but not the pillow"
                self.bare_exclusion(clause)
        elif here("bound", "distance") and (length := self.measure_length()):
            self.measured(clause, length)
        elif self.cursor.value("relation") in SAYS_WHICH:
            self.carried(clause)
        elif length := turn_length(self.cursor, said=clause.turning):
            self.turn(clause, length)
        elif here("negation") and is_aside(self.cursor.tokens, self.cursor.index):
            while not self.cursor.at_end and not here("pause"):
                self.cursor.take()
        elif here("own view"):
            self.use()
            clause.own_view = True
        elif says_again(self.cursor):  # "put the book back on the shelf"
            self.use()
        elif here("pose") and not here("relation"):
            clause.poses.append(self.use())
        elif here("face") or (clause.turning and not clause.places and here("toward")):  # "turn it towards the wall"
            self.facing(clause, self.cursor.index)
        elif here("relation"):
            self.place(clause)
        elif here("restrict") and self.says_which_end(clause):
            self.use()
            self.last_place_ends = self.cursor.index
        elif here("restrict"):
            self.exclude |= self.use().value("restrict") == "not"
            self.restrict = True
        elif starts(self.cursor) and at_noun(self.cursor):
            self.noun(clause)
        else:
            self.cursor.take()

    def says_which_end(self, clause: Clause) -> bool:
        """Whether "that is" explains an edge, an end, a corner or a side and no thing: "the end that is nearest the
        door"."""
        follows = bool(clause.places) and self.last_place_ends == self.cursor.index
        plain = self.cursor.value("restrict") == "" and self.cursor.value("relation", ahead=1) in FAR_OR_NEAR
        return follows and plain and clause.places[-1].nouns[0].region in ACROSS

    def leads_to_place(self, ahead: int) -> bool:
        """Return whether a place or a noun comes that many tokens further."""
        here = self.cursor.here
        return here("relation", "distance", "bound", ahead=ahead) or at_noun(self.cursor, ahead)

    def bare_exclusion(self, clause: Clause) -> None:
        """ "except the pillow": not on it; before a pronoun or a verb it excludes nothing."""
        begin = self.cursor.index
        noun = noun_phrase(self.cursor)
        self.exclude = False
        if noun.pronoun in ("it", "viewer"):
            return
        self.keep(begin)
        clause.places.append(Place("on", (noun,), self.restrict, f"{self.but} {noun.text}", excluded=True))
        self.restrict, self.but = False, ""

    def measure_length(self) -> int:
        """Number of tokens of a length with its bound, its relation and "away"; 0 if it does not belong to a place."""
        here = self.cursor.here
        ahead = 1 if here("bound") and here("distance", ahead=1) else 0
        if not here("distance", ahead=ahead):
            return 0
        ahead += 1
        if here("count", ahead=ahead) and here("region", ahead=ahead + 1):  # "from the left edge"
            return ahead
        fits = here("of", ahead=ahead) or self.cursor.value("relation", ahead=ahead) in OF_A_LENGTH
        return ahead if fits and at_noun(self.cursor, ahead + 1) else 0

    def measured(self, clause: Clause, length: int) -> None:
        """[ BOUND ] DISTANCE ( RELATION | "of" ) noun."""
        begin = self.cursor.index
        tokens = [self.cursor.take() for _ in range(length)]
        mode = next((token.value("bound") for token in tokens if token.has("bound")), "exactly")
        measure = Measure(float(tokens[-1].value("distance")), mode)
        side = self.cursor.value("count")
        token = self.cursor.take()
        noun = noun_phrase(self.cursor)
        noun = replace(noun, sides=(side, *noun.sides)) if side else noun
        relation = token.value("relation") if token.value("relation") in SIDED else "distance"
        self.keep(begin)
        noun = self.referred(noun, relation)
        place = Place(relation, (noun,), self.restrict, self.cursor.text(begin), excluded=self.exclude, measure=measure)
        self.said(clause, place)

    def may_say_which(self, clause: Clause) -> bool:
        """Return whether "with", "without" or "where" comes right after the name of a place."""
        follows = self.last_place_ends == self.cursor.index or self.restrict
        return self.cursor.value("relation") in SAYS_WHICH and bool(clause.places) and follows

    def carried(self, clause: Clause) -> None:
        """ "with a lamp on it" after the name of a place; otherwise "with" has no used meaning."""
        begin, may = self.cursor.index, self.may_say_which(clause)
        relation = self.cursor.take().value("relation")
        if not at_noun(self.cursor):
            return
        noun = noun_phrase(self.cursor)
        if not may and self.cursor.tokens[begin].text == "where" and self.cursor.value("verb") == "be":
            self.cursor.take()  # "put it where the lamp is": next to it, as the lamp is there
            self.keep(begin)
            self.said(clause, Place("next_to", (noun,), False, self.cursor.text(begin), excluded=self.exclude))
            return
        if not may or self.cursor.here("face", "toward", "pose") or noun.pronoun or noun.is_region:
            self.cursor.index = begin + 1
            return
        if self.cursor.here("verb") and self.cursor.value("verb") == "be":  # "where the lamp is"
            self.cursor.take()
        if self.cursor.here("relation") and self.cursor.value("relation") in SUPPORT and self.nothing_new(1):
            self.cursor.index += 2 if self.cursor.here("pronoun", ahead=1) else 1  # "on it"
        beside = self.cursor.value("relation") in BESIDE_IT and self.cursor.here("pronoun", ahead=1)
        excluded = self.exclude
        if beside and self.cursor.tokens[self.cursor.index + 1].text == "it":
            self.cursor.index += 2  # "the desk that has a chair at it" is the one near a chair, "without": is not
            relation, excluded = "near", excluded or relation == "lacking"
        self.keep(begin)
        place = Place(relation, (noun,), True, self.cursor.text(begin), excluded=excluded)
        self.said(clause, place)

    def nothing_new(self, ahead: int) -> bool:
        """Return whether only a pronoun or no noun follows: "on it", "on top"."""
        return self.cursor.here("pronoun", ahead=ahead) or not at_noun(self.cursor, ahead)

    def said(self, clause: Clause, place: Place) -> None:
        """Add a place; words that restricted or excluded it are consumed."""
        clause.places.append(replace(place, text=f"{self.but} {place.text}".strip()))
        self.restrict, self.exclude, self.but = False, False, ""
        self.last_place_ends = self.cursor.index

    def topic(self) -> None:
        """In "close the drawer": remember the noun for a later "it"."""
        if starts(self.cursor) and at_noun(self.cursor):
            self.last_noun = noun_phrase(self.cursor)
        else:
            self.cursor.take()

    def turn(self, clause: Clause, length: int) -> None:
        """Read that many tokens as a turn; the reference of its angle ("to the edge") is not a place."""
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
        """RELATION [ noun [ "and" noun ] ]; "put it inside" refers to the thing mentioned before."""
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
        if relation in SIDED and nouns[0].is_region:
            if nouns[0].region not in MIDDLES:  # "left of the edge"
                return
            side = SIDED[relation]  # "left of the middle of the desk" is on the left of the desk
            relation, nouns = "at", [replace(nouns[0], region="", sides=(side,))]
        self.keep(begin)
        if relation == "seen_from":
            self.seen_from(clause, nouns[0], begin)
            return
        if relation == "nearest" and self.last_place_ends == begin and is_bare_side(clause.places[-1].nouns[0]):
            clause.places.pop()  # "on the side nearer the stool"
        right_before = begin - (self.cursor.tokens[begin - 1].value("verb") == "be")  # "whichever end is further from"
        across = self.last_place_ends == right_before and clause.places[-1].nouns[0].region in ACROSS
        if relation in ("opposite", "away") and across:
            relation = "farthest"  # "the corner opposite the lamp"
        toward = nouns[0].owner if nouns[0].region == "side" and not nouns[0].sides else None  # "on the window side"
        toward = nouns[0] if relation == "nearest" else toward
        if toward is not None and self.is_measured_edge(clause, begin):  # "10 cm from the edge nearest the sofa"
            self.says_edge(clause, begin, toward)
            return
        clause.poses += [token] if token.has("pose") else []  # "leaning against the wall"
        nouns = [self.referred(noun, relation) for noun in nouns]
        owner = nouns[0].owner
        if token.text == "at" and nouns[0].name == "foot" and owner is not None and not belongs(clause.theme, owner):
            relation, nouns = "front_of", [owner]  # "at the foot of the bed" is on the floor before it
        if not self.exclude:
            self.last_noun = nouns[0]
        place = Place(
            relation, tuple(nouns), self.restrict, self.cursor.text(begin), attached,
            excluded=self.exclude, topmost=token.has("topmost"), literal=token.text,
        )  # fmt: skip
        self.said(clause, place)

    def seen_from(self, clause: Clause, viewer: Noun, begin: int) -> None:
        """ "The far end, seen from the door" is the end farthest from it; any other side seen from there is not
        understood."""
        last = clause.places[-1] if clause.places else None
        far = next((side for side in (last.nouns[0].sides if last else ()) if side in SEEN), "")
        if last is None or not far:
            self.kept -= set(range(begin, self.cursor.index)) if viewer.pronoun != "viewer" else set()
            return
        noun = last.nouns[0]
        noun = replace(noun, sides=tuple(side for side in noun.sides if side != far))
        clause.places[-1] = replace(last, nouns=(noun, *last.nouns[1:]))
        clause.places.append(Place(SEEN[far], (viewer,), False, self.cursor.text(begin)))

    def second(self, relation: str) -> list[Noun]:
        """The noun after "and": for "between", or for "next to A and B" if the sentence ends or pauses after it."""
        back = self.cursor.index
        self.cursor.take()
        noun = noun_phrase(self.cursor)
        ends = self.cursor.at_end or self.cursor.here("pause")
        if relation == "between" or (relation in NEIGHBOURING and ends and noun.thing and not noun.region):
            return [noun]
        self.cursor.index = back
        return []

    def facing(self, clause: Clause, begin: int) -> None:
        """[ noun ] FACE noun, starting with the first of them; after an edge it selects the edge."""
        mode = self.cursor.take().value("face") or "toward"
        if not at_noun(self.cursor) or clause.facing is not None:
            return
        edge = (
            bool(clause.places)
            and self.last_place_ends == begin
            and clause.places[-1].nouns[0].region in EDGES - {"end"}
        )
        noun = noun_phrase(self.cursor)
        self.keep(begin)
        if edge and mode == "toward":
            self.says_edge(clause, begin, noun)
        else:
            clause.facing = Facing(mode, noun, self.cursor.text(begin))

    def is_measured_edge(self, clause: Clause, begin: int) -> bool:
        """Return whether a distance from an edge was stated right before."""
        last = clause.places[-1] if clause.places and self.last_place_ends == begin else None
        return last is not None and last.measure is not None and last.nouns[0].region in EDGES

    def says_edge(self, clause: Clause, begin: int, noun: Noun) -> None:
        """Attach the thing to the edge named last, which is the edge at this thing."""
        edge = clause.places[-1]
        text = f"{edge.text} {self.cursor.text(begin)}"
        clause.places[-1] = replace(edge, nouns=(replace(edge.nouns[0], toward=noun),), text=text)
        self.last_place_ends = self.cursor.index

    def noun(self, clause: Clause) -> None:
        """A noun without a relation: the moved thing, a region, or "the one" that explains the noun before."""
        begin = self.cursor.index
        noun = noun_phrase(self.cursor)
        if noun.pronoun == "one" and clause.places:
            clause.places += [Place("which", (noun,), True, noun.text)] if noun.sides or noun.colour else []
            self.restrict |= not (noun.sides or noun.colour)
        elif is_place_alone(noun) and not (clause.theme is None and thing_and_region(noun)):
            clause.places.append(Place("at", (noun,), False, noun.text))
        elif not clause.places and (clause.theme is None or (clause.theme.is_unknown and noun.thing)):
            self.theme(clause, noun)
        elif is_front(noun, clause.theme) and self.cursor.here("face", "toward"):
            self.facing(clause, begin)
            return
        elif clause.theme is not None and clause.places and self.cursor.here("relation") and noun.thing:
            clause.theme = several(clause.theme, noun)  # "... and a mug on the desk"
        elif clause.theme is not None and noun.thing and self.alone(begin) and self.says_no_place():
            self.said(clause, Place("on", (noun,), False, noun.text))  # "mug, white table"
        elif noun.pronoun != "it":
            return
        if noun.pronoun != "it" or not (noun.colour or noun.owner):  # "it red" has no used meaning
            self.keep(begin)

    def theme(self, clause: Clause, noun: Noun) -> None:
        """Set the moved thing; "the mug dead centre" is a mug and a region, "the mug and the book" are two things."""
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
        """Noun to which "it" refers: the drawer of the cabinet to put things in, the cabinet to put them on."""
        if noun.pronoun != "it" or self.last_noun is None:
            return noun
        last = self.last_noun
        return last.owner if relation == "on" and last.encloses and last.owner is not None else last
