"""Attention checks: a placement beside a copy of it in which the object floats, so that one answer is wrong.

A folder per check, `attention/01/settled` and `attention/01/lifted`, holds pictures and a model of either; both are
made here, from the same scene.glb, so that they differ in nothing but the object's height.
"""

from collections.abc import Callable
from pathlib import Path
from random import Random

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from dcap.evaluation.study.placed_surface import PlacedSurface, camera_toward, read_placed_surface
from dcap.evaluation.study.placements import StudyRun
from dcap.scene.errors import DcapError

ATTENTION, SETTLED, LIFTED, MODEL = "attention", "settled", "lifted", "model.glb"
MOST_CHECKS = 3
"""Different checks of a study [-]; raters may meet one more than once."""
LIFT, LEAST_LIFT = 0.7, 0.12
"""How high the copy floats: over its height [-], and at least [m]."""
WIDTH = 720
"""Of a picture [pixel]."""
ASIDE_DEG = (0.0, 70.0, -70.0)
"""Directions of the views, from the one that shows most of the object [degrees]."""
AT_REST = "at_rest"


def make_checks(run: StudyRun, folder: Path, seed: int, say: Callable[[str], None]) -> tuple[tuple[str, str], ...]:
    """Make the checks of a study; (method, sample) of each. `say` is told of placements that none could be made of."""
    found: list[tuple[str, str]] = []
    for method, sample in candidates(run, seed):
        if len(found) == MOST_CHECKS:
            break
        path = run.shown[method, sample].scene_model
        try:
            if path is not None:
                pictures = run.shown[method, sample].pictures
                out = check_folder(folder, len(found) + 1)
                write_check(read_placed_surface(path), out, like_picture(pictures[0]), len(pictures))
                found.append((method, sample))
        except DcapError as error:
            say(f"no attention check of {method} {sample}: {error}")
    return tuple(found)


def candidates(run: StudyRun, seed: int) -> list[tuple[str, str]]:
    """Placements that a floating copy can be made of, of different samples: those at rest come first."""
    resting = [key for key, one in run.shown.items() if one.scene_model is not None and one.verdict == AT_REST]
    usable = resting or [key for key, one in run.shown.items() if one.scene_model is not None]
    first = {sample: (method, sample) for method, sample in reversed(usable)}  # of the run's first method that has it
    order = sorted(first)
    Random(f"{seed} attention").shuffle(order)
    return [first[sample] for sample in order]


def check_folder(study: Path, number: int, name: str = "") -> Path:
    """Folder of a check, from 1, or of one side of it."""
    return study / ATTENTION / f"{number:02d}" / name


def like_picture(path: Path) -> tuple[int, int]:
    """Rows and columns of a check's pictures: as high for their width as the run's own, so that a check looks like any
    other comparison."""
    with Image.open(path) as picture:
        return max(1, round(WIDTH * picture.height / picture.width)), WIDTH


def write_check(surface: PlacedSurface, folder: Path, shape: tuple[int, int], views: int) -> None:
    """Pictures of so many rows and columns, from at most so many sides, and models of a placement and its floating
    copy."""
    near = surface.around_thing()
    low, high = near.thing_bounds
    rise = max(LIFT * float(high[2] - low[2]), LEAST_LIFT)
    toward = near.best_direction()
    middle = (low + high) / 2 + np.array([0.0, 0.0, rise / 2])
    size = float(np.linalg.norm(high - low + np.array([0.0, 0.0, rise])))
    cameras = [camera_toward(middle, turned(toward, angle), size, shape) for angle in ASIDE_DEG[:views]]
    for name, one in ((SETTLED, near), (LIFTED, near.lifted(rise))):
        (folder / name).mkdir(parents=True, exist_ok=True)
        for number, camera in enumerate(cameras, 1):
            Image.fromarray(one.picture(camera)).save(folder / name / f"{number}.png")
        (folder / name / MODEL).write_bytes(one.glb(toward))


def turned(direction: NDArray[np.float64], angle_deg: float) -> NDArray[np.float64]:
    """A direction (3,) turned about the vertical axis."""
    cos, sin = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]]) @ direction
