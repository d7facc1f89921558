"""The files of a data set: samples and truth as YAML, and a list of scenes for each split."""

import json
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path

from dcap.evaluation.outcome_table import ExpectedOutcome
from dcap.scene.errors import InputError
from dcap.scene.types.sample import SourceOptions
from flows.samples import TRUTH, load_samples, load_yaml
from flows.scene_lists import SPLIT_SUFFIX

TRUTH_FILE = TRUTH
PLAIN = re.compile(r"[A-Za-z][A-Za-z0-9 ,.'_/-]*[A-Za-z0-9.?]")
"""Text that YAML takes unquoted; other text is quoted."""
NOT_TEXT = frozenset({"true", "false", "null", "yes", "no", "on", "off", "y", "n"})
SAMPLES_HEAD = """\
# Made by `dcap dataset sample`: put OBJECT into SCENE as PROMPT says. Paths are relative to this file.
# The intended outcomes are in truth.yaml, which no stage reads.
"""
TRUTH_HEAD = """\
# The intended outcome of every sample: what the sentence asks for, by labels, parts and sizes; nothing was simulated.
# base_id: left out where several of that label will do. part: empty where more than one may carry.
# region: empty if the sentence leaves it open.
"""


@dataclass(frozen=True, slots=True)
class SampledRow:
    """A sample with its truth."""

    id: str
    scene: Path
    object: Path
    prompt: str
    seed: int
    truth: ExpectedOutcome
    scene_options: SourceOptions
    object_options: SourceOptions


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


def dataset_text(rows: Sequence[SampledRow], folder: Path) -> str:
    """The dataset file that lies in a folder."""
    lines = [SAMPLES_HEAD.rstrip()]
    for row in rows:
        lines += [
            f"- id: {scalar(row.id)}",
            f"  scene: {scalar(relative(row.scene, folder))}",
            f"  object: {scalar(relative(row.object, folder))}",
            f"  prompt: {scalar(row.prompt)}",
            f"  seed: {row.seed}",
        ]
        for prefix, options in (("", row.scene_options), ("object_", row.object_options)):
            for one in fields(SourceOptions):
                value = getattr(options, one.name)
                lines += [f"  {prefix}{one.name}: {scalar(value)}"] if value != one.default else []
    return "\n".join(lines) + "\n"


def truth_text(rows: Sequence[SampledRow]) -> str:
    """The truth file in the same folder."""
    lines = [TRUTH_HEAD.rstrip()]
    for row in rows:
        truth = row.truth
        lines += [f"{scalar(row.id)}:", f"  base: {scalar(truth.base)}"]
        lines += [f"  base_id: {quoted(truth.base_id)}"] if truth.base_id else []
        lines += [f"  part: {scalar(truth.part)}", f"  region: {scalar(truth.region)}"]
        lines += [f"  top: {truth.top}"] if truth.top else []
        lines += [f"  front: [{truth.front[0]:.4g}, {truth.front[1]:.4g}]"] if truth.front is not None else []
        lines += [f"  feasible: {str(truth.feasible).lower()}", f"  reason: {scalar(truth.reason)}"]
    return "\n".join(lines) + "\n"


def lists_of(splits: Mapping[str, Sequence[str]]) -> dict[str, str]:
    """A file of names for each split."""
    return {f"{name}{SPLIT_SUFFIX}": "\n".join(scenes) + "\n" for name, scenes in splits.items()}


def scalar(text: str) -> str:
    """Text as a YAML scalar."""
    plain = PLAIN.fullmatch(text) and text.lower() not in NOT_TEXT and ": " not in text and " #" not in text
    return text if plain else quoted(text)


def quoted(text: str) -> str:
    """Text between quotes; a JSON string is one of YAML 1.2."""
    return json.dumps(text, ensure_ascii=False)


def relative(path: Path, folder: Path) -> str:
    """A path relative to a folder; absolute if they share only the root."""
    whole, base = path.resolve(), folder.resolve()
    shared = Path(os.path.commonpath([whole, base]))
    return str(whole) if shared == Path(shared.anchor) else Path(os.path.relpath(whole, base)).as_posix()
