"""Turns the options of a benchmark into settings of stages, a language client, a runner and a run."""

import hashlib
import json
import re
from pathlib import Path

from dcap.cores import available_cores
from dcap.evaluation.methods import methods_of
from dcap.scene.errors import InputError
from dcap.scene.settings import runs_root
from flows.benchmark import Run, run_benchmark
from flows.configure import LanguageOptions, configured, language_options, with_threads
from flows.dataset_sample import SAMPLES_FILE, SampledDataset, SamplingOptions, sample_dataset
from flows.display import print_lines
from flows.options import BenchmarkOptions, PlaceOptions, StageOptions
from flows.place import PlaceConfig
from flows.runners import RunnerName, SampleRunner, check_runner
from flows.sample_files import slug
from flows.selection import Selection
from tasks.arch import chosen_arch
from tasks.cache import MODEL_CALLS, SIMULATIONS

DIGITS = 8
"""Hexadecimal digits of the request's digest in a folder's name [-]."""


def place_dataset(options: BenchmarkOptions) -> Run:
    """Place the samples of a dataset and write the run's folder."""
    config, asking = benchmark_config(options)
    judge, runner = judge_options(options), runner_of(options)
    dataset, made = dataset_file(options)
    return run_benchmark(
        dataset,
        config,
        asking,
        selection=selection_of(options, sampled=made is not None),
        methods=methods_of(options.methods),
        workers=options.workers,
        runner=runner,
        judge=judge,
    )


def selection_of(options: BenchmarkOptions, *, sampled: bool, spread: bool = False) -> Selection:
    """Return the selection of samples; a sampled file already holds only the named scenes."""
    scenes = "" if sampled else options.scenes
    return Selection(options.limit, spread, scenes, options.only_failed, options.sugar)


def dataset_file(options: BenchmarkOptions, out: Path | None = None) -> tuple[Path | None, SampledDataset | None]:
    """Return the file of samples, and a report if it was made here. `--dataset` names the file, a folder that holds it,
    or a folder of scenes to sample (by default below data/runs/samples). InputError for scenes without objects."""
    given = options.dataset
    if given is None or not given.is_dir() or (given / SAMPLES_FILE).is_file():
        if options.objects is not None:
            what = "the embedded rooms have" if given is None else f"{given} has"
            raise InputError(f"--objects {options.objects}: {what} samples with objects; leave it out")
        return (given / SAMPLES_FILE if given is not None and given.is_dir() else given), None
    if options.objects is None:
        raise InputError(
            f"--dataset {given}: a folder of scenes without {SAMPLES_FILE}; name the meshes to place: --objects FOLDER"
        )
    path = out or runs_root() / "samples" / f"{slug(given.resolve().name)}-{request_digest(options)}" / SAMPLES_FILE
    sampling = SamplingOptions(options.per_scene, scenes=options.scenes, sugar=options.sugar, skip=True)
    shared = {name: getattr(options, name) for name in (*StageOptions.model_fields, "max_cost")}
    made = sample_dataset(given, options.objects, path, sampling, PlaceOptions(**shared), quiet=False)
    print_lines([f"left out: {name}: {why.removeprefix(f'{name}: ')}" for name, why in made.left_out.items()])
    return path, made


def request_digest(options: BenchmarkOptions) -> str:
    """Return a digest of the options that decide which samples are placed and how, without the judge and the
    workers."""
    config, _ = benchmark_config(options)
    asked: dict[str, object] = {
        name: str(path.resolve()) if (path := getattr(options, name)) is not None else ""
        for name in ("dataset", "objects", "sugar")
    }
    asked |= {name: getattr(options, name) for name in ("per_scene", "scenes", "limit")}
    asked |= {"methods": methods_of(options.methods), "config": with_threads(config, 0).model_dump(mode="json")}
    return hashlib.sha256(json.dumps(asked, sort_keys=True).encode()).hexdigest()[:DIGITS]


def judge_options(options: BenchmarkOptions) -> LanguageOptions | None:
    """Return the options of the judging model, None without one. InputError if it cannot be used."""
    name = options.judge or ("replay" if options.judge_replay else "")
    if name in ("", "offline"):
        if options.judge_model or options.judge_record:
            raise InputError("--judge-model and --judge-record are for a model: --judge anthropic or openai")
        return None
    judge = LanguageOptions(
        language=name, model=options.judge_model, max_tokens=options.max_tokens, reply_timeout=options.reply_timeout,
        record=options.judge_record, replay=options.judge_replay, max_cost=options.max_cost,
        batch=options.batch and name == "anthropic",
    )  # fmt: skip
    if len(methods_of(options.methods)) < 2:
        raise InputError(f"--judge {name}: a judge compares methods, and --methods {options.methods} is one")
    try:
        judge.config()
    except InputError as refused:  # the message names the options of the language model, not the judge's
        words = re.sub(r"--(model|replay|record)\b", r"--judge-\1", str(refused)).replace("--language", "--judge")
        raise InputError(words) from None
    return judge


def benchmark_config(options: BenchmarkOptions) -> tuple[PlaceConfig, LanguageOptions]:
    """Return the settings of the stages and the language session; parallel workers share the cores of a machine."""
    # parallel drops must not compete for the cores; a worker of the pool has its own cores and divides them itself
    share = 0 if options.runner == RunnerName.POOL.value else max(1, available_cores() // options.workers)
    asking = language_options(options)
    shared = options.model_copy(update={"threads": options.threads or share})
    return configured(shared, language=asking.config(), arch=chosen_arch(options.arch)), asking


def runner_of(options: BenchmarkOptions) -> SampleRunner:
    """Return the runner of the samples; InputError for one that cannot work here."""
    name = RunnerName(options.runner)
    check_runner(name, options.cluster, batch=options.batch)
    limits = {SIMULATIONS: options.simulations, MODEL_CALLS: options.model_calls}
    return SampleRunner(name, options.cluster, {key: most for key, most in limits.items() if most})
