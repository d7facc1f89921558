"""A prompt as tokens: known phrases with all their meanings, unknown and mistyped words, and used words.

In: text, and the names of things in the scene. Out: tokens in order; the longest known phrase at each place wins, a
number with its unit is one token, and so is the id of a thing. A misspelt word is read as the only known word that it
can be, with a note. Nothing is lost: every word is in some token.

Records the words of a sentence that rules have used, so that the others can be reported.

In: tokens, and the tokens used by a reader. Out: the phrases that no rule used.

Correction of misspelt words.

In: a word and the known words. Out: the single known word within a small edit distance, or none. The distance counts
insertions, deletions, substitutions and swaps of adjacent letters (Damerau 1964; each letter edited once). A longer
word may have more errors; the first letter is seldom wrong, and a short word soon becomes another one: for short words
only swaps and, from four letters on, a missing, a doubled or a wrong vowel count.
"""

import re
from collections.abc import Collection, Iterable
from dataclasses import dataclass, field
from functools import cache, lru_cache

from dcap.knowledge.lexicon import (
    FAMILY_WORDS,
    OPPOSITES,
    Meaning,
    label_words,
    longest_phrase,
    rows,
    split_words,
    vocabulary,
)
from dcap.knowledge.material_table import material_words
from dcap.language.offline.measures import plain_measures

LONG, VERY_LONG = 5, 8
"""Lengths from which one error of any kind, and two errors, are allowed [-]."""
SHORTEST = 3
"""Shorter words are not corrected [-]."""
VOWELS = frozenset("aeiouy")
UNKNOWN = frozenset({Meaning("unknown", "")})
PAUSE = frozenset({Meaning("pause", "")})
GRAMMAR = frozenset({"relation", "verb", "det", "side", "region", "restrict", "count", "face", "pose", "of"})
"""Kinds of words that take precedence over names of things in a correction."""
OTHER_WORDS = (FAMILY_WORDS, OPPOSITES)
"""Words that are known although the grammar does not use them."""
NOT_BY_MISTAKE = frozenset({"negation", "exclude", "choice", "numeral"})
"""Kinds of words to which a misspelling is not corrected, because they reverse the meaning of a sentence."""


@lru_cache(maxsize=100_000)
def edit_distance(a: str, b: str) -> int:
    """Insertions, deletions, substitutions and swaps of neighbours that turn one word into the other [-]."""
    before: list[int] = []
    row = list(range(len(b) + 1))
    for i, one in enumerate(a, 1):
        above, row, earlier = row, [i], before
        for j, other in enumerate(b, 1):
            best = min(above[j] + 1, row[j - 1] + 1, above[j - 1] + (one != other))
            if i > 1 and j > 1 and one == b[j - 2] and a[i - 2] == other:
                best = min(best, earlier[j - 2] + 1)
            row.append(best)
        before = above
    return row[-1]


def slips_allowed(word: str) -> int:
    """Maximum number of errors in a word of this length [-]."""
    if len(word) < SHORTEST or not word.isalpha():
        return 0
    return 2 if len(word) >= VERY_LONG else 1


def may_be(word: str, known: str) -> bool:
    """Return whether a word can be a misspelling of a known one."""
    if abs(len(word) - len(known)) > slips_allowed(word) or not known.isalpha() or len(known) < SHORTEST:
        return False
    if word[0] != known[0] and sorted(word[:2]) != sorted(known[:2]):
        return False
    slips = edit_distance(word, known)
    if not 0 < slips <= slips_allowed(word):
        return False
    return len(word) >= LONG or swapped(word, known) or (len(word) > SHORTEST and only_a_vowel(word, known))


def swapped(word: str, known: str) -> bool:
    """Return whether two words have the same letters."""
    return sorted(word) == sorted(known)


def only_a_vowel(word: str, known: str) -> bool:
    """Return whether one vowel is wrong, or one letter is missing or doubled."""
    if len(word) != len(known):
        return True
    pairs = [(a, b) for a, b in zip(word, known, strict=True) if a != b]
    return all(a in VOWELS and b in VOWELS for a, b in pairs)


def meant_by(word: str, known: Collection[str]) -> str:
    """The nearest known word that it can be; empty if there is none or several are equally near."""
    if slips_allowed(word) == 0:
        return ""
    near = sorted((edit_distance(word, one), not usual(word, one), one) for one in known if may_be(word, one))
    alone = near and (len(near) == 1 or near[0][:2] < near[1][:2])
    return near[0][2] if alone else ""


def usual(word: str, known: str) -> bool:
    """Return whether the error is a typical slip: two letters swapped, or one struck twice."""
    return swapped(word, known) or single(word) == single(known)


def single(word: str) -> str:
    """The word with each run of a letter reduced to one."""
    return "".join(letter for index, letter in enumerate(word) if index == 0 or word[index - 1] != letter)


@dataclass(frozen=True, slots=True)
class SceneWords:
    """Words of a scene for its things."""

    labels: frozenset[str] = frozenset()
    """Words of its labels."""
    ids: frozenset[str] = frozenset()

    @classmethod
    def of(cls, named: Iterable[tuple[str, str]]) -> "SceneWords":
        """The words from ids with labels."""
        pairs = list(named)
        return cls(frozenset(word for _, label in pairs for word in label_words(label)), frozenset(i for i, _ in pairs))


NO_SCENE = SceneWords()


@dataclass(frozen=True, slots=True)
class Token:
    """A phrase of the prompt."""

    text: str
    meanings: frozenset[Meaning]

    def has(self, *kinds: str) -> bool:
        """Return whether it may be one of these kinds."""
        return any(meaning.kind in kinds for meaning in self.meanings)

    def value(self, kind: str) -> str:
        """Meaning of the token as that kind, empty if it has none; the first in alphabetical order of several."""
        return next((m.value for m in sorted(self.meanings) if m.kind == kind), "")

    def values(self, kind: str) -> tuple[str, ...]:
        """All possible meanings as that kind."""
        return tuple(m.value for m in sorted(self.meanings) if m.kind == kind)

    def plural(self) -> bool:
        """Return whether it can only be a plural."""
        nouns = [m for m in self.meanings if m.kind in ("thing", "part")]
        return bool(nouns) and all(m.plural for m in nouns)


@dataclass(slots=True)
class TokenCursor:
    """A position among the tokens, from which phrases are read."""

    tokens: list[Token]
    index: int = 0

    @property
    def at_end(self) -> bool:
        """Whether every token is read."""
        return self.index >= len(self.tokens)

    def here(self, *kinds: str, ahead: int = 0) -> bool:
        """Return whether the next token, or the one `ahead` further, may be one of these kinds."""
        index = self.index + ahead
        return 0 <= index < len(self.tokens) and self.tokens[index].has(*kinds)

    def value(self, kind: str, ahead: int = 0) -> str:
        """Meaning of the next token, or of the one `ahead` further, as that kind; empty if it has none."""
        return self.tokens[self.index + ahead].value(kind) if self.here(kind, ahead=ahead) else ""

    def take(self) -> Token:
        """The next token; the cursor moves on."""
        token = self.tokens[self.index]
        self.index += 1
        return token

    def text(self, begin: int) -> str:
        """The words from `begin` to here."""
        return " ".join(token.text for token in self.tokens[begin : self.index])


@dataclass(slots=True)
class Words:
    """The words of a prompt, with misspelt ones corrected."""

    words: list[str]
    notes: tuple[str, ...] = ()
    """Notes on measures with an ambiguous reading."""
    mended: dict[str, str] = field(default_factory=dict)
    """Words as typed, and their corrections."""


def tokens_of(text: str, scene: SceneWords = NO_SCENE) -> list[Token]:
    """The prompt as tokens."""
    return tokens_of_words(words_of(text, scene).words, ids_in(text, scene))


def words_of(text: str, scene: SceneWords = NO_SCENE) -> Words:
    """The prompt's words; each unknown word is compared with the known ones and with the scene's labels."""
    plain, notes = plain_measures(text)
    words = split_words(plain)
    said = {word for one in ids_in(text, scene) for word in one}
    found = Words(words, notes)
    for index, word in enumerate(words):
        if word in known_words() or word in scene.labels or word in said:
            continue
        meant = mended(word, scene)
        if meant:
            found.words[index], found.mended[word] = meant, meant
    return found


def mended(word: str, scene: SceneWords) -> str:
    """The correction of a misspelt word: from the scene's labels, else from the grammar, else from all words; empty if
    there is none."""
    return next((meant for known in (scene.labels, *tiers()) if (meant := meant_by(word, known))), "")


@cache
def known_words() -> frozenset[str]:
    """Every word of every known phrase, including those for materials and their opposites."""
    lists = [row["words"].replace("|", " ") for name in OTHER_WORDS for row in rows(name)]
    said = {word for text in (*lists, *material_words()) for word in split_words(text)}
    return frozenset(word for phrase in vocabulary() for word in phrase) | said


@cache
def tiers() -> tuple[frozenset[str], frozenset[str]]:
    """Words to which an error may be corrected: those of the grammar, and all."""
    alone = {phrase[0]: meanings for phrase, meanings in vocabulary().items() if len(phrase) == 1}
    fit = {word: m for word, m in alone.items() if not any(one.kind in NOT_BY_MISTAKE for one in m)}
    grammar = frozenset(word for word, m in fit.items() if any(one.kind in GRAMMAR for one in m))
    named = (p for p, m in vocabulary().items() if len(p) > 1 and any(one.kind in ("thing", "part") for one in m))
    return grammar, frozenset(fit) | frozenset(word for phrase in named for word in phrase if len(word) >= LONG)


def ids_in(text: str, scene: SceneWords) -> dict[tuple[str, ...], str]:
    """The ids of the scene's things that occur in a text, by their words.

    An id that is a plain word, as for nodes of glTF files, only counts after the word "id".
    """
    found = {}
    for one in scene.ids:
        plain = one.replace(" ", "").isalpha()
        before = r"\bid\s+[\"']?" if plain else r"(?<![\w-])"
        if one and re.search(before + re.escape(one) + r"(?![\w-])", text, re.IGNORECASE):
            found[tuple(split_words(one))] = one
    return found


def tokens_of_words(words: list[str], ids: dict[tuple[str, ...], str]) -> list[Token]:
    """The words as tokens; an id comes after the word "id" or the name of a thing, or is not a plain number."""
    found: list[Token] = []
    begin = 0
    while begin < len(words):
        said = next(
            (one for one in sorted(ids, key=len, reverse=True) if tuple(words[begin : begin + len(one)]) == one), None
        )
        if said is not None and is_id(said, found, words[begin + len(said) :]):
            found.append(Token(" ".join(said), frozenset({Meaning("id", ids[said])})))
            begin += len(said)
            continue
        token, length = longest_at(words, begin)
        found.append(token)
        begin += length
    return found


def is_id(said: tuple[str, ...], before: list[Token], after: list[str]) -> bool:
    """Return whether words that equal an id are meant as one: "2" alone may be a number, "chair 2" is the chair with
    that id."""
    if not all(is_digits(word) for word in said):
        return True
    told = bool(before) and before[-1].has("id word", "thing", "det", "relation", "unknown")
    return told and not (after and (of_kind(after[0], "unit") or of_kind(after[0], "length")))


def longest_at(words: list[str], begin: int) -> tuple[Token, int]:
    """The longest known phrase that starts here, and its length in words."""
    if words[begin] == ",":
        return Token(",", PAUSE), 1
    if (measured := measure_at(words, begin)) is not None:
        return measured, 2
    for length in range(min(longest_phrase(), len(words) - begin), 0, -1):
        phrase = tuple(words[begin : begin + length])
        if phrase in vocabulary():
            return Token(" ".join(phrase), vocabulary()[phrase]), length
    return Token(words[begin], UNKNOWN), 1


def measure_at(words: list[str], begin: int) -> Token | None:
    """The angle or length of a number in digits and a unit, as written by `plain_measures`; None if there is none."""
    value, *rest = words[begin : begin + 2]
    for kind, unit in (("angle", "unit"), ("distance", "length")):
        if rest and is_digits(value) and (size := of_kind(rest[0], unit)):
            return Token(f"{value} {rest[0]}", frozenset({Meaning(kind, f"{float(value) * float(size):g}")}))
    return None


def is_digits(word: str) -> bool:
    """Return whether a word is a number in digits."""
    return re.fullmatch(r"-?\d+(\.\d+)?", word) is not None


def of_kind(word: str, kind: str) -> str:
    """Meaning of one word as that kind; empty if it has none."""
    return next((m.value for m in vocabulary().get((word,), ()) if m.kind == kind), "")


def given_last(tokens: list[Token]) -> list[Token]:
    """The tokens with a receiving thing moved to the end: "the table gets the cup" is "the cup on the table"."""
    at = next((i for i, token in enumerate(tokens) if token.has("receives")), 0)
    end = next((i for i in range(at, len(tokens)) if tokens[i].has("pause")), len(tokens))
    begin = next((i + 1 for i in range(at - 1, -1, -1) if tokens[i].has("pause")), 0)
    place, given = tokens[begin:at], tokens[at + 1 : end]
    plain = all(
        is_named(side) and not any(one.has("verb", "restrict", "face") for one in side) for side in (place, given)
    )
    if not at or not plain or not given[0].has("det", "thing") or any(one.has("relation") for one in (*place, *given)):
        return tokens
    return [
        *tokens[:begin],
        *given,
        Token(tokens[at].text, frozenset({Meaning("relation", "on")})),
        *place,
        *tokens[end:],
    ]


def is_named(tokens: list[Token]) -> bool:
    """Return whether the tokens name a thing."""
    return any(one.has("thing") for one in tokens)


def is_aside(tokens: list[Token], at: int) -> bool:
    """Return whether a negation does not refer to a place: "don't ask", "I don't want anyone to trip over it"."""
    end = next((i for i in range(at, len(tokens)) if tokens[i].has("pause")), len(tokens))
    said = tokens[at + 1 : end]
    return bool(said) and not any(token.has("thing", "part", "region", "side", "pose") for token in said)


class KeptWords:
    """A cursor among tokens that remembers which of them were used."""

    def __init__(self, tokens: list[Token]) -> None:
        self.cursor = TokenCursor(tokens)
        self.kept: set[int] = set()
        """Indices of the tokens that a rule used."""

    def alone(self, begin: int) -> bool:
        """Return whether the tokens read from `begin` on are between pauses."""
        paused = begin > 0 and self.cursor.tokens[begin - 1].has("pause")
        return paused and (self.cursor.at_end or self.cursor.here("pause"))

    def says_no_place(self) -> bool:
        """Return whether there is no relation or verb anywhere, and no further thing follows: "mug, white table, left
        side"."""
        rest = self.cursor.tokens[self.cursor.index :]
        return not any(one.has("relation", "verb") for one in self.cursor.tokens) and not any(
            one.has("thing") for one in rest
        )

    def use(self) -> Token:
        """The next token, marked as used."""
        token = self.cursor.take()
        self.keep(self.cursor.index - 1)
        return token

    def keep(self, begin: int) -> None:
        """Mark the tokens from `begin` to here as used, apart from unknown words."""
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


def trimmed(run: list[Token]) -> str:
    """The words of a run without fillers, articles and "and" at its ends."""
    bare = [index for index, token in enumerate(run) if not token.has("filler", "conj", "of", "genitive", "det")]
    return " ".join(token.text for token in run[bare[0] : bare[-1] + 1]) if bare else ""
