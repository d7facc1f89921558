"""Mistyped words: the known word that a person meant.

In: a word and the known ones. Out: the one known word within a small edit distance, or none. The distance counts
insertions, deletions, substitutions and swaps of neighbouring letters (Damerau 1964; each letter edited once). A
longer word may have more slips; the first letter is seldom wrong, and a short word is soon another one: there only
swaps and, from four letters on, a missing, a doubled or a wrong vowel count.
"""

from collections.abc import Collection
from functools import lru_cache

LONG, VERY_LONG = 5, 8
"""Letters from which any one slip is allowed, and from which two are [-]."""
SHORTEST = 3
"""Shorter words are read as they stand [-]."""
VOWELS = frozenset("aeiouy")


@lru_cache(maxsize=100_000)
def edit_distance(a: str, b: str) -> int:
    """Insertions, deletions, substitutions and swaps of neighbours that make one word of the other [-]."""
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
    """How many slips a word of this length may have [-]."""
    if len(word) < SHORTEST or not word.isalpha():
        return 0
    return 2 if len(word) >= VERY_LONG else 1


def may_be(word: str, known: str) -> bool:
    """Whether a word can be a mistyped known one."""
    if abs(len(word) - len(known)) > slips_allowed(word) or not known.isalpha() or len(known) < SHORTEST:
        return False
    if word[0] != known[0] and sorted(word[:2]) != sorted(known[:2]):
        return False
    slips = edit_distance(word, known)
    if not 0 < slips <= slips_allowed(word):
        return False
    return len(word) >= LONG or swapped(word, known) or (len(word) > SHORTEST and only_a_vowel(word, known))


def swapped(word: str, known: str) -> bool:
    """Whether the two have the same letters."""
    return sorted(word) == sorted(known)


def only_a_vowel(word: str, known: str) -> bool:
    """Whether one vowel is wrong, or one letter is missing or doubled."""
    if len(word) != len(known):
        return True
    pairs = [(a, b) for a, b in zip(word, known, strict=True) if a != b]
    return all(a in VOWELS and b in VOWELS for a, b in pairs)


def meant_by(word: str, known: Collection[str]) -> str:
    """The one known word that it can be, the nearest; empty if there is none or several are as near."""
    if slips_allowed(word) == 0:
        return ""
    near = sorted((edit_distance(word, one), not usual(word, one), one) for one in known if may_be(word, one))
    alone = near and (len(near) == 1 or near[0][:2] < near[1][:2])
    return near[0][2] if alone else ""


def usual(word: str, known: str) -> bool:
    """Whether the slip is one that fingers make: two letters swapped, or one struck twice."""
    return swapped(word, known) or single(word) == single(known)


def single(word: str) -> str:
    """The word with each run of a letter as one."""
    return "".join(letter for index, letter in enumerate(word) if index == 0 or word[index - 1] != letter)
