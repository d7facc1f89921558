"""One row per sample: what came out, what was intended, and whether they agree."""

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace

from scene.errors import InputError
from scene.sample import Sample

AT_REST = "at_rest"


@dataclass(frozen=True, slots=True)
class Truth:
    """The intended outcome of a sample; no stage sees it."""

    base: str
    """Label of the intended support."""
    part: str
    region: str
    feasible: bool
    reason: str
    """Intended reason code; empty if feasible."""


@dataclass(frozen=True, slots=True)
class Row:
    """The outcome of one sample."""

    sample: str
    scene: str
    object: str
    prompt: str
    verdict: str
    """at_rest, infeasible or failed."""
    reason: str
    message: str
    base: str
    part: str
    region: str
    region_missed: bool
    mass: float
    """[kg], 0 where unknown."""
    scale: float
    visible_fraction: float
    seconds: float
    """Sum of the stages' times when they were computed [s]."""
    error: str
    """Why the sample failed; empty if it did not."""
    expected: str
    """Intended outcome in words; empty if nobody stated one."""
    feasible_intended: bool | None
    """Whether it ought to come to rest; None if nobody said."""
    as_expected: bool | None
    """Whether verdict, support, part and reason are the intended ones."""


def read_truth(tree: object, where: str) -> dict[str, Truth]:
    """Intended outcomes by sample id, from a list with `id` or a mapping by id."""
    if isinstance(tree, Mapping):
        rows = {str(key): value for key, value in tree.items()}
    elif isinstance(tree, list):
        rows = {str(row["id"]): row for row in tree if isinstance(row, Mapping) and "id" in row}
    else:
        raise InputError(f"{where}: expected samples, found {type(tree).__name__}")
    return {key: truth_of(row, f"{where}: {key}") for key, row in rows.items()}


def truth_of(row: object, where: str) -> Truth:
    """One intended outcome."""
    if not isinstance(row, Mapping):
        raise InputError(f"{where}: expected keys and values, found {row!r}")
    known = ("id", *(one.name for one in fields(Truth)))
    for key in row:
        if key not in known:
            near = difflib.get_close_matches(str(key), known, 1)
            raise InputError(f"{where}: unknown key {key!r}" + (f"; did you mean {near[0]!r}?" if near else ""))
    return Truth(
        base=str(row.get("base") or ""),
        part=str(row.get("part") or ""),
        region=str(row.get("region") or ""),
        feasible=bool(row.get("feasible", True)),
        reason=str(row.get("reason") or ""),
    )


def row_of(sample: Sample, tree: Mapping[str, object] | None, error: str, truth: Truth | None) -> Row:
    """The row of a sample from its placement.json or its error."""
    found: Mapping[str, object] = tree or {}
    base = found.get("base")
    timings = found.get("timings")
    row = Row(
        sample=sample.id,
        scene=sample.scene,
        object=sample.object,
        prompt=sample.prompt,
        verdict=str(found.get("verdict", "failed")),
        reason=str(found.get("reason") or ""),
        message=str(found.get("message") or ""),
        base=str(base["label"]) if isinstance(base, Mapping) else "",
        part=str(found.get("part") or ""),
        region=str(found.get("region") or ""),
        region_missed=bool(found.get("region_missed")),
        mass=number(found.get("mass")),
        scale=number(found.get("scale")),
        visible_fraction=number(found.get("visible_fraction")),
        seconds=round(sum(timings.values()), 3) if isinstance(timings, Mapping) else 0.0,
        error=error if tree is None else "",
        expected=in_words(truth) if truth else "",
        feasible_intended=truth.feasible if truth else None,
        as_expected=None,
    )
    return row if truth is None else replace(row, as_expected=agrees(row, truth))


def number(value: object) -> float:
    """A number, 0 where there is none."""
    return float(value) if isinstance(value, int | float) else 0.0


def agrees(row: Row, truth: Truth) -> bool:
    """Whether the outcome is the intended one."""
    if not truth.feasible:
        return row.verdict == "infeasible" and row.reason == truth.reason
    on_support = truth.base in ("", row.base) and truth.part in ("", row.part)
    return row.verdict == AT_REST and on_support and not row.region_missed


def in_words(truth: Truth) -> str:
    """An intended outcome in words."""
    if not truth.feasible:
        return f"infeasible: {truth.reason}"
    where = " ".join(word for word in (truth.base, truth.part) if word)
    region = f", {truth.region}" if truth.region else ""
    return f"at rest on {where}{region}" if where else f"at rest{region}"


def totals(rows: Sequence[Row]) -> dict[str, object]:
    """Honest counts."""
    feasible = [row for row in rows if row.feasible_intended is True]
    infeasible = [row for row in rows if row.feasible_intended is False]
    return {
        "samples": len(rows),
        "at_rest": sum(row.verdict == AT_REST for row in rows),
        "infeasible": sum(row.verdict == "infeasible" for row in rows),
        "failed": sum(row.error != "" for row in rows),
        "region_missed": sum(row.verdict == AT_REST and row.region_missed for row in rows),
        "feasible_intended": len(feasible),
        "feasible_as_intended": sum(bool(row.as_expected) for row in feasible),
        "infeasible_intended": len(infeasible),
        "infeasible_with_right_reason": sum(bool(row.as_expected) for row in infeasible),
        "compute_s": round(sum(row.seconds for row in rows), 1),
    }
