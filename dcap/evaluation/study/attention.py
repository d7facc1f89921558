"""Attention checks: a placement next to a copy of it in which the object floats, so that one answer is wrong.

A folder per check, `attention/01/settled` and `attention/01/lifted`, hold pictures and a model of either; both are
made from the same scene.glb, so that they only differ in the object's height. The pictures have the names and sizes of
the placement's own, so that they do not reveal a check.
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from random import Random

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from dcap.evaluation.outcome_table import AT_REST
from dcap.evaluation.study.placed_surface import PlacedSurface, read_placed_surface
from dcap.evaluation.study.placements import ShownPlacement, StudyRun
from dcap.scene.errors import DcapError
from dcap.scene.json_tree import whole_file, write_whole

ATTENTION, SETTLED, LIFTED, MODEL = "attention", "settled", "lifted", "model.glb"
MOST_CHECKS = 3
"""Number of different checks of a study [-]; raters may see one more than once."""
LIFT, LEAST_LIFT = 0.7, 0.12
"""Height at which the copy floats: over its own height [-], and at least [m]."""

CheckPictures = Callable[[ShownPlacement, PlacedSurface, PlacedSurface], Mapping[str, NDArray[np.uint8]]]
"""Takes the pictures of one side of a check, by name, from a placement, its surface at rest, and the side's surface."""


def make_checks(
    run: StudyRun, folder: Path, seed: int, take: CheckPictures, say: Callable[[str], None]
) -> tuple[tuple[str, str], ...]:
    """Make the checks of a study. Returns (method, sample) of each; `say` reports placements that allow none."""
    found: list[tuple[str, str]] = []
    for method, sample in candidates(run, seed):
        if len(found) == MOST_CHECKS:
            break
        try:
            write_check(run.shown[method, sample], check_folder(folder, len(found) + 1), take)
            found.append((method, sample))
        except DcapError as error:
            say(f"no attention check of {method} {sample}: {error}")
    return tuple(found)


def candidates(run: StudyRun, seed: int) -> list[tuple[str, str]]:
    """Placements of different samples for floating copies; those at rest come first."""
    resting = [key for key, one in run.shown.items() if one.scene_model is not None and one.verdict == AT_REST]
    usable = resting or [key for key, one in run.shown.items() if one.scene_model is not None]
    first = {sample: (method, sample) for method, sample in reversed(usable)}  # from the run's first method that has it
    order = sorted(first)
    Random(f"{seed} attention").shuffle(order)
    return [first[sample] for sample in order]


def check_folder(study: Path, number: int, name: str = "") -> Path:
    """Folder of a check, from 1, or of one side of it."""
    return study / ATTENTION / f"{number:02d}" / name


def write_check(placement: ShownPlacement, folder: Path, take: CheckPictures) -> None:
    """Pictures and models of a placement that has a scene.glb, and of its floating copy."""
    assert placement.scene_model is not None
    surface = read_placed_surface(placement.scene_model)
    low, high = surface.thing_bounds
    rise = max(LIFT * float(high[2] - low[2]), LEAST_LIFT)
    near = surface.around_thing()
    toward = near.best_direction()
    for name, height in ((SETTLED, 0.0), (LIFTED, rise)):
        (folder / name).mkdir(parents=True, exist_ok=True)
        for view, rgb in take(placement, surface, surface.lifted(height)).items():
            with whole_file(folder / name / f"{view}.png") as draft:
                Image.fromarray(rgb).save(draft)
        write_whole(folder / name / MODEL, near.lifted(height).glb(toward))
