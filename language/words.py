"""A prompt cut into tokens: known phrases with everything they may mean, and unknown words.

In: text. Out: tokens in order; the longest known phrase at each place wins. Nothing is lost: every word is in some
token.
"""

from dataclasses import dataclass

from language.lexicon import Meaning, longest_phrase, split_words, vocabulary

UNKNOWN = frozenset({Meaning("unknown", "")})
PAUSE = frozenset({Meaning("pause", "")})


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
class Cursor:
    """A place among the tokens, from which phrases are read."""

    tokens: list[Token]
    index: int = 0

    @property
    def at_end(self) -> bool:
        """Whether every token is read."""
        return self.index >= len(self.tokens)

    def here(self, *kinds: str, ahead: int = 0) -> bool:
        """Whether the next token, or the one so many further, may be one of these kinds."""
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
    for length in range(min(longest_phrase(), len(words) - begin), 0, -1):
        phrase = tuple(words[begin : begin + length])
        if phrase in vocabulary():
            return Token(" ".join(phrase), vocabulary()[phrase]), length
    return Token(words[begin], UNKNOWN), 1
