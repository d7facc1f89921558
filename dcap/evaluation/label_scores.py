"""Whether a found label matches the true kind of a thing: the same word, a synonym, or a kind of it.

A found "sofa" is right for a "multi person sofa", a "cabinet" for a "shoe cabinet", a "table" for a "desk": a desk is a
table. Synonyms and kinds are those of the lexicon.
"""

from collections.abc import Sequence

import numpy as np

from dcap.evaluation.segment_scores import Score
from dcap.language.offline.lexicon import in_line, thing_of


def means_the_same(found: str, true: str) -> bool:
    """Whether two labels name the same kind of thing, one perhaps more exactly."""
    a, b = thing_of(found), thing_of(true)
    return found == true or (a is not None and b is not None and in_line(a.id, b.id))


def label_accuracy(rows: Sequence[Score]) -> float:
    """Share of the true things whose found label is right; things that were not found count as wrong. 1 for no
    things."""
    return float(np.mean([means_the_same(row.found_label, row.label) for row in rows])) if rows else 1.0
