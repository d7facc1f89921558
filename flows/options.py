"""The options of the commands, each declared once: type, range, default, meaning, and its key in `dcap.yaml`.

These models define the command line (flows/cli/checks.py), the keys of `dcap.yaml` with their environment variables
(flows/settings), the keywords of `dcap.place` and `dcap.drop`, and tables of docs/configuration.md. A model takes
missing values from the environment, then from `dcap.yaml`, then from its defaults. The errors of `effective_options`
(flows/settings.py) name the option or the place of a value.
"""

import os
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, BeforeValidator, Field, NonNegativeInt, PositiveInt, model_validator
from pydantic.fields import FieldInfo
from pydantic_settings import BaseSettings, InitSettingsSource, PydanticBaseSettingsSource, SettingsConfigDict

from dcap.language.protocol.client import DEFAULT_MODEL, Effort
from dcap.language.protocol.session import MAX_TOKENS, TIMEOUT
from dcap.scene.errors import InputError
from dcap.scene.text import LONGEST_PROMPT, LONGEST_WORDS, shortened, unfit
from dcap.scene.written_files import FULL
from flows.given_settings import given_settings
from tasks.machine_errors import machine_error

LARGEST_RESOLUTION_M = 1.0
"""Largest cell size that resolves any object placed in a room [m]."""
LONGEST_NAME = 255
"""Longest name of a file or folder on common file systems [bytes]."""
LONGEST_FOLDER = 3500
"""Longest path of a result folder [bytes]: Linux allows 4096, and the files need some."""
LARGEST_SEED = 2**63 - 1
"""Largest integer that tables can hold."""
SHOWN = 100
"""Most characters of a value in a message."""
CROSSED = "--stability needs --solver tl: mls does not verify rest states"


@dataclass(frozen=True, slots=True)
class Setting:
    """How a field of a model can be set, besides by its name."""

    key: str = ""
    """Dotted key in `dcap.yaml`, from which its environment variable follows; empty: it has none."""
    metavar: str | None = None
    """Placeholder of its value in the help."""
    is_flag: bool = True
    """Whether the command line has it."""


def setting_of(field: FieldInfo) -> Setting:
    """Return the `Setting` in a field's annotation."""
    return next((one for one in field.metadata if isinstance(one, Setting)), Setting())


def within(low: float, high: float, meaning: str) -> AfterValidator:
    """Take a number between two bounds, both excluded; a NaN is in no range."""

    def check(value: float) -> float:
        if not low < value < high:
            raise ValueError(f"is not {meaning}")
        return value

    return AfterValidator(check)


def short_text(value: str) -> str:
    """Return short text; ValueError if it is long or has control characters."""
    if why := unfit(value, LONGEST_WORDS):
        raise ValueError(why)
    return value


def joined_by_commas(value: object) -> object:
    """Return a sequence of numbers joined as on the command line."""
    if isinstance(value, str) or not isinstance(value, Iterable):
        return value
    return ",".join(str(one) for one in value)


HomePath = Annotated[Path, AfterValidator(Path.expanduser)]
"""A path that may begin with ~: not every shell expands it behind an equals sign."""
Phrase = Annotated[str, AfterValidator(short_text)]
"""A label, a name or other short text."""
TextOrPath = Annotated[
    Phrase, BeforeValidator(lambda value: os.fspath(value) if isinstance(value, os.PathLike) else value)
]
Numbers = Annotated[Phrase, BeforeValidator(joined_by_commas)]
"""Numbers separated by commas, or any sequence of numbers."""
Language = Literal["", "offline", "anthropic", "openai", "replay"]
Ambiguous = Annotated[Literal["ask", "best"], Setting("intent.ambiguous")]
Up = Literal["auto", "y", "z", "-y", "-z"]
Unit = Literal["auto", "m", "cm", "mm", "in"]  # the keys of METRES: a Literal cannot be computed
CellSize = Annotated[float, within(0.0, LARGEST_RESOLUTION_M, f"a cell size between 0 and {LARGEST_RESOLUTION_M} m")]
Mass = Annotated[float, within(0.0, float("inf"), "a positive number of kilograms")]
Seed = Annotated[int, Field(ge=0, lt=LARGEST_SEED + 1)]
Cost = Annotated[float, within(0.0, float("inf"), "a positive number of dollars")]
MaxCost = Annotated[Cost | None, Setting("run.max_cost")]
MaxTokens = Annotated[int, Field(ge=1024, le=128_000)]
ReplyTimeout = Annotated[float, within(0.0, 86_400.0, "a number of seconds, at most a day")]


class Options(BaseSettings):
    """Options of a command: frozen, no unknown ones; the docstring of a field is its help."""

    model_config = SettingsConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)

    @classmethod
    def settings_customise_sources(
        cls,
        settings_cls: type[BaseSettings],
        init_settings: PydanticBaseSettingsSource,
        env_settings: PydanticBaseSettingsSource,
        dotenv_settings: PydanticBaseSettingsSource,
        file_secret_settings: PydanticBaseSettingsSource,
    ) -> tuple[PydanticBaseSettingsSource, ...]:
        """Return the sources of values; the first wins: flags and keywords, then environment and file."""
        given, keys = given_settings(), {name: setting_of(field).key for name, field in cls.model_fields.items()}
        values = {name: given[key].value for name, key in keys.items() if key in given}
        return init_settings, InitSettingsSource(settings_cls, values)


class PhysicsOptions(Options):
    """Options that decide how bodies settle."""

    solver: Annotated[Literal["tl", "mls"], Setting("drop.solver.method")] = "tl"
    """Method of the solver: tl (implicit, total-Lagrangian) or mls (explicit MLS-MPM, the paper's kind)."""
    resolution: Annotated[CellSize | None, Setting("particles.cell")] = None
    """Cell size at the contact [m]; default: from the physics."""
    threads: Annotated[NonNegativeInt, Setting("run.threads")] = 0
    """Threads of each heavy stage; 0: all cores, in a benchmark shared among workers. Results do not depend on it."""
    arch: Annotated[Literal["auto", "cpu", "cuda"], Setting("run.arch")] = "cpu"
    """Device of the solver: cpu, cuda (a graphics card) or auto (cuda if it works)."""
    stability: Annotated[bool, Setting("drop.solver.stability")] = False
    """Push the bodies at rest and grade how much they withstand."""
    load_aware: Annotated[bool, Setting("materials.load_aware")] = False
    """Treat parts that give less than 0.05 mm under the load as rigid too, not only those above 1 GPa."""

    @model_validator(mode="after")
    def _stability_is_of_tl(self) -> "PhysicsOptions":
        if self.stability and self.solver == "mls":
            raise ValueError(CROSSED)
        return self


class DropOptions(PhysicsOptions):
    """Options of `drop`."""

    out: Path | None = None
    """Folder for the results; default in Python: a new folder below data/runs/python."""


class StageOptions(PhysicsOptions):
    """Options that configure the stages of a placement."""

    language: Annotated[Language, Setting("run.language")] = ""
    """Reader of the sentence: offline (default), anthropic, openai, or replay (default with --replay)."""
    model: Annotated[Phrase, Setting("run.model"), Field(description=f"Model to ask; default: {DEFAULT_MODEL}.")] = ""
    effort: Annotated[Effort, Setting("run.effort")] = ""
    """Amount of thinking: low, medium, high ... (depends on the model); default: the model's."""
    max_tokens: Annotated[MaxTokens, Setting("run.max_tokens")] = MAX_TOKENS
    """Most tokens of an answer, thoughts included; a cut-off answer is requested again with twice as many."""
    reply_timeout: Annotated[ReplyTimeout, Setting("run.reply_timeout")] = TIMEOUT
    """Longest wait for one answer of the model [s]."""
    record: Annotated[TextOrPath, Setting("run.record", "DIR")] = ""
    """Copy each reply into this folder, for --replay."""
    replay: Annotated[TextOrPath, Setting("run.replay", "DIR")] = ""
    """Answer from replies recorded in this folder."""
    paper_limits: Annotated[bool, Setting("materials.paper_limits")] = False
    """Clamp materials to the paper's limits (E >= 5e4 Pa ...)."""
    ambiguous: Ambiguous = "ask"
    """If the sentence may mean several things: ask (and end) or take the best."""


class PlaceOptions(StageOptions):
    """Options of `place`."""

    out: Path | None = None
    """Folder for the results; default: data/runs/place, or in Python a new folder below data/runs/python."""
    method: Phrase = "dcap"
    """How it is placed: dcap, a baseline or an ablation by name, or paper (docs/methods.md)."""
    max_cost: MaxCost = None
    """Spend at most this on a model [USD]."""
    label: Phrase = ""
    """Kind of the scene mesh, or of each of its unnamed nodes: table."""
    up: Up = "auto"
    """Up axis of the scene file: z, y, -y, -z or auto."""
    unit: Unit = "auto"
    """Length unit of the scene file: m, cm, mm, in or auto."""
    height_of: Annotated[Phrase, Setting(metavar="THING=METRES")] = ""
    """Height of a thing's surface, for a file of unknown scale: table=0.75."""
    labels: Annotated[TextOrPath, Setting(metavar="FILE")] = ""
    """Names of the scene's things: labels.json, vertex ids, RoomPlan's JSON."""
    at: Annotated[Numbers, Setting(metavar="X,Y[,Z]")] = ""
    """Point of the scene file's own frame that the object goes to."""
    support: Annotated[Numbers, Setting(metavar="X0,Y0,Z0,X1,Y1,Z1")] = ""
    """Box in the scene file's own frame whose faces carry the object."""
    object_label: Phrase = ""
    """Kind of the object: mug."""
    object_up: Up = "auto"
    """Up axis of the object file: z, y, -y, -z or auto."""
    object_unit: Unit = "auto"
    """Length unit of the object file: m, cm, mm, in or auto."""
    mass: Mass | None = None
    """Mass of the object [kg]; default: a prior for its kind."""
    seed: Seed = 0
    """Seed of all random numbers."""
    maps: bool = False
    """Write conditioning maps, too: depth, normals, masks ..."""
    animate: bool = False
    """Write a film of the drop, too: drop.mp4."""
    surface: Literal["embedded", "iso"] = "embedded"
    """Surfaces of soft bodies: embedded, or iso to add iso.glb, the surface around the material points."""

    @model_validator(mode="after")
    def _paper_has_its_own_solver(self) -> "PlaceOptions":
        if self.method == "paper" and "solver" in self.model_fields_set and self.solver != "mls":
            raise ValueError("--method paper has its own solver, mls; leave out --solver (drop.solver.method)")
        if self.method == "paper" and self.stability:
            raise ValueError("--method paper cannot be combined with --stability: mls does not verify rest states")
        return self


class DatasetOptions(StageOptions):
    """Options shared by `benchmark` and `plan`: the samples and the methods."""

    dataset: Annotated[HomePath | None, Setting("run.dataset", "PATH")] = None
    """YAML list of samples, or a folder of scenes (needs --objects); default: the embedded rooms."""
    methods: Annotated[str, Setting("run.methods")] = "dcap"
    """Comma-separated methods: dcap, fireplace, layoutgpt, holodeck, ablations by name, or all."""
    scenes: Annotated[str, Setting(metavar="LIST")] = ""
    """Only these scenes: comma-separated names, a .txt file of names, or a split."""
    limit: Annotated[int | None, Field(ge=1)] = None
    """Only the first N samples."""
    ambiguous: Ambiguous = "best"
    """If a sentence may mean several things: ask (and end) or take the best."""


class PlanOptions(DatasetOptions):
    """Options of `plan`."""

    stages: bool = False
    """A line for each stage of each sample, too."""


class BenchmarkOptions(DatasetOptions):
    """Options of `benchmark`."""

    objects: Annotated[HomePath | None, Setting("run.objects", "FOLDER")] = None
    """Meshes to place in a folder of scenes, named by their kind or by an assets.csv next to them."""
    per_scene: Annotated[int, Field(ge=1, le=200), Setting("run.per_scene")] = 3
    """Samples of each scene of a folder."""
    sugar: Annotated[HomePath | None, Setting("run.sugar", "FOLDER")] = None
    """SuGaR's repository, which meshes scenes of splats; default: our own reconstruction."""
    judge: Annotated[Language, Setting("run.judge")] = ""
    """Model that judges the methods by pictures: anthropic, openai or replay; default: the offline rubric."""
    judge_model: Annotated[Phrase, Setting("run.judge_model")] = ""
    """Model that judges, by name."""
    judge_record: Annotated[TextOrPath, Setting(metavar="DIR")] = ""
    """Keep a copy of each of the judge's replies in this folder, for --judge-replay."""
    judge_replay: Annotated[TextOrPath, Setting(metavar="DIR")] = ""
    """Judge by replies recorded in this folder."""
    workers: Annotated[int, Field(ge=1, le=64), Setting("run.workers")] = 2
    """Samples to place in parallel."""
    only_failed: bool = False
    """Only samples that failed in the last run."""
    max_cost: MaxCost = None
    """Spend at most this on the model [USD], and as much again on the judge."""
    batch: Annotated[bool, Setting("run.batch")] = False
    """Ask in batches: half the price, answers within minutes to a day."""
    runner: Annotated[Literal["local", "dask", "ray", "pool"], Setting("run.runner")] = "local"
    """Workers: local (threads of this program), dask, ray, or pool (dcap worker)."""
    cluster: Annotated[str, Setting("run.cluster", "ADDRESS")] = ""
    """Address of a running Dask or Ray cluster; default: a temporary one on this machine."""
    simulations: Annotated[PositiveInt | None, Setting("run.simulations", is_flag=False)] = None
    """Most drops and drifts at a time on all machines of a server; default: no limit."""
    model_calls: Annotated[PositiveInt | None, Setting("run.model_calls", is_flag=False)] = None
    """Most stages that ask a model at a time, on all machines of a server; default: no limit."""


class PaperOptions(BenchmarkOptions):
    """Options of `paper`."""

    methods: Annotated[str, Setting("run.methods")] = "all"
    """Comma-separated methods: dcap, fireplace, layoutgpt, holodeck, ablations by name, or all."""
    limit: Annotated[int | None, Field(ge=1)] = None
    """Only the N most different samples; default: all, or 6 of the embedded rooms."""
    only_failed: Annotated[bool, Setting(is_flag=False)] = False
    """Not an option of `paper`: the same command places failed samples again."""


class RerunOptions(Options):
    """Options of `rerun`; none has a key, because the run holds the request."""

    stage: Phrase
    """Stage to compute again."""
    max_cost: Cost | None = None
    """Spend at most this on a model [USD]; default: the run's limit."""


class JudgeOptions(Options):
    """Options of `judge`; none has a key, because the judge need not read the sentences."""

    language: Language = ""
    """Judge: offline (default: the metric rubric), anthropic, openai or replay."""
    model: Phrase = ""
    """Model to ask; it must take pictures."""
    effort: Effort = ""
    """Amount of thinking: low, medium, high ... (depends on the model); default: the model's."""
    max_tokens: MaxTokens = MAX_TOKENS
    """Most tokens of an answer, thoughts included; a cut-off answer is requested again with twice as many."""
    reply_timeout: ReplyTimeout = TIMEOUT
    """Longest wait for one answer of the model [s]."""
    record: Annotated[TextOrPath, Setting(metavar="DIR")] = ""
    """Copy each reply into this folder, for --replay."""
    replay: Annotated[TextOrPath, Setting(metavar="DIR")] = ""
    """Judge by replies recorded in this folder."""
    max_cost: Cost | None = None
    """Spend at most this on judging the run [USD]."""
    batch: bool = False
    """Ask in batches: half the price, answers within a day."""


class UiOptions(Options):
    """Options of `ui`."""

    port: Annotated[int, Field(ge=1, le=65535), Setting("server.port")] = 4200
    """Port of Prefect's pages on this machine."""


class WorkerOptions(Options):
    """Options of `worker`."""

    limit: Annotated[int, Field(ge=1, le=64)] = 1
    """Flow runs at a time."""


class AllSettings(BenchmarkOptions, UiOptions):
    """Every field that has a key: the options of the commands, and settings without an option."""

    data: Annotated[str, Setting("paths.data", is_flag=False)] = ""
    """Folder of cache, runs and generated rooms; default: `data/` of the clone, or the user's data folder."""
    store: Annotated[str, Setting("paths.store", is_flag=False)] = ""
    """Shared store of the artifacts, a folder or a URL; default: the cache only."""
    api_url: Annotated[str, Setting("server.api_url", is_flag=False)] = ""
    """Address of a running Prefect server; default: one is started if needed."""


KEYS = {key: name for name, field in AllSettings.model_fields.items() if (key := setting_of(field).key)}
"""The name of the field of `AllSettings` that each key sets."""


def check_out(folder: Path) -> None:
    """Refuse an impossible result folder before anything is computed."""
    shown = repr(shortened(str(folder), SHOWN))
    if "\0" in str(folder) or any(len(os.fsencode(part)) > LONGEST_NAME for part in folder.parts):
        raise InputError(f"--out {shown}: a name in it has a zero byte or more than {LONGEST_NAME} bytes")
    if len(os.fsencode(folder.absolute())) > LONGEST_FOLDER:
        raise InputError(f"--out {shown}: its path has more than {LONGEST_FOLDER} bytes; give a shorter one")
    nearest = next(one for one in (folder, *folder.absolute().parents) if os.path.exists(one))  # False if unreadable
    if not nearest.is_dir():
        raise InputError(f"--out {folder}: {nearest} is a file; give a folder")
    try:
        tempfile.TemporaryDirectory(dir=nearest).cleanup()
    except OSError as error:
        if error.errno in FULL:
            raise machine_error(error) or error from None
        raise InputError(f"--out {folder}: {nearest} is not writable: {error.strerror}") from None


def check_prompt(prompt: str) -> None:
    """Refuse a sentence that is empty, not text, or longer than any sentence."""
    if not prompt.strip():
        raise InputError('PROMPT is empty; say what to do, for example "put the ball at the centre of the bed"')
    if why := unfit(prompt, LONGEST_PROMPT, lines=True):
        raise InputError(f"PROMPT {why}")


def check_case(case: Path) -> None:
    """Refuse a case file that is not there."""
    if not case.is_file():
        raise InputError(f"{case}: no such file")
