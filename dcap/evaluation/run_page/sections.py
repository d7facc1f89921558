"""Sections of the page of a run: failures with their causes, costs, deformable supports, and provenance.

In: rows, run.json and the folders of the placements. Out: failures, worst kind first; times by method; figure 3;
versions, seeds and configuration, and `artifacts.sha256` with the digest of every file, which `sha256sum -c` checks.
"""

import hashlib
import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import mean, median

from dcap.evaluation.judging.rubric import row_metrics, worst_metric
from dcap.evaluation.outcome_table import SampleOutcome
from dcap.evaluation.run_folder import placement_folder
from dcap.evaluation.run_page.placement_files import shortened
from dcap.evaluation.run_page.tables import NOTHING, RESTING, ShownTable
from dcap.evaluation.statistics.comparisons import JudgedAxis
from dcap.evaluation.supports_plot import save_supports_plot, summary
from dcap.evaluation.table_files import write_if_other
from dcap.knowledge.kinds import deformable_supports
from dcap.scene.written_files import JsonObject, canonical_json, digest_of_file

LOW_SCORE = 5.0
"""Score below which it is low: the middle of the scale, where a metric is between visible and clearly wrong [-]."""
AXES = {JudgedAxis.RIGHT_PLACE: "Right Place", JudgedAxis.PHYSICS_NATURALNESS: "P&N"}
FAILED, INFEASIBLE, UNEXPECTED, LOW = "failed", "infeasible", "not as intended", "low score"
KINDS = (FAILED, INFEASIBLE, UNEXPECTED, LOW)
Timings = Mapping[str, float]
"""Seconds by stage of one placement."""
FACTS, FIGURE = "scene.json", "figures/supports.svg"
RUN, HASHES = "run.json", "artifacts.sha256"


@dataclass(frozen=True, slots=True)
class ShownFailure:
    """A placement that failed in some way."""

    row: SampleOutcome
    kinds: tuple[str, ...]
    """Of KINDS."""
    causes: tuple[str, ...]


def failures_of(rows: Sequence[SampleOutcome]) -> list[ShownFailure]:
    """All failures: errors first, then refusals, then wrong places or orientations, then low scores."""
    found = [one for one in map(failure_of, rows) if one is not None]
    return sorted(found, key=lambda one: (KINDS.index(one.kinds[0]), lowest(one.row)))


def failure_of(row: SampleOutcome) -> ShownFailure | None:
    """A placement's failures; None without any."""
    if row.error:
        return ShownFailure(row, (FAILED,), (shortened(row.error),))
    found: list[tuple[str, str]] = []
    if row.verdict not in RESTING and row.feasible_intended is not False:
        found.append((INFEASIBLE, shortened(": ".join(word for word in (row.reason, row.message) if word))))
    if row.as_expected is False:
        found.append((UNEXPECTED, f"intended: {row.expected}; came out: {outcome_words(row)}"))
    for axis, words in AXES.items():
        score = getattr(row, axis.value)
        if score is not None and score < LOW_SCORE:
            worst = worst_metric(row_metrics(row), axis)
            found.append((LOW, f"{words} {score:.1f}" + (f", worst metric {worst}" if worst else "")))
    kinds = tuple(dict.fromkeys(kind for kind, _ in found))
    return ShownFailure(row, kinds, tuple(words for _, words in found)) if found else None


def outcome_words(row: SampleOutcome) -> str:
    """An outcome in the same words as intended outcomes."""
    if row.verdict not in RESTING:
        return f"infeasible: {row.reason}"
    where = " ".join(word for word in (row.base, row.part, row.region) if word)
    missed = ", region missed" if row.region_missed else ""
    turned = "" if row.orientation_error_deg is None else f", turned by {row.orientation_error_deg:.0f}°"
    return f"{row.verdict.replace('_', ' ')} on {where}{missed}{turned}"


def lowest(row: SampleOutcome) -> float:
    """The lower of the two scores."""
    return min((one for one in (row.right_place, row.physics_naturalness) if one is not None), default=0.0)


def score_cells(row: SampleOutcome) -> Mapping[str, str]:
    """Scores and their deciding metrics in raw units, as text."""
    scores = {"RP": row.right_place, "P&N": row.physics_naturalness}
    lengths = {"penetration": row.penetration_m, "gap": row.gap_m, "drift by the referee": row.referee_drift_m}
    return {
        **{name: NOTHING if one is None else f"{one:.1f}" for name, one in scores.items()},
        **{name: NOTHING if one is None else f"{1e3 * one:.2g} mm" for name, one in lengths.items()},
    }


def costs_table(timings: Mapping[str, Sequence[Timings]], names: Mapping[str, str]) -> ShownTable | None:
    """Median and mean seconds of each stage and in total, by method; None if nothing is known.

    Args:
        timings: of each method's placements.
        names: shown names of the methods.
    """
    stages = list(dict.fromkeys(stage for own in timings.values() for one in own for stage in one))
    if not stages:
        return None
    totals = [[sum(one.values()) for one in own] for own in timings.values()]
    rows = [(stage, *(spent([one[stage] for one in own if stage in one]) for own in timings.values()))
            for stage in stages]  # fmt: skip
    rows.append(("a placement", *map(spent, totals)))
    rows.append(("all placements", *(f"{sum(own):.1f}" for own in totals)))
    return ShownTable(
        "Times", ("stage [s]", *(names[method] for method in timings)), tuple(rows), (),
        "Median (mean) seconds of n placements. A stage that several methods share counts in each, "
        "with the time that it once took.",
    )  # fmt: skip


def spent(values: Sequence[float]) -> str:
    """Median, mean and count."""
    return f"{median(values):.2f} ({mean(values):.2f}), n {len(values)}" if values else NOTHING


def timings_of(tree: Mapping[str, object]) -> Timings:
    """The stage times in a placement.json."""
    found = tree.get("timings")
    return dict(found) if isinstance(found, Mapping) else {}


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


@dataclass(frozen=True, slots=True)
class Provenance:
    """A run's provenance for its page."""

    facts: tuple[tuple[str, str], ...]
    versions: tuple[tuple[str, str], ...]
    config: str
    """The configuration as JSON."""
    files: int
    """Files in `artifacts.sha256` [-]."""
    digest: str
    """Digest of that list."""


def provenance_of(run: Path, folders: Sequence[Path]) -> Provenance:
    """Read a run's origin and write the digests of the files in the folders of its placements."""
    asked = read_run(run)
    lines = [
        f"{digest_of_file(path)}  {path.relative_to(run).as_posix()}\n"
        for folder in folders
        for path in sorted(folder.rglob("*"))
        if path.is_file() and not path.name.startswith(".")
    ]
    text = "".join(lines).encode()
    write_if_other(run / HASHES, text)
    config = asked.get("config")
    versions = asked.get("versions")
    facts = [("dataset", str(asked.get("dataset") or "")), ("started", str(asked.get("started") or "")),
             ("methods", ", ".join(map(str, listed(asked.get("methods"))))), ("language", language_of(asked)),
             ("seeds of samples", seeds_of(asked))]  # fmt: skip
    if isinstance(config, Mapping):
        facts.append(("seeds of the configuration", ", ".join(f"{name} {seed}" for name, seed in config_seeds(config))))
        facts.append(("digest of the configuration", hashlib.sha256(canonical_json(config)).hexdigest()))
    return Provenance(
        tuple((name, value) for name, value in facts if value),
        tuple((str(name), str(one)) for name, one in versions.items()) if isinstance(versions, Mapping) else (),
        json.dumps(config, indent=1, ensure_ascii=False) if config else "",
        len(lines),
        hashlib.sha256(text).hexdigest(),
    )


def read_run(run: Path) -> JsonObject:
    """Read run.json, empty if there is none."""
    try:
        tree = json.loads((run / RUN).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return tree if isinstance(tree, dict) else {}


def listed(value: object) -> Sequence[object]:
    """A list, empty for any other value."""
    return value if isinstance(value, list) else []


def seeds_of(asked: Mapping[str, object]) -> str:
    """The seeds of the samples: their range if they are many."""
    seeds = sorted({one["seed"] for one in listed(asked.get("samples"))
                    if isinstance(one, Mapping) and isinstance(one.get("seed"), int)})  # fmt: skip
    if len(seeds) > 2 and seeds == list(range(seeds[0], seeds[-1] + 1)):
        return f"{seeds[0]} to {seeds[-1]}"
    return ", ".join(map(str, seeds[:40])) + (" …" if len(seeds) > 40 else "")


def config_seeds(tree: Mapping[str, object], path: str = "") -> list[tuple[str, object]]:
    """Every `seed` of a configuration with its key."""
    found: list[tuple[str, object]] = []
    for key, value in tree.items():
        name = f"{path}.{key}" if path else str(key)
        if key == "seed":
            found.append((name, value))
        elif isinstance(value, Mapping):
            found += config_seeds(value, name)
    return found


def language_of(asked: Mapping[str, object]) -> str:
    """The language options of the run, `offline` without any."""
    told = asked.get("language")
    if not isinstance(told, Mapping):
        return ""
    return ", ".join(f"{name} {value}" for name, value in told.items() if value) or "offline"
