"""A prompt cut into tokens: known phrases with everything they may mean, and unknown words.

In: text. Out: tokens in order; the longest known phrase at each place wins, and a number with its unit is one token.
Nothing is lost: every word is in some token.
"""

import re
from dataclasses import dataclass

from dcap.language.offline.lexicon import Meaning, longest_phrase, split_words, vocabulary

UNKNOWN = frozenset({Meaning("unknown", "")})
PAUSE = frozenset({Meaning("pause", "")})
HUNDRED = 100.0
"""The number word that multiplies what stands before it."""


@dataclass(frozen=True, slots=True)
class Token:
    """A phrase of the prompt."""

    text: str
    meanings: frozenset[Meaning]

    def has(self, *kinds: str) -> bool:
        """Whether it may be one of these kinds."""
        return any(meaning.kind in kinds for meaning in self.meanings)

    def value(self, kind: str) -> str:
        """What it means as that kind, empty if it cannot be one; the first in alphabetical order of several."""
        return next((m.value for m in sorted(self.meanings) if m.kind == kind), "")

    def values(self, kind: str) -> tuple[str, ...]:
        """All that it may mean as that kind."""
        return tuple(m.value for m in sorted(self.meanings) if m.kind == kind)

    def plural(self) -> bool:
        """Whether it can only be a plural."""
        nouns = [m for m in self.meanings if m.kind in ("thing", "part")]
        return bool(nouns) and all(m.plural for m in nouns)


@dataclass(slots=True)
class TokenCursor:
    """A place among the tokens, from which phrases are read."""

    tokens: list[Token]
    index: int = 0

    @property
    def at_end(self) -> bool:
        """Whether every token is read."""
        return self.index >= len(self.tokens)

    def here(self, *kinds: str, ahead: int = 0) -> bool:
        """Whether the next token, or the one `ahead` further, may be one of these kinds."""
        index = self.index + ahead
        return 0 <= index < len(self.tokens) and self.tokens[index].has(*kinds)

    def take(self) -> Token:
        """The next token; the cursor moves on."""
        token = self.tokens[self.index]
        self.index += 1
        return token

    def text(self, begin: int) -> str:
        """The words from there up to here."""
        return " ".join(token.text for token in self.tokens[begin : self.index])


def tokens_of(text: str) -> list[Token]:
    """The prompt as tokens."""
    words = split_words(text)
    found: list[Token] = []
    begin = 0
    while begin < len(words):
        token, length = longest_at(words, begin)
        found.append(token)
        begin += length
    return found


def longest_at(words: list[str], begin: int) -> tuple[Token, int]:
    """The longest known phrase that starts here, and its length in words."""
    if words[begin] == ",":
        return Token(",", PAUSE), 1
    if length := angle_length(words, begin):
        degrees = f"{number(words[begin : begin + length - 1]):g}"
        return Token(" ".join(words[begin : begin + length]), frozenset({Meaning("angle", degrees)})), length
    for length in range(min(longest_phrase(), len(words) - begin), 0, -1):
        phrase = tuple(words[begin : begin + length])
        if phrase in vocabulary():
            return Token(" ".join(phrase), vocabulary()[phrase]), length
    return Token(words[begin], UNKNOWN), 1


def angle_length(words: list[str], begin: int) -> int:
    """How many words from there on are an angle, "forty five degrees" or "-30 deg"; 0 if none is."""
    end = begin
    while end < len(words) and (is_digits(words[end]) or of_kind(words[end], "numeral")):
        end += 1
    return end + 1 - begin if end > begin and end < len(words) and of_kind(words[end], "unit") else 0


def number(words: list[str]) -> float:
    """What digits or number words amount to: "forty five" is 45, "two hundred seventy" 270."""
    total = 0.0
    for word in words:
        value = float(word) if is_digits(word) else float(of_kind(word, "numeral"))
        total = total * value if value == HUNDRED and total > 0 else total + value
    return total


def is_digits(word: str) -> bool:
    """Whether a word is a number in digits."""
    return re.fullmatch(r"-?\d+(\.\d+)?", word) is not None


def of_kind(word: str, kind: str) -> str:
    """What one word means as that kind; empty if it is none."""
    return next((m.value for m in vocabulary().get((word,), ()) if m.kind == kind), "")
