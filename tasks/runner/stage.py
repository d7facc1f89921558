"""Turns the pure function of a stage into a cached Prefect task.

`segment_task = stage(segment)` gives a callable that takes references (`Ref[Scan]`) where the function takes values,
and plain values as they are, and returns a reference to what the function returns. Called, it looks for a record of the
same code, configuration, inputs and libraries whose artifact is sound; if there is none, it loads the inputs from the
store, runs the function (with `process=True` in a process of its own), saves what it returns, and logs time and
size. An `Infeasible` among the inputs is handed through without running anything. A function with a parameter `client`
gets the client that its configuration names, which is no input: what it may say is decided by the configuration.

mypy derives the task's signature from the function's (mypy_plugin.py beside this): a reference to the wrong kind of
value is a type error in the flow.
"""

import inspect
import json
import time
from collections.abc import Callable, Mapping
from contextlib import nullcontext
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, ParamSpec, TypeVar, get_args, get_type_hints

from pydantic import BaseModel

from dcap.language.connect import connect
from dcap.language.protocol.client import ClientName, Idle
from dcap.language.protocol.session import Session
from dcap.scene.errors import StoreError
from dcap.scene.settings import PROJECT_ROOT
from dcap.scene.store.artifacts import Store
from dcap.scene.store.codec import canonical_json, from_tree, to_tree
from dcap.scene.store.ref import Ref
from dcap.scene.types.outcome import Infeasible
from tasks.runner.cache_policy import verified_records
from tasks.runner.context import (
    Event,
    OnEvent,
    OnProgress,
    RunContext,
    StageCall,
    StageEvent,
    current_call,
    current_context,
    lent,
    use_context,
)
from tasks.runner.digests import libraries, source_digests
from tasks.runner.limits import MODEL_CALLS, SIMULATIONS, slot_of
from tasks.runner.process import run_in_process
from tasks.runner.records import Deciders, Record, records_root, share_record, usable_key

if TYPE_CHECKING:
    from prefect import Task

NOT_DECIDING = {"threads"}
"""Settings of any stage that change how long it takes, never what it returns."""
STARTING = {"threads", "arch"}
"""Settings of a simulation that a process can have one time."""
CLIENT = "client"
"""Parameter through which a stage that asks questions gets who answers them."""

P = ParamSpec("P")
ValueT = TypeVar("ValueT")
ValueT_co = TypeVar("ValueT_co", covariant=True)


class StartWatch:
    """Passes events on and notes whether a stage began to compute."""

    def __init__(self, listener: OnEvent) -> None:
        self.listener = listener
        self.started = False

    def __call__(self, event: StageEvent) -> None:
        """One event."""
        self.started |= event.event is Event.STARTED
        self.listener(event)


class Stage(Generic[P, ValueT_co]):
    """A stage as the flows call it: references in, a reference out."""

    def __init__(
        self,
        function: Callable[..., ValueT_co | Infeasible],
        *,
        process: bool | Callable[..., bool],
        name: str,
        simulates: bool,
        loads: tuple[str, ...],
    ) -> None:
        self.function = function
        self.process = process
        self.simulates = simulates
        self.loads = loads
        self.name = name
        self.signature = inspect.signature(function)
        self.module_path = Path(inspect.getfile(function)).resolve()
        self._tasks: dict[Path, Task[..., dict[str, object]]] = {}
        """By the folder of the records: $DCAP_DATA may change while a program runs."""
        self._code: tuple[Mapping[str, str], dict[str, str]] = ({}, {})
        self._settings: tuple[bytes, object] = (b"", None)
        """What decided the last call: what thousands of samples share is held once."""

    @cached_property
    def hints(self) -> dict[str, Any]:
        """Declared types of the function's parameters."""
        return get_type_hints(self.function)

    @property
    def asks(self) -> bool:
        """Whether it asks questions."""
        return CLIENT in self.signature.parameters

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> Ref[ValueT_co]:
        """Reference to what the function returns for these inputs, computed only if it was not before."""
        bound = self.signature.bind_partial(*args, **kwargs)
        bound.apply_defaults()  # left out or given, the default is the same input
        inputs = dict(bound.arguments)
        config = inputs.pop("config", None)
        for value in inputs.values():
            if isinstance(value, Ref) and value.infeasible:
                return value
        if config is None and "config" in self.signature.parameters:
            config = self.hints["config"]()
        deciders, context = self.deciders(inputs, config), current_context()
        if context.lookup_only:
            _, record = usable_key(deciders.key, Store.default())
            if record is None:
                return context.on_missing(deciders)
            record = replace(record, deciders=deciders.to_json())  # equal, and shared by all samples
            context.on_event(StageEvent(self.name, Event.CACHED, 1.0, record=record))
            return record.ref
        from tasks.runner.task_runs import task_run  # Prefect is imported on the first run: planning needs none

        watch = StartWatch(context.on_event)
        settings = None if config is None else config.model_dump(mode="json")
        call = StageCall(deciders.key, deciders.to_json(), settings)
        task = self.task.with_options(refresh_cache=True) if self.name in context.refresh else self.task
        with (
            use_context(replace(context, on_event=watch, call=call)),
            task_run(task, inputs, context.producers) as (engine, transaction),
        ):
            engine.call_task_fn(transaction)
        tree, task_run_id = engine.returned
        record = Record.from_json(tree)
        context.producers.note(record.ref, task_run_id)
        end = Event.FINISHED if watch.started else Event.CACHED
        context.on_event(StageEvent(self.name, end, 1.0, record=record))
        return record.ref

    def deciders(self, inputs: dict[str, Any], config: BaseModel | None) -> Deciders:
        """Everything that decides the result."""
        return Deciders(
            stage=self.name,
            code=self.code(),
            config=self.deciding_settings(config),
            inputs={name: plain_input(name, value) for name, value in inputs.items()},
            libraries=libraries(self.module_path, PROJECT_ROOT),
        )

    def code(self) -> dict[str, str]:
        """Digest per source file, and the function's name; the same object until a source changes."""
        digests = source_digests(self.module_path, PROJECT_ROOT)
        known, code = self._code
        if known is not digests:
            code = digests | {"function": self.function.__name__}
            self._code = digests, code
        return code

    def deciding_settings(self, config: BaseModel | None) -> object:
        """The configuration as JSON; the same object for the same settings."""
        found = None if config is None else deciding(config.model_dump(mode="json"))
        text = canonical_json(found)
        known, settings = self._settings
        if known != text:  # as it decides the key: 1 and 1.0 are equal, and not the same there
            settings = found
            self._settings = text, settings
        return settings

    @property
    def task(self) -> "Task[..., dict[str, object]]":
        """The Prefect task behind this stage, whose parameters are the stage's inputs."""
        from prefect import Task

        root = records_root()
        if root in self._tasks:
            return self._tasks[root]
        self._tasks[root] = Task(
            self._body(),
            name=self.name,
            task_run_name=self._run_name,
            cache_policy=verified_records(),
            persist_result=True,
            result_storage=root,
            result_serializer="json",
            cache_result_in_memory=False,
        )
        return self._tasks[root]

    def _run_name(self) -> str:
        """Name of a task run: the stage and the sample."""
        return f"{self.name} {current_context().session.sample}".rstrip()

    def _body(self) -> Callable[..., dict[str, object]]:
        """What Prefect runs when no record fits: a function of the stage's inputs by name, which it finds in the
        context."""

        def body(**_: object) -> dict[str, object]:
            from prefect.logging import get_run_logger

            log, context, call = get_run_logger(), current_context(), current_call()
            inputs, config = call.deciders["inputs"], call.settings
            context.on_event(StageEvent(self.name, Event.STARTED))
            begin = time.perf_counter()
            with slot_of(self.limit(config)), context.slots or nullcontext():
                if self._needs_process(inputs):
                    job, on_progress = self.job(inputs, config, context.session), progress_to(log, context, self.name)
                    done = run_in_process(job, on_progress, context.server, self.kind(config))
                    log.info(
                        "%s: took %.2f s of processor time and %.0f MiB",
                        self.name,
                        done["cpu_seconds"],
                        done["peak_memory"] / 2**20,
                    )
                else:
                    values = self.load(inputs, config, context.session, partial(lent, context.slots))
                    loaded = time.perf_counter()
                    value = self.function(**values)
                    done = self.save(value, time.perf_counter() - loaded)
            log.info(
                "%s: %s %s, %.2f s (%.2f s with loading and saving), %.1f KiB",
                self.name,
                done["ref"]["kind"],
                done["ref"]["sha256"][:12],
                done["seconds"],
                time.perf_counter() - begin,
                done["size"] / 1024,
            )
            record = Record(call.key, Ref.from_json(done["ref"]), done["seconds"], done["size"], call.deciders)
            share_record(record, Store.default())
            return record.to_json()

        names = (name for name in self.signature.parameters if name not in ("config", CLIENT))
        parameters = [inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None) for name in names]
        body.__name__ = body.__qualname__ = self.name
        body.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        return body

    def limit(self, settings: object) -> str:
        """Name of the limit that it falls under, if any."""
        if self.simulates:
            return SIMULATIONS
        if not self.asks:
            return ""
        language = self.hints["config"].model_validate(settings).language
        return MODEL_CALLS if language.client in (ClientName.ANTHROPIC, ClientName.OPENAI) else ""

    def job(self, inputs: dict[str, Any], config: object, session: Session) -> dict[str, object]:
        """What a process of its own needs to know, as JSON."""
        return {
            "module": self.function.__module__,
            "function": self.function.__name__,
            "inputs": inputs,
            "config": config,
            "session": session.to_json(),
        }

    def kind(self, settings: object) -> str:
        """For which jobs its process may be kept: simulations that start Taichi alike, which then has its kernels read;
        empty for none."""
        return json.dumps(starting(settings)) if self.simulates else ""

    def _needs_process(self, inputs: dict[str, Any]) -> bool:
        if isinstance(self.process, bool):
            return self.process
        store = Store.default()
        return self.process(**{name: self._loaded(name, tree, store) for name, tree in inputs.items()})

    def load(self, inputs: dict[str, Any], config: Any, session: Session, idle: Idle = nullcontext) -> dict[str, Any]:
        """The function's arguments, from their JSON."""
        store = Store.default()
        values = {name: self._loaded(name, tree, store) for name, tree in inputs.items()}
        if config is not None:
            values["config"] = self.hints["config"].model_validate(config)
        if self.asks:
            values[CLIENT] = connect(values["config"].language, session, idle)
        return values

    def save(self, value: object, seconds: float) -> dict[str, Any]:
        """Save what the function returned; its reference, the time it took [s] and its size [bytes] as JSON."""
        store = Store.default()
        ref = store.save(value)
        return {"ref": ref.to_json(), "seconds": seconds, "size": store.size(ref)}

    def _loaded(self, name: str, tree: dict[str, Any], store: Store) -> Any:
        """An input as the function takes it; StoreError if the artifact is of another kind than declared."""
        declared = self.hints.get(name, object)
        if "ref" not in tree:
            return from_tree(tree["value"], declared, {})
        value = store.load(Ref.from_json(tree["ref"]))
        if not isinstance(value, kinds_of(declared)):
            raise StoreError(
                f"stage {self.name}: input {name} is declared {names_of(declared)}, its artifact is a "
                f"{type(value).__name__}"
            )
        return value


def stage(
    function: Callable[..., ValueT | Infeasible],
    *,
    process: bool | Callable[..., bool] = False,
    name: str | None = None,
    simulates: bool = False,
    loads: tuple[str, ...] = (),
) -> Stage[..., ValueT]:
    """The task of a pure function; `process` gives each run a process of its own, or those that it says of by
    their inputs; what `simulates` falls under the limit of simulations, and its process does the next one, too. `loads`
    names modules that the function imports only when it runs, for its process to have beforehand."""
    return Stage(function, process=process, name=name or function.__name__, simulates=simulates, loads=loads)


def kinds_of(declared: Any) -> tuple[type, ...]:
    """The classes that a declared type allows, through unions and new names of a class."""
    options = get_args(declared) or (declared,)
    plain = (getattr(one, "__supertype__", one) for one in options)
    return tuple(one for one in plain if isinstance(one, type))


def names_of(declared: Any) -> str:
    """A declared type in words."""
    return " or ".join(one.__name__ for one in kinds_of(declared) if one is not type(None))


def deciding(tree: Any) -> Any:
    """Settings as JSON without those that never change a result, at any depth."""
    if isinstance(tree, dict):
        return {key: deciding(value) for key, value in tree.items() if key not in NOT_DECIDING}
    return [deciding(value) for value in tree] if isinstance(tree, list) else tree


def starting(tree: Any) -> list[tuple[str, Any]]:
    """Settings by which Taichi is started, once in a process, at any depth."""
    if not isinstance(tree, dict):
        return []
    own = [(key, value) for key, value in sorted(tree.items()) if key in STARTING]
    return own + [one for _, value in sorted(tree.items()) for one in starting(value)]


def plain_input(name: str, value: Any) -> dict[str, object]:
    """An input as JSON: a reference by its digest, anything else by its value."""
    if isinstance(value, Ref):
        return {"ref": value.to_json()}
    files: dict[str, bytes] = {}
    tree = to_tree(value, "", files)
    if files:
        raise StoreError(f"input {name} holds meshes or large arrays; save it and pass its reference")
    return {"value": tree}


def progress_to(log: Any, context: RunContext, stage_name: str) -> OnProgress:
    """Pass a stage's progress on to the run's log and to whoever listens."""

    def on_progress(part: float, text: str) -> None:
        log.info("%s: %s%s", stage_name, f"{part:.0%} " if part else "", text)
        context.on_event(StageEvent(stage_name, Event.PROGRESS, part, text))

    return on_progress
