"""Places the samples of a benchmark side by side, each in a flow run of its own, and keeps what comes out.

A sample that fails is kept as such, and the others go on.
"""

from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import AbstractContextManager, closing, contextmanager, nullcontext
from pathlib import Path
from threading import Semaphore

from dcap.evaluation.run_folder import sample_folder
from dcap.language.model.batch import batch_queue
from dcap.language.protocol.session import Session
from dcap.scene.json_tree import JsonObject
from dcap.scene.whole_files import write_whole
from flows.display import Display
from flows.elsewhere import SampleJob, fetched
from flows.measures_file import write_measures
from flows.output import write_placement
from flows.place import PlaceConfig
from flows.runners import LOOK_SECONDS, RunnerName, SampleRunner
from flows.sample_run import FailedSample, FinishedSample, Plan, heavy_modules, try_sample
from flows.watching import SettledSample, Watch
from tasks.runner.context import RunContext
from tasks.runner.limits import set_limits
from tasks.runner.process import kill_all
from tasks.runner.process_server import process_server

IN_A_BATCH = 32
"""Samples whose questions gather for one batch; each waits in a thread and a flow run of its own."""


def run_all(
    plans: Sequence[Plan],
    config: PlaceConfig,
    folder: Path,
    session: Session,
    workers: int,
    display: Display,
    watch: Watch,
    runner: SampleRunner,
) -> None:
    """Place the samples and leave in the run's folder what each ended with. A result is not kept in memory: the
    report reads it again."""
    waiting = [plan for plan in plans if plan.settled is None]

    def settle(result: FinishedSample | FailedSample, cached: bool) -> None:
        tree, error = settle_result(folder, result, display)
        watch.settled(SettledSample(result.sample, tree, error, cached))
        watch.progress(display.share())

    for plan in plans:
        if plan.settled is not None:
            settle(plan.settled, plan.finished is not None)
    if not waiting:
        return
    for name, most in set_limits(runner.limits).items():
        display.say(f"the server bounds {name} to {most}; change that on its page Concurrency")
    if runner.name is RunnerName.LOCAL:
        placed = placed_here(waiting, config, session, workers, display, watch)
    else:
        placed = placed_elsewhere(waiting, config, session, workers, display, watch, runner)
    with closing(placed):
        for some in placed:
            for result in some:
                settle(result, False)
            watch.progress(display.share())


def placed_here(
    plans: Sequence[Plan],
    config: PlaceConfig,
    session: Session,
    workers: int,
    display: Display,
    watch: Watch,
) -> Generator[Sequence[FinishedSample | FailedSample]]:
    """Samples as they end, placed by threads of this program."""
    slots = Semaphore(workers) if session.batch else None
    at_a_time = min(len(plans), max(workers, IN_A_BATCH)) if session.batch else workers
    # the queue closes before the pool waits for the threads that wait for it
    with (
        process_server(heavy_modules(name for plan in plans for name in plan.coming)) as server,
        threads(at_a_time) as pool,
        asking_queue(session, display),
    ):
        context = RunContext(session=session, slots=slots, server=server)
        left: set[Future[FinishedSample | FailedSample]] = {
            pool.submit(
                try_sample, one.sample, config, context=context, listener=display.listener(one.sample), run=watch.run
            )
            for one in plans
        }
        try:
            while left:
                done, left = wait(left, LOOK_SECONDS, FIRST_COMPLETED)
                yield [future.result() for future in done]
        except BaseException:
            for future in left:
                future.cancel()
            kill_all()  # the threads wait for these processes
            watch.interrupted()
            raise


def placed_elsewhere(
    plans: Sequence[Plan],
    config: PlaceConfig,
    session: Session,
    workers: int,
    display: Display,
    watch: Watch,
    runner: SampleRunner,
) -> Generator[Sequence[FinishedSample | FailedSample]]:
    """Samples as they end, placed by other processes that share the store."""
    assert watch.run is not None
    by_sample = {plan.sample: plan for plan in plans}
    jobs = [SampleJob(one, config, session, watch.run) for one in by_sample]
    try:
        for told in runner.place(jobs, workers, display.say):
            yield [fetched(by_sample[sample], config, tree) for sample, tree in told]
    except BaseException:
        watch.interrupted()
        raise


@contextmanager
def threads(count: int) -> Iterator[ThreadPoolExecutor]:
    """Threads for samples. One that computes cannot be interrupted: an interrupted program does not wait for them, they
    end with it."""
    pool = ThreadPoolExecutor(count)
    try:
        yield pool
    except BaseException as error:
        pool.shutdown(wait=isinstance(error, Exception), cancel_futures=True)
        raise
    pool.shutdown()


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
    write_whole(out / "error.txt", (f"{failed.message}\n\n{failed.details}".rstrip() + "\n").encode())
