"""Figure 3 for the scenes of a run: the number of deformable supports in each, from scene.json of its placements."""

import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from dcap.evaluation.outcome_table import SampleOutcome
from dcap.evaluation.run_folder import placement_folder
from dcap.evaluation.supports_plot import save_supports_plot, summary
from dcap.language.offline.kinds import deformable_supports

FACTS, FIGURE = "scene.json", "figures/supports.svg"


@dataclass(frozen=True, slots=True)
class SupportsFigure:
    """The figure of a run."""

    path: str
    """Relative to the run."""
    words: str
    scenes: int
    """Scenes of the run [-]."""
    known: int
    """Number of these whose labels are known from some placement."""


def supports_figure(run: Path, rows: Sequence[SampleOutcome]) -> SupportsFigure | None:
    """Draw the figure into the run; None if no scene is known."""
    found: dict[str, Counter[str] | None] = {}
    for row in rows:
        if found.get(row.scene) is None:
            labels = labels_of(placement_folder(run, row.method, row.sample) / FACTS)
            found[row.scene] = None if labels is None else deformable_supports(labels)
    known = [one for one in found.values() if one is not None]
    if not known:
        return None
    save_supports_plot(known, run / FIGURE)
    return SupportsFigure(FIGURE, summary(known), len(found), len(known))


def labels_of(path: Path) -> list[str] | None:
    """Labels of a scene's things without the placed ones; None if there is no such file."""
    try:
        tree = json.loads(path.read_text(encoding="utf-8"))
        return [str(one["label"]) for one in tree["instances"] if one["id"] != tree.get("object")]
    except (OSError, ValueError, KeyError, TypeError):
        return None
