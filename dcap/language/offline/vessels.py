"""Which things hold something: what is open of them is their mouth, not damage.

In: `lexicon/vessels.csv`, ids of things whose kinds hold something too; `face` says where their opening is their face.
"""

from functools import cache

from dcap.language.offline.lexicon import lineage, rows, thing_of


@cache
def vessels() -> frozenset[str]:
    """Ids of things that hold something."""
    return frozenset(row["id"] for row in rows("lexicon/vessels.csv"))


@cache
def faced_by_opening() -> frozenset[str]:
    """Ids of those that lie on their face when their opening is down."""
    return frozenset(row["id"] for row in rows("lexicon/vessels.csv") if row["face"] == "opening")


def is_vessel(name: str) -> bool | None:
    """Whether what a name means holds something; None where the lexicon does not know it."""
    thing = thing_of(name)
    return None if thing is None else bool(vessels() & set(lineage(thing.id)))
