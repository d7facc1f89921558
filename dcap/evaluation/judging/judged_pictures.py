"""Pictures that a judge sees: read from a run's folder only when somebody looks, pairs side by side.

In: `clean.png` (the scene before), `asset.png` (the object alone) and the canonical views of a placement, PNG. Out:
names and makers of pictures for a question.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dcap.language.protocol.requests import Picture
from dcap.scene.errors import InputError
from dcap.scene.readers.files.image import read_image

GAP = 12
"""Width of the white strip between two placements [pixels]."""
BEFORE_TITLES = ("the scene before the object is placed", "the object alone")
"""How a judge is told what the pictures are that all methods of a sample share."""


def pictures_in(folder: Path, names: Sequence[str]) -> tuple[Picture, ...]:
    """`NAME.png` of a folder of views for each name; InputError for one that is not there."""
    if not names:
        raise InputError(f"{folder}: no view is named; a judge needs at least one")
    return tuple(picture_at(folder / f"{name}.png", name) for name in names)


def picture_at(path: Path, name: str) -> Picture:
    """A picture that is read when somebody looks; InputError now if there is none."""
    if not path.is_file():
        raise InputError(f"{path}: no such picture; a judge needs the run's views, which the benchmark renders")
    return Picture(name, lambda: read_image(path.read_bytes(), str(path)))


def side_by_side(left: Picture, right: Picture) -> Picture:
    """Two pictures of one view in one; InputError, when made, if they differ in size."""
    if left.name != right.name:
        raise InputError(f"a pair shows one view, not {left.name!r} beside {right.name!r}")

    def make() -> NDArray[np.uint8]:
        first, second = left.make(), right.make()
        if first.shape != second.shape:
            raise InputError(f"view {left.name!r}: the pictures have shapes {first.shape} and {second.shape}, not one")
        strip = np.full((first.shape[0], GAP, 3), 255, dtype=np.uint8)
        return np.concatenate([first, strip, second], axis=1)

    return Picture(left.name, make)
