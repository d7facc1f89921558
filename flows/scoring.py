"""Rows of a run with measurements and scores: raw units first, then the rubric's two scores.

Intended outcomes (the truth) come in here, after every stage has ended.

`measures.json` of a sample: measurements of its final state, by any method.
"""

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from dcap.evaluation.judging.rubric import RUBRIC, row_metrics, rubric_scores
from dcap.evaluation.metrics.placeit3d import (
    ConstraintKind,
    FinalBox,
    asked_constraints,
    met,
    physical,
    room_size,
    upright_box,
)
from dcap.evaluation.metrics.right_place import TOLERANCE_M, place_measures
from dcap.evaluation.outcome_table import AS_POSED, AT_REST, QUADRANT_DEG, ExpectedOutcome, SampleOutcome, row_of
from dcap.evaluation.run_folder import sample_folder
from dcap.geometry.placement.named_regions import BESIDE, regions
from dcap.scene.types.choices import Intent
from dcap.scene.types.measures import Drift, Indentation, Measures, RefereeMeasures
from dcap.scene.types.sample import Sample
from dcap.scene.types.segmentation import Segmentation
from dcap.scene.written_files import JsonObject, JsonValue, object_to_json, write_whole
from flows.find_run import input_errors, read_keys
from flows.output import RESULT, load, readable_json
from flows.sample_run import FinishedSample
from tasks.artifact import Ref, Store
from tasks.requests.surroundings import part_frame

Kind = TypeVar("Kind")
MEASURES = "measures.json"
REFERENCED = frozenset(BESIDE)
"""Region words that mean a place next to something: the truth does not say next to what."""


def write_measures(finished: FinishedSample, out: Path) -> JsonObject | None:
    """Write the measurements next to placement.json; None without any, after removing an earlier file."""
    refs, store = finished.placement, Store.default()
    path = out / MEASURES
    if refs.measures is None:
        path.unlink(missing_ok=True)
        return None
    kinds = (("measures", refs.measures, Measures), ("indentation", refs.indentation, Indentation),
             ("drift", refs.drift, Drift), ("referee", refs.referee, RefereeMeasures))  # fmt: skip
    found = {name: load(store, ref, kind) if ref else None for name, ref, kind in kinds}
    tree = object_to_json({"scene": refs.scene.to_json(), "intent": refs.intent.to_json(), **found})
    write_whole(path, readable_json(tree))
    return tree


def states_of(run: Path, names: Iterable[str]) -> dict[str, str]:
    """Digest of the measurements of samples of a run, by their names, METHOD/SAMPLE; it tells two final states apart.
    Empty without measurements."""
    paths = {name: sample_folder(run, name) / MEASURES for name in names}
    return {
        name: hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else "" for name, path in paths.items()
    }


def changed_since(run: Path, states: Mapping[str, str]) -> tuple[str, ...]:
    """Samples of a run whose final states differ from the fingerprints in `states`."""
    now = states_of(run, states)
    return tuple(name for name, state in states.items() if now[name] != state)


def read_measures(out: Path) -> Mapping[str, JsonValue]:
    """Read the file of `write_measures`; empty without one, InputError where it is damaged."""
    path = out / MEASURES
    return read_keys(path) if path.is_file() else {}


def scored_row(
    sample: Sample, tree: JsonObject | None, error: str, truth: ExpectedOutcome | None, folder: Path
) -> SampleOutcome:
    """The row of a sample whose files lie in a folder; InputError where its placement.json is damaged."""
    if tree is None:
        return row_of(sample, tree, error, truth)
    with input_errors(folder / RESULT):
        row = row_of(sample, tree, error, truth)
    kept = read_measures(folder)
    measures = kept.get("measures")
    if not isinstance(measures, Mapping) or row.verdict not in (AT_REST, AS_POSED):
        return row
    with input_errors(folder / RESULT):
        _, turned = pose_at_rest(tree)
        box = np.asarray(tree["object_aabb"], dtype=float).reshape(2, 3)
    sinking, drift, referee = (
        one if isinstance(one := kept.get(name), Mapping) else {} for name in ("indentation", "drift", "referee")
    )
    found, reference = number(sinking.get("found_m")), number(sinking.get("reference_m"))
    margin = number(measures.get("com_margin_m"))
    row = replace(
        row,
        penetration_m=number(measures.get("penetration_m")),
        penetration_given_m=number(measures.get("penetration_given_m")),
        gap_m=known_or(np.inf, measures.get("gap_m")),
        contact_area_m2=number(measures.get("contact_area_m2")),
        com_margin_m=margin,
        com_supported=margin is not None and margin >= 0.0,
        indentation_m=found,
        indentation_error_m=None if found is None or reference is None else abs(found - reference),
        force_residual=number(drift.get("force_residual")),
        drift_m=number(drift.get("distance_m")),
        drift_deg=scaled(drift.get("angle_rad"), 180.0 / np.pi),
        drift_s=number(drift.get("seconds")),
        referee_drift_m=number(referee.get("drift_m")),
        referee_drift_deg=number(referee.get("drift_deg")),
        referee_supported=supported if isinstance(supported := referee.get("supported"), bool) else None,
        referee_penetration_m=number(referee.get("penetration_m")),
        referee_s=number(referee.get("seconds")),
    )
    row = with_rules(row, kept, box, truth)
    if truth is None or not truth.feasible:
        return with_scores(row)
    support = tuple(str(measures.get(name) or "") for name in ("support_id", "support_label", "support_part"))
    place = place_measures(
        (support[0], support[1], support[2]), np.asarray(measures["middle"], dtype=float),
        turned, truth, meant_regions(kept.get("scene"), truth, box),
    )  # fmt: skip
    row = replace(
        row,
        support_hit=place.support_hit,
        part_hit=place.part_hit,
        region_distance_m=place.region_distance_m,
        orientation_error_deg=place.orientation_error_deg,
    )
    if row.verdict == AS_POSED:  # methods have their own words for regions: only the object's position counts
        row = replace(row, as_expected=all_met(row))
    elif row.support_hit is False:  # regardless of the method's own verdict
        row = replace(row, as_expected=False)
    return with_scores(row)


def pose_at_rest(tree: Mapping[str, JsonValue]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the position [m] and the quaternion (w, x, y, z) of a placement.json that has them; any error means that
    the file is damaged."""
    pose = tree["pose"]
    assert isinstance(pose, Mapping)
    turned = np.asarray(pose["quaternion"], dtype=float).reshape(4)
    assert turned.any()
    return np.asarray(pose["position"], dtype=float).reshape(3), turned


def with_rules(
    row: SampleOutcome, kept: Mapping[str, JsonValue], box: NDArray[np.float64], truth: ExpectedOutcome | None
) -> SampleOutcome:
    """Add the results of PlaceIt3D's rules to a measured row; the request is None if scene or intent are gone.

    The gap to the final scene is in both physical columns: before a dent the surface was no lower.
    """
    row = replace(
        row,
        placeit3d_physical=physical(row.penetration_m, row.gap_m),
        placeit3d_physical_given=physical(row.penetration_given_m, row.gap_m),
    )
    scene, intent = kept.get("scene"), kept.get("intent")
    if not isinstance(scene, Mapping) or not isinstance(intent, Mapping):
        return row
    known, said = loaded(Segmentation, Ref.from_json(scene)), loaded(Intent, Ref.from_json(intent))
    measures = kept["measures"]
    assert isinstance(measures, Mapping)
    if known is None or said is None or "front" not in measures:  # not there in older files
        return row
    final = FinalBox(
        box=upright_box(box),
        front=np.asarray(measures["front"], dtype=float)[:2],
        support_id=str(measures.get("support_id") or ""),
        dz=np.inf if row.gap_m is None else max(row.gap_m, row.penetration_m or 0.0),
    )
    boxes, room = {one.id: one.box for one in known.instances}, room_size(known.mesh.bounds)
    held = [(one.kind, met(one, final, boxes, room)) for one in asked_constraints(known.instances, said, truth)]
    spatial = [yes for kind, yes in held if kind is not ConstraintKind.FACING]
    return replace(
        row,
        placeit3d_spatial_asked=len(spatial),
        placeit3d_spatial_met=sum(spatial),
        placeit3d_rotational_met=next((yes for kind, yes in held if kind is ConstraintKind.FACING), None),
    )


def all_met(row: SampleOutcome) -> bool:
    """Whether all stated and measured conditions of a place are met."""
    near = row.region_distance_m is None or row.region_distance_m <= TOLERANCE_M
    turned = row.orientation_error_deg is None or row.orientation_error_deg <= QUADRANT_DEG
    return row.support_hit is not False and row.part_hit is not False and near and turned


def with_scores(row: SampleOutcome) -> SampleOutcome:
    """Add the two scores of the metric rubric."""
    place, physics = rubric_scores(row_metrics(row))
    return replace(row, right_place=place, physics_naturalness=physics, judge=RUBRIC)


def number(value: object) -> float | None:
    """A number, None where there is none."""
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None


def scaled(value: object, factor: float) -> float | None:
    """A number in another unit, None where there is none."""
    found = number(value)
    return None if found is None else factor * found


def known_or(unknown: float, value: object) -> float:
    """A number from a JSON file, or `unknown` where null stands for a number that is not finite."""
    found = number(value)
    return unknown if found is None else found


def meant_regions(
    scene: JsonValue, truth: ExpectedOutcome, box: NDArray[np.float64]
) -> tuple[NDArray[np.float64], ...]:
    """Outlines in plan of the intended region, on the intended part, for an object in a box; empty if unknown."""
    words = truth.region.split()
    if not words or REFERENCED & set(words) or not isinstance(scene, Mapping):
        return ()
    known = loaded(Segmentation, Ref.from_json(scene))
    if known is None:
        return ()
    bases = [
        one for one in known.instances if one.id == truth.base_id or (not truth.base_id and one.label == truth.base)
    ]
    reach = np.full(2, 0.5 * float(np.ptp(box[:, :2], axis=0).max()))
    found = []
    for base in bases:
        parts = [one.box for one in base.parts if one.name == truth.part] or [base.box]
        for one in parts:
            found += [area.polygon for area in regions(part_frame(known, base, one), words, [], reach)]
    return tuple(found)


@lru_cache(maxsize=8)
def loaded(kind: type[Kind], ref: Ref[Any]) -> Kind | None:
    """A value of the store; None where it is no longer there."""
    store = Store.default()
    value = store.load(ref) if store.has(ref) else None
    return value if isinstance(value, kind) else None
