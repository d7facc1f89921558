"""One row per sample: the outcome, the intended outcome, and whether they agree."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Annotated, Literal

import numpy as np
from pydantic import AfterValidator, BeforeValidator, ConfigDict, StrictBool, TypeAdapter, ValidationError
from scipy.spatial.transform import Rotation as Turn

from dcap.evaluation.methods import DCAP, split_id
from dcap.scene.errors import InputError, short
from dcap.scene.text import did_you_mean
from dcap.scene.types.sample import Sample

AT_REST, AS_POSED = "at_rest", "as_posed"
SAME_REGION = {"middle": "center"}
"""Region words that mean the same place."""
QUADRANT_DEG = 45.0
"""Largest angle from a named direction (up, down or one of four sides): half a right angle, so the nearest counts."""


def direction(value: tuple[float, float]) -> tuple[float, float]:
    """Return a finite, nonzero direction; ValueError otherwise."""
    if not np.isfinite(value).all() or not np.any(value):
        raise ValueError("expected a direction [x, y]")
    return value


Word = Annotated[str, BeforeValidator(lambda value: "" if value is None else value)]
Direction = Annotated[tuple[float, float], AfterValidator(direction)]


@dataclass(frozen=True, slots=True)
class ExpectedOutcome:
    """The intended outcome of a sample; no stage sees it."""

    __pydantic_config__ = ConfigDict(extra="forbid", coerce_numbers_to_str=True)

    base: Word = ""
    """Label of the intended support."""
    part: Word = ""
    region: Word = ""
    """Canonical region words that the sentence asks for; empty if it asks for none."""
    feasible: StrictBool = True
    reason: Word = ""
    """Intended reason code; empty if feasible."""
    base_id: Word = ""
    """Id of the intended support; empty if several will do."""
    top: Annotated[Literal["", "up", "down", "sideways"], BeforeValidator(lambda value: value or "")] = ""
    """Direction of the object's own top (+z as read); empty if the sentence leaves it open."""
    front: Direction | None = None
    """World xy direction of the object's own front (+y as read); None if the sentence leaves it open."""


@dataclass(frozen=True, slots=True)
class SampleOutcome:
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
    base_id: str
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
    """Intended outcome in words; empty if not stated."""
    feasible_intended: bool | None
    """Whether it should come to rest; None if not stated."""
    as_expected: bool | None
    """Whether verdict, reason, support, part, region and orientation are the intended ones."""
    method: str = DCAP
    support_hit: bool | None = None
    """This and the others below: None if not measured, or not stated (docs/metrics.md)."""
    part_hit: bool | None = None
    region_distance_m: float | None = None
    orientation_error_deg: float | None = None
    penetration_m: float | None = None
    penetration_given_m: float | None = None
    gap_m: float | None = None
    contact_area_m2: float | None = None
    com_margin_m: float | None = None
    com_supported: bool | None = None
    indentation_m: float | None = None
    indentation_error_m: float | None = None
    force_residual: float | None = None
    drift_m: float | None = None
    drift_deg: float | None = None
    drift_s: float | None = None
    referee_drift_m: float | None = None
    """This and the next four by the independent referee (`referee/`), None where it cannot judge."""
    referee_drift_deg: float | None = None
    referee_supported: bool | None = None
    referee_penetration_m: float | None = None
    referee_s: float | None = None
    placeit3d_spatial_asked: int | None = None
    """Constraints counted by PlaceIt3D's rules, here and below (`metrics/placeit3d.py`)."""
    placeit3d_spatial_met: int | None = None
    placeit3d_rotational_met: bool | None = None
    placeit3d_physical: bool | None = None
    placeit3d_physical_given: bool | None = None
    right_place: float | None = None
    """1 to 10."""
    physics_naturalness: float | None = None
    """1 to 10."""
    judge: str = ""
    """Judge of the last two."""


def read_truth(tree: object, where: str) -> dict[str, ExpectedOutcome]:
    """Intended outcomes by sample id, from a list with `id` or a mapping by id."""
    if isinstance(tree, Mapping):
        rows = {str(key): value for key, value in tree.items()}
    elif isinstance(tree, list):
        rows = {
            str(row["id"]): row
            for row in tree
            if isinstance(row, Mapping) and isinstance(row.get("id"), str | int | float)
        }
    else:
        raise InputError(f"{where}: expected samples, found {type(tree).__name__}")
    return {key: truth_of(row, f"{where}: {key}") for key, row in rows.items()}


OUTCOME = TypeAdapter(ExpectedOutcome)


def truth_of(row: object, where: str) -> ExpectedOutcome:
    """One intended outcome."""
    if not isinstance(row, Mapping):
        raise InputError(f"{where}: expected keys and values, found {short(row)}")
    try:
        return OUTCOME.validate_python({key: one for key, one in row.items() if key != "id"})
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        key = str(first["loc"][0])
        known = [one.name for one in fields(ExpectedOutcome)]
        if key not in known:
            raise InputError(f"{where}: unknown key {key!r}{did_you_mean(key, known)}") from None
        what = "expected a direction [x, y]" if key == "front" else first["msg"]
        raise InputError(f"{where}: {key} is {short(row.get(key))}: {what}") from None


def row_of(
    sample: Sample, tree: Mapping[str, object] | None, error: str, truth: ExpectedOutcome | None
) -> SampleOutcome:
    """The row of a sample from its placement.json or its error."""
    found = tree or {}
    method, name = split_id(sample.id)
    base = found.get("base")
    base = base if isinstance(base, Mapping) else {"label": "", "id": ""}
    timings = found.get("timings")
    row = SampleOutcome(
        sample=name,
        method=method,
        scene=sample.scene,
        object=sample.object,
        prompt=sample.prompt,
        verdict=str(found.get("verdict", "failed")),
        reason=str(found.get("reason") or ""),
        message=str(found.get("message") or ""),
        base=str(base["label"]),
        base_id=str(base["id"]),
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
    return row if truth is None else replace(row, as_expected=agrees(row, found.get("pose"), truth))


def number(value: object) -> float:
    """A number, 0 if missing."""
    return float(value) if isinstance(value, int | float) else 0.0


def agrees(row: SampleOutcome, pose: object, truth: ExpectedOutcome) -> bool:
    """Whether the outcome is the intended one."""
    if truth.base not in ("", row.base) or truth.base_id not in ("", row.base_id):
        return False
    if not truth.feasible:
        return row.verdict == "infeasible" and row.reason == truth.reason
    there = truth.part in ("", row.part) and same_region(row.region, truth.region) and not row.region_missed
    return row.verdict in (AT_REST, AS_POSED) and there and oriented(pose, truth)


def same_region(found: str, intended: str) -> bool:
    """Whether two regions are the same words in any order, or none is intended."""
    found_words, words = ({SAME_REGION.get(word, word) for word in one.split()} for one in (found, intended))
    return not words or found_words == words


def oriented(pose: object, truth: ExpectedOutcome) -> bool:
    """Whether the object's own top and front have the intended directions."""
    if not truth.top and truth.front is None:
        return True
    if not isinstance(pose, Mapping):
        return False
    axes = Turn.from_quat(pose["quaternion"], scalar_first=True).as_matrix()
    near = np.cos(np.radians(QUADRANT_DEG))
    height = axes[2, 2]
    tops = {"": True, "up": height >= near, "down": height <= -near, "sideways": abs(height) < near}
    if truth.front is None:
        return bool(tops[truth.top])
    ahead = np.array(truth.front) / np.linalg.norm(truth.front)
    return bool(tops[truth.top] and axes[:2, 1] @ ahead >= near)


def in_words(truth: ExpectedOutcome) -> str:
    """An intended outcome in words."""
    if not truth.feasible:
        return f"infeasible: {truth.reason}"
    where = " ".join(word for word in (truth.base, truth.part) if word)
    asked = [f"on {where}"] if where else []
    asked += [truth.region] if truth.region else []
    asked += [f"top {truth.top}"] if truth.top else []
    asked += [f"front towards ({truth.front[0]:g}, {truth.front[1]:g})"] if truth.front else []
    return f"at rest {', '.join(asked)}".rstrip()
