"""What a benchmark is asked to do, from flags, environment and `dcap.yaml`: its stages' settings, and who places."""

from collections.abc import Mapping

from dcap.cores import available_cores
from dcap.scene.errors import InputError
from dcap.scene.spelling import not_one_of
from flows.configure import configured, many_options
from flows.language_options import LanguageOptions, language_of
from flows.place import PlaceConfig
from flows.runners import RunnerName, SampleRunner, check_runner
from flows.settings.own import RunSettings
from tasks.arch import chosen_arch
from tasks.runner.limits import MODEL_CALLS, SIMULATIONS


def benchmark_config(flags: Mapping[str, object], asked: RunSettings) -> tuple[PlaceConfig, LanguageOptions]:
    """The settings of the stages, and who is asked; workers beside each other share the cores of a machine."""
    # drops side by side must not fight for the cores; a worker of the pool has others, and divides them itself
    share = 0 if asked.runner == RunnerName.POOL.value else max(1, available_cores() // asked.workers)
    threads = asked.threads or share
    asking = language_of(asked)
    arch = chosen_arch(asked.arch)
    return configured(many_options(flags, threads), language=asking.config(), arch=arch), asking


def runner_of(asked: RunSettings) -> SampleRunner:
    """Who places the samples; InputError for one that cannot work here."""
    if asked.runner not in set(RunnerName):
        raise InputError(f"--runner {asked.runner!r} {not_one_of(asked.runner, RunnerName)}")
    name = RunnerName(asked.runner)
    check_runner(name, asked.cluster, batch=asked.batch)
    limits = {SIMULATIONS: asked.simulations, MODEL_CALLS: asked.model_calls}
    return SampleRunner(name, asked.cluster, {key: most for key, most in limits.items() if most})
