"""The files of a data set: samples and truth as YAML, scenes of each split, and names of assets.

Labels of the meshes in a folder, from its `assets.csv` with columns file, name, category.

`file` is a mesh, relative to the folder. `name` is the word for it in sentences, `category` a kind that the lexicon
knows; either may be empty. The label made from both is read like the stem of a file name.
"""

import csv
import os
import re
from collections.abc import Collection, Iterable, Mapping
from dataclasses import fields
from pathlib import Path

from dcap.evaluation.outcome_table import ExpectedOutcome
from dcap.knowledge.lexicon import is_a, thing_of, things
from dcap.scene.errors import InputError
from dcap.scene.readers.files import yaml_text
from dcap.scene.text import LONGEST_WORDS, did_you_mean, unfit
from dcap.scene.types.sample import Sample, SourceOptions
from flows.samples import TRUTH, load_samples, load_yaml

TRUTH_FILE = TRUTH
SAMPLES_HEAD = """\
# Made by `dcap dataset sample`: put OBJECT into SCENE as PROMPT says. Paths are relative to this file.
# The intended outcomes are in truth.yaml, which no stage reads.
"""
TRUTH_HEAD = """\
# The intended outcome of every sample: what the sentence asks for, by labels, parts and sizes; nothing was simulated.
# base_id: left out where several of that label will do. part: empty where more than one may carry.
# region: empty if the sentence leaves it open.
"""
ASSETS = "assets.csv"
COLUMNS = ("file", "name", "category")


def slug(text: str) -> str:
    """Text as a part of a file name."""
    return re.sub(r"[^A-Za-z0-9_.-]+", "_", text).strip("._-") or "samples"


def check_free(path: Path) -> None:
    """Raise InputError for a data set that would overwrite a folder, or the truth of another data set."""
    if path.suffix not in (".yaml", ".yml") or path.name == TRUTH_FILE:
        raise InputError(
            f"--out {path}: give the name of a YAML file, samples.yaml; its {TRUTH_FILE} is written next to it"
        )
    if path.is_dir():
        raise InputError(f"--out {path} is a folder; give the name of a YAML file in it")
    truth = path.with_name(TRUTH_FILE)
    if not truth.exists():
        return
    own: set[str] = set()
    if path.exists():
        own = {sample.id for sample in load_samples(path)}
    tree = load_yaml(truth)
    others = [str(key) for key in tree if str(key) not in own] if isinstance(tree, Mapping) else ["it"]
    if others:
        raise InputError(
            f"--out {path}: {truth} is the truth of another data set ({others[0]}); give a folder of its own"
        )


def dataset_text(samples: Iterable[Sample], folder: Path) -> str:
    """The dataset file that lies in a folder."""
    tree = []
    for row in samples:
        paths = {"scene": relative(Path(row.scene), folder), "object": relative(Path(row.object), folder)}
        frames = {
            f"{prefix}{one.name}": getattr(options, one.name)
            for prefix, options in (("", row.scene_options), ("object_", row.object_options))
            for one in fields(SourceOptions)
            if getattr(options, one.name) != one.default
        }
        tree.append({"id": row.id, **paths, "prompt": row.prompt, "seed": row.seed, **frames})
    return SAMPLES_HEAD + yaml_text(tree)


def truth_text(truths: Mapping[str, ExpectedOutcome]) -> str:
    """The truth file in the same folder, of samples by their ids."""
    tree = {}
    for name, truth in truths.items():
        tree[name] = {
            "base": truth.base,
            **({"base_id": truth.base_id} if truth.base_id else {}),
            "part": truth.part,
            "region": truth.region,
            **({"top": truth.top} if truth.top else {}),
            **({"front": [float(f"{one:.4g}") for one in truth.front]} if truth.front is not None else {}),
            "feasible": truth.feasible,
            "reason": truth.reason,
        }
    return TRUTH_HEAD + yaml_text(tree)


def relative(path: Path, folder: Path) -> str:
    """A path relative to a folder; absolute if they share only the root."""
    whole, base = path.resolve(), folder.resolve()
    shared = Path(os.path.commonpath([whole, base]))
    return str(whole) if shared == Path(shared.anchor) else Path(os.path.relpath(whole, base)).as_posix()


def asset_labels(folder: Path, meshes: Collection[Path]) -> dict[Path, str]:
    """The labels of the meshes that assets.csv in the folder names; none without such a file. InputError for a row that
    cannot be used, with its line."""
    table = folder / ASSETS
    if not table.is_file():
        return {}
    try:
        with table.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.DictReader(file, skipinitialspace=True)
            head = [name.strip() for name in reader.fieldnames or ()]
            if "file" not in head or not set(head) <= set(COLUMNS):
                raise InputError(f"{table}: columns {', '.join(head) or 'none'}; expected {', '.join(COLUMNS)}")
            reader.fieldnames = head
            rows = [(reader.line_num, row) for row in reader]
    except (OSError, UnicodeDecodeError, csv.Error) as broken:
        raise InputError(f"{table}: cannot be read: {getattr(broken, 'strerror', '') or broken}") from None
    found: dict[Path, str] = {}
    known = {one.relative_to(folder).as_posix(): one for one in meshes}
    for line, row in rows:
        if None in row or None in row.values():
            raise InputError(f"{table}:{line}: expected {len(head)} cells, as in its first line")
        cells = {name: (row.get(name) or "").strip() for name in COLUMNS}
        mesh = known.get(cells["file"])
        if mesh is None:
            hint = did_you_mean(cells["file"], list(known))
            raise InputError(f"{table}:{line}: no mesh {cells['file']!r} in this folder{hint}")
        if mesh in found:
            raise InputError(f"{table}:{line}: {cells['file']} has two rows")
        for name in ("name", "category"):
            if cells[name] and (why := unfit(cells[name], LONGEST_WORDS)):
                raise InputError(f"{table}:{line}: {name} {why}")
        if cells["category"] and thing_of(cells["category"]) is None:
            hint = did_you_mean(cells["category"], list(things()))
            raise InputError(f"{table}:{line}: the lexicon does not know the category {cells['category']!r}{hint}")
        found[mesh] = label_of(cells["name"] or mesh.stem.replace("_", " "), cells["category"])
    return found


def label_of(name: str, category: str) -> str:
    """Name that the lexicon can classify: `gundam` of category figurine becomes `gundam figurine`, or the category
    alone where the lexicon would take the combined name for another kind."""
    if not category or is_kind(name, category):
        return name
    both = f"{name} {category}"
    return both if is_kind(both, category) else category


def is_kind(label: str, category: str) -> bool:
    """Whether the lexicon classifies a label as a thing of a category that it knows."""
    thing, kind = thing_of(label), thing_of(category)
    return thing is not None and kind is not None and is_a(thing.id, kind.id)
