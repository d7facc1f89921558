"""Guesses what a mistyped word was meant to be."""

import difflib
from collections.abc import Iterable, Sequence


def did_you_mean(word: object, known: Iterable[str]) -> str:
    """The end of an error message that names the nearest known word; empty if none is near."""
    near = difflib.get_close_matches(str(word), list(known), 1)
    return f"; did you mean {near[0]!r}?" if near else ""


def first_of(words: Sequence[str], most: int) -> str:
    """The first of some words, and how many more there are."""
    more = len(words) - most
    return ", ".join(words[:most]) + (f" and {more} more" if more > 0 else "")


def not_one_of(word: object, known: Iterable[str]) -> str:
    """The end of an error message about a word of a closed list, after what was given."""
    words = list(known)
    return f"is not one of {', '.join(words)}{did_you_mean(word, words)}"
