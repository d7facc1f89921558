"""The deformable supports of many scenes as a table: one row a scene, the numbers behind the paper's figure 3."""

import csv
import io
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence

from dcap.language.offline.kinds import KINDS, OTHER, deformable_supports
from dcap.language.offline.lexicon import first_part, is_a, thing_of

SHOWN = (*KINDS, OTHER)
COLUMNS = ("scene", "instances", "supports", "deformable", "share", *SHOWN)


def is_support(label: str) -> bool:
    """Whether a label names a support: furniture and rugs with a carrying part, or a deformable thing."""
    thing = thing_of(label)
    carries = thing is not None and not is_a(thing.id, "structure") and first_part(thing.id) != ""
    return carries or deformable_supports([label]).total() > 0


def supports_table(scenes: Mapping[str, Sequence[str]]) -> str:
    """CSV of the scenes, given as the labels of their instances by name, and a last row of all of them.

    `share` is the share of deformable supports among supports [-], empty without supports.
    """
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(COLUMNS)
    for name, labels in scenes.items():
        table.writerow(row_of_labels(name, labels))
    table.writerow(row_of_labels("all", [label for labels in scenes.values() for label in labels]))
    return text.getvalue()


def row_of_labels(name: str, labels: Iterable[str]) -> list[object]:
    """Counts of one scene."""
    known = list(labels)
    kinds: Counter[str] = deformable_supports(known)
    supports = sum(is_support(label) for label in known)
    share = f"{kinds.total() / supports:.4f}" if supports else ""
    return [name, len(known), supports, kinds.total(), share, *(kinds[kind] for kind in SHOWN)]
