"""On which side of a thing its front is, where its category says so: at an end of its long side or in the middle of it.

In: `lexicon/fronts.csv`. A car drives along its long side, a television looks across it; shape alone tells neither.
"""

from collections.abc import Mapping
from enum import StrEnum
from functools import cache
from types import MappingProxyType

from dcap.language.offline.lexicon import lineage, rows, thing_of


class FrontSide(StrEnum):
    """Where the front is, seen from above."""

    LONG = "long"
    """At an end of the longer horizontal side."""
    SHORT = "short"
    """Across it."""
    UNKNOWN = ""


@cache
def front_sides() -> Mapping[str, FrontSide]:
    """By thing id."""
    return MappingProxyType({row["id"]: FrontSide(row["front"]) for row in rows("lexicon/fronts.csv")})


def front_side(name: str) -> FrontSide:
    """Of the thing that a name means, or of its nearest kind that says."""
    thing = thing_of(name)
    kinds = lineage(thing.id) if thing else ()
    return next((front_sides()[kind] for kind in kinds if kind in front_sides()), FrontSide.UNKNOWN)
