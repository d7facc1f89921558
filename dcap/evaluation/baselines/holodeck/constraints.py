"""Parser of Holodeck's line of relations, equivalent to its program's.

As in the source (`parse_constraints`): lines hold `|`, their letters are made small, a leading number or dash and a
last full stop are dropped; what is before the first `|` is the object; each further piece is a relation and perhaps a
target behind a comma. A relation that is not known is taken for the one with the least edit distance. A target must be
placed before; a piece without one is dropped. `around` means near and facing, `in front of` also aligned. An object
without a line is not placed.
"""

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from enum import StrEnum

LEADING = re.compile(r"^(\d+[.)]\s*|- )")


class RelationKind(StrEnum):
    """Kinds of relations."""

    GLOBAL = "global"
    RELATIVE = "relative"
    DIRECTION = "direction"
    ALIGNMENT = "alignment"
    DISTANCE = "distance"


KINDS: Mapping[str, RelationKind] = {
    "edge": RelationKind.GLOBAL,
    "middle": RelationKind.GLOBAL,
    "in front of": RelationKind.RELATIVE,
    "behind": RelationKind.RELATIVE,
    "left of": RelationKind.RELATIVE,
    "right of": RelationKind.RELATIVE,
    "side of": RelationKind.RELATIVE,
    "around": RelationKind.RELATIVE,
    "face to": RelationKind.DIRECTION,
    "face same as": RelationKind.DIRECTION,
    "aligned": RelationKind.ALIGNMENT,
    "center alignment": RelationKind.ALIGNMENT,
    "center aligned": RelationKind.ALIGNMENT,
    "aligned center": RelationKind.ALIGNMENT,
    "edge alignment": RelationKind.ALIGNMENT,
    "near": RelationKind.DISTANCE,
    "far": RelationKind.DISTANCE,
}
"""The vocabulary, including aliases."""


@dataclass(frozen=True, slots=True)
class Relation:
    """One relation of the object."""

    kind: RelationKind
    name: str
    target: str = ""
    """Empty: it has none."""


def parsed_relations(text: str, object_name: str, placed: Collection[str]) -> list[Relation] | None:
    """The relations of one object, from its last line; None if no line names it.

    Args:
        text: the answer, any number of lines.
        object_name: the object; names are compared in lower case.
        placed: names of possible targets.
    """
    found: list[Relation] | None = None
    for line in (line.lower() for line in text.splitlines() if "|" in line):
        plain = LEADING.sub("", line.strip()).removesuffix(".")
        about, *pieces = plain.split("|")
        if about.replace("*", "").strip() != object_name.lower():
            continue
        found = [one for piece in pieces for one in relations_of(piece.strip(), {name.lower() for name in placed})]
    return found


def relations_of(piece: str, placed: Collection[str]) -> list[Relation]:
    """Relations of one piece between bars."""
    said, comma, behind = piece.partition(",")
    if not said.strip() or said.strip() == "n/a":
        return []
    name = nearest_name(said.strip())
    kind = KINDS[name]
    if kind is RelationKind.GLOBAL:
        return [Relation(kind, name)]
    target = behind.split(",")[0].strip()
    if not comma or target not in placed:
        return []
    if name == "around":
        return [Relation(RelationKind.DISTANCE, "near", target), Relation(RelationKind.DIRECTION, "face to", target)]
    if name == "in front of":
        return [Relation(kind, name, target), Relation(RelationKind.ALIGNMENT, "center aligned", target)]
    return [Relation(kind, name, target)]


def nearest_name(said: str) -> str:
    """A word of the vocabulary: the same word, or the one with the least edit distance, alphabetically first of
    several."""
    return said if said in KINDS else min(KINDS, key=lambda name: (edit_distance(name, said), name))


def edit_distance(a: str, b: str) -> int:
    """Number of letters to insert, delete or replace (Levenshtein, 1966)."""
    row = list(range(len(b) + 1))
    for i, letter in enumerate(a, 1):
        above, row[0] = row[0], i
        for j, other in enumerate(b, 1):
            above, row[j] = row[j], min(row[j] + 1, row[j - 1] + 1, above + (letter != other))
    return row[-1]
