"""`dcap paper`: the paper's whole evaluation of a data set, in one flow run and one folder.

Makes missing meshes and sentences, runs all methods on the same samples, has a model judge them if one is named,
prepares a study, and writes `index.html` over all of it. Every step also has a command of its own. The folder's name
depends on the request: the same command resumes an interrupted evaluation, and ends in the same files.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from dcap.evaluation.methods import DCAP, methods_of, split_id
from dcap.evaluation.paper_page import PaperNotes, SceneFacts, write_paper_page
from dcap.geometry.pieces import boundary_edges
from dcap.scene.errors import InputError
from dcap.scene.settings import runs_root
from dcap.scene.types.sample import Sample
from dcap.scene.types.segmentation import Segmentation
from flows.benchmark import Run, run_benchmark
from flows.benchmark_config import (
    benchmark_config,
    dataset_file,
    judge_options,
    request_digest,
    runner_of,
    selection_of,
)
from flows.dataset_sample import SAMPLES_FILE, SampledDataset
from flows.display import console_on_stderr, summary_line
from flows.options import PaperOptions
from flows.place import PlaceConfig
from flows.prepare_sugar import mesh_source
from flows.run_files import load_run_request
from flows.sample_files import slug
from flows.sample_run import benchmark_tags, plan_sample
from flows.samples import EMBEDDED
from flows.server import prefect_server
from flows.study.serve import prepare_study
from tasks.artifact import Store
from tasks.segment.stage import segment_task

EMBEDDED_LIMIT = 6
"""Default number of samples of the embedded rooms [-]: five methods place them in some minutes on two cores."""
DATASET_FOLDER = "dataset"
"""Subfolder of the run for samples made from the scenes."""


@dataclass(frozen=True, slots=True)
class PaperRun:
    """A finished evaluation."""

    run: Run
    page: Path
    study: str
    """How to serve the study, or why there is none, in a sentence."""


def run_paper(options: PaperOptions) -> PaperRun:
    """Evaluate a data set by all methods; impossible requests are refused before anything is computed."""
    if options.dataset is None and options.limit is None:
        options = options.model_copy(update={"limit": EMBEDDED_LIMIT})
    config, asking = benchmark_config(options)
    methods, runner, judge = methods_of(options.methods), runner_of(options), judge_options(options)
    name = (options.dataset or EMBEDDED).resolve()
    folder = runs_root() / f"paper-{slug(name.stem if name.is_file() else name.name)}-{request_digest(options)}"
    made: list[PaperRun] = []
    with prefect_server():
        from flows.watched import in_flow, paper, run_step

        def work() -> tuple[str, str]:
            dataset, sampled = run_step(
                "samples", lambda: dataset_file(options, folder / DATASET_FOLDER / SAMPLES_FILE)
            )
            run = run_benchmark(
                dataset,
                config,
                asking,
                selection=selection_of(options, sampled=sampled is not None, spread=True),
                methods=methods,
                workers=options.workers,
                runner=runner,
                judge=judge,
                into=folder,
            )
            study = run_step("study", lambda: study_words(folder))
            notes = PaperNotes(study, sampled.left_out if sampled else {}, choice_words(options, sampled, run))
            page = run_step("page", lambda: write_paper_page(folder, run.rows, run.summary, scene_facts(folder), notes))
            made.append(PaperRun(run, page, study))
            return ("Failed" if run.failed else "Completed"), summary_line(run.summary)

        shown = paper.with_options(flow_run_name=lambda: folder.name)
        parameters = str(options.dataset or EMBEDDED), list(methods), options.judge
        in_flow(partial(shown, *parameters), benchmark_tags(folder.name, methods), work, console_on_stderr().print)
    return made[0]


def study_words(folder: Path) -> str:
    """Prepare the study of a run. Returns how to serve it, or why there is none."""
    try:
        prepare_study(str(folder), console_on_stderr().print)
    except InputError as refused:
        return f"No study: {refused}"
    votes = f"then dcap study report {folder.name}, and this evaluation again, which shows Table 2 here"
    return f"The study is ready: dcap study serve {folder.name} --raters N; {votes}."


def choice_words(options: PaperOptions, sampled: SampledDataset | None, run: Run) -> str:
    """A sentence on how the samples were chosen."""
    count = len({row.sample for row in run.rows})
    if sampled is not None:
        source = f"samples made by dcap dataset sample, {options.per_scene} of each scene"
    else:
        source = f"given samples of {'the embedded rooms' if options.dataset is None else options.dataset.name}"
    spread = (
        f"; {count} of them that differ as much as they can in scene, object, support and intended outcome"
        if options.limit is not None
        else f"; all {count}"
    )
    return f"{source[0].upper()}{source[1:]}{spread}."


def scene_facts(folder: Path) -> list[SceneFacts]:
    """Contents of a run's scenes, each from its first sample whose scene could be read."""
    asked = load_run_request(folder)
    config = asked.config.model_copy(update={"measured": False})
    scenes: dict[str, list[Sample]] = {}
    for name, sample in asked.samples.items():
        if split_id(name)[0] == DCAP or DCAP not in {one.method for one in asked.samples.values()}:
            scenes.setdefault(sample.scene, []).append(sample)
    names = scene_names(list(scenes))
    found = []
    for path, samples in scenes.items():
        contents = next((one for sample in samples if (one := contents_of(sample, config))), None)
        if contents is not None:
            source = mesh_source(Path(path))
            inside = Path(source.file).name if Path(path).is_file() else str(Path(source.file).relative_to(path))
            things = tuple((one.label, tuple(part.name for part in one.parts)) for one in contents.instances)
            open_edges = len(boundary_edges(contents.mesh)[0])
            found.append(SceneFacts(names[path], source.kind, inside, len(contents.mesh.faces), open_edges, things))
    return found


def contents_of(sample: Sample, config: PlaceConfig) -> Segmentation | None:
    """The things of a sample's scene from the cache; None if they are not cached."""
    plan = plan_sample(sample, config)
    refs = [one.ref for one in plan.found if one.stage == segment_task.name]
    if not refs:
        return None
    value = Store.default().load(refs[0])
    return value if isinstance(value, Segmentation) else None


def scene_names(paths: Sequence[str]) -> Mapping[str, str]:
    """The name of each scene, with as much of its folder as makes it unique."""
    for depth in range(1, max((len(Path(one).parts) for one in paths), default=1) + 1):
        names = {one: "/".join(Path(one).parts[-depth:]) for one in paths}
        if len(set(names.values())) == len(paths):
            return names
    return {one: one for one in paths}
