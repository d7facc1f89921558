"""A dataset run: plan, run what is missing, keep going, and report.

A run is a folder `data/runs/NAME` with one folder per sample (placement.json, object.ply, scene.glb, pictures),
`run.json` (the request), `results.parquet` (one row per sample) and `report.html`. Intended outcomes are read only
after the last sample has finished, and only for the report.
"""

import os
import platform
import time
from collections.abc import Mapping, Sequence
from contextlib import nullcontext, suppress
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from threading import Semaphore
from typing import TYPE_CHECKING

from dcap.evaluation.method_report import MethodTable, shown_lines
from dcap.evaluation.methods import DCAP, METHODS
from dcap.evaluation.outcome_table import SampleOutcome
from dcap.evaluation.report import write_report
from dcap.evaluation.run_folder import RunSummary, sample_folder, summary_of
from dcap.language.model.batch import batch_queue
from dcap.language.model.ledger import check_budget, spending_of
from dcap.language.protocol.client import ClientName
from dcap.language.protocol.session import Session
from dcap.scene.errors import InputError
from dcap.scene.settings import runs_root, version
from dcap.scene.text import not_one_of
from dcap.scene.types.sample import Sample
from dcap.scene.written_files import JsonObject, object_to_json, write_whole
from flows.configure import LEDGER, LanguageOptions
from flows.display import Display, console_on_stderr, print_lines, print_table, summary_line
from flows.find_run import ASKED_VERSION, RUN, find_run, input_errors, read_keys, read_request
from flows.judge_run import judge_run, judged_rows, write_rows
from flows.output import readable_json, write_placement
from flows.place import PlaceConfig
from flows.place_one import stage_lines
from flows.run_files import load_run_request, located, read_result, sample_from_json
from flows.runners import RunnerName, SampleRunner
from flows.sample_run import OVERVIEW, STAGE_NAMES, FailedSample, FinishedSample, benchmark_tags, plan_sample
from flows.scoring import scored_row, write_measures
from flows.selection import Selection, dataset_samples, failed_before, truths_of
from flows.server import pages_of, prefect_server
from tasks.code import installed_version
from tasks.machine_errors import is_server_error
from tasks.mesh.stage import mesh_object_task, mesh_scene_task
from tasks.run_context import RunContext, use_context

if TYPE_CHECKING:
    from flows.watched import BenchmarkPage, SampleJob

LOCAL = SampleRunner()
MESH, BOTH_MESHES = "mesh", {mesh_scene_task.name, mesh_object_task.name}
"""Name by which people refer to the two stages together."""
MOST_WAITING = 32
"""Most samples that collect questions for one batch or wait for workers of the pool; each occupies a thread."""
LIBRARIES = (
    "numpy", "scipy", "taichi", "open3d", "libigl", "manifold3d", "shapely", "trimesh", "scikit-image", "pyarrow",
    "prefect", "anthropic", "openai",
)  # fmt: skip
"""Libraries whose versions run.json records."""


@dataclass(frozen=True, slots=True)
class Run:
    """A finished benchmark run."""

    folder: Path
    rows: tuple[SampleOutcome, ...]
    summary: RunSummary
    table: MethodTable | None = None
    """Table of scores; None where methods cannot be compared."""

    @property
    def failed(self) -> int:
        """Number of samples that failed."""
        return sum(row.error != "" for row in self.rows)


def run_benchmark(
    dataset: Path | None,
    config: PlaceConfig,
    language: LanguageOptions | None = None,
    *,
    selection: Selection | None = None,
    methods: Sequence[str] = (DCAP,),
    workers: int = 2,
    runner: SampleRunner = LOCAL,
    judge: LanguageOptions | None = None,
    into: Path | None = None,
) -> Run:
    """Place the samples of a dataset by each method and write the run's folder. `judge` is the model that judges it.
    `into` is the folder, by default a new one; it may hold an earlier run of the same samples."""
    begin = time.monotonic()
    config = measured_config(config, methods)
    selection = selection or Selection()
    path, samples = dataset_samples(dataset, methods, selection)
    if selection.only_failed:
        samples = failed_before(path, samples, config)
    language = language or LanguageOptions()
    # a run begins once its server answers, so that a refused one leaves no folder behind
    with prefect_server() as url:
        from flows.watched import BenchmarkPage, SampleJob, benchmark, in_flow, run_step

        check_access()
        limits = set_limits(runner.limits)
        folder = new_run_folder(path, samples, config, language, into)
        page, runs = BenchmarkPage(folder), list[Run]()
        session = language.session(folder)
        jobs = [SampleJob(one, config, session, folder.name, limits) for one in samples]

        def work() -> tuple[str, str]:
            cached = run_all(jobs, folder, session, workers, page, runner)
            runs.append(finish(folder, scored_rows(folder, samples, path), time.monotonic() - begin))
            if judge is not None:
                judged = run_step("judge", lambda: judge_run(str(folder), judge, console_on_stderr().print))
                runs[0] = finish(folder, judged.rows, time.monotonic() - begin)
            line = summary_line(runs[0].summary)
            page.show_results([shown_row(row) for row in runs[0].rows], line)
            print_table(runs[0].rows, runs[0].summary, folder, cached)
            return ("Failed" if runs[0].failed else "Completed"), line

        print_lines([f"Prefect: {pages_of(url)}"])
        waits = session.batch or runner.name is RunnerName.POOL
        at_a_time = max(workers, MOST_WAITING) if waits else workers
        shown = benchmark.with_options(flow_run_name=lambda: folder.name, task_runner=runner.task_runner(at_a_time))
        parameters = (str(path), list(methods), workers, runner.name)
        in_flow(partial(shown, *parameters), benchmark_tags(folder.name, methods), work, console_on_stderr().print)
    if runs[0].table:
        print_lines(shown_lines(runs[0].table))
    return runs[0]


def run_all(
    jobs: Sequence["SampleJob"],
    folder: Path,
    session: Session,
    workers: int,
    page: "BenchmarkPage",
    runner: SampleRunner,
) -> set[str]:
    """Place the samples and write each result into the run's folder. Returns the ids of cached samples."""
    from flows.watched import place_all

    cached = set[str]()
    slots = Semaphore(workers) if session.batch else None
    with (
        Display([job.sample for job in jobs]) as display,
        batch_queue(Path(session.batch), session, display.say) if session.batch else nullcontext(),
        use_context(RunContext(slots=slots)),
    ):
        for job, result in place_all(jobs, runner.task(), display.listener):
            if isinstance(result, FinishedSample) and not any(one.computed for one in result.results):
                cached.add(job.sample.id)
            _, error = keep_result(folder, job.sample, result)
            display.ended(job.sample, error)
            page.show_progress(display.share, display.counts)
    return cached


def keep_result(folder: Path, sample: Sample, result: FinishedSample | BaseException) -> tuple[JsonObject | None, str]:
    """Write a sample's outcome into the run: its placement.json, or why it failed."""
    out = sample_folder(folder, sample.id)
    if isinstance(result, FinishedSample):
        try:
            (out / "error.txt").unlink(missing_ok=True)
            tree = write_placement(result, out)
            write_measures(result, out)
        except Exception as error:  # a result that cannot be written is this sample's failure
            return keep_result(folder, sample, error)
        return tree, ""
    failed = FailedSample(sample, result)
    out.mkdir(parents=True, exist_ok=True)
    write_whole(out / "error.txt", (f"{failed.message}\n\n{failed.details}".rstrip() + "\n").encode())
    return None, failed.message


def shown_row(row: SampleOutcome) -> dict[str, object]:
    """Return the row of a sample in the table on Prefect's page."""
    return {
        "sample": row.sample,
        "method": row.method,
        "verdict": row.verdict,
        "on": f"{row.base} {row.part}".strip(),
        "seconds": row.seconds,
        "why": row.error or " ".join(f"{row.reason}: {row.message}".split()).rstrip(": ") * bool(row.reason),
    }


def check_access() -> None:
    """Send the server one request before a run begins, so that missing authentication is an error at once."""
    from prefect.client.orchestration import get_client

    with get_client(sync_client=True) as client:
        client.read_flow_runs(limit=1)


def set_limits(limits: Mapping[str, int]) -> frozenset[str]:
    """Tell the server how many stages of a kind may compute at a time. Returns the names of these limits."""
    from prefect.client.orchestration import get_client

    if limits:
        with get_client(sync_client=True) as client:
            for name, most in limits.items():
                client.upsert_global_concurrency_limit_by_name(name, most)
    return frozenset(limits)


def scored_rows(folder: Path, samples: Sequence[Sample], dataset: Path) -> tuple[SampleOutcome, ...]:
    """A row for each sample of a run, from its files, method by method. Intended outcomes come from the dataset's
    folder."""
    rows = []
    for sample, truth in zip(samples, truths_of(dataset, samples), strict=True):
        out = sample_folder(folder, sample.id)
        try:
            rows.append(scored_row(sample, *read_result(out), truth, out))
        except InputError as damaged:
            rows.append(scored_row(sample, None, str(damaged), truth, out))
    order = list(METHODS)
    return tuple(sorted(rows, key=lambda row: order.index(row.method)))


def new_run_folder(
    dataset: Path,
    samples: Sequence[Sample],
    config: PlaceConfig,
    language: LanguageOptions,
    into: Path | None = None,
) -> Path:
    """Create the run's folder, by default a new one, with `run.json` in it; `runs/last` points at it."""
    folder = into or free_folder(dataset.stem)
    folder.mkdir(parents=True, exist_ok=True)
    asked = {
        "version": ASKED_VERSION,
        "dataset": str(dataset.resolve()),
        "versions": versions(),
        "started": datetime.now(UTC).isoformat(timespec="seconds"),
        "config": config.model_dump(mode="json"),
        "language": asdict(language.located()),
        "methods": list(dict.fromkeys(sample.method for sample in samples)),
        "samples": [asdict(located(sample)) for sample in samples],
    }
    try:
        write_whole(folder / RUN, readable_json(asked))
    except OSError:
        if into is None:
            folder.rmdir()  # nothing is in it
        raise
    draft = runs_root() / f".last-{os.getpid()}"
    draft.symlink_to(os.path.relpath(folder, runs_root()))
    os.replace(draft, runs_root() / "last")
    return folder


def free_folder(stem: str) -> Path:
    """Make a new folder among the runs."""
    name = f"{stem}-{datetime.now(UTC):%Y%m%d-%H%M%S}"
    runs_root().mkdir(parents=True, exist_ok=True)
    for suffix in ("", *(f"-{number}" for number in range(2, 1000))):
        with suppress(FileExistsError):
            folder = runs_root() / f"{name}{suffix}"
            folder.mkdir()
            return folder
    raise InputError(f"{runs_root()}: a thousand runs are called {name}; move some away")


def versions() -> dict[str, str]:
    """Versions of the libraries that compute the run; a library that is not installed is left out."""
    told = {name: one for name in LIBRARIES if (one := installed_version(name))}
    return {"dcap": version(), "python": platform.python_version(), "machine": platform.machine(), **told}


def finish(folder: Path, rows: Sequence[SampleOutcome], seconds: float) -> Run:
    """Write tables, summary and report, with the judge's scores for a run of several methods."""
    write_rows(folder, rows)
    rows, table = judged_rows(folder, rows)
    language = spending_of(folder / LEDGER) if (folder / LEDGER).is_file() else None
    summary = summary_of(rows, run=str(folder), wall_s=seconds, language=language)
    write_whole(folder / "summary.json", readable_json(object_to_json(summary)))
    write_report(folder, rows, summary)
    return Run(folder, rows, summary, table)


def measured_config(config: PlaceConfig, methods: Sequence[str]) -> PlaceConfig:
    """Configuration with the measurements switched on that one method, or a comparison of several, needs."""
    return config.model_copy(update={"measured": True, "compared": len(set(methods)) > 1})


def rerun_sample(run: str, sample_id: str, stage: str, max_cost: float | None = None) -> tuple[JsonObject, Path]:
    """Compute one stage of one sample again and rewrite its placement.json and the run's report."""
    folder = find_run(run)
    asked = load_run_request(folder)
    sample, config = asked.sample(sample_id), asked.config
    refreshed = stages_to_refresh(stage, sample, config)
    budget = asked.language.max_cost if max_cost is None else max_cost
    language = replace(asked.language, max_cost=budget, batch=False)
    if language.client is ClientName.REPLAY and language.config() != config.intent.language:
        raise InputError(f"--replay {language.replay}: the recording has changed since {folder.name}; run it again")
    check_budget(config.intent.language.model, budget)
    session = replace(language.session(folder), fresh=True)
    console = console_on_stderr()
    result: FinishedSample | Exception
    with prefect_server(), console.status("starting") as status:
        from flows.watched import place_in_flow

        context = RunContext(refresh=refreshed, session=session, on_event=stage_lines(console, status))
        try:
            result = place_in_flow(sample, config, context, console.print, folder.name)
        except Exception as error:
            if is_server_error(error):
                raise  # an interruption says nothing about the sample, which may be finished
            result = error
    tree, _ = keep_result(folder, sample, result)
    page = rewrite_report(run)
    if isinstance(result, Exception):
        raise result
    assert tree is not None
    return tree, page


def stages_to_refresh(stage: str, sample: Sample, config: PlaceConfig) -> frozenset[str]:
    """Stages that a name stands for. Stages that measure or propose follow from the sample itself."""
    refreshed = frozenset(BOTH_MESHES if stage == MESH else {stage})
    known = dict.fromkeys((*STAGE_NAMES, OVERVIEW))
    if not refreshed.issubset(known):
        known |= dict.fromkeys(one.stage for one in plan_sample(sample, config, bring=False).stages)
    if not refreshed.issubset(known):
        raise InputError(f"--stage {stage!r} {not_one_of(stage, (MESH, *known))}")
    return refreshed


def rewrite_report(run: str) -> Path:
    """Rewrite the table and report of a run from its folder."""
    folder = find_run(run)
    asked = read_request(folder / RUN)
    with input_errors(folder / RUN):
        dataset, samples = Path(asked["dataset"]), [sample_from_json(one) for one in asked["samples"]]
    return rewrite_page(folder, scored_rows(folder, samples, dataset))


def rewrite_page(folder: Path, rows: Sequence[SampleOutcome]) -> Path:
    """Rewrite tables, summary and report from known rows."""
    before = read_keys(folder / "summary.json") if (folder / "summary.json").is_file() else {}
    finish(folder, rows, float(before.get("wall_s", 0.0)))
    return folder / "report.html"
