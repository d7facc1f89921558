"""Comparable placements of a run: its methods, its samples, and the pictures of each placement.

In: the folder of a run and its rows. Out: for each (method, sample) the folder of the placement and its pictures, or
why it is not shown. People see the same placements as judges (dcap/evaluation/judging/judge.py). Nothing outside of
the run's folder is ever named.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from dcap.evaluation.judging.judge import Standing, standing_of
from dcap.evaluation.methods import DCAP, split_id
from dcap.evaluation.outcome_table import SampleOutcome
from dcap.evaluation.run_folder import placement_folder
from dcap.scene.errors import InputError
from dcap.scene.types.pictures import BEFORE, PLACED

VIEWS = "views"
CLEAN, ASSET = BEFORE
"""Pictures of the scene before and of the asset alone, from the first method's folder."""
SCENE_GLB, OBJECT_GLB = "scene.glb", "object.glb"


@dataclass(frozen=True, slots=True)
class ShownPlacement:
    """A placement that can be shown to people."""

    method: str
    sample: str
    folder: Path
    pictures: tuple[Path, ...]
    """Its views in the order in which judges see them."""
    verdict: str

    @property
    def scene_model(self) -> Path | None:
        """The scene with the object in it; None if it was not written."""
        path = self.folder / SCENE_GLB
        return path if path.is_file() else None


@dataclass(frozen=True, slots=True)
class StudyRun:
    """A run in the form for a study."""

    folder: Path
    methods: tuple[str, ...]
    prompts: Mapping[str, str]
    """The sentence of each sample, by its id, in the run's order."""
    shown: Mapping[tuple[str, str], ShownPlacement]
    """By (method, sample)."""
    left_out: Mapping[tuple[str, str], str]
    """Why a placement cannot be shown, by (method, sample)."""

    def clean_picture(self, sample: str) -> Path | None:
        """The scene before anything was placed."""
        return self._first_file(sample, f"{VIEWS}/{CLEAN}.png")

    def asset_picture(self, sample: str) -> Path | None:
        """The asset alone."""
        return self._first_file(sample, f"{VIEWS}/{ASSET}.png")

    def asset_model(self, sample: str) -> Path | None:
        """The asset alone, in three dimensions."""
        return self._first_file(sample, OBJECT_GLB)

    def _first_file(self, sample: str, name: str) -> Path | None:
        """A file for a sample, from the first method that has it."""
        paths = (placement_folder(self.folder, method, sample) / name for method in self.methods)
        return next((path for path in paths if path.is_file()), None)


def read_study_run(folder: Path, rows: Sequence[SampleOutcome]) -> StudyRun:
    """The comparable placements of a run; `rows` are its results. InputError for fewer than two methods, or without
    pictures."""
    methods, prompts = asked_of_folder(folder)
    if len(methods) < 2:
        named = f"only {methods[0]}" if methods else "none"
        raise InputError(f"{folder.name}: a study compares methods, and the run has {named}; benchmark --methods all")
    known = {(row.method, row.sample): row for row in rows}
    shown: dict[tuple[str, str], ShownPlacement] = {}
    left_out: dict[tuple[str, str], str] = {}
    for method in methods:
        for sample in prompts:
            found = show(folder, method, sample, known.get((method, sample)))
            if isinstance(found, str):
                left_out[method, sample] = found
            else:
                shown[method, sample] = found
    if not shown:
        where = placement_folder(folder, methods[0], next(iter(prompts), "SAMPLE")) / VIEWS
        raise InputError(
            f"{folder.name}: the run has no pictures of placements ({where}/*.png); run the benchmark again"
        )
    return StudyRun(folder, methods, prompts, shown, left_out)


def asked_of_folder(folder: Path) -> tuple[tuple[str, ...], dict[str, str]]:
    """Methods, and prompts by sample regardless of the method, from the run.json of a run."""
    path = folder / "run.json"
    try:
        tree = json.loads(path.read_text(encoding="utf-8"))
        samples = {split_id(str(one["id"]))[1]: str(one["prompt"]) for one in tree["samples"]}
        methods = tuple(dict.fromkeys(str(one) for one in tree.get("methods", [DCAP])))
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(f"{path}: not what a benchmark writes ({type(error).__name__}: {error})") from None
    for method in methods:
        if not method.replace("_", "").isalnum():
            raise InputError(f"{path}: {method!r} is not the name of a method")
    return methods, samples


def show(run: Path, method: str, sample: str, row: SampleOutcome | None) -> ShownPlacement | str:
    """A placement with its pictures; or why it is not shown."""
    if row is None:
        return "not in the results"
    if row.feasible_intended is False:
        return "meant to be impossible"
    if standing_of(row) is not Standing.JUDGED:
        return f"no placement: {row.reason or row.error or row.verdict}"
    folder = placement_folder(run, method, sample)
    pictures = views_of(folder / VIEWS)
    there = all(path.is_file() for path in pictures)
    return ShownPlacement(method, sample, folder, pictures, row.verdict) if there else "no pictures"


def views_of(folder: Path) -> tuple[Path, ...]:
    """The pictures of a placement in the order in which judges see them."""
    return tuple(folder / f"{name}.png" for name in PLACED)
