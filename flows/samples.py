"""Reads a dataset: a YAML list of samples, each with the names or paths of a scene and an object and a prompt.

Keys of a sample: `id`, `room` (or `scene`), `object`, `prompt`, and optionally `seed`, `mass`, `label`, `up`, `unit`,
`object_label`, `object_up`, `object_unit`. A name is looked up beside the file, then in `rooms/` and `objects/`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path

from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from evaluation.run_folder import folder_name
from scene.errors import InputError
from scene.sample import Sample, SourceOptions
from scene.settings import PROJECT_ROOT, data_root
from scene.spelling import did_you_mean

EMBEDDED = PROJECT_ROOT / "data" / "rooms.yaml"
"""The dataset that the project makes itself."""
TRUTH = "truth.yaml"
"""Intended outcomes of a dataset's samples, beside it; read after a run, never by a stage."""
REQUIRED = ("id", "object", "prompt")
UPS = ("auto", "y", "z")
UNITS = ("auto", "m", "cm", "mm", "in")
OPTIONAL = ("room", "scene", "seed", "mass", "label", "up", "unit", "object_label", "object_up", "object_unit")
CHOICES = {"up": UPS, "unit": UNITS}
MESH_SUFFIXES = (".glb", ".gltf", ".obj", ".ply", ".stl")


def load_samples(path: Path) -> list[Sample]:
    """The samples of a dataset file, in its order."""
    rows = load_yaml(path)
    if not isinstance(rows, list) or not rows:
        raise InputError(f"{path}: expected a list of samples, found {type(rows).__name__}")
    samples = [sample_of(row, f"{path}: sample {index}", path.parent) for index, row in enumerate(rows)]
    check_ids([sample.id for sample in samples], str(path))
    return samples


def check_ids(ids: Sequence[str], where: str) -> None:
    """Refuse ids that cannot each have a folder of their own in a run."""
    seen: dict[str, str] = {}
    for one in ids:
        name = folder_name(one)
        if not name.strip("."):
            raise InputError(f"{where}: id {one!r} cannot name a folder; use letters and digits")
        if name in seen and seen[name] == one:
            raise InputError(f"{where}: two samples have the id {one!r}")
        if name in seen:
            raise InputError(f"{where}: ids {seen[name]!r} and {one!r} would share the folder {name}; rename one")
        seen[name] = one


def load_yaml(path: Path) -> object:
    """The tree of a YAML 1.2 file."""
    try:
        return YAML(typ="safe", pure=True).load(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; --dataset takes a YAML file") from None
    except (OSError, UnicodeDecodeError, YAMLError) as error:
        raise InputError(f"{path}: cannot be read as YAML: {error}") from error


def sample_of(row: object, where: str, folder: Path) -> Sample:
    """One sample; unknown keys are errors with the nearest known name."""
    if not isinstance(row, Mapping):
        raise InputError(f"{where}: expected keys and values, found {row!r}")
    known = (*REQUIRED, *OPTIONAL)
    for key in row:
        if key not in known:
            raise InputError(f"{where}: unknown key {key!r}{did_you_mean(key, known)}")
    for key in REQUIRED:
        if key not in row:
            raise InputError(f"{where}: key {key!r} is missing")
    if ("room" in row) == ("scene" in row):
        raise InputError(f"{where}: give either 'room' or 'scene'")
    return Sample(
        id=text(row, "id", where),
        scene=find(text(row, "room" if "room" in row else "scene", where), folder, "rooms"),
        object=find(text(row, "object", where), folder, "objects"),
        prompt=text(row, "prompt", where),
        scene_options=options_of(row, "", where),
        object_options=options_of(row, "object_", where),
        mass=None if row.get("mass") is None else mass_of(row["mass"], where),
        seed=seed_of(row.get("seed", 0), where),
    )


def text(row: Mapping[str, object], key: str, where: str) -> str:
    """A word or sentence of a row; a number counts as written."""
    value = row[key]
    if isinstance(value, bool) or not isinstance(value, str | int | float) or not str(value).strip():
        raise InputError(f"{where}: {key} is {value!r}, expected text")
    return str(value)


def mass_of(value: object, where: str) -> float:
    """A mass [kg]."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < float("inf"):
        raise InputError(f"{where}: mass is {value!r}, expected a positive number of kilograms")
    return float(value)


def seed_of(value: object, where: str) -> int:
    """A seed of everything random."""
    if isinstance(value, bool) or not isinstance(value, int) or value < 0:
        raise InputError(f"{where}: seed is {value!r}, expected a whole number, 0 or larger")
    return value


def options_of(row: Mapping[str, object], prefix: str, where: str) -> SourceOptions:
    """How to read the scene (no prefix) or the object."""
    given = {}
    for one in fields(SourceOptions):
        key = prefix + one.name
        if key in row:
            given[one.name] = text(row, key, where)
            allowed = CHOICES.get(one.name, (given[one.name],))
            if given[one.name] not in allowed:
                raise InputError(f"{where}: {key} {given[one.name]!r} is not one of {', '.join(allowed)}")
    return SourceOptions(**given)


def find(name: str, folder: Path, kind: str) -> str:
    """Path of a scene or object by path or name; the name itself where nothing is found, for the reader to report."""
    for place in (folder / name, folder / kind / name, data_root() / kind / name):
        if place.exists():
            return shortest(place)
        for suffix in MESH_SUFFIXES:
            if place.with_name(place.name + suffix).is_file():
                return shortest(place.with_name(place.name + suffix))
    return name


def shortest(path: Path) -> str:
    """The path relative to the working directory if it lies below it: easier to read."""
    resolved = path.resolve()
    return str(resolved.relative_to(Path.cwd())) if resolved.is_relative_to(Path.cwd()) else str(resolved)
