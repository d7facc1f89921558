"""A dataset run: plan, run what is missing, keep going, and report.

A run is a folder `data/runs/NAME` with one folder per sample (placement.json, object.ply, scene.glb, pictures),
`run.json` (what was asked), `results.parquet` (one row per sample) and `report.html`. Intended outcomes are read only
after the last sample has finished, and only for the report.
"""

import os
import platform
import time
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

from dcap.evaluation.method_report import MethodTable, shown_lines
from dcap.evaluation.methods import DCAP, METHODS, by_method, split_id, with_examples
from dcap.evaluation.outcome_table import ExpectedOutcome, SampleOutcome, read_truth
from dcap.evaluation.report import write_report
from dcap.evaluation.run_folder import sample_folder
from dcap.evaluation.run_summary import RunSummary, summary_of
from dcap.language.model.ledger import check_budget, spending_of
from dcap.language.protocol.client import ClientName
from dcap.scene.errors import InputError
from dcap.scene.json_tree import JsonObject, object_to_json
from dcap.scene.settings import data_root, runs_root, version
from dcap.scene.spelling import not_one_of
from dcap.scene.types.sample import Sample
from dcap.scene.whole_files import write_whole
from flows.display import Display, print_lines, print_table, summary_line
from flows.failed_before import failed_before
from flows.find_run import RUN, find_run
from flows.judge_run import judged_rows, write_rows
from flows.language_options import LEDGER, LanguageOptions
from flows.look_ahead import plan_ahead
from flows.output import readable_json
from flows.place import PlaceConfig
from flows.run_files import asked_of_run, kept, located, read_result, sample_from_json, undamaged
from flows.run_names import WatchedRun
from flows.run_samples import run_all, settle_result
from flows.runners import SampleRunner
from flows.sample_run import (
    OVERVIEW,
    STAGE_NAMES,
    FailedSample,
    Plan,
    heavy_modules,
    plan_sample,
    try_sample,
)
from flows.samples import EMBEDDED, SPLAT_ROOMS, TRUTH, load_samples, load_yaml
from flows.scene_lists import of_scenes
from flows.scoring import scored_row
from flows.server import prefect_server, server_answers
from flows.watching import Watch
from tasks.mesh.stage import mesh_object_task, mesh_scene_task
from tasks.runner.context import RunContext
from tasks.runner.digests import installed_version
from tasks.runner.process_server import process_server

DATASET_SEED = 0
LOCAL = SampleRunner()
MESH, BOTH_MESHES = "mesh", {mesh_scene_task.name, mesh_object_task.name}
"""What a person calls the two stages together."""
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
    runner: SampleRunner = LOCAL,
) -> Run:
    """Place the samples of a dataset by each method and write the run's folder."""
    begin = time.monotonic()
    config = measured_config(config, methods)
    path, samples = dataset_samples(dataset, methods, limit, scenes)
    if only_failed:
        samples = failed_before(path, samples, config)
    language = language or LanguageOptions()
    with Display(samples) as display:
        plans = plan_all(samples, config, display)
        asked: dict[str, object] = {"dataset": str(path), "workers": workers, "runner": runner.name}
        # a run begins once its server answers: what is refused before leaves none behind
        with served(plans, display) as shown:
            folder = new_run_folder(path, samples, config, language)
            with watched(folder, plans, asked) if shown else nullcontext(Watch()) as watch:
                run_all(plans, config, folder, language.session(folder), workers, display, watch, runner)
                rows = scored_rows(folder, samples, path)
                run = finish(folder, rows, time.monotonic() - begin)
                watch.finished(run.failed == 0, summary_line(run.summary))
    print_table(run.rows, run.summary, folder, {plan.sample.id for plan in plans if plan.finished})
    if run.table:
        print_lines(shown_lines(run.table))
    return run


def scored_rows(folder: Path, samples: Sequence[Sample], dataset: Path) -> tuple[SampleOutcome, ...]:
    """A row for each sample of a run, from its files, method by method; what was meant stands beside the dataset."""
    rows = []
    for sample, truth in zip(samples, truths_of(dataset, samples), strict=True):
        out = sample_folder(folder, sample.id)
        rows.append(scored_row(sample, *read_result(out), truth, out))
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


def ensure_dataset(folder: Path, seed: int, *, rooms: Sequence[str] = (), splats: int = 0, scenes: int = 0) -> Path:
    """Generate the embedded rooms and objects that are not there whole."""
    from dcap.synthetic.dataset import make_dataset

    make_dataset(folder, seed, rooms=rooms, splats=splats, scenes=scenes)
    return folder


def plan_all(samples: Sequence[Sample], config: PlaceConfig, display: Display) -> list[Plan]:
    """Plans of all samples."""
    plans = []
    for sample in samples:
        plans.append(plan_sample(sample, config))
        display.planned(plans[-1])
    return plans


@contextmanager
def served(plans: Sequence[Plan], display: Display) -> Iterator[bool]:
    """A block with a server, and whether there is one. Where all is cached, none is started: then the benchmark is
    shown only if one runs already."""
    work = any(plan.settled is None for plan in plans)
    if not work and not server_answers():
        yield False
        return
    with prefect_server() as url:
        from flows.benchmark_flow import check_access  # imports Prefect, after the server's address is known

        check_access()
        if work:
            display.serving(url)
        yield True


def watched(folder: Path, plans: Sequence[Plan], asked: dict[str, object]) -> AbstractContextManager[Watch]:
    """A block as the flow run of the whole benchmark."""
    from flows.benchmark_flow import benchmark_run  # imports Prefect, after the server's address is known

    return benchmark_run(folder, [plan.sample for plan in plans], asked)


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
    try:
        write_whole(folder / RUN, readable_json(asked))
    except OSError:
        folder.rmdir()  # nothing is in it
        raise
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
    write_whole(folder / "summary.json", readable_json(object_to_json(summary)))
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


def rerun_sample(run: str, sample_id: str, stage: str, max_cost: float | None = None) -> tuple[JsonObject, Path]:
    """Compute one stage of one sample again; its placement.json and the run's report, both written anew."""
    folder = find_run(run)
    asked = asked_of_run(folder)
    sample, config = asked.sample(sample_id), asked.config
    refreshed = stages_to_refresh(stage, sample, config)
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
            run=WatchedRun(folder.name),
        )
        tree, _ = settle_result(folder, result, display)
    page = rewrite_report(run)
    if isinstance(result, FailedSample):
        raise result.error
    assert tree is not None
    return tree, page


def stages_to_refresh(stage: str, sample: Sample, config: PlaceConfig) -> frozenset[str]:
    """The stages that a person means by a name; those that measure or propose are known from the sample itself."""
    refreshed = frozenset(BOTH_MESHES if stage == MESH else {stage})
    known = dict.fromkeys((*STAGE_NAMES, OVERVIEW))
    if not refreshed.issubset(known):
        known |= dict.fromkeys(one.stage for one in plan_ahead(sample, config).stages)
    if not refreshed.issubset(known):
        raise InputError(f"--stage {stage!r} {not_one_of(stage, (MESH, *known))}")
    return refreshed


def rewrite_report(run: str) -> Path:
    """Read a run's folder again and write its table and report."""
    folder = find_run(run)
    asked = kept(folder / RUN)
    with undamaged(folder / RUN):
        dataset, samples = Path(asked["dataset"]), [sample_from_json(one) for one in asked["samples"]]
    return rewrite_page(folder, scored_rows(folder, samples, dataset))


def rewrite_page(folder: Path, rows: Sequence[SampleOutcome]) -> Path:
    """Write tables, summary and report of known rows again."""
    before = kept(folder / "summary.json") if (folder / "summary.json").is_file() else {}
    finish(folder, rows, float(before.get("wall_s", 0.0)))
    return folder / "report.html"
