"""Whether a sentence was aimed as intended: support, part and region against a person's annotation.

A field missing in the truth is left open by the sentence: it is not compared and not counted.
"""

from collections.abc import Iterable
from dataclasses import dataclass, fields

import numpy as np

from dcap.evaluation.outcome_table import same_region
from dcap.scene.types.choices import Anchor, Intent
from dcap.scene.types.outcome import BesideThePart, Infeasible, NoRoom


@dataclass(frozen=True, slots=True)
class Aim:
    """Where an object goes, in words."""

    base: str = ""
    """Id of the instance that carries it; in a truth empty where several will do."""
    part: str = ""
    region: str = ""
    """Region words in any order; in a truth empty where the sentence leaves it open."""
    references: frozenset[str] = frozenset()
    """Instance ids and part:NAME that the region refers to; in a truth empty where that is open."""
    reason: str = ""
    """Reason code if there is no such place."""


@dataclass(frozen=True, slots=True)
class Marks:
    """Whether each field is right; None if the truth leaves it open."""

    base: bool | None
    part: bool | None
    region: bool | None
    references: bool | None
    reason: bool | None

    @property
    def all_right(self) -> bool:
        """Whether no compared field is wrong."""
        return all(getattr(self, field.name) is not False for field in fields(self))


def aim_of(intent: Intent | Infeasible, anchor: Anchor | Infeasible | None) -> Aim:
    """The aim that two stages found; without an anchor that of the intent."""
    if isinstance(intent, Infeasible):
        return Aim(reason=intent.reason)
    asked = Aim(intent.base_id, intent.region.part, " ".join(intent.region.names), frozenset(intent.region.references))
    if anchor is None:
        return asked
    if isinstance(anchor, Infeasible):
        part = anchor.evidence.part if isinstance(anchor.evidence, NoRoom | BesideThePart) else ""
        return Aim(asked.base, part, asked.region, asked.references, anchor.reason)
    return Aim(anchor.base_id, anchor.part, anchor.region, asked.references)


def marks(truth: Aim, found: Aim) -> Marks:
    """Compare; a refusal where the truth has a place is wrong."""
    return Marks(
        base=found.base == truth.base if truth.base else None,
        part=found.part == truth.part if truth.part else None,
        region=same_region(found.region, truth.region) if truth.region else None,
        references=found.references == truth.references if truth.references else None,
        reason=found.reason == truth.reason if truth.reason or found.reason else None,
    )


def shares(rows: Iterable[Marks]) -> dict[str, float]:
    """Share of right values by field, among the compared ones, and share of rows without any fault [-]."""
    rows = list(rows)
    result = {}
    for field in fields(Marks):
        compared = [getattr(row, field.name) for row in rows if getattr(row, field.name) is not None]
        result[field.name] = float(np.mean(compared)) if compared else 1.0
    result["all"] = float(np.mean([row.all_right for row in rows])) if rows else 1.0
    return result
