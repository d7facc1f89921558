"""Turns the pure function of a stage into a cached Prefect task.

`segment_task = stage(segment)` gives a callable that takes references (`Ref`) and plain values and returns a reference.
Called, it looks for a record of the same code, configuration, inputs and libraries whose artifact is sound; if there is
none, it loads the inputs from the store, runs the function (with `process=True` in a fresh process of its own), saves
what it returns, and logs time and size. An `Infeasible` among the inputs is handed through without running anything.

Prefect is imported on the first run, not before: planning needs no server and must not wait for it.
"""

import inspect
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from contextvars import ContextVar
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property, partial
from pathlib import Path
from threading import Semaphore
from typing import TYPE_CHECKING, Any, get_type_hints

from pydantic import BaseModel

from dcap.language.protocol.session import Session, current_session, speaking
from dcap.scene.errors import StoreError
from dcap.scene.settings import PROJECT_ROOT, cache_root
from dcap.scene.store.artifacts import Ref, Store
from dcap.scene.store.codec import from_tree, to_tree
from dcap.scene.types.outcome import Infeasible
from tasks.runner.digests import libraries, source_digests
from tasks.runner.locks import FileLocks
from tasks.runner.process import run_in_process
from tasks.runner.records import Deciders, Record, records_root, usable_key

if TYPE_CHECKING:
    from prefect import Task
    from prefect.cache_policies import CachePolicy

OnProgress = Callable[[float, str], None]
NOT_DECIDING = {"threads"}
"""Settings of any stage that change how long it takes, never what it returns."""


class Event(StrEnum):
    """What can be told about a stage while a sample is placed."""

    STARTED = "started"
    PROGRESS = "progress"
    FINISHED = "finished"
    CACHED = "cached"


@dataclass(frozen=True, slots=True)
class StageEvent:
    """One thing that happened to a stage."""

    stage: str
    event: Event
    part: float = 0.0
    """Share of the work that is done, 0..1, where the stage knows it."""
    text: str = ""
    record: Record | None = None
    """The record, once there is one."""


@dataclass(slots=True)
class Conduct:
    """How the stages that are called inside `conducting` behave."""

    lookup_only: bool = False
    """Only look records up; a stage without one raises NotCachedError."""
    refresh: frozenset[str] = frozenset()
    """Stages to compute again although they have a record."""
    on_event: Callable[[StageEvent], None] = lambda event: None
    session: Session = field(default_factory=Session)
    """How questions are asked."""
    slots: Semaphore | None = None
    """How many stages may compute at a time; a stage that waits for a reply gives its slot to another."""
    ran: bool = field(default=False, init=False)
    """Whether the stage called last computed something."""


class NotCachedError(LookupError):
    """A stage has no usable record; carries what it would be computed from."""

    def __init__(self, deciders: Deciders) -> None:
        super().__init__(deciders.stage)
        self.deciders = deciders


current: ContextVar[Conduct] = ContextVar("current")


@contextmanager
def conducting(conduct: Conduct) -> Iterator[Conduct]:
    """Let stages called in this block and thread behave as `conduct` says."""
    token = current.set(conduct)
    try:
        yield conduct
    finally:
        current.reset(token)


class Stage:
    """A stage as the flows call it: references in, a reference out."""

    def __init__(self, function: Callable[..., Any], *, process: bool | Callable[..., bool], name: str) -> None:
        self.function = function
        self.process = process
        self.name = name
        self.signature = inspect.signature(function)
        self.module_path = Path(inspect.getfile(function)).resolve()

    @cached_property
    def hints(self) -> dict[str, Any]:
        """Declared types of the function's parameters."""
        return get_type_hints(self.function)

    def __call__(self, *arguments: Any, **named: Any) -> Ref:
        """Reference to what the function returns for these inputs, computed only if it was not before."""
        inputs = dict(self.signature.bind_partial(*arguments, **named).arguments)
        config = inputs.pop("config", None)
        for value in inputs.values():
            if isinstance(value, Ref) and value.kind == Infeasible.__name__:
                return value
        if config is None and "config" in self.signature.parameters:
            config = self.hints["config"]()
        return self._record(self.deciders(inputs, config), config).ref

    def deciders(self, inputs: dict[str, Any], config: BaseModel | None) -> Deciders:
        """Everything that decides the result."""
        return Deciders(
            stage=self.name,
            code=source_digests(self.module_path, PROJECT_ROOT) | {"function": self.function.__name__},
            config=None if config is None else deciding(config.model_dump(mode="json")),
            inputs={name: plain_input(name, value) for name, value in inputs.items()},
            libraries=libraries(self.module_path, PROJECT_ROOT),
        )

    def _record(self, deciders: Deciders, config: BaseModel | None) -> Record:
        conduct = current.get(None) or Conduct()
        if conduct.lookup_only:
            _, record = usable_key(deciders.key, Store.default())
            if record is None:
                raise NotCachedError(deciders)
        else:
            record = self._run(deciders, config, conduct)
        conduct.on_event(StageEvent(self.name, Event.FINISHED if conduct.ran else Event.CACHED, 1.0, record=record))
        return record

    def _run(self, deciders: Deciders, config: BaseModel | None, conduct: Conduct) -> Record:
        conduct.ran = False
        settings = None if config is None else config.model_dump(mode="json")
        with conducting(conduct):
            task = self.task.with_options(refresh_cache=True) if self.name in conduct.refresh else self.task
            return Record.from_json(task(deciders.key, deciders.to_json(), settings))

    @cached_property
    def task(self) -> "Task[[str, dict[str, object], object], dict[str, object]]":
        """The Prefect task behind this stage."""
        from prefect import Task

        return Task(
            self._body,
            name=self.name,
            task_run_name=self.name,
            cache_policy=verified_records(),
            persist_result=True,
            result_storage=records_root(),
            result_serializer="json",
            cache_result_in_memory=False,
        )

    def _body(self, key: str, deciders: dict[str, Any], config: object) -> dict[str, object]:
        """What Prefect runs when no record fits."""
        from prefect.logging import get_run_logger

        log = get_run_logger()
        conduct = current.get()
        conduct.ran = True
        conduct.on_event(StageEvent(self.name, Event.STARTED))
        begin = time.perf_counter()
        with conduct.slots or nullcontext(), speaking(conduct.session, partial(given_back, conduct.slots)):
            done = self._compute_anywhere(deciders["inputs"], config, progress_to(log, conduct, self.name))
        log.info(
            "%s: %s %s, %.2f s (%.2f s with loading and saving), %.1f KiB",
            self.name,
            done["ref"]["kind"],
            done["ref"]["sha256"][:12],
            done["seconds"],
            time.perf_counter() - begin,
            done["size"] / 1024,
        )
        record = Record(key, Ref.from_json(done["ref"]), done["seconds"], done["size"], deciders)
        return record.to_json()

    def _compute_anywhere(self, inputs: dict[str, Any], config: object, on_progress: OnProgress) -> dict[str, Any]:
        if not self._needs_process(inputs):
            return self.compute(inputs, config)
        job = {
            "module": self.function.__module__,
            "function": self.function.__name__,
            "inputs": inputs,
            "config": config,
            "session": current_session().to_json(),
        }
        return run_in_process(job, on_progress)

    def _needs_process(self, inputs: dict[str, Any]) -> bool:
        if isinstance(self.process, bool):
            return self.process
        store = Store.default()
        return self.process(**{name: self._loaded(name, tree, store) for name, tree in inputs.items()})

    def compute(self, inputs: dict[str, Any], config: Any) -> dict[str, Any]:
        """Load the inputs, run the function, save its value; reference, time [s] and size [bytes] as JSON."""
        store = Store.default()
        values = {name: self._loaded(name, tree, store) for name, tree in inputs.items()}
        if config is not None:
            values["config"] = self.hints["config"].model_validate(config)
        begin = time.perf_counter()
        value = self.function(**values)
        seconds = time.perf_counter() - begin
        ref = store.save(value)
        return {"ref": ref.to_json(), "seconds": seconds, "size": store.size(ref)}

    def _loaded(self, name: str, tree: dict[str, Any], store: Store) -> Any:
        if "ref" in tree:
            return store.load(Ref.from_json(tree["ref"]))
        return from_tree(tree["value"], self.hints.get(name, object), {})


def stage(
    function: Callable[..., Any], *, process: bool | Callable[..., bool] = False, name: str | None = None
) -> Stage:
    """The task of a pure function; `process` gives each run a fresh process of its own, or those that it says of by
    their inputs."""
    return Stage(function, process=process, name=name or function.__name__)


@contextmanager
def given_back(slots: Semaphore | None) -> Iterator[None]:
    """Without the slot that this thread holds; waits for one at the end."""
    if slots is None:
        yield
        return
    slots.release()
    try:
        yield
    finally:
        slots.acquire()


def deciding(tree: Any) -> Any:
    """Settings as JSON without those that never change a result, at any depth."""
    if isinstance(tree, dict):
        return {key: deciding(value) for key, value in tree.items() if key not in NOT_DECIDING}
    return [deciding(value) for value in tree] if isinstance(tree, list) else tree


def plain_input(name: str, value: Any) -> dict[str, object]:
    """An input as JSON: a reference by its digest, anything else by its value."""
    if isinstance(value, Ref):
        return {"ref": value.to_json()}
    files: dict[str, bytes] = {}
    tree = to_tree(value, "", files)
    if files:
        raise StoreError(f"input {name} holds meshes or large arrays; save it and pass its reference")
    return {"value": tree}


def progress_to(log: Any, conduct: Conduct, stage_name: str) -> OnProgress:
    """Pass a stage's progress on to the run's log and to whoever listens."""

    def on_progress(part: float, text: str) -> None:
        log.info("%s: %s%s", stage_name, f"{part:.0%} " if part else "", text)
        conduct.on_event(StageEvent(stage_name, Event.PROGRESS, part, text))

    return on_progress


def verified_records() -> "CachePolicy":
    """The cache policy: the key of the deciders, or the next free name where that record's artifact is damaged."""
    from prefect.cache_policies import CachePolicy
    from prefect.context import TaskRunContext

    class VerifiedRecords(CachePolicy):
        def compute_key(
            self,
            task_ctx: TaskRunContext,
            inputs: dict[str, Any],
            flow_parameters: dict[str, Any],
            **kwargs: Any,
        ) -> str | None:
            return usable_key(str(inputs["key"]), Store.default())[0]

    # serialisable: two samples that need the same room read it once, the second waits for the first
    return VerifiedRecords().configure(isolation_level="SERIALIZABLE", lock_manager=FileLocks(cache_root() / "locks"))
