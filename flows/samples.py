"""Reads a dataset: a YAML list of samples, each with the names or paths of a scene and an object and a prompt.

Keys of a sample: `id`, `room` (or `scene`), `object`, `prompt`, and optionally `seed`, `mass`, `label`, `up`, `unit`,
`object_label`, `object_up`, `object_unit`, `labels`, `at`, `support`, `height_of`, `licence` (of its scene and object,
for `dataset pack`). A name is looked up next to the file
and in the data folder, in each case also in its `rooms/` or `objects/`.
"""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, BeforeValidator, ConfigDict, ValidationError
from pydantic_core import ErrorDetails

from dcap.evaluation.methods import DCAP, split_id
from dcap.evaluation.run_folder import folder_name, same_folder
from dcap.scene.errors import InputError, Report, error, refusing, short
from dcap.scene.readers.files import BROKEN_YAML, parse_yaml, yaml_fault
from dcap.scene.readers.scenes.sugar import MESH_SUFFIXES
from dcap.scene.settings import data_root, resource
from dcap.scene.text import LONGEST_ID, LONGEST_PROMPT, LONGEST_WORDS, did_you_mean, unfit
from dcap.scene.types.sample import Sample, SourceOptions
from flows.options import Mass, Numbers, Seed, Unit, Up
from flows.scene_hints import height_of, place_of
from flows.settings import is_ours, reason

EMBEDDED = resource("data/rooms.yaml")
"""The dataset that the project makes itself."""
SPLAT_ROOMS = resource("data/splat_rooms.yaml")
"""A part of that dataset in rooms made of Gaussian splats."""
TRUTH = "truth.yaml"
"""Intended outcomes of a dataset's samples, in the same folder; read after a run, never by a stage."""


def load_samples(path: Path) -> list[Sample]:
    """The samples of a dataset file, in its order."""
    return [sample for _, sample in samples_of(load_yaml(path), path.parent, refusing(path))]


def samples_of(rows: object, folder: Path, report: Report) -> list[tuple[int, Sample]]:
    """Valid samples of a dataset whose file lies in `folder`, and the index of each."""
    if not isinstance(rows, list) or not rows:
        found = "none" if rows in (None, []) else type(rows).__name__
        report(error(f"expected a list of samples, found {found}"))
        return []
    read = [(index, sample_of(row, index, folder, report)) for index, row in enumerate(rows)]
    samples = [(index, sample) for index, sample in read if sample is not None]
    check_ids(samples, report)
    return samples


def check_ids(samples: list[tuple[int, Sample]], report: Report) -> None:
    """Refuse ids that do not give each sample a folder of its own in a run."""
    seen: dict[str, str] = {}
    for index, sample in samples:
        one, name, place = sample.id, folder_name(sample.id), (index, "id")
        key = same_folder(name)
        if not one.strip("."):
            report(error(f"id {one!r} cannot name a folder; use letters and digits", place))
        elif split_id(one) != (DCAP, one):
            report(error(f"id {short(one)} begins with the name of a method; rename it", place))
        elif key in seen and seen[key] == one:
            report(error(f"two samples have the id {short(one)}", place))
        elif key in seen:
            alike = "" if folder_name(seen[key]) == name else " where case does not count"
            told = f"ids {short(seen[key])} and {short(one)} would share the folder {short(name)[1:-1]}"
            report(error(f"{told}{alike}; rename one", place))
        seen.setdefault(key, one)


def licences_in(path: Path) -> dict[str, str]:
    """Licence of scene and object in the samples of a dataset file, by id; '' if not stated."""
    tree = load_yaml(path)
    rows = [row for row in tree if isinstance(row, Mapping)] if isinstance(tree, list) else []
    return {str(row.get("id", "")): str(row.get("licence", "")) for row in rows}


def load_yaml(path: Path) -> object:
    """The tree of a YAML 1.2 file."""
    try:
        return parse_yaml(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; --dataset takes a YAML file") from None
    except IsADirectoryError:
        raise InputError(f"{path}: a folder; --dataset takes a YAML file, such as its samples.yaml") from None
    except (OSError, *BROKEN_YAML) as broken:
        raise InputError(f"{path}: cannot be read as YAML: {yaml_fault(broken)}") from broken


def text_up_to(most: int, *, lines: bool = False) -> BeforeValidator:
    """A validator of text with at most `most` characters; a number is converted to text."""

    def check(value: object) -> str:
        text = str(value) if isinstance(value, str | int | float) and not isinstance(value, bool) else ""
        if why := unfit(text, most, lines=lines) if text.strip() else "is no text":
            raise ValueError(why)
        return text

    return BeforeValidator(check)


Word = Annotated[str, text_up_to(LONGEST_WORDS)]


class SampleKeys(BaseModel):
    """The keys of a sample with the types of their values."""

    model_config = ConfigDict(extra="forbid", strict=True)

    id: Annotated[str, text_up_to(LONGEST_ID)]
    room: Word = ""
    scene: Word = ""
    object: Word
    prompt: Annotated[str, text_up_to(LONGEST_PROMPT, lines=True)]
    seed: Seed = 0
    mass: Mass | None = None
    label: Word = ""
    up: Up = "auto"
    unit: Unit = "auto"
    object_label: Word = ""
    object_up: Up = "auto"
    object_unit: Unit = "auto"
    labels: Word = ""
    at: Numbers = ""
    support: Numbers = ""
    height_of: Word = ""
    licence: Word = ""


def sample_of(row: object, index: int, folder: Path, report: Report) -> Sample | None:
    """One sample, None if it is invalid; every mistake is reported."""

    def wrong(what: str, key: str = "") -> None:
        report(error(f"sample {index}: {what}", (index, key) if key else (index,)))

    if not isinstance(row, Mapping):
        wrong(f"expected keys and values, found {short(row)}")
        return None
    nested = {str(key): value for key, value in row.items() if not is_flat(value)}
    for key, value in nested.items():
        wrong(f"{key} is {short(value)}, expected text or numbers", key)
    if nested:
        return None
    try:
        read = SampleKeys.model_validate({str(key): value for key, value in row.items()})
        if bool(read.room) == bool(read.scene):
            raise InputError("give either 'room' or 'scene'")
        place, known_height = place_of(read.at, read.support), height_of(read.height_of, read.unit)
    except ValidationError as broken:
        errors = broken.errors(include_url=False)
        # misspelt keys before missing ones
        for one in sorted(errors, key=lambda one: one["type"] != "extra_forbidden"):
            wrong(mistake_in_words(one), str(one["loc"][0]) if one["type"] != "missing" else "")
        return None
    except InputError as refused:
        wrong(str(refused))
        return None
    return Sample(
        id=read.id,
        scene=find(read.room or read.scene, folder, "rooms"),
        object=find(read.object, folder, "objects"),
        prompt=read.prompt,
        scene_options=SourceOptions(read.up, read.unit, read.label),
        object_options=SourceOptions(read.object_up, read.object_unit, read.object_label),
        mass=read.mass,
        seed=read.seed,
        labels=labels_path(read.labels, folder) if read.labels else "",
        place=place,
        known_height=known_height,
    )


def is_flat(value: object) -> bool:
    """Whether a value is a scalar or a list of numbers; nested YAML with shared parts may be endless when printed."""
    return not isinstance(value, Mapping | list) or all(isinstance(one, int | float) for one in value)


def mistake_in_words(one: ErrorDetails) -> str:
    """Describe an invalid, unknown or missing key of a sample."""
    key = str(one["loc"][0])
    if one["type"] == "missing":
        return f"key {key!r} is missing"
    if one["type"] == "extra_forbidden":
        return f"unknown key {key!r}{did_you_mean(key, SampleKeys.model_fields)}"
    return f"{key} {short(one['input'])}{' ' if is_ours(one) else ': '}{reason(one)}"


def labels_path(name: str, folder: Path) -> str:
    """Path of a label file next to the dataset, or as given."""
    return str(folder / name) if os.path.exists(folder / name) else name


def find(name: str, folder: Path, kind: str) -> str:
    """Path of a scene or object given by path or name. An unknown name is returned unchanged; the reader reports it."""
    for place in (folder / name, folder / kind / name, data_root() / name, data_root() / kind / name):
        for suffix in ("", *MESH_SUFFIXES):
            if os.path.exists(f"{place}{suffix}"):  # False, not an exception, for a name that no file can have
                return shortest(Path(f"{place}{suffix}"))
    return name


def shortest(path: Path) -> str:
    """The path relative to the working directory if it lies below it: easier to read."""
    resolved = path.resolve()
    return str(resolved.relative_to(Path.cwd())) if resolved.is_relative_to(Path.cwd()) else str(resolved)
