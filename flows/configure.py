"""Options of a command as the stages' configurations, and as the model, recordings and spending limit.

In: the options. Out: the part that decides results (`LanguageConfig`) and the part that does not (`Session`).
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TypeVar
from urllib.parse import unquote

from pydantic import BaseModel

from dcap.language.model.apis import APIS
from dcap.language.model.ledger import check_budget
from dcap.language.model.reply_folder import MARK, ReplyFolder
from dcap.language.protocol.client import DEFAULT_MODEL, ClientName, LanguageConfig
from dcap.language.protocol.session import MAX_TOKENS, TIMEOUT, Session
from dcap.scene.errors import InputError
from dcap.scene.text import not_one_of
from flows.options import Options, StageOptions
from flows.place import PlaceConfig
from flows.settings import stage_settings

Config = TypeVar("Config", bound=BaseModel)
LEDGER = "usage.jsonl"
"""Name of the ledger in a run's folder."""
QUEUE = "batch-queue"
"""Name of the batch queue's folder in a run's folder."""


def configured(options: StageOptions, *, language: LanguageConfig | None = None, arch: str = "cpu") -> PlaceConfig:
    """Return the stages' settings (flows/settings) with a person's choices in them.

    `arch` is cpu or cuda, to which `options.arch` resolves on this machine: keys of the cache must not depend on the
    hardware in another way. `language` follows from several options (flows/configure.py).
    """
    default = stage_settings()
    asking = {"language": language or LanguageConfig()}
    threads = {"threads": options.threads}
    physics = changed(
        default.drop.solver,
        {
            "arch": arch,
            "method": options.solver,
            "stability": options.stability,
        },
    )
    stages = {
        "scene_mesh": changed(default.scene_mesh, threads),
        "object_mesh": changed(default.object_mesh, threads),
        "segment": changed(default.segment, asking),
        "intent": changed(default.intent, {**asking, "ambiguous": options.ambiguous}),
        "rotation": changed(default.rotation, asking),
        "anchor": changed(default.anchor, asking),
        "materials": changed(
            default.materials, {**asking, "load_aware": options.load_aware, "paper_limits": options.paper_limits}
        ),
        "particles": changed(default.particles, {"cell": options.resolution}),
        "drop": changed(default.drop, {"solver": physics, **threads}),
        "drift": changed(default.drift, threads),
    }
    return changed(default, stages)


def with_threads(config: PlaceConfig, threads: int) -> PlaceConfig:
    """Return the settings with so many threads for every stage that has some: they change no result."""
    stages = {name: getattr(config, name) for name in PlaceConfig.model_fields}
    return changed(
        config, {name: changed(one, {"threads": threads}) for name, one in stages.items() if hasattr(one, "threads")}
    )


def changed(config: Config, settings: Mapping[str, object]) -> Config:
    """Return the configuration with some settings replaced and checked; a name that it does not have is an error."""
    return type(config).model_validate({**dict(config), **settings})


@dataclass(frozen=True, slots=True)
class LanguageOptions:
    """The options as typed."""

    language: str = ""
    """offline, anthropic, openai or replay; empty: replay where a recording is named, else offline."""
    model: str = ""
    effort: str = ""
    max_tokens: int = MAX_TOKENS
    reply_timeout: float = TIMEOUT
    record: str = ""
    replay: str = ""
    max_cost: float | None = None
    batch: bool = False

    def located(self) -> "LanguageOptions":
        """The options with whole paths: a run is repeated from any working directory."""
        return replace(self, record=whole(self.record), replay=whole(self.replay))

    @property
    def client(self) -> ClientName:
        """Name of the client; InputError for options that contradict each other."""
        name = self.language or (ClientName.REPLAY if self.replay else ClientName.OFFLINE)
        if name not in list(ClientName):
            raise InputError(f"--language {name!r} {not_one_of(name, ClientName)}")
        client = ClientName(name)
        if client is ClientName.REPLAY and not self.replay:
            raise InputError("--language replay needs --replay DIR, a folder that --record DIR has written")
        if client is not ClientName.REPLAY and self.replay:
            raise InputError(f"--replay {self.replay} is for --language replay, not {client}")
        if client is not ClientName.ANTHROPIC and self.batch:
            raise InputError(f"--batch is for --language anthropic, not {client}")
        if client not in APIS and self.record:
            raise InputError(f"--record is for --language {' or '.join(APIS)}: {client} asks no model")
        if client is ClientName.OFFLINE and self.model:
            raise InputError(
                f"--model {self.model} is for --language {', '.join(APIS)} or replay: offline asks no model"
            )
        if client is ClientName.OFFLINE and self.effort:
            raise InputError(
                f"--effort {self.effort} is for --language {', '.join(APIS)} or replay: offline asks no model"
            )
        if client is ClientName.OPENAI and not self.model:
            raise InputError(
                "--language openai needs --model NAME: a server of your own knows its models by its own names"
            )
        return client

    def config(self, *, plan: bool = False) -> LanguageConfig:
        """The part that decides the stages' results; for a `plan` nothing is written."""
        client = self.client
        if client is ClientName.OFFLINE:
            return LanguageConfig()
        if client is ClientName.REPLAY:
            folder = ReplyFolder(Path(self.replay))
            name, _, host = recorded_model(folder, self.model, self.effort).partition("@")
            model, _, effort = name.partition("+")
            return LanguageConfig(
                client=client, model=unquote(model), effort=effort, endpoint=host, recording=folder.content()
            )
        model, api = self.model or DEFAULT_MODEL, APIS[client]
        api.check()
        if model.startswith("."):  # the name becomes that of a folder
            raise InputError(f"--model {model!r} is not the name of a model")
        check_budget(model, self.max_cost)
        return LanguageConfig(
            client=client, model=model, effort=self.effort, endpoint=api.endpoint(),
            recording=recording_of(self.record, plan=plan),
        )  # fmt: skip

    def session(self, folder: Path) -> Session:
        """The part that does not decide results; ledger and batch queue lie in the run's folder."""
        if self.client is ClientName.OFFLINE:
            return Session()
        return Session(
            record=whole(self.record),
            replay=whole(self.replay),
            ledger=str(folder.resolve() / LEDGER),
            max_cost=self.max_cost,
            batch=str(folder.resolve() / QUEUE) if self.batch else "",
            max_tokens=self.max_tokens,
            timeout=self.reply_timeout,
        )


def language_options(options: Options) -> LanguageOptions:
    """Return the language options among the options of a command, which need not have all of them."""
    names = [one.name for one in fields(LanguageOptions)]
    return LanguageOptions(**{name: getattr(options, name) for name in names if hasattr(options, name)})


def recorded_model(folder: ReplyFolder, wanted: str, effort: str = "") -> str:
    """The model whose replies a recording holds. InputError if it holds none that fit, or those of several models."""
    models = folder.models()
    if not models:
        raise InputError(f"--replay {folder.root}: no recorded replies there; record some with --record DIR")
    fitting = [name for name in models if wanted in ("", name, unquote(name.partition("@")[0].partition("+")[0]))]
    if not fitting:
        raise InputError(f"--replay {folder.root} has replies of {', '.join(models)}, none of --model {wanted}")
    suffix = f"+{effort}" if effort else ""
    exact = [name for name in fitting if name.partition("@")[0].endswith(suffix) and (effort or "+" not in name)]
    fitting = exact if len(fitting) > 1 and (wanted or effort) and len(exact) == 1 else fitting
    if len(fitting) > 1:
        raise InputError(f"--replay {folder.root} has replies of {', '.join(fitting)}; choose one with --model")
    return fitting[0]


def recording_of(folder: str, *, plan: bool) -> str:
    """Name of the recording in a folder, empty for none; InputError if it cannot be written. A plan starts no
    recording."""
    if not folder:
        return ""
    if plan and not (Path(folder) / MARK).exists():
        return "to be begun"
    try:
        return ReplyFolder(Path(folder)).mark()
    except OSError as error:
        raise InputError(f"--record {folder}: {error.strerror}; give a folder") from None
    except (ValueError, KeyError, TypeError):
        raise InputError(f"--record {folder}: its {MARK} is damaged; remove that file or give another folder") from None


def whole(path: str) -> str:
    """An absolute path, empty for none."""
    return str(Path(path).resolve()) if path else ""
