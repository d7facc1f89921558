"""Which words of a sentence a rule has used, so that the others can be reported.

In: tokens, and from a reader what it used of them. Out: the phrases that no rule used.
"""

from dcap.language.offline.words import Token, TokenCursor


class KeptWords:
    """A cursor among tokens that remembers which of them were used."""

    def __init__(self, tokens: list[Token]) -> None:
        self.cursor = TokenCursor(tokens)
        self.kept: set[int] = set()
        """Indices of the tokens that a rule used."""

    def alone(self, begin: int) -> bool:
        """Whether what was read from that token on stands between pauses."""
        paused = begin > 0 and self.cursor.tokens[begin - 1].has("pause")
        return paused and (self.cursor.at_end or self.cursor.here("pause"))

    def says_no_place(self) -> bool:
        """Whether no relation or verb stands anywhere, and no thing comes any more: "mug, white table, left side"."""
        rest = self.cursor.tokens[self.cursor.index :]
        return not any(one.has("relation", "verb") for one in self.cursor.tokens) and not any(
            one.has("thing") for one in rest
        )

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


def trimmed(run: list[Token]) -> str:
    """The words of a run without fillers, articles and "and" at its ends."""
    bare = [index for index, token in enumerate(run) if not token.has("filler", "conj", "of", "genitive", "det")]
    return " ".join(token.text for token in run[bare[0] : bare[-1] + 1]) if bare else ""
