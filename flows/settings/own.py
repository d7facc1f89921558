"""The sections of `dcap.yaml` that are no stage's, and how options of the command line take their values from it.

A flag wins over the environment, that over the file, that over the default. Nothing heavy is imported here: options are
checked before the stages are loaded; settings of stages are checked with these (stages.py).
"""

import json
import math
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Annotated, Literal, TypeVar

from pydantic import BaseModel, Field, NonNegativeInt, PositiveFloat, PositiveInt, ValidationError

from flows.options import ArchName, Options, checked, said_of
from flows.settings.given import (
    EXPORTED,
    VARIABLES,
    Given,
    GivenSetting,
    check_underscores,
    given_settings,
    refused,
    unknown,
)

Section = TypeVar("Section", bound=BaseModel)
Port = Annotated[int, Field(ge=1, le=65535)]


class RunSettings(BaseModel, frozen=True, extra="forbid"):
    """What is run, by whom and with how much of the machine."""

    workers: Annotated[int, Field(ge=1, le=64)] = 2
    """Samples that a benchmark places in parallel."""
    methods: str = "dcap"
    """Methods of a benchmark, between commas."""
    threads: NonNegativeInt = 0
    """Threads of each heavy stage, 0: all cores, of a benchmark its workers' share of them; never changes a result."""
    arch: ArchName = "cpu"
    """Where the solver runs: cpu, cuda (a graphics card) or auto (cuda if it starts)."""
    language: Literal["", "offline", "anthropic", "openai", "replay"] = ""
    """Who reads the sentence; without a word: replay where a recording is named, else offline."""
    model: str = ""
    """Model to ask; without a word the usual one."""
    record: str = ""
    """Folder that gets a copy of each reply; relative to the file's folder."""
    replay: str = ""
    """Folder of recorded replies to answer from; relative to the file's folder."""
    max_cost: PositiveFloat | None = None
    """Most that is spent on a model in a run [USD]."""
    batch: bool = False
    """Whether a benchmark asks in batches: half the price, answers within minutes to a day."""
    runner: Literal["local", "dask", "ray", "pool"] = "local"
    """Who places the samples of a benchmark: threads of the program, a cluster, or workers of the pool."""
    cluster: str = ""
    """Address of a cluster of Dask or Ray that is there; without a word one of this machine for the time of the run."""
    simulations: PositiveInt | None = None
    """Most drops and drifts at a time on all machines of a server; without a word as many as there are samples at
    work."""
    model_calls: PositiveInt | None = None
    """Most stages at a time that ask a model, on all machines of a server; without a word as many as there are."""


class PathSettings(BaseModel, frozen=True, extra="forbid"):
    """Where things lie."""

    data: str = ""
    """Folder of cache, runs and generated rooms; relative to the file's folder; without a word `data/` of the clone,
    or the user's data folder."""
    store: str = ""
    """Where the artifacts lie, a folder or a URL, if not in the cache; relative to the file's folder."""


class ServerSettings(BaseModel, frozen=True, extra="forbid"):
    """Prefect's server."""

    port: Port = 4200
    """Port of its pages on this machine."""
    api_url: str = ""
    """Address of a server that runs already; without a word one is started where there is work."""


OWN: Mapping[str, type[BaseModel]] = {"run": RunSettings, "paths": PathSettings, "server": ServerSettings}
"""The sections by name."""
OPTIONS = {
    "solver": "drop.solver.method",
    "stability": "drop.solver.stability",
    "resolution": "particles.cell",
    "load_aware": "materials.load_aware",
    "paper_limits": "materials.paper_limits",
    "ambiguous": "intent.ambiguous",
    "port": "server.port",
    **{name: f"run.{name}" for name in RunSettings.model_fields if name not in ("simulations", "model_calls")},
}
"""The key that each option of the command line sets."""


def section(name: str, kind: type[Section], given: Given) -> Section:
    """A section with what was given in it."""
    check_underscores(f"{name}.{field}" for field in kind.model_fields)
    mine = {key.partition(".")[2]: one for key, one in given.items() if key.partition(".")[0] == name}
    for word, one in list(mine.items()):
        if not word:
            empty_section(one)
            del mine[word]
        elif word not in kind.model_fields:
            raise unknown(one, (f"{name}.{field}" for field in kind.model_fields))
    try:
        return kind.model_validate_json(as_json({word: plain(one) for word, one in mine.items()}), strict=True)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        raise refused(mine[str(first["loc"][0])], said_of(first)) from None


def empty_section(one: GivenSetting) -> None:
    """Refuse a value where keys are expected; a section without any is as good as none."""
    if one.value is not None:
        raise refused(one, "expected keys and values")


def plain(one: GivenSetting) -> object:
    """A value that JSON can hold: a scalar, or a list of such; anything nested deeper is refused unread."""
    items = one.value if isinstance(one.value, list) else [one.value]
    if any(isinstance(item, list | dict | set) for item in items):
        raise refused(one, "expected a value or a list of values")
    if any(isinstance(item, float) and not math.isfinite(item) for item in items):
        raise refused(one, "expected a finite number")
    return one.value


def as_json(tree: object) -> str:
    """Values as strict JSON; what JSON has no word for (a date) becomes text."""
    return json.dumps(tree, default=str)


def run_settings(flags: Mapping[str, object] | None = None) -> RunSettings:
    """The section `run`, with flags over it."""
    flags = flags or {}
    found = section("run", RunSettings, given_settings())
    return found.model_copy(update={name: flags[name] for name in RunSettings.model_fields if name in flags})


def server_settings() -> ServerSettings:
    """The section `server`."""
    return section("server", ServerSettings, given_settings())


def effective_options(
    kind: type[Options], flags: Mapping[str, object], defaults: Mapping[str, object] | None = None
) -> Options:
    """The options of a command: its flags, then what the environment and the file say, then the command's defaults."""
    given = given_settings()
    section("run", RunSettings, given)  # its mistakes are told before anything is computed
    set_elsewhere: dict[str, object] = {}
    for name, key in OPTIONS.items():
        if name in kind.model_fields and key in given:
            set_elsewhere[name] = option_value(kind, name, given[key])
    return checked(kind, {**(defaults or {}), **set_elsewhere, **flags})


def option_value(kind: type[BaseModel], name: str, one: GivenSetting) -> object:
    """A value for an option, alone as it ought to be."""
    try:
        kind.model_validate({name: plain(one)})
    except ValidationError as error:
        raise refused(one, said_of(error.errors(include_url=False)[0])) from None
    return one.value


@contextmanager
def exported_paths() -> Iterator[None]:
    """Puts what the file says of places into the environment, for this process and all that it starts."""
    given = given_settings()
    for name in ("paths", "server"):
        section(name, OWN[name], given)
    new = {name: str(given[key].value) for key, name in VARIABLES.items() if key in given and not os.environ.get(name)}
    os.environ.update(new)
    EXPORTED.update(new)
    try:
        yield
    finally:
        for name in new:
            EXPORTED.pop(name, None)
            os.environ.pop(name, None)
