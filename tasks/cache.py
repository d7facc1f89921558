"""Turns the pure function of a stage into a cached Prefect task.

`segment_task = stage(segment)` gives a callable that takes references (`Ref[Scan]`) where the function takes values,
takes plain values unchanged, and returns a reference to the function's result. An `Infeasible` among the inputs is
passed on without running anything. A function with a parameter `client` gets the client that its configuration names.
The `RunContext` around the calls decides how they run:

- WATCHED: as a stock Prefect task, `Stage.task`, whose cache policy finds the record of the same recipe;
- DIRECT: the same lookup and the same record, without Prefect, for a single placement without a server;
- LOOKUP: nothing is computed; without a known result, a pending reference is returned and passed on.

mypy derives the signature of a stage from its function's (mypy_plugin.py): a swapped reference is a type error.
"""

import inspect
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from dataclasses import replace
from functools import cached_property, partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, ParamSpec, TypeVar, get_args, get_type_hints

from pydantic import BaseModel

from dcap.language.connect import connect
from dcap.language.protocol.client import ClientName
from dcap.language.protocol.session import Session
from dcap.scene.errors import StoreError
from dcap.scene.types.outcome import Infeasible
from tasks.artifact import Record, Ref, Store
from tasks.code import Code, check_data_files, code_at_begin, code_of, note_files
from tasks.codec import from_tree, to_tree
from tasks.machine_errors import pass_over_server_errors
from tasks.process import StageProcessError, preload, run_in_process
from tasks.records import (
    DECODER,
    ENCODER,
    FileLocks,
    find_record,
    key_of,
    records_root,
    share_record,
    write_record,
)
from tasks.run_context import Event, Mode, RunContext, StageEvent, current_context, use_context

if TYPE_CHECKING:
    from prefect import Task
    from prefect.client.schemas.objects import State, TaskRun

P = ParamSpec("P")
ValueT = TypeVar("ValueT")
ValueT_co = TypeVar("ValueT_co", covariant=True)
NOT_DECIDING = frozenset({"threads"})
"""Settings of any stage that change its duration, never its result."""
CLIENT = "client"
"""Parameter that receives the language client of a stage that asks questions."""
SIMULATIONS, MODEL_CALLS = "dcap-simulations", "dcap-model-calls"
"""Names of Prefect's global concurrency limits for stages that simulate, and for stages that ask a model."""
INFEASIBLE = "Infeasible"
"""Name of the completed state of an infeasible stage or sample: its reason is a result like any other."""
RETRIES = 1
"""Number of retries of a stage whose process has died: memory may have been short."""
STAGE_FILES: dict[Path, None] = {}
"""Modules of all stages created."""
_hashed: list[bool] = []
"""Whether the modules known at the first call of a stage are hashed."""


class Stage(Generic[P, ValueT_co]):
    """A stage for the flows: references in, a reference out."""

    def __init__(
        self,
        function: Callable[..., ValueT_co | Infeasible],
        *,
        process: bool | Callable[..., bool],
        name: str,
        simulates: bool,
    ) -> None:
        self.function = function
        self.process = process
        self.name = name
        self.simulates = simulates
        self._tasks: dict[Path, Task[..., Ref[Any]]] = {}
        self.signature = inspect.signature(function)
        self.file = Path(inspect.getfile(function)).resolve()
        STAGE_FILES[self.file] = None

    @cached_property
    def hints(self) -> dict[str, Any]:
        """Declared types of the function's parameters."""
        return get_type_hints(self.function)

    @cached_property
    def code(self) -> Code:
        """The sources that decide the function's result; hashed for all known stages at once, before a file is
        edited."""
        if not _hashed:
            code_at_begin(tuple(STAGE_FILES))
            _hashed.append(True)
        return code_of(self.file)

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> Ref[ValueT_co]:
        """Return a reference to the function's result for these inputs, computed only if it is not cached."""
        inputs = self._bound(*args, **kwargs)
        context, computed = current_context(), threading.Event()
        for value in inputs.values():
            if isinstance(value, Ref) and value.infeasible:
                return value
        if context.mode is Mode.LOOKUP:
            return self._look_up(inputs, context)

        def on_event(event: StageEvent) -> None:
            if event.event is Event.STARTED:
                computed.set()
            context.on_event(event)

        with use_context(replace(context, on_event=on_event)):
            ref = self._run_watched(inputs) if context.mode is Mode.WATCHED else self._run_directly(inputs)
        if Store.default().shared is not None:
            share_record(find_record(key_of(self.recipe(inputs)))[0], ref, new=computed.is_set())
        context.on_event(StageEvent(self.name, Event.FINISHED if computed.is_set() else Event.CACHED, 1.0, ref=ref))
        return ref

    def recipe(self, inputs: Mapping[str, Any]) -> dict[str, Any]:
        """Return the recipe: everything that decides the result for these inputs."""
        config = inputs.get("config")
        given = {name: plain_input(name, value) for name, value in inputs.items() if name != "config"}
        return {
            "stage": self.name,
            "function": self.function.__name__,
            "code": self.code.digest,
            "libraries": dict(self.code.libraries),
            "config": None if config is None else deciding(config.model_dump(mode="json")),
            "inputs": given,
        }

    @property
    def task(self) -> "Task[..., Ref[Any]]":
        """The Prefect task behind this stage, one for each folder of records."""
        if records_root() not in self._tasks:
            self._tasks[records_root()] = self._new_task()
        return self._tasks[records_root()]

    def _new_task(self) -> "Task[..., Ref[Any]]":
        from prefect import Task  # planning, and a placement without a server, need not wait for it
        from prefect.cache_policies import CachePolicy
        from prefect.context import TaskRunContext
        from prefect.serializers import JSONSerializer
        from prefect.states import Completed

        recipe = self.recipe

        class SoundRecord(CachePolicy):
            """Cache policy that accepts a result only if its record is whole and its artifact sound."""

            def compute_key(
                self, task_ctx: TaskRunContext, inputs: dict[str, Any], flow_parameters: dict[str, Any], **_: Any
            ) -> str | None:
                # set late: for initial tags Prefect queries the server, which may be unavailable
                task_ctx.task_run.tags = list(current_context().tags)
                return find_record(key_of(recipe(inputs)), wait=FileLocks().wait_for_lock)[0]

        def body(**inputs: Any) -> Any:  # a reference, or a state that holds one
            ref = self._compute(inputs)
            if not ref.infeasible:
                return ref
            found = Store.default().load(ref)
            assert isinstance(found, Infeasible)
            return Completed(name=INFEASIBLE, message=reason_line(found), data=ref)

        body.__name__ = body.__qualname__ = self.name
        body.__doc__ = self.function.__doc__
        named = inspect.Parameter.KEYWORD_ONLY
        shown = [one.replace(kind=named) for one in self.signature.parameters.values() if one.name != CLIENT]
        body.__signature__ = inspect.Signature(shown)  # type: ignore[attr-defined]
        return Task(
            body,
            name=self.name,
            task_run_name=lambda: f"{self.name} {current_context().session.sample}".rstrip(),
            # two samples that need the same room read it once, the second waits for the first
            cache_policy=SoundRecord().configure(isolation_level="SERIALIZABLE", lock_manager=FileLocks()),
            persist_result=True,
            result_storage=records_root(),
            result_serializer=JSONSerializer(object_encoder=ENCODER, object_decoder=DECODER),
            cache_result_in_memory=False,
            retries=RETRIES,
            retry_condition_fn=_process_died,
        )

    def _bound(self, *args: Any, **kwargs: Any) -> dict[str, Any]:
        """Return the inputs by name; missing inputs and a missing configuration get their defaults."""
        bound = self.signature.bind_partial(*args, **kwargs)
        bound.apply_defaults()
        inputs = {name: value for name, value in bound.arguments.items() if name != CLIENT}
        if "config" in self.signature.parameters and inputs.get("config") is None:
            inputs["config"] = self.hints["config"]()
        return inputs

    def _look_up(self, inputs: Mapping[str, Any], context: RunContext) -> Ref[Any]:
        waits = [value.kind for value in inputs.values() if isinstance(value, Ref) and value.pending]
        recipe = {} if waits else self.recipe(inputs)
        ref = None if waits else find_record(key_of(recipe), bring=context.bring)[1]
        if ref is None:
            text = ", ".join(dict.fromkeys(waits))
            context.on_event(StageEvent(self.name, Event.MISSING, text=text, recipe=recipe))
            return Ref(self.name, "")
        context.on_event(StageEvent(self.name, Event.CACHED, 1.0, ref=ref))
        return ref

    def _run_watched(self, inputs: Mapping[str, Any]) -> Ref[Any]:
        """Call the Prefect task; it returns a reference, or a state that holds a reference."""
        # raises errors that Prefect would swallow and then compute without a record
        find_record(key_of(self.recipe(inputs)))
        task = self.task.with_options(refresh_cache=True) if self.name in current_context().refresh else self.task
        result: Any = task(**inputs)
        return result if isinstance(result, Ref) else result.data.result

    def _run_directly(self, inputs: Mapping[str, Any]) -> Ref[Any]:
        """Run like Prefect's transaction, without Prefect."""
        key = key_of(self.recipe(inputs))
        with FileLocks().held(find_record(key, wait=FileLocks().wait_for_lock)[0]):
            name, ref = find_record(key)
            if ref is None or self.name in current_context().refresh:
                for attempt in range(RETRIES + 1):
                    try:
                        ref = self._compute(inputs)
                        break
                    except StageProcessError:
                        if attempt == RETRIES:
                            raise
                assert ref is not None
                write_record(name, ref)
            return ref

    def _compute(self, inputs: Mapping[str, Any]) -> Ref[Any]:
        """Run the function and save its result."""
        check_data_files(self.code)  # before the work, too: a result from a changed file would be lost
        preload()  # starts the fork server for later stages
        context = current_context()
        context.on_event(StageEvent(self.name, Event.STARTED))
        given = {name: plain_input(name, value) for name, value in inputs.items() if name != "config"}
        config = inputs.get("config")
        begin = time.perf_counter()
        with ExitStack() as held:
            held.enter_context(self._limit(config))
            held.enter_context(context.slots or nullcontext())
            if self._needs_process(given):
                where = (self.function.__module__, self.function.__name__)
                settings = None if config is None else config.model_dump(mode="json")
                done = run_in_process(
                    run_job,
                    *where,
                    self.code.digest,
                    given,
                    settings,
                    context.session,
                    on_progress=self._progress_listener(),
                )
            else:
                done = self.run(given, config, context.session, partial(_slot_lent, context.slots))
        kind, sha256, seconds, size = done
        self._log(
            f"{kind} {sha256[:12]}, {seconds:.2f} s ({time.perf_counter() - begin:.2f} s with loading and saving)"
        )
        check_data_files(self.code)
        note_files(self.code)
        recipe = self.recipe(inputs)
        return Ref(kind, sha256, Record(key_of(recipe), seconds, size, recipe))

    def run(
        self,
        given: Mapping[str, Any],
        config: BaseModel | None,
        session: Session,
        idle: Callable[[], AbstractContextManager[object]] = nullcontext,
    ) -> tuple[str, str, float, int]:
        """Load the inputs, run the function and save its result. Returns its kind, digest, time [s] and size
        [bytes]."""
        values = {name: self._loaded(name, tree) for name, tree in given.items()}
        if config is not None:
            values["config"] = config
        if CLIENT in self.signature.parameters:
            values[CLIENT] = connect(values["config"].language, session, idle)
        begin = time.perf_counter()
        value = self.function(**values)
        seconds = time.perf_counter() - begin
        ref = Store.default().save(value)
        return ref.kind, ref.sha256, seconds, Store.default().size(ref)

    def _loaded(self, name: str, tree: Mapping[str, Any]) -> Any:
        """Return an input in the function's form; raises StoreError if the artifact is of another kind than
        declared."""
        declared = self.hints.get(name, object)
        if "ref" not in tree:
            return from_tree(tree["value"], declared, {})
        value = Store.default().load(Ref.from_json(tree["ref"]))
        if not isinstance(value, kinds_of(declared)):
            raise StoreError(f"stage {self.name}: {name} is a {type(value).__name__}, expected {declared}")
        return value

    def _needs_process(self, given: Mapping[str, Any]) -> bool:
        if isinstance(self.process, bool):
            return self.process
        return self.process(**{name: self._loaded(name, tree) for name, tree in given.items()})

    @contextmanager
    def _limit(self, config: Any) -> Iterator[None]:
        """Hold a slot of the stage's limit, if the limit is set and its server is available.

        A cached stage waits for nothing.
        """
        asks = CLIENT in self.signature.parameters
        models = asks and config.language.client in (ClientName.ANTHROPIC, ClientName.OPENAI)
        name = SIMULATIONS if self.simulates else MODEL_CALLS if models else ""
        if name not in current_context().limits:
            yield
            return
        from prefect.concurrency.sync import concurrency

        held, counts = ExitStack(), False
        with pass_over_server_errors():
            held.enter_context(concurrency(name))
            counts = True
        if not counts:
            self._log(f"the server does not count {name}: the stage runs without that limit")
        try:
            yield
        finally:
            with pass_over_server_errors():
                held.close()

    def _progress_listener(self) -> Callable[[float, str], None]:
        context = current_context()

        def on_progress(part: float, text: str) -> None:
            self._log(f"{part:.0%} {text}" if part else text)
            context.on_event(StageEvent(self.name, Event.PROGRESS, part, text))

        return on_progress

    def _log(self, text: str) -> None:
        if current_context().mode is Mode.WATCHED:
            from prefect.logging import get_run_logger

            get_run_logger().info("%s: %s", self.name, text)


def stage(
    function: Callable[..., ValueT | Infeasible],
    *,
    process: bool | Callable[..., bool] = False,
    name: str | None = None,
    simulates: bool = False,
) -> Stage[..., ValueT]:
    """Return the stage of a pure function.

    With `process`, each run gets a process of its own, or only the runs for whose inputs `process` returns true; a
    stage that `simulates` counts towards the limit of simulations.
    """
    return Stage(function, process=process, name=name or function.__name__, simulates=simulates)


def run_job(
    module: str, function: str, code: str, given: dict[str, Any], settings: object, session: Session
) -> tuple[str, str, float, int]:
    """Run a stage in its own process; raises StoreError if its code does not match the digest `code`."""
    own = stage(getattr(import_module(module), function))
    if own.code.digest != code:
        raise StoreError(f"code of the stage {own.name} has changed while this program started; start it again")
    config = None if settings is None else own.hints["config"].model_validate(settings)
    return own.run(given, config, session)


def deciding(tree: Any) -> Any:
    """Return settings as JSON without those that never change a result, at any depth."""
    if isinstance(tree, dict):
        return {key: deciding(value) for key, value in tree.items() if key not in NOT_DECIDING}
    return [deciding(value) for value in tree] if isinstance(tree, list) else tree


def plain_input(name: str, value: Any) -> dict[str, Any]:
    """Return an input as JSON: a reference by its digest, anything else by its value."""
    if isinstance(value, Ref):
        return {"ref": value.to_json()}
    files: dict[str, bytes] = {}
    tree = to_tree(value, "", files)
    if files:
        raise StoreError(f"input {name} holds meshes or large arrays; save it and pass its reference")
    return {"value": tree}


def kinds_of(declared: Any) -> tuple[type, ...]:
    """Return the classes that a declared type allows, through unions and aliases of a class."""
    options = get_args(declared) or (declared,)
    plain = (getattr(one, "__supertype__", one) for one in options)
    return tuple(one for one in plain if isinstance(one, type))


def reason_line(found: Infeasible) -> str:
    """Return the reason why there is no value, in one line."""
    return " ".join(f"{found.reason}: {found.message}".split()).rstrip(": ")


def _process_died(task: "Task[..., Any]", task_run: "TaskRun", state: "State[Any]") -> bool:
    """Return whether a stage has failed because its process ended without a result."""
    return isinstance(state.data, StageProcessError)


@contextmanager
def _slot_lent(slots: threading.Semaphore | None) -> Iterator[None]:
    """Release the slot of this thread inside the block."""
    if slots is None:
        yield
        return
    slots.release()
    try:
        yield
    finally:
        slots.acquire()
