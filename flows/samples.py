"""Reads a dataset: a YAML list of samples, each with the names or paths of a scene and an object and a prompt.

Keys of a sample: `id`, `room` (or `scene`), `object`, `prompt`, and optionally `seed`, `mass`, `label`, `up`, `unit`,
`object_label`, `object_up`, `object_unit`, `labels`, `at`, `support`, `height_of`, `licence` (of its scene and object,
for `dataset pack`). A name is looked up next to the file and in the data folder, in each case also in its `rooms/` or
`objects/`.
"""

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TypeVar, get_args

from dcap.evaluation.methods import DCAP, split_id
from dcap.evaluation.run_folder import folder_name, same_folder
from dcap.scene.errors import InputError, Report, error, refusing, short
from dcap.scene.readers.files import BROKEN_YAML, parse_yaml, yaml_fault
from dcap.scene.readers.scenes.sugar import MESH_SUFFIXES
from dcap.scene.settings import data_root, resource
from dcap.scene.text import LONGEST_ID, LONGEST_PROMPT, LONGEST_WORDS, did_you_mean, unfit
from dcap.scene.types.sample import GivenPlace, KnownHeight, Sample, SourceOptions
from flows.options import LARGEST_SEED, Unit, Up
from flows.scene_hints import height_of, place_of

EMBEDDED = resource("data/rooms.yaml")
"""The dataset that the project makes itself."""
SPLAT_ROOMS = resource("data/splat_rooms.yaml")
"""Some of its placements in rooms that are Gaussian splats."""
TRUTH = "truth.yaml"
"""Intended outcomes of a dataset's samples, in the same folder; read after a run, never by a stage."""
REQUIRED = ("id", "object", "prompt")
OPTIONAL = ("room", "scene", "seed", "mass", "label", "up", "unit", "object_label", "object_up", "object_unit",
            "labels", "at", "support", "height_of", "licence")  # fmt: skip
HEAVIEST = 1e12
"""Upper bound of an object's mass, excluded [kg]."""
Found = TypeVar("Found")
LONGEST = {"prompt": LONGEST_PROMPT, "id": LONGEST_ID}
"""Longest prompt; other texts are labels and names [characters]."""
CHOICES = {"up": get_args(Up), "unit": get_args(Unit)}


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


def sample_of(row: object, index: int, folder: Path, report: Report) -> Sample | None:
    """One sample, None if it is invalid; unknown keys are errors with the nearest known name."""
    if not isinstance(row, Mapping):
        report(error(f"sample {index}: expected keys and values, found {short(row)}", (index,)))
        return None
    read = SampleReader(row, index, report)
    read.check_keys()
    if "licence" in row:
        read.text("licence")
    room = "room" if "room" in row else "scene"
    sample = Sample(
        id=read.text("id"),
        scene=find(read.text(room), folder, "rooms"),
        object=find(read.text("object"), folder, "objects"),
        prompt=read.text("prompt"),
        scene_options=read.options(""),
        object_options=read.options("object_"),
        mass=read.mass(),
        seed=read.seed(),
        labels=labels_path(read.text("labels"), folder) if "labels" in row else "",
        place=read.place(),
        known_height=read.known_height(),
    )
    return sample if read.sound else None


@dataclass(slots=True)
class SampleReader:
    """Reads the values of one sample and reports invalid ones, for which it returns placeholders."""

    values: Mapping[str, object]
    index: int
    report: Report
    sound: bool = True

    def wrong(self, what: str, key: object = "") -> None:
        """Report a mistake at a key."""
        self.sound = False
        self.report(error(f"sample {self.index}: {what}", (self.index, str(key)) if key else (self.index,)))

    def check_keys(self) -> None:
        """Unknown and missing keys."""
        known = (*REQUIRED, *OPTIONAL)
        for key in self.values:
            if key not in known:
                self.wrong(f"unknown key {key!r}{did_you_mean(key, known)}", key)
        for key in REQUIRED:
            if key not in self.values:
                self.wrong(f"key {key!r} is missing")
        if ("room" in self.values) == ("scene" in self.values):
            self.wrong("give either 'room' or 'scene'")

    def text(self, key: str) -> str:
        """A word or sentence; a number is taken as text, a missing key is reported elsewhere."""
        value = self.values.get(key, "missing")
        try:
            # other YAML values may share parts, which would never end when written out
            text = str(value) if isinstance(value, str | int | float) and not isinstance(value, bool) else ""
        except ValueError:  # an integer of more than 4300 digits
            text = ""
        if not text.strip():
            self.wrong(f"{key} is {short(value)}, expected text", key)
        elif why := unfit(text, LONGEST.get(key, LONGEST_WORDS), lines=key == "prompt"):
            self.wrong(f"{key} {why}", key)
        return text

    def mass(self) -> float | None:
        """A mass [kg]."""
        value = self.values.get("mass")
        if value is None:
            return None
        if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < HEAVIEST:
            self.wrong(f"mass is {short(value)}, expected a positive number of kilograms", "mass")
            return None
        return float(value)

    def seed(self) -> int:
        """Seed of all random numbers."""
        value = self.values.get("seed", 0)
        if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= LARGEST_SEED:
            self.wrong(f"seed is {short(value)}, expected a whole number from 0 to {LARGEST_SEED}", "seed")
            return 0
        return value

    def place(self) -> GivenPlace | None:
        """A point or a box of the scene's own frame."""
        return self.parse("at", lambda: place_of(self.numbers("at"), self.numbers("support")))

    def known_height(self) -> KnownHeight | None:
        """The height of a thing of the scene."""
        unit = str(self.values.get("unit", "auto"))
        return self.parse(
            "height_of", lambda: height_of(self.text("height_of") if "height_of" in self.values else "", unit)
        )

    def numbers(self, key: str) -> str:
        """A list of numbers as the command line has it."""
        value = self.values.get(key, "")
        return ",".join(str(one) for one in value) if isinstance(value, list) else str(value)

    def parse(self, key: str, read: Callable[[], Found]) -> Found | None:
        """Parse a value, or report a mistake at its key."""
        try:
            return read()
        except InputError as refused:
            self.wrong(str(refused), key)
            return None

    def options(self, prefix: str) -> SourceOptions:
        """How to read the scene (no prefix) or the object."""
        given = {}
        for one in fields(SourceOptions):
            key = prefix + one.name
            if key in self.values:
                given[one.name] = self.text(key)
                allowed = CHOICES.get(one.name, (given[one.name],))
                if given[one.name] not in allowed:
                    self.wrong(f"{key} {given[one.name]!r} is not one of {', '.join(allowed)}", key)
        return SourceOptions(**given)


def labels_path(name: str, folder: Path) -> str:
    """Path of a label file next to the dataset, or as given."""
    return str(folder / name) if os.path.exists(folder / name) else name


def find(name: str, folder: Path, kind: str) -> str:
    """Path of a scene or object by path or name; the name itself where nothing is found, for the reader to report."""
    for place in (folder / name, folder / kind / name, data_root() / name, data_root() / kind / name):
        for suffix in ("", *MESH_SUFFIXES):
            if os.path.exists(f"{place}{suffix}"):  # False, not an exception, for a name that no file can have
                return shortest(Path(f"{place}{suffix}"))
    return name


def shortest(path: Path) -> str:
    """The path relative to the working directory if it lies below it: easier to read."""
    resolved = path.resolve()
    return str(resolved.relative_to(Path.cwd())) if resolved.is_relative_to(Path.cwd()) else str(resolved)
