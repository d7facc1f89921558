"""A dataset run: plan, run what is missing, keep going, and report.

A run is a folder `data/runs/NAME` with one folder per sample (placement.json, object.ply, scene.glb, pictures),
`run.json` (what was asked), `results.parquet` (one row per sample) and `report.html`. Intended outcomes are read only
after the last sample has finished, and only for the report.
"""

import json
import os
import platform
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from contextlib import AbstractContextManager, nullcontext
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from threading import Semaphore

from dcap.evaluation.method_report import MethodTable, shown_lines
from dcap.evaluation.methods import DCAP, METHODS, by_method, split_id, with_examples
from dcap.evaluation.outcome_table import ExpectedOutcome, SampleOutcome, read_truth
from dcap.evaluation.report import write_report
from dcap.evaluation.run_folder import sample_folder
from dcap.evaluation.run_summary import RunSummary, summary_of
from dcap.language.model.batch import batch_queue
from dcap.language.model.ledger import check_budget, spending_of
from dcap.language.protocol.client import ClientName
from dcap.language.protocol.session import Session
from dcap.scene.errors import InputError
from dcap.scene.json_tree import JsonObject, object_to_json
from dcap.scene.settings import data_root, runs_root, version
from dcap.scene.types.sample import Sample
from flows.display import Display, print_lines, print_plan, print_table
from flows.judge_run import judged_rows, write_rows
from flows.language_options import LEDGER, LanguageOptions
from flows.measures_file import write_measures
from flows.output import readable_json, write_placement
from flows.place import PlaceConfig
from flows.run_files import RUN, asked_of_run, find_run, located, sample_from_json
from flows.sample_run import (
    OVERVIEW,
    STAGE_NAMES,
    FailedSample,
    FinishedSample,
    Plan,
    heavy_modules,
    plan_sample,
    try_sample,
)
from flows.samples import EMBEDDED, SPLAT_ROOMS, TRUTH, load_samples, load_yaml
from flows.scene_lists import of_scenes
from flows.scoring import scored_row
from flows.server import prefect_server
from tasks.mesh.stage import mesh_object_task, mesh_scene_task
from tasks.runner.context import RunContext
from tasks.runner.digests import installed_version
from tasks.runner.process import kill_all
from tasks.runner.process_server import process_server

DATASET_SEED = 0
MESH, BOTH_MESHES = "mesh", {mesh_scene_task.name, mesh_object_task.name}
"""What a person calls the two stages together."""
IN_A_BATCH = 32
"""Samples whose questions gather for one batch; each waits in a thread and a flow run of its own."""
SPLATS = 500_000
"""Gaussians per room of the embedded dataset of splats; a scene of InteriorGS has as many."""

LIBRARIES = (
    "numpy", "scipy", "taichi", "open3d", "libigl", "manifold3d", "shapely", "trimesh", "scikit-image", "pyarrow",
    "prefect", "anthropic", "openai",
)  # fmt: skip
"""Whose versions run.json tells."""


@dataclass(frozen=True, slots=True)
class Run:
    """A finished benchmark run."""

    folder: Path
    rows: tuple[SampleOutcome, ...]
    summary: RunSummary
    table: MethodTable | None = None
    """Table 1; None where methods cannot be compared."""

    @property
    def failed(self) -> int:
        """Number of samples that did not get through."""
        return sum(row.error != "" for row in self.rows)


@dataclass(frozen=True, slots=True)
class PlanRow:
    """What a benchmark would do for one sample."""

    sample: str
    cached: tuple[str, ...]
    """Stages whose results are there."""
    runs: str | None
    """First stage that would run; None if none would."""
    why: str | None
    """Why it would run, or what is wrong with the sample; None if all is there."""
    may_run: tuple[str, ...]
    """Stages that run after it if their inputs change."""


def run_benchmark(
    dataset: Path | None,
    config: PlaceConfig,
    language: LanguageOptions | None = None,
    *,
    limit: int | None = None,
    workers: int = 2,
    only_failed: bool = False,
    methods: Sequence[str] = (DCAP,),
    scenes: str = "",
) -> Run:
    """Place the samples of a dataset by each method and write the run's folder."""
    begin = time.monotonic()
    config = measured_config(config, methods)
    path, samples = dataset_samples(dataset, methods, limit, scenes)
    if only_failed:
        samples = failed_before(samples)
    language = language or LanguageOptions()
    folder = new_run_folder(path, samples, config, language)
    with Display(samples) as display:
        plans = plan_all(samples, config, display)
        results = run_all(plans, config, folder, language.session(folder), workers, display)
    rows = scored_rows(folder, results, truths_of(path, list(results)))
    run = finish(folder, rows, time.monotonic() - begin)
    print_table(run.rows, run.summary, folder)
    if run.table:
        print_lines(shown_lines(run.table))
    return run


def scored_rows(
    folder: Path,
    results: Mapping[Sample, tuple[JsonObject | None, str]],
    truths: Sequence[ExpectedOutcome | None],
) -> tuple[SampleOutcome, ...]:
    """A row for each sample and method, method by method."""
    rows = [
        scored_row(sample, tree, error, truth, sample_folder(folder, sample.id))
        for (sample, (tree, error)), truth in zip(results.items(), truths, strict=True)
    ]
    order = list(METHODS)
    return tuple(sorted(rows, key=lambda row: order.index(row.method)))


def dataset_samples(
    dataset: Path | None, methods: Sequence[str], limit: int | None, scenes: str = ""
) -> tuple[Path, list[Sample]]:
    """The dataset's file and its samples as each method places them, of all scenes or of those that a list names; the
    embedded rooms are generated if they are missing."""
    path = dataset or EMBEDDED
    if path.resolve() == EMBEDDED:
        ensure_dataset(data_root(), DATASET_SEED)
    elif path.resolve() == SPLAT_ROOMS:
        rooms = [Path(sample.scene).name for sample in load_samples(path)]
        ensure_dataset(data_root(), DATASET_SEED, rooms=list(dict.fromkeys(rooms)), splats=SPLATS)
    every = load_samples(path)
    chosen = of_scenes(every, scenes, path.parent)[:limit]
    return path, with_examples([by_method(sample, method) for sample in chosen for method in methods], every)


def ensure_dataset(folder: Path, seed: int, *, rooms: Sequence[str] = (), splats: int = 0) -> Path:
    """Generate the embedded rooms and objects that are not there whole."""
    from dcap.synthetic.dataset import make_dataset

    make_dataset(folder, seed, rooms=rooms, splats=splats)
    return folder


def plan_all(samples: Sequence[Sample], config: PlaceConfig, display: Display) -> list[Plan]:
    """Plans of all samples."""
    plans = []
    for sample in samples:
        plans.append(plan_sample(sample, config))
        display.planned(plans[-1])
    return plans


def run_all(
    plans: Sequence[Plan], config: PlaceConfig, folder: Path, session: Session, workers: int, display: Display
) -> dict[Sample, tuple[JsonObject | None, str]]:
    """placement.json and error message of every sample; Prefect starts only if some sample has work to do."""
    results: dict[Sample, tuple[JsonObject | None, str]] = {plan.sample: (None, "") for plan in plans}
    waiting = []
    for plan in plans:
        known = plan.finished or plan.failed
        if known is None:
            waiting.append(plan.sample)
        else:
            results[plan.sample] = settle_result(folder, known, display)
    if not waiting:
        return results
    slots = Semaphore(workers) if session.batch else None
    at_a_time = min(len(waiting), max(workers, IN_A_BATCH)) if session.batch else workers
    # the queue closes before the pool waits for the threads that wait for it
    with (
        prefect_server() as url,
        process_server(heavy_modules(name for plan in plans for name in plan.coming)) as server,
        ThreadPoolExecutor(at_a_time) as pool,
        asking_queue(session, display),
    ):
        display.serving(url)
        context = RunContext(session=session, slots=slots, server=server)
        futures: dict[Future[FinishedSample | FailedSample], Sample] = {
            pool.submit(try_sample, sample, config, context=context, listener=display.listener(sample)): sample
            for sample in waiting
        }
        try:
            for future in as_completed(futures):
                results[futures[future]] = settle_result(folder, future.result(), display)
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            kill_all()  # the threads wait for these processes
            raise
    return results


def asking_queue(session: Session, display: Display) -> AbstractContextManager[None]:
    """A queue for questions in batches, if the run asks in batches."""
    return batch_queue(Path(session.batch), session, display.say) if session.batch else nullcontext()


def settle_result(
    folder: Path, result: FinishedSample | FailedSample, display: Display
) -> tuple[JsonObject | None, str]:
    """Keep what a sample returned, good or bad."""
    if isinstance(result, FailedSample):
        write_failure(folder, result)
        display.failed(result.sample, result.message)
        return None, result.message
    try:
        tree = keep(folder, result)
    except Exception as error:  # the border between samples: a result that cannot be written is this one's failure
        return settle_result(folder, FailedSample(result.sample, error), display)
    display.finished(result.sample)
    return tree, ""


def keep(folder: Path, finished: FinishedSample) -> JsonObject:
    """Write a sample's results into the run."""
    out = sample_folder(folder, finished.sample.id)
    (out / "error.txt").unlink(missing_ok=True)
    tree = write_placement(finished, out)
    write_measures(finished, out)
    return tree


def write_failure(folder: Path, failed: FailedSample) -> None:
    """Write why a sample failed into the run."""
    out = sample_folder(folder, failed.sample.id)
    out.mkdir(parents=True, exist_ok=True)
    (out / "error.txt").write_text(f"{failed.message}\n\n{failed.details}".rstrip() + "\n")


def new_run_folder(dataset: Path, samples: Sequence[Sample], config: PlaceConfig, language: LanguageOptions) -> Path:
    """A new folder that says what was asked; `runs/last` points at it."""
    name = f"{dataset.stem}-{datetime.now(UTC):%Y%m%d-%H%M%S}"
    folder = runs_root() / name
    suffix = 2
    while folder.exists():
        folder = runs_root() / f"{name}-{suffix}"
        suffix += 1
    folder.mkdir(parents=True)
    asked = {
        "dataset": str(dataset.resolve()),
        "versions": versions(),
        "started": datetime.now(UTC).isoformat(timespec="seconds"),
        "config": config.model_dump(mode="json"),
        "language": asdict(language.located()),
        "methods": list(dict.fromkeys(sample.method for sample in samples)),
        "samples": [asdict(located(sample)) for sample in samples],
    }
    (folder / RUN).write_bytes(readable_json(asked))
    draft = runs_root() / f".last-{os.getpid()}"
    draft.symlink_to(folder.name)
    os.replace(draft, runs_root() / "last")
    return folder


def versions() -> dict[str, str]:
    """What the run is computed with; a library that is not installed is left out."""
    found = {name: installed_version(name) for name in LIBRARIES}
    told = {name: one for name, one in found.items() if one}
    return {"dcap": version(), "python": platform.python_version(), "machine": platform.machine(), **told}


def finish(folder: Path, rows: Sequence[SampleOutcome], seconds: float) -> Run:
    """Write tables, summary and report; a run of several methods has its judge's scores then."""
    write_rows(folder, rows)
    rows, table = judged_rows(folder, rows)
    language = spending_of(folder / LEDGER) if (folder / LEDGER).is_file() else None
    summary = summary_of(rows, run=str(folder), wall_s=seconds, language=language)
    (folder / "summary.json").write_bytes(readable_json(object_to_json(summary)))
    write_report(folder, rows, summary)
    return Run(folder, rows, summary, table)


def truths_of(dataset: Path, samples: Sequence[Sample]) -> list[ExpectedOutcome | None]:
    """Intended outcomes beside the dataset, None where there are none."""
    path = dataset.parent / TRUTH
    known = read_truth(load_yaml(path), str(path)) if path.is_file() else {}
    return [known.get(split_id(sample.id)[1]) for sample in samples]


def measured_config(config: PlaceConfig, methods: Sequence[str]) -> PlaceConfig:
    """With what is measured of one method, or of several that are compared."""
    return config.model_copy(update={"measured": True, "compared": len(set(methods)) > 1})


def plan_benchmark(
    dataset: Path | None,
    config: PlaceConfig,
    *,
    limit: int | None = None,
    methods: Sequence[str] = (DCAP,),
    scenes: str = "",
) -> list[PlanRow]:
    """Print what would run and why."""
    _, samples = dataset_samples(dataset, methods, limit, scenes)
    config = measured_config(config, methods)
    plans = [plan_sample(sample, config) for sample in samples]
    print_plan(plans)
    return [plan_row(plan) for plan in plans]


def plan_row(plan: Plan) -> PlanRow:
    """The row of a sample."""
    why = plan.failed.message if plan.failed else plan.why or None
    return PlanRow(plan.sample.id, plan.cached, plan.missing or None, why, plan.later)


def rerun_sample(run: str, sample_id: str, stage: str, max_cost: float | None = None) -> tuple[JsonObject, Path]:
    """Compute one stage of one sample again; its placement.json and the run's report, both written anew."""
    known = (*STAGE_NAMES, OVERVIEW)
    refreshed = frozenset(BOTH_MESHES if stage == MESH else {stage})
    if not refreshed.issubset(known):
        raise InputError(f"--stage {stage!r} is not one of {', '.join((MESH, *known))}")
    folder = find_run(run)
    asked = asked_of_run(folder)
    sample, config = asked.sample(sample_id), asked.config
    language = replace(asked.language, max_cost=max_cost, batch=False)
    if language.client is ClientName.REPLAY and language.config() != config.intent.language:
        raise InputError(f"--replay {language.replay}: the recording has changed since {folder.name}; run it again")
    check_budget(config.intent.language.model, max_cost)
    with (
        Display([sample]) as display,
        prefect_server() as url,
        process_server(heavy_modules(STAGE_NAMES)) as server,
    ):
        display.serving(url)
        result = try_sample(
            sample,
            config,
            context=RunContext(refresh=refreshed, session=replace(language.session(folder), fresh=True), server=server),
            listener=display.listener(sample),
        )
        tree, _ = settle_result(folder, result, display)
    page = rewrite_report(run)
    if isinstance(result, FailedSample):
        raise result.error
    assert tree is not None
    return tree, page


def rewrite_report(run: str) -> Path:
    """Read a run's folder again and write its table and report."""
    folder = find_run(run)
    asked = json.loads((folder / RUN).read_text())
    samples = [sample_from_json(one) for one in asked["samples"]]
    results = {sample: read_result(sample_folder(folder, sample.id)) for sample in samples}
    return rewrite_page(folder, scored_rows(folder, results, truths_of(Path(asked["dataset"]), samples)))


def rewrite_page(folder: Path, rows: Sequence[SampleOutcome]) -> Path:
    """Write tables, summary and report of known rows again."""
    before = json.loads((folder / "summary.json").read_text()) if (folder / "summary.json").is_file() else {}
    finish(folder, rows, float(before.get("wall_s", 0.0)))
    return folder / "report.html"


def read_result(folder: Path) -> tuple[JsonObject | None, str]:
    """placement.json or the error of a sample's folder."""
    if (folder / "error.txt").is_file():
        return None, (folder / "error.txt").read_text().splitlines()[0]
    if (folder / "placement.json").is_file():
        return json.loads((folder / "placement.json").read_text()), ""
    return None, "did not finish"


def failed_before(samples: Sequence[Sample]) -> list[Sample]:
    """The samples of the last run that failed or did not finish in it."""
    folder = find_run("last")
    asked = {one["id"] for one in json.loads((folder / RUN).read_text())["samples"]}
    known = [sample for sample in samples if sample.id in asked]
    left = [sample for sample in known if read_result(sample_folder(folder, sample.id))[0] is None]
    if not left:
        raise InputError(f"nothing failed in {folder.name}; run without --only-failed")
    return left
