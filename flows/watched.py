"""Placements as flow and task runs of Prefect; imports Prefect, so only once the server's address is known.

A benchmark is one flow run, each sample a task in it, each stage a task in the sample. The server only watches: if
it is lost, samples go on, and Prefect's pages stay incomplete.
"""

import base64
import fcntl
import html
import io
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar
from uuid import UUID

from PIL import Image
from prefect import flow, task
from prefect.artifacts import (
    create_markdown_artifact,
    create_progress_artifact,
    create_table_artifact,
    update_progress_artifact,
)
from prefect.cache_policies import NO_CACHE
from prefect.client.orchestration import get_client
from prefect.client.schemas.filters import FlowRunFilter, TaskRunFilter
from prefect.context import TaskRunContext
from prefect.futures import PrefectFuture, as_completed
from prefect.runtime import flow_run, task_run
from prefect.states import Completed, Crashed, Failed
from prefect.transactions import CommitMode, transaction

from dcap.language.protocol.session import Session
from dcap.scene.errors import StoreError
from dcap.scene.settings import server_folder
from dcap.scene.types.outcome import Infeasible
from dcap.scene.types.sample import Sample
from flows.place import PlaceConfig
from flows.sample_run import FinishedSample, error_line, run_sample, sample_tags
from flows.server import give_up_server, own_server_has_ended, was_given_up
from tasks.artifact import Store
from tasks.cache import INFEASIBLE, reason_line
from tasks.codec import picture_from_png
from tasks.machine_errors import is_lost_server, is_server_error, pass_over_server_errors, team_server
from tasks.run_context import Mode, OnEvent, RunContext, current_context, use_context

if TYPE_CHECKING:
    from prefect import Task
    from prefect.client.schemas.objects import State

SIDE, QUALITY, MOST = 320, 80, 3
"""Pictures on a sample's page: side [pixels], quality of the JPEG, and how many: 100 KB of the server's database."""
SHOWN = ("settled", "closeup", "before_after", "asked", "clean", "candidates", "hole")
"""Pictures of a placement, the most telling first."""
RUN_ID = re.compile(r"[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}")
STEERING = re.compile(r"[\\`*_\[\]()#+!|~]")
"""Special characters of Markdown."""
FAILED = "Failed"
LOST = "the Prefect server was lost: its page of this run is incomplete; no result depends on it"
Say = Callable[[str], object]
Value = TypeVar("Value")
_work: ContextVar[Callable[[], object]] = ContextVar("work of the flow")
"""Work of the flow that is called next: the flow object is sent to clusters, and its work cannot be."""


@dataclass(frozen=True, slots=True)
class SampleJob:
    """A sample to place, here or on another machine."""

    sample: Sample
    config: PlaceConfig
    session: Session
    run: str = ""
    """Name of its run."""
    limits: frozenset[str] = frozenset()
    """Prefect's global concurrency limits in force."""
    refresh: frozenset[str] = frozenset()
    """Stages to compute again."""


class PlacedSample:
    """Return value of a sample's task. A plain class: Prefect would keep references to the parts of a dataclass."""

    def __init__(self, finished: FinishedSample) -> None:
        self.finished = finished


def sample_run_name() -> str:
    """Return the name of the task run of a sample."""
    job: SampleJob = task_run.parameters["job"]
    return job.sample.id


@task(name="sample", task_run_name=sample_run_name, cache_policy=NO_CACHE, persist_result=False)
def place_sample(job: SampleJob) -> object:
    """Place a sample; its stages are tasks in this one."""
    tag_task_run(job)
    finished = run_watched(job)
    show_pictures(finished)
    name, why = ending_of(finished)
    return Completed(name=name, message=why or None, data=PlacedSample(finished))


def tag_task_run(job: SampleJob) -> None:
    """Tag the task run of a sample once it runs: for tags that it starts with, Prefect would query the server."""
    context = TaskRunContext.get()
    assert context is not None
    context.task_run.tags = list(sample_tags(job.sample, job.run))


def run_watched(job: SampleJob) -> FinishedSample:
    """Run the stages of a sample as tasks, each of which commits its result when it ends."""
    around = current_context()  # the requesting program's, if it is this one
    context = replace(
        around,
        mode=Mode.WATCHED,
        session=job.session,
        limits=job.limits,
        refresh=job.refresh,
        tags=sample_tags(job.sample, job.run),
    )
    with transaction(commit_mode=CommitMode.EAGER):
        return run_sample(job.sample, job.config, context)


def ending_of(finished: FinishedSample) -> tuple[str, str]:
    """Return the name of the final state of a sample, and why it is infeasible."""
    if not finished.placement.renders.infeasible:
        return "Completed", ""
    found = Store.default().load(finished.placement.renders)
    assert isinstance(found, Infeasible)
    return INFEASIBLE, reason_line(found)


def do_work() -> object:
    """Do the work that `in_flow` was given. A module-level function: clusters are sent its name, not the variable."""
    return _work.get()()


@flow(name="place", persist_result=False, validate_parameters=False)
def place(scene: str, object: str, prompt: str) -> object:  # noqa: A002
    """Run the work of `in_flow`; the parameters are for those who watch."""
    return do_work()


@flow(name="benchmark", persist_result=False, validate_parameters=False)
def benchmark(dataset: str, methods: list[str], workers: int, runner: str) -> object:
    """Run the work of `in_flow`; the parameters are for those who watch."""
    return do_work()


@flow(name="paper", persist_result=False, validate_parameters=False)
def paper(dataset: str, methods: list[str], judge: str) -> object:
    """Run the work of `in_flow`; the parameters are for those who watch."""
    return do_work()


def run_step(name: str, work: Callable[[], Value]) -> Value:
    """Run a step of the current flow as a task, whose page shows its start and its outcome; directly if the server is
    lost."""
    if own_server_has_ended():
        give_up_server()
    if was_given_up():
        return work()
    found: list[Value] = []  # not the task's result: Prefect would keep it

    @task(name=name, cache_policy=NO_CACHE, persist_result=False)
    def shown() -> None:
        found.append(work())

    try:
        shown()
    except Exception as error:
        if not found or not is_server_error(error):
            raise
    return found[0]


def in_flow(shown: Callable[..., Any], tags: Sequence[str], work: Callable[[], tuple[str, str]], say: Say) -> None:
    """Run some work as a flow; it returns the name and the message of the final state. Its errors are raised.

    A server that is lost on the way is reported by `say`, in one line.
    """
    ended: list[str] = []
    claims: list[Path] = []

    def tagged_work() -> object:
        claims.append(claimed.enter_context(claimed_run()))
        with pass_over_server_errors(), get_client(sync_client=True) as client:
            # not around the flow: the tags would be those of each task from its start
            client.update_flow_run(UUID(flow_run.id), tags=list(tags))
        name, message = work()
        ended.append(name)
        return Failed(message=message) if name == FAILED else Completed(name=name, message=message or None)

    token = _work.set(tagged_work)
    try:
        with ExitStack() as claimed:  # until the server has been told how the run ended
            state = shown(return_state=True)
            for claim in claims:
                claim.unlink(missing_ok=True)
        if not ended:
            state.result()  # raises what the work has raised
        if own_server_has_ended():
            give_up_server()
    except Exception as error:
        if not ended or not is_server_error(error):
            raise
        if is_lost_server(error):
            give_up_server()
    finally:
        _work.reset(token)
        if was_given_up():
            say(LOST)


def place_in_flow(sample: Sample, config: PlaceConfig, context: RunContext, say: Say, run: str = "") -> FinishedSample:
    """Place a single sample, perhaps of a run, in a flow run of its own; directly if the server is lost before the run
    has begun."""
    placed: list[FinishedSample] = []
    failed: list[Exception] = []

    def work() -> tuple[str, str]:
        try:
            placed.append(run_watched(SampleJob(sample, config, context.session, run, refresh=context.refresh)))
        except Exception as error:
            failed.append(error)
            return FAILED, error_line(error)
        show_pictures(placed[0])
        return ending_of(placed[0])

    named = place.with_options(flow_run_name=lambda: sample.id)
    shown = partial(named, sample.scene, sample.object, sample.prompt)
    try:
        with use_context(context):
            in_flow(shown, sample_tags(sample, run), work, say)
    except Exception as error:
        if placed or failed or not is_lost_server(error):
            raise
        if not was_given_up():
            give_up_server()
            say(LOST)
        return run_sample(sample, config, context)
    if failed:
        raise failed[0]
    return placed[0]


class BenchmarkPage:
    """Content of Prefect's page of a benchmark: progress, a table of results, the report's path."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._progress: UUID | None = None

    def show_progress(self, share: float, text: str) -> None:
        """Show the share of the work that is done, 0..1."""

        def show() -> None:
            if self._progress is None:
                self._progress = UUID(str(create_progress_artifact(round(100 * share, 1), "progress", text)))
            else:
                update_progress_artifact(self._progress, round(100 * share, 1), text)

        show_there(show)

    def show_results(self, rows: Sequence[Mapping[str, object]], line: str) -> None:
        """Show how each sample ended, and the report's path as text: browsers open no file from a page of a server."""
        cells = [{key: plain_text(one) if isinstance(one, str) else one for key, one in row.items()} for row in rows]
        report = f"{plain_text(line)}\n\nOpen in a browser:\n\n    {self.folder / 'report.html'}\n"
        show_there(lambda: create_table_artifact(cells, "results", "How each sample ended."))
        show_there(lambda: create_markdown_artifact(report, "report", "Where the results are."))


def place_all(
    jobs: Sequence[SampleJob], place: "Task[..., Any]", listener: Callable[[Sample], OnEvent]
) -> Iterator[tuple[SampleJob, FinishedSample | BaseException]]:
    """Submit all samples to the task runner of the flow, and yield them with their results as they end."""
    futures: dict[PrefectFuture[Any], SampleJob] = {}
    for job in jobs:
        with use_context(replace(current_context(), on_event=listener(job.sample))):
            futures[place.submit(job)] = job
    for future in as_completed(list(futures)):
        found = future.result(raise_on_failure=False)
        yield futures[future], found.finished if isinstance(found, PlacedSample) else found


def show_there(show: Callable[[], object]) -> None:
    """Show something on Prefect's pages, unless the server was lost: each request would wait for it."""
    if own_server_has_ended():
        give_up_server()
    if not was_given_up():
        with pass_over_server_errors() as lost:
            show()
        if lost:
            give_up_server()


def show_pictures(finished: FinishedSample) -> None:
    """Show pictures of a placement on the page of the run that computed a part of it. They are embedded in the text, as
    browsers load no files."""
    if not any(one.computed for one in finished.results):
        return
    folder = Store.default().folder(finished.placement.overview or finished.placement.renders)
    paths = [path for name in SHOWN if (path := folder / f"{name}.png").is_file()][:MOST]
    parts = []
    with suppress(OSError, StoreError):  # damaged meanwhile: the sample is placed nevertheless
        for path in paths:
            small = Image.fromarray(picture_from_png(path.read_bytes(), path.name)).convert("RGB")
            small.thumbnail((SIDE, SIDE))
            data = io.BytesIO()
            small.save(data, "JPEG", quality=QUALITY)
            code = base64.b64encode(data.getvalue()).decode()
            name = path.stem.replace("_", " ")
            parts.append(f"**{name}**\n\n![{name}](data:image/jpeg;base64,{code})")
    if parts:
        show_there(lambda: create_markdown_artifact("\n\n".join(parts), "pictures"))


def plain_text(text: str) -> str:
    """Escape foreign text, including links, so that a page of Markdown shows it literally."""
    return STEERING.sub(r"\\\g<0>", html.escape(text, quote=False)).replace("://", "&#58;//")


@contextmanager
def claimed_run() -> Iterator[Path]:
    """Hold the lock of a file that shows that the program of this flow run is alive, and names its server. First set
    runs of dead programs to Crashed. The caller deletes the file once the server knows how the run ended."""
    folder = server_folder() / "running"
    folder.mkdir(parents=True, exist_ok=True)
    with pass_over_server_errors():
        end_dead_runs(folder)
    path = folder / str(flow_run.id)
    draft = path.with_suffix(".draft")  # locked before any other program sees it
    with draft.open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        lock.write(team_server())
        lock.flush()
        draft.rename(path)
        yield path


def end_dead_runs(folder: Path) -> None:
    """Set flow runs on this server whose programs were killed on this machine to Crashed, together with their running
    tasks and their samples waiting in the pool."""
    for path in (one for one in folder.iterdir() if RUN_ID.fullmatch(one.name)):
        with suppress(FileNotFoundError), path.open() as file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:  # it lives
                continue
            if file.read() != team_server():
                continue
            state: State[Any] = Crashed(message="its program was killed")
            run = UUID(path.name)
            with get_client(sync_client=True) as client:
                unended = {"state": {"type": {"any_": ["SCHEDULED", "PENDING", "RUNNING"]}}}
                inside = FlowRunFilter.model_validate({"id": {"any_": [run]}})
                filter_ = TaskRunFilter.model_validate(unended)
                while some := client.read_task_runs(flow_run_filter=inside, task_run_filter=filter_):
                    for one in some:
                        client.set_task_run_state(one.id, state, force=True)
                for which in ({"id": {"any_": [run]}}, {"parent_flow_run_id": {"any_": [run]}}):
                    runs = FlowRunFilter.model_validate({**unended, **which})
                    for found in client.read_flow_runs(flow_run_filter=runs):
                        client.set_flow_run_state(found.id, state, force=True)
            path.unlink(missing_ok=True)
