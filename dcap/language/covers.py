"""Covers: what is spread over other things as a layer, and how thick it usually is.

In: the name of a part or the label of a thing. Out: its usual thickness, None for what is no cover. It is the role that
makes a cover, not what it is made of: a blanket of the same fleece as a pillow is a layer, the pillow is not.
"""

import csv
from functools import cache
from importlib.resources import files


@cache
def cover_thicknesses() -> dict[str, float]:
    """Usual thickness of each cover [m], by each of its words."""
    with (files("dcap.language") / "covers.csv").open(encoding="utf-8") as text:
        return {
            word: float(row["thickness_m"]) for row in csv.DictReader(text) for word in row["words"].split("|")
        }  # fmt: skip


def cover_thickness(name: str) -> float | None:
    """Usual thickness of a cover of this name [m]; None if it names none. The last words decide: a "wool blanket" is a
    blanket, a "blanket box" is a box."""
    known, words = cover_thicknesses(), name.lower().replace("_", " ").replace("-", " ").split()
    endings = [" ".join(words[start:]) for start in range(len(words))]
    singular = [one.removesuffix("s") for one in endings]
    return next((known[one] for one in (*endings, *singular) if one in known), None)
