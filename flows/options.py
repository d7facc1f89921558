"""The options of `place` and `drop`, checked once: for the command line, for Python, and for the stages' settings.

In: what a person gave, by name. Out: a frozen `DropOptions` or `PlaceOptions`. An unknown name is an error that names
the nearest known one; messages write options as the command line does, `object_up` as `--object-up`.
"""

import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Literal, TypedDict, TypeVar, get_args

from pydantic import AfterValidator, BaseModel, BeforeValidator, Field, ValidationError, model_validator
from pydantic_core import ErrorDetails

from dcap.scene.errors import InputError
from dcap.scene.given_text import LONGEST_PROMPT, LONGEST_WORDS, shortened, unfit
from dcap.scene.spelling import did_you_mean, not_one_of

LARGEST_RESOLUTION_M = 1.0
"""A cell larger than this resolves nothing that can be placed in a room [m]."""
SolverName = Literal["tl", "mls"]
ArchName = Literal["auto", "cpu", "cuda"]
AmbiguousName = Literal["ask", "best"]
SurfaceName = Literal["embedded", "iso"]
UpName = Literal["auto", "y", "z", "-y", "-z"]
UnitName = Literal["auto", "m", "cm", "mm", "in"]  # the keys of METRES: a Literal cannot be computed
UPS: tuple[str, ...] = get_args(UpName)
UNITS: tuple[str, ...] = get_args(UnitName)
LONGEST_NAME = 255
"""Bytes of the name of a file or folder on all common file systems."""
LONGEST_FOLDER = 3500
"""Bytes of a result folder's path: Linux takes 4096, and files are named below it."""
LARGEST_SEED = 2**63 - 1
"""What tables can hold."""
SHOWN = 100
"""Characters of a value that a message shows."""
CROSSED = "--stability needs --solver tl: mls does not verify rest states"


def one_of(words: object) -> BeforeValidator:
    """A word from a closed list, given as a Literal: refused in our words before pydantic refuses it in its own."""
    allowed = get_args(words)

    def check(value: object) -> object:
        if value not in allowed:
            raise ValueError(not_one_of(value, allowed))
        return value

    return BeforeValidator(check)


def within(low: float, high: float, meaning: str) -> AfterValidator:
    """A number between two bounds, both excluded; a NaN is in no range."""

    def check(value: float) -> float:
        if not low < value < high:
            raise ValueError(f"is not {meaning}")
        return value

    return AfterValidator(check)


def fitting(value: str) -> str:
    """Short text without control characters."""
    if why := unfit(value, LONGEST_WORDS):
        raise ValueError(why)
    return value


Phrase = Annotated[str, AfterValidator(fitting)]
"""A label, a name or other short text."""
Words = Annotated[Phrase, BeforeValidator(lambda value: os.fspath(value) if isinstance(value, os.PathLike) else value)]
"""Text, or a path."""


def between_commas(value: object) -> object:
    """Numbers as the command line has them."""
    if isinstance(value, str) or not isinstance(value, Iterable):
        return value
    return ",".join(str(one) for one in value)


Numbers = Annotated[Phrase, BeforeValidator(between_commas)]
"""Numbers between commas, or any sequence of them."""
Up = Annotated[UpName, one_of(UpName)]
Unit = Annotated[UnitName, one_of(UnitName)]
CellSize = Annotated[float, within(0.0, LARGEST_RESOLUTION_M, f"a cell size between 0 and {LARGEST_RESOLUTION_M} m")]
Mass = Annotated[float, within(0.0, float("inf"), "a positive number of kilograms")]
Whole = Annotated[int, Field(ge=0, le=LARGEST_SEED)]


class DropOptions(BaseModel, frozen=True, extra="forbid"):
    """What `drop` takes; `place` takes the same and more."""

    out: Path | None = None
    """Folder for the results; None: a folder of the caller's choice."""
    solver: Annotated[SolverName, one_of(SolverName)] = "tl"
    """Method: tl (implicit, total-Lagrangian) or mls (the paper's explicit MLS-MPM)."""
    resolution: CellSize | None = None
    """Cell size at the contact [m]; None: from the physics."""
    threads: Whole = 0
    """Threads of the solver, 0: all cores; never changes a result."""
    arch: Annotated[ArchName, one_of(ArchName)] = "cpu"
    """Where the solver runs; auto: cuda if it starts."""
    stability: bool = False
    """Push what rests around; grade what it can take."""
    load_aware: bool = False
    """What gives less than 0.05 mm under the load is rigid too, not only E > 1 GPa."""

    @model_validator(mode="after")
    def _pushed(self) -> "DropOptions":
        if self.stability and self.solver == "mls":
            raise ValueError(CROSSED)
        return self


class PlaceOptions(DropOptions, frozen=True, extra="forbid"):
    """What `place` takes. A subclass, because options are given flat, by their names, on the command line and in
    Python."""

    language: Phrase = ""
    """Who reads the sentence: offline (default), anthropic, openai or replay."""
    model: Phrase = ""
    """Model to ask."""
    record: Words = ""
    """Folder that gets a copy of every reply."""
    replay: Words = ""
    """Folder of recorded replies to answer from."""
    max_cost: float | None = None
    """Most to be spent on a model [USD]."""
    label: Phrase = ""
    """What the scene mesh, or its unnamed nodes, shows."""
    up: Up = "auto"
    """Up axis of the scene file."""
    unit: Unit = "auto"
    """Length unit of the scene file."""
    height_of: Phrase = ""
    """THING=METRES: the height of a thing of the scene, by which a file of unknown scale is scaled."""
    labels: Words = ""
    """File that names the scene's things."""
    at: Numbers = ""
    """X,Y,Z or X,Y: a point of the scene file's own frame that the object goes to."""
    support: Numbers = ""
    """x0,y0,z0,x1,y1,z1: a box of the scene file's own frame whose faces carry."""
    object_label: Phrase = ""
    """What the object is."""
    object_up: Up = "auto"
    """Up axis of the object file."""
    object_unit: Unit = "auto"
    """Length unit of the object file."""
    mass: Mass | None = None
    """Mass of the object [kg]; None: a prior for its kind."""
    seed: Whole = 0
    """Seed of everything random."""
    paper_limits: bool = False
    """Clamp the materials as the paper does."""
    ambiguous: Annotated[AmbiguousName, one_of(AmbiguousName)] = "ask"
    """Where the sentence may mean another thing as well: ask which, or take the best and say so."""
    maps: bool = False
    """Write conditioning maps, too."""
    animate: bool = False
    """Write a film of the drop, too."""
    surface: Annotated[SurfaceName, one_of(SurfaceName)] = "embedded"
    """iso: write the surfaces around the material points, too."""


class DropKeywords(TypedDict, total=False):
    """The fields of `DropOptions` as keyword arguments."""

    out: str | os.PathLike[str] | None
    solver: SolverName
    resolution: float | None
    threads: int
    arch: ArchName
    stability: bool
    load_aware: bool


class PlaceKeywords(DropKeywords, total=False):
    """The fields of `PlaceOptions` as keyword arguments."""

    language: str
    model: str
    record: str | os.PathLike[str]
    replay: str | os.PathLike[str]
    max_cost: float | None
    label: str
    up: UpName
    unit: UnitName
    height_of: str
    labels: str | os.PathLike[str]
    at: str | Sequence[float]
    support: str | Sequence[float]
    object_label: str
    object_up: UpName
    object_unit: UnitName
    mass: float | None
    seed: int
    paper_limits: bool
    ambiguous: AmbiguousName
    maps: bool
    animate: bool
    surface: SurfaceName


Options = TypeVar("Options", bound=DropOptions)


def checked(kind: type[Options], given: Mapping[str, object]) -> Options:
    """The options that were given by name; raises InputError with the option, its value and what is wrong with it."""
    for name in given:
        if name not in kind.model_fields:
            hint = did_you_mean(name, kind.model_fields) or f"; there are {', '.join(sorted(kind.model_fields))}"
            raise InputError(f"unknown option {name!r}{hint}")
    try:
        return kind.model_validate(given)
    except ValidationError as error:
        raise InputError(complaint(error)) from None


def complaint(error: ValidationError) -> str:
    """The first thing that is wrong, in a line."""
    first = error.errors(include_url=False)[0]
    if not first["loc"]:
        return said_of(first)
    option = "--" + str(first["loc"][0]).replace("_", "-")
    value = first["input"]
    shown = shortened(repr(value) if isinstance(value, str) else str(value), SHOWN)
    return f"{option} {shown}{' ' if is_own(first) else ': '}{said_of(first)}"


def said_of(first: ErrorDetails) -> str:
    """What is wrong with a value: in our words where a check of ours said so, else in pydantic's."""
    return str(first["ctx"]["error"]) if is_own(first) else first["msg"]


def is_own(first: ErrorDetails) -> bool:
    """Whether a check of ours refused a value."""
    return "error" in first.get("ctx", {})


def check_out(folder: Path) -> None:
    """Refuse a result folder that cannot be one before anything is computed."""
    shown = repr(shortened(str(folder), SHOWN))
    if "\0" in str(folder) or any(len(os.fsencode(part)) > LONGEST_NAME for part in folder.parts):
        raise InputError(f"--out {shown}: a name in it has a zero byte or more than {LONGEST_NAME} bytes")
    if len(os.fsencode(folder.absolute())) > LONGEST_FOLDER:
        raise InputError(f"--out {shown}: its path has more than {LONGEST_FOLDER} bytes; give a shorter one")
    nearest = next(one for one in (folder, *folder.absolute().parents) if os.path.exists(one))  # False if unreadable
    if not nearest.is_dir():
        raise InputError(f"--out {folder}: {nearest} is a file; give a folder")
    if not os.access(nearest, os.W_OK | os.X_OK):
        raise InputError(f"--out {folder}: {nearest} is not writable")


def check_prompt(prompt: str) -> None:
    """Refuse a sentence that says nothing, is no text or is longer than any sentence."""
    if not prompt.strip():
        raise InputError('PROMPT is empty; say what to do, for example "put the ball at the centre of the bed"')
    if why := unfit(prompt, LONGEST_PROMPT, lines=True):
        raise InputError(f"PROMPT {why}")


def check_case(case: Path) -> None:
    """Refuse a case file that is not there."""
    if not case.is_file():
        raise InputError(f"{case}: no such file")
