"""What the options of a benchmark come to: its stages' settings, who is asked, who places, and the run."""

from dcap.cores import available_cores
from dcap.evaluation.methods import methods_of
from flows.benchmark import Run, run_benchmark
from flows.configure import configured
from flows.language_options import LanguageOptions, language_options
from flows.options import BenchmarkOptions
from flows.place import PlaceConfig
from flows.runners import RunnerName, SampleRunner, check_runner
from tasks.arch import chosen_arch
from tasks.cache import MODEL_CALLS, SIMULATIONS


def place_dataset(options: BenchmarkOptions) -> Run:
    """Place the samples of a dataset and write the run's folder."""
    config, asking = benchmark_config(options)
    methods, runner = methods_of(options.methods), runner_of(options)
    return run_benchmark(
        options.dataset,
        config,
        asking,
        limit=options.limit,
        workers=options.workers,
        only_failed=options.only_failed,
        methods=methods,
        scenes=options.scenes,
        runner=runner,
    )


def benchmark_config(options: BenchmarkOptions) -> tuple[PlaceConfig, LanguageOptions]:
    """Return the settings of the stages, and who is asked; workers beside each other share the cores of a machine."""
    # drops side by side must not fight for the cores; a worker of the pool has others, and divides them itself
    share = 0 if options.runner == RunnerName.POOL.value else max(1, available_cores() // options.workers)
    asking = language_options(options)
    shared = options.model_copy(update={"threads": options.threads or share})
    return configured(shared, language=asking.config(), arch=chosen_arch(options.arch)), asking


def runner_of(options: BenchmarkOptions) -> SampleRunner:
    """Return who places the samples; InputError for one that cannot work here."""
    name = RunnerName(options.runner)
    check_runner(name, options.cluster, batch=options.batch)
    limits = {SIMULATIONS: options.simulations, MODEL_CALLS: options.model_calls}
    return SampleRunner(name, options.cluster, {key: most for key, most in limits.items() if most})
