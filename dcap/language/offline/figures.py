"""Which things are figures: what has a body that can sit or stand, where others are just set down.

In: `lexicon/figures.csv`, ids of things whose kinds are figures too.
"""

from functools import cache

from dcap.language.offline.lexicon import lineage, rows, thing_of


@cache
def figures() -> frozenset[str]:
    """Ids of things that are figures."""
    return frozenset(row["id"] for row in rows("lexicon/figures.csv"))


def is_figure(name: str) -> bool | None:
    """Whether what a name means is a figure; None where the lexicon does not know it."""
    thing = thing_of(name)
    return None if thing is None else bool(figures() & set(lineage(thing.id)))
